//! The absolute test: are the residuals no more than noise?
//!
//! The run is cut into stretches. In each, the initial state is fitted to the stretch's own measurements
//! (linearised about the smoothed one), so that only model errors and noise remain. Without
//! model errors, the sum of squares has a chi-squared distribution with the number of samples less the number of fitted
//! values as degrees of freedom.

use nalgebra::{DMatrix, DVector, Vector3};
use serde::Serialize;
use whorl_dynamics::PlatformModel;
use whorl_math::quaternion_exp;
use whorl_math::statistics::chi_squared_quantile;
use whorl_recording::{Channel, Component, Mounting, Recording};

use crate::noise_floor::NoiseFloors;
use crate::prediction::{Prediction, Simulator, predicted_channels};
use crate::statistics::{
    CrossCorrelation, CumulativePeriodogram, LjungBox, cross_correlation, cumulative_periodogram, ljung_box,
};
use whorl_trajectory::commands::Commands;
use whorl_trajectory::noise::typical_step_s;
use whorl_trajectory::smoothing::Motion;

/// Length of a stretch \[s\], longer for slow sensors: so many readings; half the run for shorter ones.
const STRETCH_S: f64 = 10.0;
const STRETCH_READINGS: f64 = 50.0;
/// Steps by which the initial state is varied: attitude \[rad\], rate and wheel speed [rad/s].
const STEPS: [f64; 3] = [1e-4, 1e-4, 1e-2];
/// Prior standard deviation of the fitted changes, in the same units: wide, only for regularisation.
const SPREAD: [f64; 3] = [0.02, 0.02, 2.0];
/// Lags of the whiteness tests.
const LAGS: usize = 25;

/// Outcome of the test against noise alone.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Absolute {
    /// Sum of squares of the whitened residuals over their degrees of freedom; 1 = noise.
    pub chi_squared_per_degree: f64,
    /// 99 % band of this ratio for noise alone.
    pub band_99: (f64, f64),
    /// Degrees of freedom.
    pub degrees: usize,
    /// Length of the stretches whose initial states were fitted \[s\].
    pub stretch_s: f64,
}

impl Absolute {
    /// The prediction error relative to the noise: root of chi-squared per degree of freedom; 1 = noise.
    #[must_use]
    pub fn prediction_error(&self) -> f64 {
        self.chi_squared_per_degree.sqrt()
    }

    /// Whether the residuals are consistent with noise alone.
    #[must_use]
    pub fn is_noise(&self) -> bool {
        self.chi_squared_per_degree <= self.band_99.1
    }
}

/// Tests of one channel's residual.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Whiteness {
    /// Channel.
    pub channel: String,
    /// RMS of the whitened residual; 1 = noise.
    pub rms: f64,
    /// Test of the first autocorrelations.
    pub ljung_box: Option<LjungBox>,
    /// Cumulative power over frequency.
    pub periodogram: Option<CumulativePeriodogram>,
    /// Correlations with inputs, the largest first.
    pub inputs: Vec<InputCorrelation>,
}

/// Correlation of a residual with one input.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct InputCorrelation {
    /// The input.
    pub input: String,
    /// Whether the correlation is significant at 99 % over all lags. With a controller
    /// running only lags >= 0 count.
    pub significant: bool,
    /// Lag of the largest correlation, samples.
    pub lag: i64,
    /// The largest correlation.
    pub value: f64,
    /// The correlation at all lags.
    pub correlation: CrossCorrelation,
}

/// Whitened residuals after fitting the initial states.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Residuals {
    /// Channel, times \[s\], values.
    pub channels: Vec<(String, Vec<f64>, Vec<f64>)>,
    /// Inputs at the times of the first channel.
    pub inputs: Vec<(String, Vec<f64>)>,
}

impl Residuals {
    /// Tests every channel.
    #[must_use]
    pub fn tests(&self, closed_loop: bool) -> Vec<Whiteness> {
        let lags = u32::try_from(LAGS).unwrap_or(u32::MAX);
        self.channels
            .iter()
            .map(|(channel, time_s, value)| {
                let span_s = time_s.last().zip(time_s.first()).map_or(0.0, |(b, a)| b - a);
                let rate_hz = value.len().saturating_sub(1) as f64 / span_s.max(1e-9);
                let mut inputs: Vec<InputCorrelation> = self
                    .inputs
                    .iter()
                    .filter_map(|(input, u)| {
                        let correlation = cross_correlation(value, u, LAGS)?;
                        let (lag, largest) = correlation.largest(closed_loop)?;
                        let significant = correlation.is_significant(closed_loop);
                        Some(InputCorrelation {
                            input: input.clone(),
                            significant,
                            lag,
                            value: largest,
                            correlation,
                        })
                    })
                    .collect();
                inputs.sort_by(|a, b| b.value.abs().total_cmp(&a.value.abs()));
                let squares: f64 = value.iter().map(|x| x * x).sum();
                Whiteness {
                    channel: channel.clone(),
                    rms: (squares / value.len().max(1) as f64).sqrt(),
                    ljung_box: ljung_box(value, lags),
                    periodogram: cumulative_periodogram(value, rate_hz),
                    inputs,
                }
            })
            .collect()
    }
}

