//! Lines in the spectrum of what the base model leaves: over time, and over the angle of each wheel.

use nalgebra::Vector3;
use whorl_math::statistics::median;
use whorl_recording::Channel;
use whorl_trajectory::spectrum::Fourier;

use crate::explanations::hypothesis::Hypothesis;
use crate::explanations::lines::{Lines, gamma_significance};
use crate::explanations::place::Place;

/// Lines looked at, strongest first.
const MOST_LINES: usize = 2;

/// Most lines that are evaluated by a regression of their own before they are looked at.
const MOST_FAINT: usize = 6;

/// Standard deviations from which on a peak is a line at all.
const NOTICED: f64 = 3.5;

/// Lines are looked for up to this many per turn of a wheel.
const HIGHEST_ORDER: f64 = 1.6;

/// Whitened residual of a run at every node.
struct Residual {
    run: usize,
    rate: Vec<Vector3<f64>>,
    speeds: Vec<Vec<f64>>,
}

/// A peak of a spectrum.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Peak {
    /// Cycles per unit of the axis.
    pub frequency: f64,
    /// Standard deviations above what is around it.
    pub significance: f64,
    /// Power around it, over that of the noise; at least 1.
    pub level: f64,
}

/// Finds lines in the whitened residual of the gyro, about axes of the room and of the body: torques that
/// have a frequency of their own, or that of a wheel.
pub(crate) fn lines(place: Place<'_>, of: &Hypothesis) -> Lines {
    let estimate = of.estimate.spread(place.design.columns.len());
    // Of each run: the residual at every node about axes of the body, and of each wheel's speed.
    let mut residuals: Vec<Residual> = Vec::new();
    let wheels = place.problem.reference.model.wheels().len();
    for (r, (run, whitened)) in place.problem.runs.iter().zip(&place.data.whitened).enumerate() {
        if run.clamped || run.nodes() < 64 {
            continue;
        }
        let mut series = vec![Vector3::zeros(); run.nodes()];
        let mut speeds = vec![vec![0.0; run.nodes()]; wheels];
        for ((e, reading), node) in
            whitened.residual(&estimate).iter().zip(&whitened.reading).zip(&whitened.node)
        {
            let slot = match reading.channel {
                Channel::Gyro => series.get_mut(*node as usize).and_then(|v| v.get_mut(reading.index())),
                Channel::WheelSpeed => {
                    speeds.get_mut(reading.index()).and_then(|list| list.get_mut(*node as usize))
                }
                _ => None,
            };
            if let Some(slot) = slot {
                *slot = e.clamp(-6.0, 6.0);
            }
        }
        residuals.push(Residual { run: r, rate: series, speeds });
    }
    let step_s = |r: usize| {
        let run = &place.problem.runs[r];
        (run.time(run.nodes() - 1) - run.time(0)) / (run.nodes() - 1) as f64
    };
    let Some(first_step_s) = residuals.first().map(|r| step_s(r.run)) else { return Lines::default() };
    let size = residuals.iter().map(|r| r.rate.len()).max().unwrap_or(0).next_power_of_two() * 2;
    let mut in_body = Spectrum::new(size);
    let mut in_room = Spectrum::new(size);
    for Residual { run, rate: series, .. } in &residuals {
        let stretch = step_s(*run) / first_step_s;
        let motion = &place.problem.motions[*run];
        let turned: Vec<Vector3<f64>> =
            series.iter().zip(&motion.q).map(|(e, q)| q.transform_vector(e)).collect();
        in_body.add(&axes(series), stretch);
        in_room.add(&axes(&turned), stretch);
    }
    let mut peaks: Vec<Peak> =
        in_body.peaks(first_step_s, 0.0).into_iter().chain(in_room.peaks(first_step_s, 0.0)).collect();
    peaks.retain(|peak| !is_of_turning(place, peak.frequency, first_step_s));
    peaks.sort_by(|a, b| b.significance.total_cmp(&a.significance));
    let mut chosen: Vec<Peak> = Vec::new();
    for peak in peaks {
        if chosen.len() < MOST_FAINT
            && chosen.iter().all(|c| (c.frequency - peak.frequency).abs() > 0.03 * peak.frequency)
        {
            chosen.push(peak);
        }
    }
    let settings = &place.problem.reference.settings;
    let mut orders = wheel_orders(place, &residuals);
    orders.retain(|(wheel, order, _)| {
        !place.turning.contains(wheel) || (order - 1.0).abs() > settings.imbalance_turn_share
    });
    let hz: Vec<f64> = chosen.iter().map(|p| p.frequency).take(MOST_LINES).collect();
    let strongest = chosen.first().map_or(0.0, |p| p.significance);
    let strongest_order = orders.first().map_or(0.0, |o| o.2);
    Lines {
        torque_hz: hz.clone(),
        sensor_hz: hz,
        faint_hz: chosen.iter().map(|p| p.frequency).collect(),
        modes: crate::explanations::modes::modes(place, of),
        strongest: strongest.max(strongest_order),
        // A line over time is blurred over a wheel's angle, and the other way round.
        orders: if strongest_order > settings.certain_stddevs.max(strongest) {
            orders.iter().take(1).map(|o| (o.0, o.1)).collect()
        } else {
            Vec::new()
        },
    }
}

