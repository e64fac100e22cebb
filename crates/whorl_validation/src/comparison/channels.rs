//! Errors of each channel at each horizon.

use serde::Serialize;
use whorl_math::GrowingCurve;
use whorl_math::statistics::chi_squared_quantile;
use whorl_prediction::{AheadError, Noise, Prepared};
use whorl_recording::{Channel, Component, Form};

use super::PredictionError;
use crate::remarks::MOVES;

/// Error of one channel at one horizon.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct HorizonError {
    /// How far ahead \[s\]; `None`: the whole run, all of its samples.
    pub horizon_s: Option<f64>,
    /// Root mean square of measured less predicted.
    pub rms: f64,
    /// The same of the deviations that the model predicts for these errors, from noise and what is uncertain of the start.
    pub predicted_stddev: f64,
    /// The same of errors over the deviations that the model predicts for them; 1 = as good as the model says.
    pub ratio: f64,
    /// 99 % band of the ratio for the true model.
    pub band_99: (f64, f64),
    /// 100 (1 - |y - predicted| / |y - mean y|) [%]; `None` for what does not move beyond its noise, and for directions.
    pub fit_percent: Option<f64>,
}

/// Errors of one channel: of one axis or one wheel; for a direction, of both axes across it together.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct ChannelErrors {
    /// Name: `gyro_x`, `accelerometer_z`, `vector_1`, `wheel_x_speed`.
    pub name: String,
    /// What it measures.
    pub quantity: Channel,
    /// SI unit of the numbers.
    pub unit: &'static str,
    /// RMS of a reading's own noise, as the run shows it.
    pub noise_floor: f64,
    /// The same as the platform's file states it.
    pub stated_noise: f64,
    /// By horizon, shortest first, the whole run last.
    pub horizons: Vec<HorizonError>,
    /// Curves for plots, of a direction none; not part of the JSON.
    #[serde(skip)]
    pub overlay: Option<Overlay>,
}

/// A channel's measured and predicted values, for a plot: curves that stay short however long the run is.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Overlay {
    /// Length of each prediction \[s\].
    pub horizon_s: f64,
    /// Measured.
    pub measured: GrowingCurve,
    /// Predicted, one prediction after the other.
    pub predicted: GrowingCurve,
    /// Measured less predicted.
    pub error: GrowingCurve,
    /// Standard deviation that the model predicts for the error.
    pub stddev: GrowingCurve,
}

/// A channel while its errors come in: with its components, one or those across a direction, and its sums by horizon.
type Column = (ChannelErrors, Vec<Component>, Vec<Sums>);

#[derive(Debug, Clone, Copy, Default)]
struct Sums {
    errors_squared: f64,
    variances: f64,
    normalised_squared: f64,
    reading: f64,
    reading_squared: f64,
    count: usize,
}

impl Sums {
    fn add(&mut self, error: &AheadError) {
        self.errors_squared += error.error.value.powi(2);
        self.variances += error.error.stddev.powi(2);
        self.normalised_squared += error.error.normalised().powi(2);
        self.reading += error.reading;
        self.reading_squared += error.reading.powi(2);
        self.count += 1;
    }

    fn error(&self, horizon_s: Option<f64>, components: f64, noise: f64) -> HorizonError {
        let count = self.count as f64;
        let degrees = u32::try_from(self.count).unwrap_or(u32::MAX);
        let band = |p: f64| (chi_squared_quantile(p, degrees.max(1)) / count).sqrt();
        let about_mean = self.reading_squared - self.reading.powi(2) / count;
        // NaN where a reading is no number.
        let moves = about_mean > MOVES * noise * noise * count;
        HorizonError {
            horizon_s,
            rms: (self.errors_squared / count * components).sqrt(),
            predicted_stddev: (self.variances / count * components).sqrt(),
            ratio: (self.normalised_squared / count).sqrt(),
            band_99: (band(0.005), band(0.995)),
            fit_percent: moves.then(|| 100.0 * (1.0 - (self.errors_squared / about_mean).sqrt())),
        }
    }
}

/// Errors of all channels at all horizons, while predictions come in.
pub(super) struct Errors<'a> {
    horizons_s: &'a [f64],
    columns: Vec<Column>,
    /// On the way to the last horizon, all channels.
    together: PredictionError,
}

impl<'a> Errors<'a> {
    /// Over these horizons \[s\] and the whole run, whose position is behind theirs; with the noise that the run shows and that which is stated.
    pub fn new(case: &Prepared<'_>, horizons_s: &'a [f64], noises: [&Noise; 2]) -> Self {
        let wheels: Vec<&str> = case.model().wheels().iter().map(|wheel| wheel.name.as_str()).collect();
        let horizon_s = horizons_s.last().copied().unwrap_or(0.0);
        let is_direction = |of: &Component| of.channel.info().form == Form::Directions;
        // Both axes across a direction are one channel.
        let is_one = |a: &Component, b: &Component| {
            is_direction(a) && (a.channel, a.sensor()) == (b.channel, b.sensor())
        };
        let column = |components: &[Component]| {
            let (first, quantity) = (components[0], components[0].channel);
            let name = match (is_direction(&first), case.recording().vectors.len() > 1) {
                (true, true) => format!("{}_{}", quantity.info().key, first.sensor() + 1),
                (true, false) => quantity.info().key.to_owned(),
                _ => first.name(&wheels),
            };
            let overlay = (!is_direction(&first)).then(|| Overlay { horizon_s, ..Overlay::default() });
            let of = |noise: &Noise| noise.of(first) * (components.len() as f64).sqrt();
            let ([noise_floor, stated_noise], unit) = (noises.map(of), quantity.unit());
            let (horizons, sums) = (Vec::new(), vec![Sums::default(); horizons_s.len() + 1]);
            let channel =
                ChannelErrors { name, quantity, unit, noise_floor, stated_noise, horizons, overlay };
            (channel, components.to_vec(), sums)
        };
        let components: Vec<Component> = case.components().collect();
        let together = PredictionError { horizon_s, squares: 0.0, numbers: 0 };
        Self { horizons_s, columns: components.chunk_by(is_one).map(column).collect(), together }
    }

    /// Adds an error of a horizon, by its position.
    pub fn add(&mut self, horizon: usize, error: &AheadError) {
        let mut columns = self.columns.iter_mut();
        let column = columns.find(|of| of.1.contains(&error.error.component));
        let Some((channel, _, sums)) = column else { return };
        let is_run = horizon == self.horizons_s.len();
        if is_run || error.is_at_horizon {
            sums[horizon].add(error);
        }
        if horizon + 1 != self.horizons_s.len() {
            return;
        }
        self.together.squares += error.error.normalised().powi(2);
        self.together.numbers += 1;
        if let Some(overlay) = &mut channel.overlay {
            let (t, e) = (error.error.time_s, error.error.value);
            overlay.measured.push(t, error.reading);
            overlay.predicted.push(t, error.reading - e);
            overlay.error.push(t, e);
            overlay.stddev.push(t, error.error.stddev);
        }
    }

    pub fn finish(self) -> (Vec<ChannelErrors>, Option<PredictionError>) {
        let horizons = || self.horizons_s.iter().copied().map(Some).chain([None]);
        let finished = |(mut channel, components, sums): Column| {
            let (components, noise) = (components.len() as f64, channel.noise_floor);
            channel.horizons = horizons().zip(&sums).map(|(h, of)| of.error(h, components, noise)).collect();
            channel
        };
        let together = Some(self.together).filter(|together| together.numbers > 0);
        (self.columns.into_iter().map(finished).collect(), together)
    }
}
