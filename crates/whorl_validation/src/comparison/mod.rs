//! Prediction errors by channel and horizon.

mod channels;
mod verdict;
mod words;

pub use channels::{ChannelErrors, HorizonError, Overlay};
pub use verdict::{Absolute, PredictionError, Unexplained, Whiteness, prediction_error};
pub use whorl_recording::Channel;
pub use words::{SMALL_ERROR, ahead};

use serde::Serialize;
use whorl_dynamics::PlatformModel;
use whorl_prediction::{Followed, Told, predict, simulate};
use whorl_recording::Recording;

use crate::remarks::remarks;
use crate::unexplained::followed;
use channels::Errors;
use verdict::Innovations;

/// Prediction horizons \[s\], in addition to the whole run; the last is a quarter of runs that are shorter than four of it.
const HORIZONS_S: [f64; 3] = [0.1, 1.0, 10.0];

/// How predictions come about, to be printed with the numbers.
pub const PREDICTION_RULE: &str = "each prediction starts from what a filter with this model knows at its first instant, from the \
     readings before it alone, and goes on with the model and the recorded commands; that of the whole run starts from the \
     start that the run shows. Ratios are over the deviations that the model itself predicts, from noise and start: 1 = as \
     good as the model says";

/// A recording against a model.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Comparison {
    /// Name of the run.
    pub run: String,
    /// The platform whose model was compared.
    pub platform: String,
    /// Length \[s\].
    pub duration_s: f64,
    /// Errors of every channel.
    pub channels: Vec<ChannelErrors>,
    /// Errors of all channels together, on the way to the longest horizon.
    pub prediction: Option<PredictionError>,
    /// Test of the whole run against noise alone.
    pub absolute: Absolute,
    /// What pushes the platform beside its model.
    pub unexplained: Unexplained,
    /// What is left in each channel's innovations with the model alone.
    pub whiteness: Vec<Whiteness>,
    /// Consequences of missing channels, and other remarks, one sentence each.
    pub remarks: Vec<String>,
    /// The run as the filter with this model follows it; not part of the JSON.
    #[serde(skip)]
    pub followed: Followed,
}

/// Compares a recording with a model; `known` is the run as a fit that ended with this model has followed it, if one has.
///
/// # Errors
/// If no comparison is possible, with advice.
pub fn compare(
    recording: &Recording,
    model: &PlatformModel,
    known: Option<&Followed>,
) -> Result<Comparison, whorl_prediction::PredictionError> {
    let (case, stated, followed) = followed(recording, model, known)?;
    let duration_s = recording.duration_s();
    let longest_s = HORIZONS_S[2].min(duration_s / 4.0);
    let horizons_s: Vec<f64> = HORIZONS_S.into_iter().filter(|h| *h < longest_s).chain([longest_s]).collect();
    let mut errors = Errors::new(&case, &horizons_s, [&followed.noise, &stated]);
    let mut innovations = Innovations::default();
    let is_disturbed = followed.noise.disturbance.is_some();
    predict(&case, &followed.noise, &followed.fitted.start, &horizons_s, &mut |told| match told {
        Told::Innovation(innovation) if !is_disturbed => innovations.add(innovation),
        Told::Innovation(_) => {}
        Told::Ahead(horizon, error) => errors.add(horizon, error),
    });
    let (quiet, alone) = (followed.undisturbed_noise(), &followed.undisturbed);
    simulate(&case, &quiet, alone, &mut |error| errors.add(horizons_s.len(), error));
    if is_disturbed {
        predict(&case, &quiet, &alone.start, &[], &mut |told| match told {
            Told::Innovation(innovation) => innovations.add(innovation),
            Told::Ahead(..) => {}
        });
    }
    let (channels, prediction) = errors.finish();
    Ok(Comparison {
        run: recording.name.clone(),
        platform: recording.platform.clone(),
        duration_s,
        remarks: remarks(&case, &followed.noise, &stated),
        channels,
        prediction,
        absolute: Absolute::of(&followed.undisturbed_likelihood, followed.undisturbed.determined),
        unexplained: Unexplained::of(model, &followed.noise.disturbance),
        whiteness: innovations.tests(&case),
        followed,
    })
}
