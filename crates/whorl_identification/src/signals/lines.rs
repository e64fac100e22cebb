//! Lines in the spectrum of what a fit leaves: over time, and over the angle of each wheel.

use nalgebra::Vector3;
use whorl_dynamics::PlatformModel;

use crate::Settings;
use crate::signals::modes::{Mode, modes};
use crate::signals::observed::{Grid, Observed};
use crate::signals::spectrum::{Peak, Spectrum};

/// Lines looked at, strongest first.
const MOST_LINES: usize = 3;
/// Lines are looked for up to this many per turn of a wheel.
const HIGHEST_ORDER: f64 = 1.6;
/// Fewest samples of a run in which lines are looked for.
const FEWEST: usize = 64;
/// Lines this close, as a share of the frequency, are one.
const SAME: f64 = 0.03;

/// Periodicities of what a fit leaves.
#[derive(Debug, Clone, Default)]
pub(crate) struct Lines {
    /// Lines over time, strongest first \[Hz\].
    pub hz: Vec<f64>,
    /// Lines over the angle of a wheel: wheel, cycles per turn.
    pub orders: Vec<(usize, f64)>,
    /// Resonances that the motion drives.
    pub modes: Vec<Mode>,
    /// Standard deviations by which the strongest line stands out.
    pub strongest: f64,
    /// Frequencies at which a line might have been.
    pub frequencies: f64,
}

impl Lines {
    /// Whether something periodic shows that is faster than this \[Hz\], or goes with a wheel.
    pub fn is_any_faster(&self, hz: f64, settings: &Settings) -> bool {
        // Of lines only the strongest is known to be one.
        let is_certain = self.strongest > settings.certain_stddevs;
        is_certain && (!self.orders.is_empty() || self.hz.first().is_some_and(|line| *line > hz))
            || self.modes.iter().any(|mode| mode.hz > hz && mode.significance > settings.certain_stddevs)
    }

