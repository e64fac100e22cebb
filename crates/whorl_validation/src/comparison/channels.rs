//! Errors of each channel at each horizon.

use serde::Serialize;
use whorl_dynamics::PlatformModel;
use whorl_recording::Recording;

use crate::noise_floor::{FloorSource, NoiseFloor, NoiseFloors};
use crate::prediction::Prediction;

/// What a channel measures, which decides its unit.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Quantity {
    /// Rate gyro [rad/s].
    Gyro,
    /// Accelerometer [m/s^2].
    Accelerometer,
    /// Angle between measured and predicted direction \[rad\].
    Vector,
    /// Wheel speed [rad/s].
    WheelSpeed,
}

impl Quantity {
    /// SI unit, in which all numbers are.
    #[must_use]
    pub fn unit(self) -> &'static str {
        match self {
            Self::Gyro | Self::WheelSpeed => "rad/s",
            Self::Accelerometer => "m/s^2",
            Self::Vector => "rad",
        }
    }

    /// Unit for people and the factor to it.
    #[must_use]
    pub fn display(self) -> (&'static str, f64) {
        match self {
            Self::Gyro => ("deg/s", whorl_math::deg_from_rad(1.0)),
            Self::Vector => ("deg", whorl_math::deg_from_rad(1.0)),
            Self::Accelerometer => ("m/s^2", 1.0),
            Self::WheelSpeed => ("rad/s", 1.0),
        }
    }
}

/// Error of one channel at one horizon.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct HorizonError {
    /// How long each prediction runs \[s\]; `None`: the whole run.
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

/// One channel.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Channel {
    /// Name: `gyro_x`, `accelerometer_z`, `vector_1`, `wheel_x_speed`.
    pub name: String,
    /// What it measures.
    pub quantity: Quantity,
    /// SI unit of the numbers.
    pub unit: &'static str,
    /// RMS error that noise alone gives.
    pub noise_floor: f64,
    /// Where the noise floor comes from.
    pub floor_source: FloorSource,
    /// Still time behind it \[s\].
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
    pub quantity: Quantity,
    /// Time \[s\].
    pub time_s: Vec<f64>,
    /// Measured.
    pub measured: Vec<f64>,
    /// Predicted, one curve for each horizon.
    pub predicted: Vec<(Option<f64>, Vec<f64>)>,
}

/// A channel as plain numbers: components that are summed over, one per axis but for directions.
struct Column {
    name: String,
    quantity: Quantity,
    time_s: Vec<f64>,
    measured: Vec<Vec<f64>>,
    predicted: Vec<Vec<Vec<f64>>>,
    floor: NoiseFloor,
    /// Independent noise components that make up the error.
    noise_components: f64,
}

fn columns(
    recording: &Recording,
    model: &PlatformModel,
    predictions: &[Prediction],
    floors: &NoiseFloors,
) -> Vec<Column> {
    let mut columns = Vec::new();
    let axes = ["x", "y", "z"];
    for (i, axis) in axes.iter().enumerate() {
        columns.push(Column {
            name: format!("gyro_{axis}"),
            quantity: Quantity::Gyro,
            time_s: recording.gyro_b_rad_s.time_s.clone(),
            measured: vec![recording.gyro_b_rad_s.value.iter().map(|v| v[i]).collect()],
            predicted: predictions
                .iter()
                .map(|p| vec![p.gyro_b_rad_s.iter().map(|v| v[i]).collect()])
                .collect(),
            floor: floors.gyro[i],
            noise_components: 1.0,
        });
    }
    for (i, axis) in axes.iter().enumerate() {
        columns.push(Column {
            name: format!("accelerometer_{axis}"),
            quantity: Quantity::Accelerometer,
            time_s: recording.specific_force_b_m_s2.time_s.clone(),
            measured: vec![recording.specific_force_b_m_s2.value.iter().map(|v| v[i]).collect()],
            predicted: predictions
                .iter()
                .map(|p| vec![p.specific_force_b_m_s2.iter().map(|v| v[i]).collect()])
                .collect(),
            floor: floors.accelerometer[i],
            noise_components: 1.0,
        });
    }
    for (j, vector) in recording.vectors.iter().enumerate() {
        let component = |i: usize| vector.direction_b.value.iter().map(|v| v[i]).collect::<Vec<f64>>();
        let of = |p: &Prediction| {
            let found = p.vectors.get(j).cloned().unwrap_or_default();
            (0..3).map(|i| found.iter().map(|v| v[i]).collect()).collect()
        };
        columns.push(Column {
            name: if recording.vectors.len() > 1 { format!("vector_{}", j + 1) } else { "vector".into() },
            quantity: Quantity::Vector,
            time_s: vector.direction_b.time_s.clone(),
            measured: (0..3).map(component).collect(),
            predicted: predictions.iter().map(of).collect(),
            floor: floors.vector,
            noise_components: 2.0,
        });
    }
    let command_known = !recording.wheel_torque_command_n_m.is_empty();
    for (j, wheel) in model.wheels().iter().enumerate().filter(|_| command_known) {
        let of = |values: &[Vec<f64>]| -> Vec<f64> {
            values.iter().map(|v| v.get(j).copied().unwrap_or(f64::NAN)).collect()
        };
        columns.push(Column {
            name: format!("{}_speed", wheel.name),
            quantity: Quantity::WheelSpeed,
            time_s: recording.wheel_speed_rad_s.time_s.clone(),
            measured: vec![of(&recording.wheel_speed_rad_s.value)],
            predicted: predictions.iter().map(|p| vec![of(&p.wheel_speed_rad_s)]).collect(),
            floor: floors.wheel_speed,
            noise_components: 1.0,
        });
    }
    columns.retain(|c| !c.time_s.is_empty());
    columns
}

pub(super) fn channels(
    recording: &Recording,
    model: &PlatformModel,
    horizons: &[Option<f64>],
    predictions: &[Prediction],
    floors: &NoiseFloors,
) -> Vec<Channel> {
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
            Channel {
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
        .filter(|c| c.quantity != Quantity::Vector)
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