/// One row of the residual: stretch, channel, time, whitened value.
struct Row {
    stretch: usize,
    channel: usize,
    time_s: f64,
}

pub(super) fn test(
    recording: &Recording,
    model: &PlatformModel,
    simulator: &Simulator<'_>,
    start: &dyn Fn(f64) -> Motion,
    floors: &NoiseFloors,
    commands: &Commands,
) -> Option<(Absolute, Residuals)> {
    let slowest = |times: &[f64]| if times.is_empty() { 0.0 } else { typical_step_s(times) };
    let step_s = slowest(&recording.gyro_b_rad_s.time_s).max(slowest(&recording.wheel_speed_rad_s.time_s));
    let stretch_s = STRETCH_S.max(STRETCH_READINGS * step_s).min(0.5 * recording.duration_s());
    let wheels = model.wheels().len();
    let (rows, names) = rows(recording, model, simulator.first_s(), stretch_s);
    let measured = whitened(recording, &measurements(recording), floors, wheels);
    let nominal = whitened(recording, &simulator.predict(Some(stretch_s), start), floors, wheels);
    let changes = changes(recording.mounting == Mounting::Clamped || !model.freedom.turns(), wheels);
    let columns: Vec<Vec<f64>> = changes
        .iter()
        .map(|change| {
            let varied = simulator.predict(Some(stretch_s), &|t| change.applied(start(t)));
            let varied = whitened(recording, &varied, floors, wheels);
            varied.iter().zip(&nominal).map(|(a, b)| (a - b) / change.step).collect()
        })
        .collect();
    let mut residual: Vec<f64> = measured.iter().zip(&nominal).map(|(y, p)| y - p).collect();
    let stretches = rows.iter().map(|r| r.stretch).max()? + 1;
    let mut members = vec![Vec::new(); stretches];
    for (k, row) in rows.iter().enumerate() {
        let finite = residual.get(k).is_some_and(|r| r.is_finite())
            && columns.iter().all(|c| c.get(k).is_some_and(|x| x.is_finite()));
        if finite && let Some(list) = members.get_mut(row.stretch) {
            list.push(k);
        }
    }
    let (mut squares, mut degrees) = (0.0, 0usize);
    for list in members.iter().filter(|list| list.len() > 2 * changes.len()) {
        let jacobian = DMatrix::from_fn(list.len(), changes.len(), |i, j| columns[j][list[i]]);
        let left = DVector::from_fn(list.len(), |i, _| residual[list[i]]);
        let mut normal = jacobian.transpose() * &jacobian;
        for (i, change) in changes.iter().enumerate() {
            normal[(i, i)] += change.spread.powi(-2);
        }
        let Some(factor) = normal.clone().cholesky() else { continue };
        let best = factor.solve(&(jacobian.transpose() * &left));
        let left = left - jacobian * &best;
        // Effective number of fitted values: those determined by the data, not by the prior.
        let prior: f64 =
            changes.iter().enumerate().map(|(i, c)| factor.inverse()[(i, i)] * c.spread.powi(-2)).sum();
        let fitted = (changes.len() as f64 - prior).round().max(0.0) as usize;
        squares += left.norm_squared();
        degrees += list.len() - fitted;
        for (i, k) in list.iter().enumerate() {
            residual[*k] = left[i];
        }
    }
    let kept: Vec<bool> = {
        let mut kept = vec![false; rows.len()];
        for k in members.iter().filter(|list| list.len() > 2 * changes.len()).flatten() {
            kept[*k] = true;
        }
        kept
    };
    if degrees == 0 {
        return None;
    }
    let mut channels: Vec<(String, Vec<f64>, Vec<f64>)> =
        names.into_iter().map(|name| (name, Vec::new(), Vec::new())).collect();
    for ((row, value), _) in rows.iter().zip(&residual).zip(&kept).filter(|(_, kept)| **kept) {
        if let Some((_, times, values)) = channels.get_mut(row.channel) {
            times.push(row.time_s);
            values.push(*value);
        }
    }
    channels.retain(|(_, times, _)| times.len() > 4 * LAGS);
    let inputs = channels.first().map_or_else(Vec::new, |(_, times, _)| commands.inputs(model, times));
    let n = u32::try_from(degrees).unwrap_or(u32::MAX);
    let band = |p: f64| chi_squared_quantile(p, n) / degrees as f64;
    let absolute = Absolute {
        chi_squared_per_degree: squares / degrees as f64,
        band_99: (band(0.005), band(0.995)),
        degrees,
        stretch_s,
    };
    Some((absolute, Residuals { channels, inputs }))
}

