//! Lines in the spectrum of what a fit leaves, and resonances that the platform's own motion drives: sloshing masses and flexible appendages.

use std::f64::consts::TAU;

use nalgebra::{Matrix3, SymmetricEigen, Vector3};
use whorl_dynamics::PlatformModel;
use whorl_dynamics::effects::Resonance;
use whorl_math::noise::typical_step_s;
use whorl_math::resonance::{Driven, Ringing, ringing};
use whorl_math::spectrum::{Gridded, Peak, peaks};

use crate::Settings;
use crate::signals::observed::Observed;

/// Lines, and resonances, that are looked at, strongest first.
const MOST: usize = 3;
/// Fewest samples of a run in which they are looked for.
const FEWEST: usize = 64;
/// Lines this close, as a share of the frequency, are one; and so are resonances.
const SAME: f64 = 0.03;
const SAME_RESONANCE: f64 = 0.08;
/// Slower resonances are told from slow torques by the regression itself \[Hz\].
const SLOWEST_HZ: f64 = 0.15;

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
    pub fn of(runs: &[Observed<'_>], model: &PlatformModel, turning: &[usize], settings: &Settings) -> Self {
        let free: Vec<_> = runs.iter().filter(|run| !run.clamped && run.loud.len() >= FEWEST).collect();
        let has_quiet = runs.iter().any(|run| run.quiet.is_some());
        let loudness = [false, true].into_iter().filter(|quiet| has_quiet || !quiet);
        let mut found: Vec<Peak> = loudness.flat_map(|quiet| peaks_in_time(&free, quiet)).collect();
        found.retain(|peak| !is_of_turning(runs, turning, peak.frequency, settings));
        let chosen = strongest(found, |peak| (peak.significance, peak.frequency), SAME);
        let ringing = ringing_of(runs, &free, settings);
        let certain = ringing.iter().filter(|mode| mode.significance > settings.certain_stddevs);
        let inertia = Matrix3::from_diagonal(&model.mass_properties.inertia_b_kg_m2().diagonal());
        let resonance = |mode: &Ringing| {
            // Torque about i for acceleration about j is d_i d_j.
            let coupling = inertia * mode.coupling;
            let eigen = SymmetricEigen::new(0.5 * (coupling + coupling.transpose()));
            let axis_b = eigen.eigenvectors.column(eigen.eigenvalues.imax()).into_owned();
            Resonance { hz: mode.hz, damping_ratio: mode.damping_ratio, axis_b }
        };
        Self {
            hz: chosen.iter().map(|peak| peak.frequency).collect(),
            fastest_resonance_hz: certain.map(|mode| mode.hz).fold(0.0, f64::max),
            resonances: ringing.iter().map(resonance).collect(),
            strongest: chosen.first().map_or(0.0, |peak| peak.significance),
            frequencies: runs.iter().map(|run| run.loud.len()).max().unwrap_or(1).max(2) as f64,
        }
    }
}

/// The strongest of several at frequencies that are further apart than a share of them; `of`: significance and frequency.
fn strongest<T>(mut all: Vec<T>, of: impl Fn(&T) -> (f64, f64), same: f64) -> Vec<T> {
    all.sort_by(|a, b| of(b).0.total_cmp(&of(a).0));
    let mut chosen: Vec<T> = Vec::new();
    for one in all {
        let hz = of(&one).1;
        let is_apart = |known: &T| (of(known).1 - hz).abs() > same * hz.max(of(known).1);
        if chosen.len() < MOST && chosen.iter().all(is_apart) {
            chosen.push(one);
        }
    }
    chosen
}

/// Resonances in what a hypothesis leaves. Where runs go without a random torque: a filter that has one follows slow swings.
fn ringing_of(observed: &[Observed<'_>], free: &[&Observed<'_>], settings: &Settings) -> Vec<Ringing> {
    let driven = |run: &&Observed<'_>| {
        let grid = run.grid(true);
        let rates: Vec<Vector3<f64>> = (0..=grid.len()).map(|k| run.motion.rate(grid.time(k))).collect();
        Driven::new([0, 1, 2].map(|i| grid.inertial[i].as_slice()), &rates, grid.step_s)
    };
    let runs: Vec<Driven> = free.iter().filter(|run| run.motion.states.len() >= FEWEST).map(driven).collect();
    let step_s = observed.iter().map(|run| typical_step_s(&run.motion.times_s())).fold(1e-3, f64::max);
    let found = ringing(&runs, SLOWEST_HZ, 0.3 / step_s, 0.8 * settings.certain_stddevs);
    strongest(found, |mode| (mode.significance, mode.hz), SAME_RESONANCE)
}

/// Of the gyro's innovations, and about the axes of the room.
fn peaks_in_time(runs: &[&Observed<'_>], quiet: bool) -> Vec<Peak> {
    let Some(step_s) = runs.first().map(|run| run.grid(quiet).step_s) else { return Vec::new() };
    let part = |run: &&Observed<'_>, in_room: bool| {
        let grid = run.grid(quiet);
        let rate = |k: usize| Vector3::from_fn(|i, _| grid.inertial[i][k]);
        let turned = |k: usize| run.motion.attitude(grid.time(k)).transform_vector(&rate(k));
        let rates: Vec<_> = (0..grid.len()).map(|k| if in_room { turned(k) } else { rate(k) }).collect();
        let series = (0..3).map(|i| rates.iter().map(|v| v[i]).collect()).collect();
        Gridded { series, variance: grid.len() as f64, stretch: grid.step_s / step_s }
    };
    let of = |in_room: bool| {
        let parts: Vec<Gridded> = runs.iter().map(|run| part(run, in_room)).collect();
        peaks(&parts, step_s, 0.0)
    };
    [false, true].into_iter().flat_map(of).collect()
}

/// Whether a wheel whose imbalance shows turns at this frequency at some time, or at one of which the samples make this one.
fn is_of_turning(observed: &[Observed<'_>], turning: &[usize], hz: f64, settings: &Settings) -> bool {
    let turns = |step_s: f64, speed_rad_s: f64| {
        let turning_hz = speed_rad_s.abs() / TAU;
        let sampled_hz = (turning_hz - (turning_hz * step_s).round() / step_s).abs();
        (sampled_hz - hz).abs() < settings.imbalance_turn_share * turning_hz
    };
    observed.iter().any(|run| {
        let speeds = run.motion.states.iter().map(|state| &state.wheel_speed_rad_s);
        let mut of_turning = speeds.flat_map(|all| turning.iter().filter_map(|wheel| all.get(*wheel)));
        of_turning.any(|speed| turns(run.loud.step_s, *speed))
    })
}