    /// In what these runs leave; wheels whose imbalance the samples show turn at no frequency of their own.
    pub fn of(
        observed: &[Observed<'_>],
        model: &PlatformModel,
        turning: &[usize],
        settings: &Settings,
    ) -> Self {
        let mut peaks: Vec<Peak> = Vec::new();
        let grids = |quiet: bool| -> Vec<(&Observed<'_>, &Grid)> {
            let free = observed.iter().filter(|run| !run.clamped && run.loud.len() >= FEWEST);
            free.map(|run| (run, run.grid(quiet))).collect()
        };
        let has_quiet = observed.iter().any(|run| run.quiet.is_some());
        for quiet in [false, true].into_iter().filter(|quiet| has_quiet || !quiet) {
            peaks.extend(peaks_of(&grids(quiet)));
        }
        peaks.retain(|peak| !is_of_turning(observed, turning, peak.frequency, settings));
        peaks.sort_by(|a, b| b.significance.total_cmp(&a.significance));
        let mut chosen: Vec<Peak> = Vec::new();
        for peak in peaks {
            let is_new = |c: &Peak| (c.frequency - peak.frequency).abs() > SAME * peak.frequency;
            if chosen.len() < MOST_LINES && chosen.iter().all(is_new) {
                chosen.push(peak);
            }
        }
        let mut orders = wheel_orders(observed, model);
        orders.retain(|(wheel, order, _)| {
            !turning.contains(wheel) || (order - 1.0).abs() > settings.imbalance_turn_share
        });
        let strongest = chosen.first().map_or(0.0, |peak| peak.significance);
        let strongest_order = orders.first().map_or(0.0, |order| order.2);
        Self {
            hz: chosen.iter().map(|peak| peak.frequency).collect(),
            modes: modes(observed, model, settings),
            strongest: strongest.max(strongest_order),
            frequencies: observed.iter().map(|run| run.loud.len()).max().unwrap_or(1).max(2) as f64,
            // A line over time is blurred over a wheel's angle, and the other way round.
            orders: if strongest_order > settings.certain_stddevs.max(strongest) {
                orders.iter().take(1).map(|order| (order.0, order.1)).collect()
            } else {
                Vec::new()
            },
        }
    }
}

/// The gyro's innovations, and about the axes of the room.
fn peaks_of(grids: &[(&Observed<'_>, &Grid)]) -> Vec<Peak> {
    let Some(step_s) = grids.first().map(|(_, grid)| grid.step_s) else { return Vec::new() };
    let size = grids.iter().map(|(_, grid)| grid.len()).max().unwrap_or(0).next_power_of_two() * 2;
    let (mut in_body, mut in_room) = (Spectrum::new(size), Spectrum::new(size));
    for (run, grid) in grids {
        let stretch = grid.step_s / step_s;
        let rate = |k: usize| Vector3::new(grid.inertial[0][k], grid.inertial[1][k], grid.inertial[2][k]);
        let turned: Vec<Vector3<f64>> =
            (0..grid.len()).map(|k| run.motion.attitude(grid.time(k)).transform_vector(&rate(k))).collect();
        in_body.add(&grid.inertial[..3], stretch);
        in_room.add(&[0, 1, 2].map(|i| turned.iter().map(|v| v[i]).collect::<Vec<f64>>()), stretch);
    }
    in_body.peaks(step_s, 0.0).into_iter().chain(in_room.peaks(step_s, 0.0)).collect()
}

/// Whether a wheel whose imbalance the samples show turns at this frequency at some time, or at one of which the samples
/// make this one.
fn is_of_turning(observed: &[Observed<'_>], turning: &[usize], hz: f64, settings: &Settings) -> bool {
    turning.iter().any(|wheel| {
        observed.iter().any(|run| {
            let step_s = run.loud.step_s;
            let sampled = |turning_hz: f64| (turning_hz - (turning_hz * step_s).round() / step_s).abs();
            run.motion.wheel.iter().filter_map(|speeds| speeds.get(*wheel)).any(|speed| {
                let turning_hz = speed.abs() / std::f64::consts::TAU;
                (sampled(turning_hz) - hz).abs() < settings.imbalance_turn_share * turning_hz
            })
        })
    })
}

/// Lines over the angle of each wheel: wheel, cycles per turn, significance; strongest first.
fn wheel_orders(observed: &[Observed<'_>], model: &PlatformModel) -> Vec<(usize, f64, f64)> {
    // Steps of the angle, small against a cycle of the highest order.
    let step_turns = 0.16 / HIGHEST_ORDER;
    let free: Vec<&Observed<'_>> =
        observed.iter().filter(|run| !run.clamped && run.loud.len() >= FEWEST).collect();
    let mut found = Vec::new();
    for wheel in 0..model.wheels().len() {
        let mut gridded: Vec<[Vec<f64>; 4]> = Vec::new();
        let (mut longest, mut fewest_turns) = (0, f64::INFINITY);
        for run in &free {
            let grid = &run.loud;
            let angle: Vec<f64> = (0..grid.len())
                .map(|k| run.motion.wheel_at(wheel, grid.time(k)).1 / std::f64::consts::TAU)
                .collect();
            let low = angle.iter().copied().fold(f64::INFINITY, f64::min);
            let high = angle.iter().copied().fold(f64::NEG_INFINITY, f64::max);
            fewest_turns = fewest_turns.min(high - low);
            let cells = ((high - low) / step_turns).clamp(0.0, 4e6) as usize + 1;
            longest = longest.max(cells);
            let mut cells_of: [Vec<f64>; 4] = std::array::from_fn(|_| vec![0.0; cells]);
            let speeds = grid.wheels.get(wheel).map_or(&[][..], Vec::as_slice);
            for (k, turn) in angle.iter().enumerate() {
                let cell = (((turn - low) / step_turns) as usize).min(cells - 1);
                let rates = grid.inertial[..3].iter().map(|axis| axis[k]);
                let speed = speeds.get(k).copied().unwrap_or(0.0);
                for (list, x) in cells_of.iter_mut().zip(rates.chain([speed])) {
                    list[cell] += x;
                }
            }
            gridded.push(cells_of);
        }
        if fewest_turns < 40.0 || !fewest_turns.is_finite() {
            continue;
        }
        let mut spectrum = Spectrum::new(longest.next_power_of_two() * 2);
        for (cells, run) in gridded.iter().zip(&free) {
            spectrum.add_of(cells, run.loud.len() as f64, 1.0);
        }
        // Slower than a few cycles a run is no periodicity of the wheel.
        let peaks = spectrum.peaks(step_turns, 8.0 / fewest_turns);
        found.extend(
            peaks
                .iter()
                .filter(|p| p.frequency < HIGHEST_ORDER)
                .map(|p| (wheel, p.frequency, p.significance)),
        );
    }
    found.sort_by(|a, b| b.2.total_cmp(&a.2));
    found
}