/// Whether a wheel whose imbalance the samples show turns at this frequency at some time, or at one of which the nodes
/// make this one.
fn is_of_turning(place: Place<'_>, hz: f64, step_s: f64) -> bool {
    let sampled = |turning_hz: f64| (turning_hz - (turning_hz * step_s).round() / step_s).abs();
    let share = place.problem.reference.settings.imbalance_turn_share;
    place.turning.iter().any(|wheel| {
        place.problem.motions.iter().flat_map(|motion| &motion.wheel).any(|speeds| {
            let turning_hz = speeds[*wheel].abs() / std::f64::consts::TAU;
            (sampled(turning_hz) - hz).abs() < share * turning_hz
        })
    })
}

/// Lines over the angle of each wheel: wheel, cycles per turn, significance; strongest first.
fn wheel_orders(place: Place<'_>, residuals: &[Residual]) -> Vec<(usize, f64, f64)> {
    // Steps of the angle, small against a cycle of the highest order.
    let step_turns = 0.16 / HIGHEST_ORDER;
    let mut found = Vec::new();
    for wheel in 0..place.problem.reference.model.wheels().len() {
        let turns = |r: usize| -> Vec<f64> {
            let motion = &place.problem.motions[r];
            motion.wheel_angle.iter().map(|a| a[wheel] / std::f64::consts::TAU).collect()
        };
        let mut gridded: Vec<[Vec<f64>; 4]> = Vec::new();
        let mut longest = 0;
        let mut fewest_turns = f64::INFINITY;
        for Residual { run, rate, speeds } in residuals {
            let angle = turns(*run);
            let low = angle.iter().copied().fold(f64::INFINITY, f64::min);
            let high = angle.iter().copied().fold(f64::NEG_INFINITY, f64::max);
            fewest_turns = fewest_turns.min(high - low);
            let cells = ((high - low) / step_turns).clamp(0.0, 4e6) as usize + 1;
            longest = longest.max(cells);
            let mut grid: [Vec<f64>; 4] = std::array::from_fn(|_| vec![0.0; cells]);
            for ((turn, e), speed) in angle.iter().zip(rate).zip(&speeds[wheel]) {
                let cell = (((turn - low) / step_turns) as usize).min(cells - 1);
                for (list, x) in grid.iter_mut().zip(e.iter().chain([speed])) {
                    list[cell] += x;
                }
            }
            gridded.push(grid);
        }
        if fewest_turns < 40.0 {
            continue;
        }
        let mut spectrum = Spectrum::new(longest.next_power_of_two() * 2);
        for (grid, residual) in gridded.iter().zip(residuals) {
            spectrum.add_of(grid, residual.rate.len() as f64, 1.0);
        }
        // Slower than a few cycles a run is no periodicity of the wheel.
        for peak in spectrum.peaks(step_turns, 8.0 / fewest_turns) {
            if peak.frequency < HIGHEST_ORDER {
                found.push((wheel, peak.frequency, peak.significance));
            }
        }
    }
    found.sort_by(|a, b| b.2.total_cmp(&a.2));
    found
}

fn axes(series: &[Vector3<f64>]) -> [Vec<f64>; 3] {
    [0, 1, 2].map(|i| series.iter().map(|v| v[i]).collect())
}

