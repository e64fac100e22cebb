//! Errors of each channel at each horizon.

use serde::Serialize;
use whorl_dynamics::PlatformModel;
use whorl_recording::{Channel, Component, Form, Recording};

use crate::noise_floor::{FloorSource, NoiseFloor, NoiseFloors};
use crate::prediction::{Prediction, predicted_channels};

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

/// A channel's measured and predicted values, for a plot.
#[derive(Debug, Clone, PartialEq)]
pub struct Overlay {
    /// Channel.
    pub name: String,
    /// What it measures.
    pub quantity: Channel,
    /// Time \[s\].
    pub time_s: Vec<f64>,
    /// Measured.
    pub measured: Vec<f64>,
    /// Predicted, one curve for each horizon.
    pub predicted: Vec<(Option<f64>, Vec<f64>)>,
}

/// A channel as plain numbers: the components to sum over, one per axis except for directions.
struct Column {
    name: String,
    quantity: Channel,
    time_s: Vec<f64>,
    measured: Vec<Vec<f64>>,
    predicted: Vec<Vec<Vec<f64>>>,
    floor: NoiseFloor,
    /// Number of independent noise components in the error.
    noise_components: f64,
}

fn columns(
    recording: &Recording,
    model: &PlatformModel,
    predictions: &[Prediction],
    floors: &NoiseFloors,
) -> Vec<Column> {
    let wheels: Vec<&str> = model.wheels().iter().map(|wheel| wheel.name.as_str()).collect();
    let mut columns = Vec::new();
    for (channel, sensor) in predicted_channels(recording) {
        let Some(series) = recording.series(channel, sensor) else { continue };
        let samples = series.time_s().len();
        if samples == 0 {
            continue;
        }
        let numbers = |number: &dyn Fn(usize) -> Option<f64>| -> Vec<f64> {
            (0..samples).map(|k| number(k).unwrap_or(f64::NAN)).collect()
        };
        let mut add =
            |name: String, indices: std::ops::Range<usize>, floor: NoiseFloor, noise_components: f64| {
                let measured = indices.clone().map(|i| numbers(&|k| series.number(k, i))).collect();
                let of = |p: &Prediction| {
                    indices.clone().map(|i| numbers(&|k| p.number(channel, sensor, k, i))).collect()
                };
                columns.push(Column {
                    name,
                    quantity: channel,
                    time_s: series.time_s().to_vec(),
                    measured,
                    predicted: predictions.iter().map(of).collect(),
                    floor,
                    noise_components,
                });
            };
        let components: Vec<Component> = Component::of(channel, sensor, wheels.len()).collect();
        if channel.info().form == Form::Directions {
            let key = channel.info().key;
            let several = recording.vectors.len() > 1;
            let name = if several { format!("{key}_{}", sensor + 1) } else { key.to_owned() };
            // The error is an angle about two axes.
            let floor = floors.of_component(Component::new(channel, sensor, 0));
            add(name, 0..3, floor, components.len() as f64);
        } else {
            for component in components.into_iter().filter(|component| recording.measures(*component)) {
                let index = component.index();
                add(component.name(&wheels), index..index + 1, floors.of_component(component), 1.0);
            }
        }
    }
    columns
}

pub(super) fn channels(
    recording: &Recording,
    model: &PlatformModel,
    horizons: &[Option<f64>],
    predictions: &[Prediction],
    floors: &NoiseFloors,
) -> Vec<ChannelErrors> {
    let columns = columns(recording, model, predictions, floors);
    columns
        .into_iter()
        .map(|column| {
            let noise_floor = column.floor.sigma * column.noise_components.sqrt();
            let errors = horizons.iter().zip(&column.predicted).map(|(horizon_s, predicted)| {
                let (rms, fit, samples) = error(&column.measured, predicted, noise_floor);
                HorizonError {
                    horizon_s: *horizon_s,
                    rms,
                    ratio: rms / noise_floor,
                    fit_percent: fit,
                    samples,
                }
            });
            ChannelErrors {
                horizons: errors.collect(),
                unit: column.quantity.unit(),
                name: column.name,
                quantity: column.quantity,
                noise_floor,
                floor_source: column.floor.source,
                still_s: column.floor.still_s,
            }
        })
        .collect()
}

/// RMS error, fit and number of samples.
fn error(measured: &[Vec<f64>], predicted: &[Vec<f64>], floor: f64) -> (f64, Option<f64>, usize) {
    let (mut left, mut about_mean, mut samples) = (0.0, 0.0, 0);
    for (y, p) in measured.iter().zip(predicted) {
        let used: Vec<(f64, f64)> =
            y.iter().copied().zip(p.iter().copied()).filter(|(_, p)| p.is_finite()).collect();
        let mean = used.iter().map(|(y, _)| y).sum::<f64>() / used.len().max(1) as f64;
        left += used.iter().map(|(y, p)| (y - p).powi(2)).sum::<f64>();
        about_mean += used.iter().map(|(y, _)| (y - mean).powi(2)).sum::<f64>();
        samples = used.len();
    }
    let count = samples as f64;
    let moves = about_mean > 1.2 * floor * floor * count;
    let fit = moves.then(|| 100.0 * (1.0 - (left / about_mean).sqrt()));
    ((left / count).sqrt(), fit, samples)
}

pub(super) fn overlays(
    recording: &Recording,
    model: &PlatformModel,
    horizons: &[Option<f64>],
    predictions: &[Prediction],
) -> Vec<Overlay> {
    let floors = NoiseFloors::of(recording, model, &Prediction::default());
    columns(recording, model, predictions, &floors)
        .into_iter()
        .filter(|c| c.quantity != Channel::Vector)
        .map(|column| Overlay {
            name: column.name,
            quantity: column.quantity,
            time_s: column.time_s,
            measured: column.measured.into_iter().next().unwrap_or_default(),
            predicted: horizons
                .iter()
                .copied()
                .zip(column.predicted.into_iter().map(|p| p.into_iter().next().unwrap_or_default()))
                .collect(),
        })
        .collect()
}
