//! Errors of each channel at each horizon.

use serde::Serialize;
use whorl_dynamics::PlatformModel;
use whorl_math::GrowingCurve;
use whorl_recording::{Channel, ChannelSeries, Component, Form, Recording};

use super::gaps::Gaps;
use crate::noise_floor::{FloorSource, NoiseFloors};
use crate::prediction::{Chunk, Simulator, predicted_channels};

/// Error of one channel at one horizon.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct HorizonError {
    /// Length of each prediction \[s\]; `None`: the whole run.
    pub horizon_s: Option<f64>,
    /// Root mean square of measured less predicted, over all predictions.
    pub rms: f64,
    /// `rms` over the noise floor.
    pub ratio: f64,
    /// 100 (1 - |y - predicted| / |y - mean y|) [%]; `None` for a channel that does not move beyond its noise.
    pub fit_percent: Option<f64>,
    /// Samples predicted.
    pub samples: usize,
}

/// Errors of one channel: of one axis or one wheel; for a direction, of all axes together.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct ChannelErrors {
    /// Name: `gyro_x`, `accelerometer_z`, `vector_1`, `wheel_x_speed`.
    pub name: String,
    /// What it measures.
    pub quantity: Channel,
    /// SI unit of the numbers.
    pub unit: &'static str,
    /// RMS error due to noise alone.
    pub noise_floor: f64,
    /// Source of the noise floor.
    pub floor_source: FloorSource,
    /// Still time from which it was estimated \[s\].
    pub still_s: f64,
    /// By horizon, shortest first, the whole run last.
    pub horizons: Vec<HorizonError>,
}

/// A channel's measured and predicted values, for a plot: curves that stay short however long the run is.
#[derive(Debug, Clone, PartialEq)]
pub struct Overlay {
    /// Channel.
    pub name: String,
    /// What it measures.
    pub quantity: Channel,
    /// Length of each prediction \[s\]: the longest that is shorter than the run; `None`: the whole run.
    pub horizon_s: Option<f64>,
    /// Measured.
    pub measured: GrowingCurve,
    /// Predicted, one prediction after the other.
    pub predicted: GrowingCurve,
    /// Measured less predicted.
    pub error: GrowingCurve,
}

/// Compares a channel with its predictions, chunk by chunk: the components to sum over, one per axis except for
/// directions.
struct Column {
    name: String,
    quantity: Channel,
    sensor: usize,
    track: usize,
    indices: std::ops::Range<usize>,
    /// Whose noise floor is the channel's.
    component: Component,
    /// Number of independent noise components in the error.
    noise_components: f64,
    /// By horizon, and each of the indices.
    sums: Vec<Vec<Sums>>,
    overlay: Option<Overlay>,
}

/// Sums over the samples of one component that were predicted.
#[derive(Debug, Clone, Default)]
struct Sums {
    /// Errors squared.
    left: f64,
    measured: f64,
    count: usize,
    not_predicted: Gaps,
}

impl Sums {
    fn add(&mut self, k: usize, measured: f64, predicted: f64) {
        if predicted.is_finite() {
            self.left += (measured - predicted).powi(2);
            self.measured += measured;
            self.count += 1;
        } else {
            self.not_predicted.add(k);
        }
    }

    /// Squares of the measured values about the mean of those that were predicted.
    fn about_mean(&self, series: &dyn ChannelSeries, index: usize) -> f64 {
        let mean = self.measured / self.count.max(1) as f64;
        let used = self.not_predicted.others(series.time_s().len());
        used.map(|k| (series.number(k, index).unwrap_or(f64::NAN) - mean).powi(2)).sum()
    }
}

/// Errors of all channels at all horizons, while predictions come in.
pub(super) struct Errors<'a> {
    recording: &'a Recording,
    horizons: &'a [Option<f64>],
    columns: Vec<Column>,
    /// The horizon that is plotted: the longest that is shorter than the run.
    shown: usize,
}