/// Sum of the power spectra of series of unit variance.
pub(crate) struct Spectrum {
    size: usize,
    fourier: Fourier,
    power: Vec<f64>,
    series: f64,
}

impl Spectrum {
    /// For series of at most `size` entries.
    pub fn new(size: usize) -> Self {
        Self { size, fourier: Fourier::of_length(size), power: vec![0.0; size / 2], series: 0.0 }
    }

    /// Adds series whose steps are `stretch` times those of the first.
    pub fn add(&mut self, list: &[Vec<f64>], stretch: f64) {
        let length = list.first().map_or(0, Vec::len);
        self.add_of(list, length as f64, stretch);
    }

    /// As [`Self::add`], with the sum of the variances of each series' entries.
    pub fn add_of(&mut self, list: &[Vec<f64>], variance: f64, stretch: f64) {
        // An axis that no sensor watches has no spectrum.
        for series in list.iter().filter(|series| series.iter().any(|x| *x != 0.0)) {
            let power = self.fourier.power(series.iter().copied());
            for (m, power) in power.into_iter().enumerate().take(self.size / 2) {
                let at = (m as f64 / stretch).round() as usize;
                if let Some(slot) = self.power.get_mut(at) {
                    *slot += power / variance.max(1.0);
                }
            }
            self.series += 1.0;
        }
    }

    /// Peaks that stand out of the spectrum beside them, from frequency `from` on.
    pub fn peaks(&self, step: f64, from: f64) -> Vec<Peak> {
        let power = &self.power;
        let mut peaks = Vec::new();
        if self.series < 1.0 {
            return peaks;
        }
        let degrees = self.series;
        let first = ((from * self.size as f64 * step).ceil() as usize).max(2);
        for m in first..power.len().saturating_sub(2) {
            let here = power[m];
            if here < power[m - 1] || here < power[m + 1] || here < 1.5 * degrees {
                continue;
            }
            let (low, high) = (m.saturating_sub(40).max(1), (m + 41).min(power.len()));
            let median = median(power[low..high].iter().copied());
            // Noise alone: a sum of exponential variates of mean 1. A louder spectrum on both sides counts as noise.
            let level = (median / (degrees - 1.0 / 3.0)).max(1.0);
            let significance = gamma_significance(here / level, degrees);
            if significance < NOTICED {
                continue;
            }
            // Between two bins the line is where their amplitudes balance.
            let (left, right) = (power[m - 1].sqrt(), power[m + 1].sqrt());
            let shift =
                if right > left { right / (right + here.sqrt()) } else { -left / (left + here.sqrt()) };
            // Padded to twice the length or more, the peak is wider than a bin.
            peaks.push(Peak {
                frequency: (m as f64 + 0.5 * shift) / (self.size as f64 * step),
                significance,
                level,
            });
        }
        peaks
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_sine_in_noise_has_one_line() {
        let mut state = 4_u64;
        let mut noise = || {
            state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
            ((state >> 11) as f64 / (1u64 << 53) as f64 - 0.5) * 12f64.sqrt()
        };
        let step_s = 0.02;
        let series: Vec<f64> = (0..4000)
            .map(|k| 0.25 * (std::f64::consts::TAU * 3.217 * f64::from(k) * step_s).sin() + noise())
            .collect();
        let certain = crate::Settings::default().certain_stddevs;
        let mut spectrum = Spectrum::new(8192);
        spectrum.add(&[series], 1.0);
        let mut peaks = spectrum.peaks(step_s, 0.0);
        peaks.sort_by(|a, b| b.significance.total_cmp(&a.significance));
        assert!(peaks[0].significance > certain, "{peaks:?}");
        assert!((peaks[0].frequency - 3.217).abs() < 3e-3, "{peaks:?}");
        assert!(peaks.iter().skip(1).all(|p| p.significance < certain), "{peaks:?}");
    }

    #[test]
    fn the_tail_of_a_sum_of_exponentials_is_that_of_the_normal_law() {
        // P(sum of one exponential > x) = exp(-x): 2.33 and 3.09 standard deviations are 1e-2 and 1e-3.
        assert!((gamma_significance(100f64.ln(), 1.0) - 2.326).abs() < 0.05);
        assert!((gamma_significance(1000f64.ln(), 1.0) - 3.090).abs() < 0.08);
    }
}
