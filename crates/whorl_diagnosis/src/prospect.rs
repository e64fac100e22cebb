//! What further data would say: the basis of choosing the next manoeuvre.
//!
//! T-optimality (Atkinson and Fedorov, Biometrika 62, 1975): data are worth as much as the log odds that they
//! are expected to bring between the explanations that are left. In the whitened linear regression that
//! expectation needs no noise drawn: if explanation A is true, further data with the normal matrix N have the
//! expected right-hand side N theta_A, and every explanation is refitted to it together with the data at hand.

use whorl_dynamics::effects::find;
use whorl_dynamics::{ModelPrior, PlatformModel};
use whorl_recording::Recording;

use crate::candidates::Available;
use crate::hypothesis::Hypothesis;
use crate::parameters::BASE_EFFECTS;
use crate::problem::Dataset;
use crate::regression::{BLOCKS_PER_RUN, Estimate, Normal};
use crate::search::{LEAST_DROP, Search, systematic};
use crate::{DiagnosisError, Options, prepare};

/// What data say, or would say.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Prospect {
    /// Log odds between the leading explanation and the next, beyond what errors of constants and formulas may do: as they are
    /// with the data at hand; with further data as the true one is expected to lead, the mean over which of them is
    /// true. A diagnosis takes two for equal below 3. `None` with fewer than two.
    pub log_odds: Option<f64>,
    /// Effects that would show at their ordinary size (one standard deviation of the catalogue's prior).
    pub shown: Vec<String>,
    /// Effects that were looked at and would not.
    pub not_shown: Vec<String>,
}

/// What the data at hand say, and what they would say together with each further recording.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Prospects {
    /// With the data at hand.
    pub now: Prospect,
    /// With each further recording added, in their order.
    pub with: Vec<Prospect>,
}

/// Judges `further` recordings, real or simulated, by what each would add to `training`. Only their motion and
/// inputs count, not what their readings say of any effect. `explanations` are sets of effects, ids of the catalogue; an
/// empty set is the model without any.
///
/// # Errors
/// As [`crate::diagnose`].
pub fn prospects(
    training: &[Recording],
    further: &[Recording],
    model: &PlatformModel,
    prior: &ModelPrior,
    explanations: &[Vec<String>],
    options: &Options,
) -> Result<Prospects, DiagnosisError> {
    for id in explanations.iter().flatten() {
        find(id).ok_or_else(|| DiagnosisError::UnknownEffect { id: id.clone() })?;
    }
    let (mut problem, mut held) = prepare(training, further, model, prior, options, None, &mut |_| {})?;
    let mut search = Search::start(&mut problem, held.as_mut(), options, &mut |_| {})?;
    // Actuators and sensors that only the further recordings have make more effects testable.
    let own = search.available;
    let added = search.held_out.as_ref().map_or(own, |held| Available::of(&held.runs));
    let joint = Available {
        body: own.body || added.body,
        jets: own.jets || added.jets,
        wheels: own.wheels || added.wheels,
        wheel_command: own.wheel_command || added.wheel_command,
        accel: own.accel || added.accel,
        vector: own.vector || added.vector,
        temperature: own.temperature || added.temperature,
        ballast: own.ballast || added.ballast,
        bin_s: own.bin_s.max(added.bin_s),
        largest_rate_rad_s: own.largest_rate_rad_s.max(added.largest_rate_rad_s),
        largest_tilt_rad: own.largest_tilt_rad.max(added.largest_tilt_rad),
        clips: own.clips || added.clips,
    };
    let testable = |a: &Available| {
        [a.body, a.jets, a.wheels, a.wheel_command, a.accel, a.vector, a.temperature, a.ballast]
    };
    if testable(&joint) != testable(&own) {
        search.available = joint;
        search.relinearise()?;
    }
    let ids: Vec<&str> = explanations.iter().flatten().map(String::as_str).collect();
    make_columns_for(&mut search, &ids)?;
    let total = &search.data.total;
    let rivals: Vec<Hypothesis> = explanations.iter().filter_map(|set| explanation(&search, set)).collect();
    let nothing = Normal::zeros(search.layout.columns.len());
    let mut now = prospect(&search, total, &nothing, &rivals);
    let mut evidence: Vec<(f64, f64)> =
        rivals.iter().map(|h| (h.log_evidence, h.estimate.drop - search.base.estimate.drop)).collect();
    evidence.sort_by(|a, b| b.0.total_cmp(&a.0));
    now.log_odds = match evidence.as_slice() {
        [(first, drop), (second, _), ..] => Some(certain(first - second, *drop) / search.data.temper),
        _ => None,
    };
    let with = search
        .held_data
        .iter()
        .flat_map(|held: &Dataset| held.blocks.chunks(BLOCKS_PER_RUN))
        .map(|blocks| {
            let mut added = nothing.clone();
            for block in blocks {
                added.add(block, 1.0);
            }
            prospect(&search, total, &added, &rivals)
        })
        .collect();
    Ok(Prospects { now, with })
}

