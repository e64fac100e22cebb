//! Expected information of further data: the basis of choosing the next manoeuvre.
//!
//! T-optimality (Atkinson and Fedorov, Biometrika 62, 1975): data are worth as much as the log odds that they
//! are expected to bring between the explanations that are left. In the whitened linear regression that
//! expectation needs no noise drawn: if explanation A is true, further data with the normal matrix N have the
//! expected right-hand side N theta_A, and every explanation is refitted to it together with the data at hand.

use whorl_dynamics::effects::{Need, find};
use whorl_dynamics::{ModelPrior, PlatformModel};
use whorl_math::statistics::normal_probability;
use whorl_recording::Recording;

use crate::evidence::problem::{Dataset, FREE_RATE_WALK, ProcessNoise};
use crate::evidence::regression::{BLOCKS_PER_RUN, Normal};
use crate::explanations::hypothesis::Hypothesis;
use crate::parameters::available::Available;
use crate::search::Search;
use crate::search::prior::log_prior;
use crate::search::step::regression_at;
use crate::{DiagnosisError, Options, prepare};

/// Information in data on which explanation is true: as it is, or as it is expected to be.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct ExpectedInformation {
    /// Log odds between the leading explanation and the next. With the data at hand: the present ones. With further data: the
    /// expected lead of the true explanation, averaged over which one is true. A diagnosis names one alone from about 3 (20
    /// to 1). `None` with fewer than two.
    pub log_odds: Option<f64>,
    /// Probability that a diagnosis would tell the true explanation from all others, averaged over which one is true.
    /// `None` with fewer than two.
    pub told_apart: Option<f64>,
    /// Effects that would show at their ordinary size (one standard deviation of the catalogue's prior).
    pub shown: Vec<String>,
    /// Effects that were looked at and would not.
    pub not_shown: Vec<String>,
}

/// Information in the data at hand, and that expected together with each further recording.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct InformationByRun {
    /// With the data at hand.
    pub now: ExpectedInformation,
    /// With each further recording added, in their order.
    pub with: Vec<ExpectedInformation>,
}

/// Information that each of the `further` recordings, real or simulated, is expected to add to `training`. Only their motion and
/// inputs count, not their readings. `explanations` are sets of effects, ids of the catalogue; an
/// empty set is the model without any.
///
/// # Errors
/// As [`crate::diagnose`].
pub fn expected_information(
    training: &[Recording],
    further: &[Recording],
    model: &PlatformModel,
    prior: &ModelPrior,
    explanations: &[Vec<String>],
    options: &Options,
) -> Result<InformationByRun, DiagnosisError> {
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
        voltage: own.voltage || added.voltage,
        ballast: own.ballast || added.ballast,
        gimbals: own.gimbals || added.gimbals,
        bin_s: own.bin_s.max(added.bin_s),
        largest_rate_rad_s: own.largest_rate_rad_s.max(added.largest_rate_rad_s),
        largest_tilt_rad: own.largest_tilt_rad.max(added.largest_tilt_rad),
        largest_turn_rad: own.largest_turn_rad.max(added.largest_turn_rad),
        clips: own.clips || added.clips,
    };
    let testable = |a: &Available| {
        [
            a.body,
            a.jets,
            a.wheels,
            a.wheel_command,
            a.gimbals,
            a.accel,
            a.vector,
            a.temperature,
            a.voltage,
            a.ballast,
            a.has(Need::HalfATurn),
        ]
    };
    if testable(&joint) != testable(&own) {
        search.available = joint;
        search.relinearise()?;
    }
    let ids: Vec<&str> = explanations.iter().flatten().map(String::as_str).collect();
    make_columns_for(&mut search, &ids)?;
    go_to_leading(&mut search, explanations)?;
    let total = &search.data.total;
    let rivals: Vec<Hypothesis> = explanations.iter().filter_map(|set| explanation(&search, set)).collect();
    let nothing = Normal::zeros(search.design.columns.len());
    let weights = weights(&search, &rivals);
    let mut now = expected_of(&search, total, &nothing, &rivals, &weights);
    let mut weights_now: Vec<f64> = rivals.iter().map(|h| weight(&search, h)).collect();
    weights_now.sort_by(|a, b| b.total_cmp(a));
    now.log_odds = match weights_now.as_slice() {
        [first, second, ..] => Some(first - second),
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
            expected_of(&search, total, &added, &rivals, &weights)
        })
        .collect();
    Ok(InformationByRun { now, with })
}

