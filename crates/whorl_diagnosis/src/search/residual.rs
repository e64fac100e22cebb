//! The residual of a set: slow sums that noise alone would not give.

use crate::evidence::excess::{Power, WINDOWS_S, powers};
use crate::evidence::problem::{Dataset, Problem};
use crate::explanations::candidates::Design;
use crate::explanations::hypothesis::Hypothesis;

/// Slow power of the residual of all runs with a hypothesis.
pub(crate) fn residual_powers(
    problem: &Problem,
    data: &Dataset,
    design: &Design,
    hypothesis: &Hypothesis,
) -> [Power; WINDOWS_S.len()] {
    let mut total = [Power::default(); WINDOWS_S.len()];
    for of_run in residual_powers_by_run(problem, data, design, hypothesis) {
        for (sum, power) in total.iter_mut().zip(of_run) {
            sum.add(power);
        }
    }
    total
}

fn residual_powers_by_run(
    problem: &Problem,
    data: &Dataset,
    design: &Design,
    hypothesis: &Hypothesis,
) -> Vec<[Power; WINDOWS_S.len()]> {
    let estimate = hypothesis.estimate.spread(design.columns.len());
    problem
        .runs
        .iter()
        .zip(&data.whitened)
        .map(|(run, whitened)| {
            let duration_s = run.time(run.nodes() - 1) - run.time(0);
            powers(whitened, &whitened.residual(&estimate), duration_s)
        })
        .collect()
}

/// RMS over the windows of 1 and 8 s: the whitened momentum residual.
pub(crate) fn momentum_rms(powers: &[Power; WINDOWS_S.len()]) -> f64 {
    let mut both = Power::default();
    for (power, window_s) in powers.iter().zip(WINDOWS_S) {
        if window_s == 1.0 || window_s == 8.0 {
            both.add(*power);
        }
    }
    both.rms()
}

/// The most significant window.
pub(crate) fn worst(powers: &[Power; WINDOWS_S.len()]) -> usize {
    let mut best = 0;
    for (i, power) in powers.iter().enumerate() {
        if power.significance() > powers[best].significance() {
            best = i;
        }
    }
    best
}
