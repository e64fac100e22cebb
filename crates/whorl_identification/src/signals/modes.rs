//! Resonances that the platform's own motion drives: sloshing masses and flexible appendages.

use nalgebra::{Matrix3, SymmetricEigen, Vector3};
use whorl_dynamics::PlatformModel;
use whorl_dynamics::effects::Resonance;
use whorl_math::noise::typical_step_s;
use whorl_math::resonance::{Driven, ringing};

use crate::Settings;
use crate::signals::observed::Observed;

/// Slower resonances are told from slow torques by the regression itself \[Hz\].
const SLOWEST_HZ: f64 = 0.15;
/// Resonances that are looked at, strongest first.
const MOST_MODES: usize = 3;
/// Resonances this close, as a share of the frequency, are one.
const SAME: f64 = 0.08;
/// Fewest samples of a run in which they are looked for.
const FEWEST: usize = 64;

/// Resonances in what a hypothesis leaves, strongest first, and the standard deviations by which each stands out.
pub(crate) fn resonances(
    observed: &[Observed<'_>],
    model: &PlatformModel,
    settings: &Settings,
) -> Vec<(Resonance, f64)> {
    let is_long = |run: &&Observed<'_>| run.loud.len() >= FEWEST && run.motion.time_s.len() >= FEWEST;
    // Where runs go without a random torque: a filter that has one follows slow swings.
    let driven = |run: &Observed<'_>| {
        let grid = run.grid(true);
        let rates: Vec<Vector3<f64>> = (0..=grid.len()).map(|k| run.motion.rate(grid.time(k))).collect();
        Driven::new([0, 1, 2].map(|i| grid.inertial[i].as_slice()), &rates, grid.step_s)
    };
    let runs: Vec<Driven> = observed.iter().filter(|run| !run.clamped).filter(is_long).map(driven).collect();
    let step_s = observed.iter().map(|run| typical_step_s(&run.motion.time_s)).fold(1e-3, f64::max);
    let mut found = ringing(&runs, SLOWEST_HZ, 0.3 / step_s, 0.8 * settings.certain_stddevs);
    found.sort_by(|a, b| b.significance.total_cmp(&a.significance));
    let inertia = Matrix3::from_diagonal(&model.mass_properties.inertia_b_kg_m2().diagonal());
    let mut chosen: Vec<(Resonance, f64)> = Vec::new();
    for mode in found {
        let (hz, damping_ratio) = (mode.hz, mode.damping_ratio);
        let is_near = |(known, _): &(Resonance, f64)| (known.hz - hz).abs() < SAME * hz.max(known.hz);
        if chosen.len() < MOST_MODES && !chosen.iter().any(is_near) {
            // Torque about i for acceleration about j is d_i d_j.
            let coupling = inertia * mode.coupling;
            let eigen = SymmetricEigen::new(0.5 * (coupling + coupling.transpose()));
            let axis_b = eigen.eigenvectors.column(eigen.eigenvalues.imax()).into_owned();
            chosen.push((Resonance { hz, damping_ratio, axis_b }, mode.significance));
        }
    }
    chosen
}