impl<'a> Errors<'a> {
    pub fn new(
        recording: &'a Recording,
        model: &PlatformModel,
        simulator: &Simulator<'_>,
        horizons: &'a [Option<f64>],
    ) -> Self {
        let shown = horizons.iter().rposition(Option::is_some).unwrap_or(horizons.len().saturating_sub(1));
        let wheels: Vec<&str> = model.wheels().iter().map(|wheel| wheel.name.as_str()).collect();
        let mut columns = Vec::new();
        for (channel, sensor) in predicted_channels(recording) {
            let Some(track) = simulator.track(channel, sensor) else { continue };
            if simulator.tracks().get(track).is_none_or(|track| track.time_s.is_empty()) {
                continue;
            }
            let mut add = |name: String,
                           indices: std::ops::Range<usize>,
                           component: Component,
                           noise_components: f64| {
                let overlay = (channel != Channel::Vector).then(|| Overlay {
                    name: name.clone(),
                    quantity: channel,
                    horizon_s: horizons.get(shown).copied().flatten(),
                    measured: GrowingCurve::default(),
                    predicted: GrowingCurve::default(),
                    error: GrowingCurve::default(),
                });
                columns.push(Column {
                    name,
                    quantity: channel,
                    sensor,
                    track,
                    sums: vec![vec![Sums::default(); indices.len()]; horizons.len()],
                    indices,
                    component,
                    noise_components,
                    overlay,
                });
            };
            let components: Vec<Component> = Component::of(channel, sensor, wheels.len()).collect();
            if channel.info().form == Form::Directions {
                let key = channel.info().key;
                let several = recording.vectors.len() > 1;
                let name = if several { format!("{key}_{}", sensor + 1) } else { key.to_owned() };
                // The error is an angle about two axes.
                add(name, 0..3, Component::new(channel, sensor, 0), components.len() as f64);
            } else {
                for component in components.into_iter().filter(|component| recording.measures(*component)) {
                    let index = component.index();
                    add(component.name(&wheels), index..index + 1, component, 1.0);
                }
            }
        }
        Self { recording, horizons, columns, shown }
    }

    /// Adds samples and their predictions over a horizon, by its position.
    pub fn add(&mut self, horizon: usize, measured: &Chunk, predicted: &Chunk) {
        for column in &mut self.columns {
            let Some(sums) = column.sums.get_mut(horizon) else { continue };
            let series = self.recording.series(column.quantity, column.sensor);
            let times = series.map_or(&[][..], |series| series.time_s());
            for k in predicted.samples(column.track) {
                for (sums, index) in sums.iter_mut().zip(column.indices.clone()) {
                    let (y, p) =
                        (measured.number(column.track, k, index), predicted.number(column.track, k, index));
                    sums.add(k, y, p);
                    if let (Some(overlay), Some(&t)) = (&mut column.overlay, times.get(k))
                        && horizon == self.shown
                    {
                        let curves = [
                            (&mut overlay.measured, y),
                            (&mut overlay.predicted, p),
                            (&mut overlay.error, y - p),
                        ];
                        for (curve, value) in curves.into_iter().filter(|(_, value)| value.is_finite()) {
                            curve.push(t, value);
                        }
                    }
                }
            }
        }
    }

    /// The errors with these noise floors, and the curves.
    pub fn finish(self, floors: &NoiseFloors) -> (Vec<ChannelErrors>, Vec<Overlay>) {
        let (mut channels, mut overlays) = (Vec::new(), Vec::new());
        for column in self.columns {
            let floor = floors.of_component(column.component);
            let noise_floor = floor.sigma * column.noise_components.sqrt();
            let series = self.recording.series(column.quantity, column.sensor);
            let errors = self.horizons.iter().zip(&column.sums).map(|(horizon_s, sums)| {
                let (rms, fit, samples) = error(series, sums, column.indices.clone(), noise_floor);
                HorizonError {
                    horizon_s: *horizon_s,
                    rms,
                    ratio: rms / noise_floor,
                    fit_percent: fit,
                    samples,
                }
            });
            channels.push(ChannelErrors {
                horizons: errors.collect(),
                unit: column.quantity.unit(),
                name: column.name,
                quantity: column.quantity,
                noise_floor,
                floor_source: floor.source,
                still_s: floor.still_s,
            });
            overlays.extend(column.overlay);
        }
        (channels, overlays)
    }
}

/// RMS error, fit and number of samples.
fn error(
    series: Option<&dyn ChannelSeries>,
    sums: &[Sums],
    indices: std::ops::Range<usize>,
    floor: f64,
) -> (f64, Option<f64>, usize) {
    let (mut left, mut about_mean, mut samples) = (0.0, 0.0, 0);
    for (sums, index) in sums.iter().zip(indices) {
        left += sums.left;
        about_mean += series.map_or(0.0, |series| sums.about_mean(series, index));
        samples = sums.count;
    }
    let count = samples as f64;
    let moves = about_mean > 1.2 * floor * floor * count;
    let fit = moves.then(|| 100.0 * (1.0 - (left / about_mean).sqrt()));
    ((left / count).sqrt(), fit, samples)
}
