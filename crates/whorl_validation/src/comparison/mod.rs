//! Prediction errors by channel and horizon.

mod channels;
mod verdict;
mod whiteness;
mod words;

pub use channels::{ChannelErrors, HorizonError, Overlay, ahead};
pub use verdict::{Absolute, PredictionError, Unexplained};
pub use whiteness::Whiteness;
pub use whorl_recording::Channel;
pub use words::SMALL_ERROR;

use serde::Serialize;
use whorl_dynamics::PlatformModel;
use whorl_prediction::{Followed, Told, predict, simulate};
use whorl_recording::Recording;

use channels::Errors;
use whiteness::Innovations;

use crate::error::ValidationError;
use crate::remarks::remarks;
use crate::unexplained::followed;

/// Prediction horizons \[s\], in addition to the whole run; the last is a quarter of runs that are shorter than four of it.
pub const HORIZONS_S: [f64; 3] = [0.1, 1.0, 10.0];
/// Stretches of the longest horizon that a run holds at least.
const FEWEST_STRETCHES: f64 = 4.0;

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
    /// Curves for plots; not part of the JSON.
    #[serde(skip)]
    pub overlays: Vec<Overlay>,
    /// The run as the filter with this model follows it; not part of the JSON.
    #[serde(skip)]
    pub followed: Followed,
}

/// Compares a recording with a model.
///
/// # Errors
/// If no comparison is possible, with advice: see [`ValidationError`].
pub fn compare(recording: &Recording, model: &PlatformModel) -> Result<Comparison, ValidationError> {
    compare_as(recording, model, None)
}

/// The same with the run as a fit that ended with this model has followed it, if one has.
///
/// # Errors
/// As [`compare`].
pub fn compare_as(
    recording: &Recording,
    model: &PlatformModel,
    known: Option<&Followed>,
) -> Result<Comparison, ValidationError> {
    let (case, stated, followed) = followed(recording, model, known)?;
    let duration_s = recording.duration_s();
    let longest_s = HORIZONS_S[2].min(duration_s / FEWEST_STRETCHES);
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
        predict(&case, &quiet, &alone.start, &[], &mut |told| {
            if let Told::Innovation(innovation) = told {
                innovations.add(innovation);
            }
        });
    }
    let (channels, overlays, prediction) = errors.finish();
    Ok(Comparison {
        run: recording.name.clone(),
        platform: recording.platform.clone(),
        duration_s,
        remarks: remarks(&case, &followed.noise, &stated),
        channels,
        prediction,
        absolute: Absolute::of(&followed.undisturbed_likelihood, followed.undisturbed.determined),
        unexplained: Unexplained::of(&case, &followed),
        whiteness: innovations.tests(&case),
        overlays,
        followed,
    })
}

/// Prediction error of a model over these runs; `None` if none is long enough. 1 = as good as the model says: noise alone. It is the root
/// of the mean square of all errors of all runs, each over the deviation that the model predicts for it.
#[must_use]
pub fn prediction_error<'a>(runs: impl IntoIterator<Item = &'a Comparison>) -> Option<f64> {
    let all = runs.into_iter().filter_map(|run| run.prediction);
    let (squares, numbers) =
        all.fold((0.0, 0), |(squares, numbers), of| (squares + of.squares, numbers + of.numbers));
    (numbers > 0).then(|| (squares / numbers as f64).sqrt())
}