/// Makes the columns of effects that have them only on demand: lines and hidden states.
pub(crate) fn make_columns_for(search: &mut Search<'_>, ids: &[&str]) -> Result<(), DiagnosisError> {
    let model = &search.problem.reference.model;
    let on_demand = |id: &&str| {
        find(id).is_some_and(|effect| effect.periodicity().is_some() || effect.hidden_states(model) > 0)
    };
    if ids.iter().any(on_demand) && !search.with_hidden {
        search.with_hidden = true;
        search.lines = crate::explanations::spectrum::lines(search.place(), &search.base);
        search.relinearise()?;
    }
    Ok(())
}

/// Goes to where the leading explanation fits the data at hand best: what a large effect does, and what the others
/// leave of it, is far from linear in its size.
fn go_to_leading(search: &mut Search<'_>, explanations: &[Vec<String>]) -> Result<(), DiagnosisError> {
    // The motion of further recordings is that of their readings, whatever effect they hold or not.
    if let Some(held) = &mut search.held_out {
        held.smooth(&search.point, ProcessNoise::Fixed(FREE_RATE_WALK))?;
    }
    let further = search.held_out.take();
    let leading = explanations.first().and_then(|set| explanation(search, set));
    if let Some(leading) = leading.filter(|l| !l.terms.is_empty())
        && let Some(converged) = search.converge(&leading)?
    {
        search.settle(converged)?;
    }
    search.held_out = further;
    if let Some(held) = &search.held_out {
        let data = regression_at(held, &search.point, &search.design, search.relative_error)?;
        search.held_data = Some(data);
    }
    Ok(())
}

/// Lead in log posterior from which an explanation is sure.
fn sure_lead(sure: f64) -> f64 {
    (sure / (1.0 - sure)).ln()
}

/// Probability that an explanation with this expected lead over a rival, in log evidence and in misfit, becomes sure. Noise
/// gives a lead in log evidence a variance of twice its mean, which is half the lead in the misfit. The expectation is
/// linear in the effect's size, for a motion that the effect itself will change, and is taken to be right to half of its size.
fn probability_of_telling(lead: (f64, f64), sure: f64) -> f64 {
    let drop = lead.1.max(0.0);
    normal_probability((lead.0 - sure_lead(sure)) / (1.0 + drop + (0.25 * drop).powi(2)).sqrt())
}

/// Log posterior of an explanation in the present regression, up to a constant.
fn weight(search: &Search<'_>, hypothesis: &Hypothesis) -> f64 {
    hypothesis.log_evidence + log_prior(&hypothesis.names(&search.design), &search.options.settings)
}

/// A set of effects fitted to the data at hand; `None` if they cannot enter.
fn explanation(search: &Search<'_>, set: &[String]) -> Option<Hypothesis> {
    let mut found = search.base.clone();
    for id in set {
        let candidate = search.design.candidates.iter().position(|c| c.id == id.as_str())?;
        found = found.with(&search.design, &search.data.total, candidate)?;
    }
    Some(found)
}

/// Ways to enter that are tried anew where the data are others.
const MOST_WAYS: usize = 32;