/// Makes the columns of effects that have them only on demand: lines and hidden states.
pub(crate) fn make_columns_for(search: &mut Search<'_>, ids: &[&str]) -> Result<(), DiagnosisError> {
    let model = &search.problem.reference.model;
    let on_demand = |id: &&str| {
        matches!(*id, "air_current_periodic" | "vibration_alias")
            || find(id).is_some_and(|effect| effect.hidden_states(model) > 0)
    };
    if ids.iter().any(on_demand) && !search.with_hidden {
        search.with_hidden = true;
        search.lines = crate::spectrum::lines(search, &search.base);
        search.relinearise()?;
    }
    Ok(())
}

/// Log odds that are left when constants and formulas err as much as they may.
fn certain(log_odds: f64, drop: f64) -> f64 {
    (log_odds.abs() - systematic(drop)).max(0.0).copysign(log_odds)
}

/// A set of effects fitted to the data at hand; `None` if they cannot enter.
fn explanation(search: &Search<'_>, set: &[String]) -> Option<Hypothesis> {
    let mut found = search.base.clone();
    for id in set {
        let candidate = search.layout.candidates.iter().position(|c| c.id == id.as_str())?;
        found = found.with(&search.layout, &search.data.total, candidate)?;
    }
    Some(found)
}

fn prospect(search: &Search<'_>, data: &Normal, added: &Normal, rivals: &[Hypothesis]) -> Prospect {
    let mut odds = Vec::new();
    for (truth, hypothesis) in rivals.iter().enumerate() {
        // What the added data are expected to hold if this one is true.
        let mut expected = data.clone();
        expected.matrix += &added.matrix;
        expected.vector += &added.matrix * hypothesis.estimate.spread(search.layout.columns.len());
        let base = Hypothesis::base(&search.layout, &expected);
        let fitted = |h: &Hypothesis| h.refitted(&search.layout, &expected).or_else(|| base.clone());
        let evidence = |h: &Hypothesis| fitted(h).map(|h| h.log_evidence);
        let own = fitted(hypothesis);
        let others = rivals.iter().enumerate().filter(|(k, _)| *k != truth).filter_map(|(_, h)| evidence(h));
        let best = others.fold(f64::NEG_INFINITY, f64::max);
        if let (Some(own), Some(base)) = (own.filter(|_| best.is_finite()), &base) {
            let drop = own.estimate.drop - base.estimate.drop;
            odds.push(certain(own.log_evidence - best, drop) / search.data.temper);
        }
    }
    let log_odds = (!odds.is_empty()).then(|| odds.iter().sum::<f64>() / odds.len() as f64);
    let mut both = data.clone();
    both.matrix += &added.matrix;
    let (mut shown, mut not_shown) = (Vec::new(), Vec::new());
    for candidate in &search.layout.candidates {
        if BASE_EFFECTS.contains(&candidate.id) {
            continue;
        }
        let columns = candidate.options.first().map_or(&[][..], Vec::as_slice);
        let largest = columns.iter().filter_map(|i| information(search, &both, *i)).fold(0.0, f64::max);
        let list = if largest > LEAST_DROP { &mut shown } else { &mut not_shown };
        list.push(candidate.id.to_owned());
    }
    Prospect { log_odds, shown, not_shown }
}

/// Detectability of a column at its unit, the base refitted.
fn information(search: &Search<'_>, normal: &Normal, column: usize) -> Option<f64> {
    let mut active: Vec<usize> = search.layout.base.iter().copied().filter(|i| *i != column).collect();
    active.push(column);
    let fit =
        Estimate::new(normal, &active, |c| if c == column { 1e6 } else { search.layout.base_variance(c) })?;
    let variance = fit.covariance()[(active.len() - 1, active.len() - 1)];
    (variance > 0.0).then(|| 1.0 / variance)
}

#[cfg(test)]
mod tests {
    use super::certain;

    #[test]
    fn log_odds_that_errors_may_make_are_worth_nothing() {
        // One per cent of a signal of misfit 1e6 has a misfit of 100, so log odds of 50; constants make 6 at most.
        assert!((certain(80.0, 1e6) - 24.0).abs() < 1e-9);
        assert!((certain(-80.0, 1e6) + 24.0).abs() < 1e-9);
        assert_eq!(certain(40.0, 1e6), 0.0);
        // A faint effect: two per cent of 100.
        assert!((certain(40.0, 100.0) - 38.0).abs() < 0.01);
        assert_eq!(certain(40.0, 0.0), 40.0);
    }
}
