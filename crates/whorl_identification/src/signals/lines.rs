//! Lines in the spectrum of what a fit leaves.

use std::f64::consts::TAU;

use nalgebra::Vector3;
use whorl_dynamics::PlatformModel;
use whorl_dynamics::effects::Resonance;
use whorl_math::spectrum::{Gridded, Peak, peaks};

use crate::Settings;
use crate::signals::modes::resonances;
use crate::signals::observed::Observed;

/// Lines looked at, strongest first.
const MOST_LINES: usize = 3;
/// Fewest samples of a run in which lines are looked for.
const FEWEST: usize = 64;
/// Lines this close, as a share of the frequency, are one.
const SAME: f64 = 0.03;

/// Periodicities of what a fit leaves.
#[derive(Debug, Clone, Default)]
pub(crate) struct Lines {
    /// Lines over time, strongest first \[Hz\].
    pub hz: Vec<f64>,
    /// Resonances that the motion drives, strongest first, and of the fastest that is certain the frequency \[Hz\].
    pub resonances: Vec<Resonance>,
    fastest_resonance_hz: f64,
    /// Standard deviations by which the strongest line stands out.
    pub strongest: f64,
    /// Frequencies at which a line might have been.
    pub frequencies: f64,
}

impl Lines {
    /// Whether something periodic shows that is faster than this \[Hz\].
    pub fn is_any_faster(&self, hz: f64, settings: &Settings) -> bool {
        // Of lines only the strongest is known to be one.
        let is_certain = self.strongest > settings.certain_stddevs;
        is_certain && self.hz.first().is_some_and(|line| *line > hz) || self.fastest_resonance_hz > hz
    }

    /// In what these runs leave; wheels whose imbalance the samples show turn at no frequency of their own.
    pub fn of(
        observed: &[Observed<'_>],
        model: &PlatformModel,
        turning: &[usize],
        settings: &Settings,
    ) -> Self {
        let free: Vec<&Observed<'_>> =
            observed.iter().filter(|run| !run.clamped && run.loud.len() >= FEWEST).collect();
        let has_quiet = observed.iter().any(|run| run.quiet.is_some());
        let loudness = [false, true].into_iter().filter(|quiet| has_quiet || !quiet);
        let mut found: Vec<Peak> = loudness.flat_map(|quiet| peaks_in_time(&free, quiet)).collect();
        found.retain(|peak| !is_of_turning(observed, turning, peak.frequency, settings));
        found.sort_by(|a, b| b.significance.total_cmp(&a.significance));
        let mut chosen: Vec<Peak> = Vec::new();
        for peak in found {
            let is_new = |c: &Peak| (c.frequency - peak.frequency).abs() > SAME * peak.frequency;
            if chosen.len() < MOST_LINES && chosen.iter().all(is_new) {
                chosen.push(peak);
            }
        }
        let strongest = chosen.first().map_or(0.0, |peak| peak.significance);
        let resonances = resonances(observed, model, settings);
        let certain = resonances.iter().filter(|(_, stddevs)| *stddevs > settings.certain_stddevs);
        Self {
            hz: chosen.iter().map(|peak| peak.frequency).collect(),
            fastest_resonance_hz: certain.map(|(resonance, _)| resonance.hz).fold(0.0, f64::max),
            resonances: resonances.into_iter().map(|(resonance, _)| resonance).collect(),
            strongest,
            frequencies: observed.iter().map(|run| run.loud.len()).max().unwrap_or(1).max(2) as f64,
        }
    }
}

/// Of the gyro's innovations, and about the axes of the room.
fn peaks_in_time(runs: &[&Observed<'_>], quiet: bool) -> Vec<Peak> {
    let Some(step_s) = runs.first().map(|run| run.grid(quiet).step_s) else { return Vec::new() };
    let part = |run: &&Observed<'_>, in_room: bool| {
        let grid = run.grid(quiet);
        let rate = |k: usize| Vector3::from_fn(|i, _| grid.inertial[i][k]);
        let turned = |k: usize| run.motion.attitude(grid.time(k)).transform_vector(&rate(k));
        let rates: Vec<Vector3<f64>> =
            (0..grid.len()).map(|k| if in_room { turned(k) } else { rate(k) }).collect();
        let series = (0..3).map(|i| rates.iter().map(|v| v[i]).collect()).collect();
        Gridded { series, variance: grid.len() as f64, stretch: grid.step_s / step_s }
    };
    let of = |in_room: bool| {
        let parts: Vec<Gridded> = runs.iter().map(|run| part(run, in_room)).collect();
        peaks(&parts, step_s, 0.0)
    };
    of(false).into_iter().chain(of(true)).collect()
}

/// Whether a wheel whose imbalance the samples show turns at this frequency at some time, or at one of which the samples
/// make this one.
fn is_of_turning(observed: &[Observed<'_>], turning: &[usize], hz: f64, settings: &Settings) -> bool {
    turning.iter().any(|wheel| {
        observed.iter().any(|run| {
            let step_s = run.loud.step_s;
            let sampled = |turning_hz: f64| (turning_hz - (turning_hz * step_s).round() / step_s).abs();
            run.motion.wheel.iter().filter_map(|speeds| speeds.get(*wheel)).any(|speed| {
                let turning_hz = speed.abs() / TAU;
                (sampled(turning_hz) - hz).abs() < settings.imbalance_turn_share * turning_hz
            })
        })
    })
}