/// An explanation fitted to other data. An effect that can enter in several ways (a cable at any heading, damped or not)
/// enters in the one that these data like best.
fn chosen_anew(search: &Search<'_>, hypothesis: &Hypothesis, data: &Normal) -> Option<Hypothesis> {
    let same = hypothesis.refitted(&search.design, data);
    let ways = |candidate: usize| search.design.candidates.get(candidate).map_or(0, |c| c.options.len());
    if !hypothesis.terms.iter().all(|m| (1..=MOST_WAYS).contains(&ways(m.candidate))) {
        return same;
    }
    let anew = hypothesis.terms.iter().try_fold(Hypothesis::base(&search.design, data)?, |set, m| {
        set.with(&search.design, data, m.candidate)
    });
    [same, anew].into_iter().flatten().max_by(|a, b| a.log_evidence.total_cmp(&b.log_evidence))
}

/// How likely each explanation is to be the true one, relative to the likeliest.
fn weights(search: &Search<'_>, rivals: &[Hypothesis]) -> Vec<f64> {
    let best = rivals.iter().map(|h| weight(search, h)).fold(f64::NEG_INFINITY, f64::max);
    rivals.iter().map(|h| (weight(search, h) - best).exp()).collect()
}

fn expected_of(
    search: &Search<'_>,
    data: &Normal,
    added: &Normal,
    rivals: &[Hypothesis],
    weights: &[f64],
) -> ExpectedInformation {
    let settings = &search.options.settings;
    let (mut odds, mut told, mut sum) = (0.0, 0.0, 0.0);
    for (truth, (hypothesis, share)) in rivals.iter().zip(weights).enumerate() {
        // What the added data are expected to hold if this one is true.
        let mut expected = data.clone();
        expected.matrix += &added.matrix;
        expected.vector += &added.matrix * hypothesis.estimate.spread(search.design.columns.len());
        let base = Hypothesis::base(&search.design, &expected);
        let fitted = |h: &Hypothesis| chosen_anew(search, h, &expected).or_else(|| base.clone());
        let Some(own) = fitted(hypothesis) else { continue };
        let leads: Vec<(f64, f64)> = rivals
            .iter()
            .enumerate()
            .filter(|(k, _)| *k != truth)
            .filter_map(|(_, h)| fitted(h))
            .map(|h| (weight(search, &own) - weight(search, &h), own.estimate.drop - h.estimate.drop))
            .collect();
        let Some(least) = leads.iter().map(|l| l.0).min_by(f64::total_cmp) else { continue };
        odds += share * least;
        told += share * leads.iter().map(|l| probability_of_telling(*l, settings.sure)).fold(1.0, f64::min);
        sum += share;
    }
    let mean = |of: f64| (sum > 0.0).then(|| of / sum);
    let (log_odds, told_apart) = (mean(odds), mean(told));
    let mut both = data.clone();
    both.matrix += &added.matrix;
    let (mut shown, mut not_shown) = (Vec::new(), Vec::new());
    for candidate in &search.design.candidates {
        if candidate.effect.is_base() {
            continue;
        }
        let columns = candidate.options.first().map_or(&[][..], Vec::as_slice);
        let largest =
            columns.iter().filter_map(|i| search.design.detectability(&both, *i)).fold(0.0, f64::max);
        let list = if largest > settings.clear_misfit { &mut shown } else { &mut not_shown };
        list.push(candidate.id.to_owned());
    }
    ExpectedInformation { log_odds, told_apart, shown, not_shown }
}

#[cfg(test)]
mod tests {
    use super::probability_of_telling;

    #[test]
    fn what_becomes_just_sure_is_told_in_half_of_the_cases() {
        let sure = super::sure_lead(0.95);
        assert!((sure - 2.944).abs() < 1e-3);
        assert!((probability_of_telling((sure, 2.0 * sure), 0.95) - 0.5).abs() < 1e-6);
        assert!(probability_of_telling((0.0, 0.0), 0.95) < 0.01);
        let far = [6.0, 12.0, 400.0].map(|lead| probability_of_telling((lead, 2.0 * lead), 0.95));
        assert!(far[0] > 0.6 && far[0] < far[1] && far[1] < far[2] && far[2] > 0.95, "{far:?}");
    }
}