/// One component of the error of an initial state.
struct Change {
    index: usize,
    kind: usize,
    step: f64,
    spread: f64,
}

impl Change {
    fn applied(&self, mut motion: Motion) -> Motion {
        let mut delta = Vector3::zeros();
        if let Some(x) = delta.get_mut(self.index) {
            *x = self.step;
        }
        match self.kind {
            0 => motion.q_world_body *= quaternion_exp(&delta),
            1 => motion.omega_wb_b_rad_s += delta,
            _ => {
                if let Some(speed) = motion.wheel_speed_rad_s.get_mut(self.index) {
                    *speed += self.step;
                }
            }
        }
        motion
    }
}

fn changes(clamped: bool, wheels: usize) -> Vec<Change> {
    let mut changes = Vec::new();
    for (kind, (step, spread)) in STEPS.into_iter().zip(SPREAD).enumerate() {
        let count = if kind == 2 { wheels } else { 3 };
        if kind < 2 && clamped {
            continue;
        }
        changes.extend((0..count).map(|index| Change { index, kind, step, spread }));
    }
    changes
}

/// The measurements in the form of a prediction.
fn measurements(recording: &Recording) -> Prediction {
    Prediction {
        gyro_b_rad_s: recording.gyro_b_rad_s.value.clone(),
        specific_force_b_m_s2: recording.specific_force_b_m_s2.value.clone(),
        vectors: recording.vectors.iter().map(|v| v.direction_b.value.clone()).collect(),
        wheel_speed_rad_s: recording.wheel_speed_rad_s.value.clone(),
    }
}

/// The tested values: the free components of every predicted channel.
fn components(recording: &Recording, wheels: usize) -> impl Iterator<Item = Component> {
    predicted_channels(recording)
        .flat_map(move |(channel, sensor)| Component::of(channel, sensor, wheels))
        .filter(|component| recording.measures(*component))
}

/// Every value divided by its noise, in the order of [`rows`]. A direction has only two free components; they
/// are taken along two axes perpendicular to the measured direction.
fn whitened(recording: &Recording, p: &Prediction, floors: &NoiseFloors, wheels: usize) -> Vec<f64> {
    let mut all = Vec::new();
    for component in components(recording, wheels) {
        let (channel, sensor) = (component.channel, component.sensor());
        let sigma = floors.of_component(component).sigma;
        if channel == Channel::Vector {
            let (Some(measured), Some(found)) = (recording.vectors.get(sensor), p.vectors.get(sensor)) else {
                continue;
            };
            all.extend(measured.direction_b.value.iter().zip(found).map(|(measured, v)| {
                let helper = if measured.z.abs() > 0.7 { Vector3::x() } else { Vector3::z() };
                let first = whorl_math::unit_or(measured.cross(&helper), Vector3::x_axis()).into_inner();
                let axis = if component.index() == 0 { first } else { measured.cross(&first) };
                v.dot(&axis) / sigma
            }));
        } else {
            let samples = recording.series(channel, sensor).map_or(0, |series| series.time_s().len());
            let number = |k| p.number(channel, sensor, k, component.index()).unwrap_or(f64::NAN);
            all.extend((0..samples).map(|k| number(k) / sigma));
        }
    }
    all
}

/// Channel and component of each value of [`whitened`], with names.
fn rows(
    recording: &Recording,
    model: &PlatformModel,
    first_s: f64,
    stretch_s: f64,
) -> (Vec<Row>, Vec<String>) {
    let wheels: Vec<&str> = model.wheels().iter().map(|wheel| wheel.name.as_str()).collect();
    let (mut rows, mut names) = (Vec::new(), Vec::new());
    let stretch = |t: f64| ((t - first_s) / stretch_s + 1e-9).floor().max(0.0) as usize;
    for component in components(recording, wheels.len()) {
        let series = recording.series(component.channel, component.sensor());
        let times = series.map_or(&[][..], |series| series.time_s());
        let channel = names.len();
        names.push(component.name(&wheels));
        rows.extend(times.iter().map(|t| Row { stretch: stretch(*t), channel, time_s: *t }));
    }
    (rows, names)
}
