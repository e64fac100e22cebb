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

use super::gaps::Gaps;
use crate::noise_floor::NoiseFloors;
use crate::prediction::{Chunk, Simulator, Walk, predicted_channels};
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
pub(super) struct Residuals {
    channels: Vec<Residual>,
    /// Inputs at the times of the first channel.
    inputs: Vec<(String, Vec<f64>)>,
}

/// Residual of one component.
struct Residual {
    channel: String,
    /// From the first sample to the last \[s\].
    span_s: f64,
    value: Vec<f64>,
}

impl Residuals {
    /// Tests every channel.
    pub fn tests(&self, closed_loop: bool) -> Vec<Whiteness> {
        let lags = u32::try_from(LAGS).unwrap_or(u32::MAX);
        self.channels
            .iter()
            .map(|Residual { channel, span_s, value }| {
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

/// A component that is tested, and its residual as far as it is known.
struct Tested {
    component: Component,
    name: String,
    track: usize,
    sigma: f64,
    residual: Vec<f64>,
    /// Samples without a residual.
    left_out: Gaps,
}

/// A row of a stretch's regression: which component, and which of its samples.
struct Row {
    tested: usize,
    sample: usize,
}

pub(super) fn test(
    recording: &Recording,
    model: &PlatformModel,
    simulator: &Simulator<'_>,
    start: &dyn Fn(f64) -> Motion,
    floors: &NoiseFloors,
    commands: &Commands<'_>,
) -> Option<(Absolute, Residuals)> {
    let slowest = |times: &[f64]| if times.is_empty() { 0.0 } else { typical_step_s(times) };
    let step_s = slowest(&recording.gyro_b_rad_s.time_s).max(slowest(&recording.wheel_speed_rad_s.time_s));
    let stretch_s = STRETCH_S.max(STRETCH_READINGS * step_s).min(0.5 * recording.duration_s());
    let first_s = simulator.first_s();
    let stretch = |t: f64| ((t - first_s) / stretch_s + 1e-9).floor().max(0.0) as usize;
    let mut tested = tested(recording, model, simulator, floors);
    let changes =
        changes(recording.mounting == Mounting::Clamped || !model.freedom.turns(), model.wheels().len());
    // Stretch by stretch, all of them side by side: only one stretch's sensitivities are ever there.
    let mut nominal = simulator.walk(Some(stretch_s));
    let mut varied: Vec<Walk<'_>> = changes.iter().map(|_| nominal.clone()).collect();
    let (mut squares, mut degrees) = (0.0, 0usize);
    while let Some(from_s) = nominal.time_s() {
        let present = stretch(from_s);
        let wanted = |t: f64| stretch(t) == present;
        let predicted = nominal.next(wanted, start);
        let measured = simulator.measured(&predicted);
        let nominal = whitened(&tested, &measured, &predicted);
        let columns: Vec<Vec<f64>> = changes
            .iter()
            .zip(&mut varied)
            .map(|(change, walk)| {
                let varied = walk.next(wanted, &|t| change.applied(start(t)));
                let varied = whitened(&tested, &measured, &varied);
                varied.iter().zip(&nominal).map(|(a, b)| (a - b) / change.step).collect()
            })
            .collect();
        let residual = whitened(&tested, &measured, &measured);
        let residual: Vec<f64> = residual.iter().zip(&nominal).map(|(y, p)| y - p).collect();
        let fitted = Stretch::fit(residual, &columns, &changes);
        if let Some((of_stretch, freedom)) = fitted.misfit {
            squares += of_stretch;
            degrees += freedom;
        }
        for (row, value) in rows(&tested, &predicted).zip(fitted.residual) {
            let Some(tested) = tested.get_mut(row.tested) else { continue };
            match value {
                Some(value) => tested.residual.push(value),
                None => tested.left_out.add(row.sample),
            }
        }
    }
    if degrees == 0 {
        return None;
    }
    tested.retain(|tested| tested.residual.len() > 4 * LAGS);
    let times = |tested: &Tested| -> Vec<f64> {
        let all = simulator.tracks().get(tested.track).map_or(&[][..], |track| track.time_s);
        tested.left_out.others(all.len()).filter_map(|k| all.get(k)).copied().collect()
    };
    let inputs = tested.first().map_or_else(Vec::new, |first| commands.inputs(model, &times(first)));
    let span_s = |times: Vec<f64>| times.last().zip(times.first()).map_or(0.0, |(b, a)| b - a);
    let channels = tested.into_iter().map(|tested| Residual {
        span_s: span_s(times(&tested)),
        channel: tested.name,
        value: tested.residual,
    });
    let channels = channels.collect();
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

/// A stretch with its initial state fitted.
struct Stretch {
    /// Of each row; `None` where something cannot be predicted, or the stretch is too short to be fitted.
    residual: Vec<Option<f64>>,
    /// Sum of squares and degrees of freedom, if it was fitted.
    misfit: Option<(f64, usize)>,
}

impl Stretch {
    fn fit(residual: Vec<f64>, columns: &[Vec<f64>], changes: &[Change]) -> Self {
        let finite = |k: &usize| {
            residual.get(*k).is_some_and(|r| r.is_finite())
                && columns.iter().all(|c| c.get(*k).is_some_and(|x| x.is_finite()))
        };
        let list: Vec<usize> = (0..residual.len()).filter(finite).collect();
        let mut fitted = Self { residual: vec![None; residual.len()], misfit: None };
        if list.len() <= 2 * changes.len() {
            return fitted;
        }
        let jacobian = DMatrix::from_fn(list.len(), changes.len(), |i, j| columns[j][list[i]]);
        let mut left = DVector::from_fn(list.len(), |i, _| residual[list[i]]);
        let mut normal = jacobian.transpose() * &jacobian;
        for (i, change) in changes.iter().enumerate() {
            normal[(i, i)] += change.spread.powi(-2);
        }
        if let Some(factor) = normal.cholesky() {
            let best = factor.solve(&(jacobian.transpose() * &left));
            left -= jacobian * &best;
            // Effective number of fitted values: those determined by the data, not by the prior.
            let prior: f64 =
                changes.iter().enumerate().map(|(i, c)| factor.inverse()[(i, i)] * c.spread.powi(-2)).sum();
            let values = (changes.len() as f64 - prior).round().max(0.0) as usize;
            fitted.misfit = Some((left.norm_squared(), list.len() - values));
        }
        for (i, k) in list.iter().enumerate() {
            fitted.residual[*k] = Some(left[i]);
        }
        fitted
    }
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

/// The tested values: the free components of every predicted channel.
fn tested(
    recording: &Recording,
    model: &PlatformModel,
    simulator: &Simulator<'_>,
    floors: &NoiseFloors,
) -> Vec<Tested> {
    let wheels: Vec<&str> = model.wheels().iter().map(|wheel| wheel.name.as_str()).collect();
    predicted_channels(recording)
        .flat_map(|(channel, sensor)| Component::of(channel, sensor, wheels.len()))
        .filter(|component| recording.measures(*component))
        .filter_map(|component| {
            Some(Tested {
                component,
                name: component.name(&wheels),
                track: simulator.track(component.channel, component.sensor())?,
                sigma: floors.of_component(component).sigma,
                residual: Vec::new(),
                left_out: Gaps::default(),
            })
        })
        .collect()
}

/// The rows of a chunk: component by component, each in order of time.
fn rows(tested: &[Tested], chunk: &Chunk) -> impl Iterator<Item = Row> + use<> {
    let ranges: Vec<_> = tested.iter().map(|tested| chunk.samples(tested.track)).collect();
    let of_range = |(tested, samples): (usize, std::ops::Range<usize>)| {
        samples.map(move |sample| Row { tested, sample })
    };
    ranges.into_iter().enumerate().flat_map(of_range)
}

/// Every value divided by its noise, in the order of [`rows`]. A direction has only two free components; they
/// are taken along two axes perpendicular to the measured direction.
fn whitened(tested: &[Tested], measured: &Chunk, values: &Chunk) -> Vec<f64> {
    let vector =
        |chunk: &Chunk, track: usize, k: usize| Vector3::from_fn(|index, _| chunk.number(track, k, index));
    let mut all = Vec::new();
    for Tested { component, track, sigma, .. } in tested {
        let samples = values.samples(*track);
        if component.channel == Channel::Vector {
            all.extend(samples.map(|k| {
                let (measured, v) = (vector(measured, *track, k), vector(values, *track, k));
                let helper = if measured.z.abs() > 0.7 { Vector3::x() } else { Vector3::z() };
                let first = whorl_math::unit_or(measured.cross(&helper), Vector3::x_axis()).into_inner();
                let axis = if component.index() == 0 { first } else { measured.cross(&first) };
                v.dot(&axis) / sigma
            }));
        } else {
            all.extend(samples.map(|k| values.number(*track, k, component.index()) / sigma));
        }
    }
    all
}
