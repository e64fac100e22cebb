//! When two explanations are both kept.
//!
//! Noise alone lets the wrong one of two lead now and then, and so do constants and formulas that are not those of
//! the real platform. What is closer than these may do is a tie, and both are stated.

use crate::excess::{Power, WINDOWS_S};
use crate::search::{LEAST_EVIDENCE, Search};

/// Explanations closer than this in log evidence are both kept. Noise alone lets the wrong one of two lead by so
/// much in fewer than one case of a hundred, however far apart they are: their difference is normal with a
/// variance of twice its mean.
pub(crate) const TIE: f64 = 3.0;

/// What constants that are wrong by some per cent (inertia, thrust) may add to or take from the log evidence by which
/// one of two like effects leads: this share of the drop that they explain, and no more than twice what noise may do.
const CONSTANTS_ERROR: f64 = 0.02;

/// Relative error of a formula along the difference between two given effects: laws of friction, flow and fields
/// with constant coefficients follow real parts to some per cent, and about a third of such an error, in a space of
/// many motions, points from one effect to the other.
const FORMULA_ERROR: f64 = 0.01;

/// Of an error of a formula, a third of whose size points from one effect to the other, a ninth of its square lies
/// there and eight ninths remain in the data, whichever of the two is fitted: a winner that leaves little has a
/// formula that errs little.
const ALONG_TO_ACROSS: f64 = 1.0 / 8.0;

/// Log evidence that an explanation of this drop of the misfit may gain or lose because constants and formulas are
/// not those of the real platform. An error of the signal of relative size e has a misfit of e^2 of the drop, and a
/// wrong formula gains at most what it has by following all of it. `rest` is the misfit that the leading
/// explanation may leave beyond noise.
pub(crate) fn systematic(drop: f64, rest: f64) -> f64 {
    let drop = drop.max(0.0);
    let formula = (FORMULA_ERROR.powi(2) * drop).min(ALONG_TO_ACROSS * rest.max(0.0));
    (CONSTANTS_ERROR * drop).min(2.0 * TIE) + 0.5 * formula
}

/// Misfit of structured errors that windows of several lengths do not exclude: what is found in the worst of them,
/// and two standard deviations of what noise may have hidden. Only where laws of torques differ: over a second or more.
pub(crate) fn rest_not_excluded(powers: &[Power; WINDOWS_S.len()]) -> f64 {
    let slow = powers.iter().zip(WINDOWS_S).filter(|(_, window_s)| *window_s >= 1.0).map(|(p, _)| p);
    slow.map(|p| p.excess() + 2.0 * (2.0 * p.count).sqrt()).fold(0.0, f64::max)
}

/// By how much a lead in log evidence and in the drop of the misfit goes beyond a margin; negative for a tie. An
/// explanation that fits as well and loses only by the price of its further parameters is not refuted by the data.
pub(crate) fn beyond((evidence, drop): (f64, f64), margin: f64) -> f64 {
    (evidence - margin).min((0.5 * drop - margin).max(evidence - 2.0 * LEAST_EVIDENCE))
}

impl Search<'_> {
    /// Misfit that the best set may leave beyond noise.
    pub(crate) fn rest_of_best(&self) -> f64 {
        rest_not_excluded(&crate::answer::rest(self.problem, &self.data, &self.layout, &self.best))
    }

    /// Log evidence by which an explanation must lead its rivals, given the drop of the misfit that an effect brings:
    /// what noise may do, and what errors of constants and formulas may.
    pub(crate) fn tie(&self, drop: f64) -> f64 {
        TIE * self.data.temper + systematic(drop, self.rest)
    }

    /// Whether a rival of this advantage in log evidence and in the drop of the misfit explains the data as well as
    /// an effect that brings `effect_drop`.
    pub(crate) fn is_tie(&self, (evidence, drop): (f64, f64), effect_drop: f64) -> bool {
        beyond((-evidence, -drop), self.tie(effect_drop)) < 0.0
    }
}
