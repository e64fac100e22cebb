//! Expected information of further data: the basis of choosing the next manoeuvre.
//!
//! T-optimality (Atkinson and Fedorov, Biometrika 62, 1975): data are worth as much as the log odds that they
//! are expected to bring between the explanations that are left. About a fit the samples are a linear regression, in which that
//! expectation needs no noise drawn: if explanation A is true, further data with the normal matrix N have the
//! expected right-hand side N theta_A, and every explanation is fitted again to it together with the data at hand.

use whorl_dynamics::effects::find;
use whorl_dynamics::{ModelPrior, PlatformModel};
use whorl_math::statistics::normal_probability;
use whorl_prediction::{Followed, Noise, Prepared, follow};
use whorl_recording::Recording;

use crate::case::Case;
use crate::fitting::normal_equations::{Estimate, Normal};
use crate::parameter_space::available::Available;
use crate::selection::prior::{SIZES, log_prior, size_penalty_nats};
use crate::selection::{Beside, Evaluated, Runs, Selection};
use crate::{DiagnosisError, Options, threads};

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
    // Low-passes are as stated where nobody has found otherwise.
    let delaying = options.delaying.as_ref().unwrap_or(model);
    let as_stated = Options { delaying: Some(delaying.clone()), ..options.clone() };
    let mut case = Case::new(training, further, model, prior, &as_stated)?;
    // Actuators and sensors that only the further recordings have make more effects testable.
    case.available = Available::of(training.iter().chain(further), delaying);
    let selection = Selection::begun(Runs { held_out: &[], ..case.runs() }, options)?;
    let leading = leading(&selection, explanations, options)?;
    let beside = selection.beside(&leading, options)?;
    let Some((at_hand, beside)) = beside.and_then(|beside| Some((beside.in_values()?, beside))) else {
        let with = vec![ExpectedInformation::default(); further.len()];
        return Ok(InformationByRun { with, ..InformationByRun::default() });
    };
    let of_further = normals_of(&selection.runs, &case.held_out, &beside)?;
    let rivals: Vec<Rival<'_>> =
        explanations.iter().filter_map(|set| Rival::of(&beside, set, &at_hand)).collect();
    let none = Normal::zeros(at_hand.vector.len());
    let mut now = expected_of(&beside, &at_hand, &none, &rivals);
    let mut weights: Vec<f64> = rivals.iter().map(|rival| rival.weight).collect();
    weights.sort_by(|a, b| b.total_cmp(a));
    now.log_odds = weights.first().zip(weights.get(1)).map(|(first, second)| first - second);
    let with = |added: &Normal| expected_of(&beside, &at_hand, added, &rivals);
    Ok(InformationByRun { now, with: of_further.iter().map(with).collect() })
}

/// The leading explanation where it fits the data at hand; that of no effects where it cannot enter.
fn leading(
    selection: &Selection<'_>,
    explanations: &[Vec<String>],
    options: &Options,
) -> Result<Evaluated, DiagnosisError> {
    let base = selection.base();
    let ids: Vec<&'static str> =
        explanations.first().into_iter().flatten().filter_map(|id| Some(find(id)?.info().id)).collect();
    let beside = if ids.is_empty() { None } else { selection.beside(base, options)? };
    let hypothesis = beside.and_then(|beside| beside.with(&ids));
    let Some(hypothesis) = hypothesis else { return Ok(base.clone()) };
    let found = DiagnosisError::possible(selection.runs.evaluate(hypothesis, &[base]))?;
    Ok(found.unwrap_or_else(|| base.clone()))
}

/// What each further recording says by its motion.
fn normals_of(
    runs: &Runs<'_>,
    further: &[Recording],
    beside: &Beside<'_>,
) -> Result<Vec<Normal>, DiagnosisError> {
    let model = beside.set.model(runs.reference)?;
    let followed = |run: &Recording| -> Result<Followed, DiagnosisError> {
        let case = Prepared::new(run, &model, runs.prediction())?;
        Ok(follow(&case, &Noise::stated(&case)?))
    };
    let all: Result<Vec<Followed>, DiagnosisError> =
        threads::map(runs.threads, further, followed).into_iter().collect();
    let hints = beside.hints(runs, further, &all?)?;
    Ok(hints.iter().map(|of| Normal::about([of], &[], &[])).collect())
}

/// An explanation fitted to data.
struct Rival<'b> {
    set: &'b [String],
    estimate: Estimate,
    /// Log posterior, up to a constant.
    weight: f64,
}

/// Columns that take part, the sizes of those that entered, and the fit.
type Entered = (Vec<usize>, Vec<(usize, f64)>, Estimate);

impl<'b> Rival<'b> {
    /// Each effect in the way, and of the size, that these data like best; `None` if one cannot enter.
    fn of(beside: &Beside<'_>, set: &'b [String], data: &Normal) -> Option<Self> {
        let settings = &beside.reference().settings;
        let fit = |active: Vec<usize>, sizes: Vec<(usize, f64)>| -> Option<Entered> {
            let variance = |i: usize| {
                let size = sizes.iter().find(|(column, _)| *column == i);
                size.map_or_else(|| beside.known(i), |(_, size)| beside.entering_variance(i, *size))
            };
            let estimate = Estimate::new(data, &active, variance)?;
            Some((active, sizes, estimate))
        };
        // Effects of the leading explanation take no part but where they are in the set.
        let left_out: Vec<usize> = (beside.set.names().iter())
            .filter(|id| set.iter().all(|own| own != *id))
            .flat_map(|id| beside.set.columns_of(id))
            .collect();
        let own = (0..beside.own()).filter(|i| !left_out.contains(i));
        let mut best = fit(own.collect(), Vec::new())?;
        let mut choices = 0.0;
        for id in set.iter().filter(|id| !beside.set.names().contains(&id.as_str())) {
            let options = beside.options(id);
            let penalty = |size: f64| (options.len() as f64).ln() + size_penalty_nats(size, settings);
            let tried = options.iter().flat_map(|option| SIZES.map(|size| (option, size)));
            let entered = tried.filter_map(|(option, size)| {
                let (mut active, mut sizes) = (best.0.clone(), best.1.clone());
                active.extend(option.iter().filter(|i| !best.0.contains(i)));
                sizes.extend(option.iter().map(|i| (*i, size)));
                Some((penalty(size), fit(active, sizes)?))
            });
            let worth = |(penalty, (_, _, estimate)): &(f64, Entered)| estimate.log_evidence - penalty;
            let (penalty, with) = entered.max_by(|a, b| worth(a).total_cmp(&worth(b)))?;
            choices += penalty;
            best = with;
        }
        let (_, _, estimate) = best;
        let weight = estimate.log_evidence - choices + log_prior(set, settings);
        Some(Self { set, estimate, weight })
    }
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

fn expected_of(
    beside: &Beside<'_>,
    data: &Normal,
    added: &Normal,
    rivals: &[Rival<'_>],
) -> ExpectedInformation {
    let settings = &beside.reference().settings;
    let mut both = data.clone();
    both.matrix += &added.matrix;
    let most = rivals.iter().map(|rival| rival.weight).fold(f64::NEG_INFINITY, f64::max);
    let (mut odds, mut told, mut sum) = (0.0, 0.0, 0.0);
    for (truth, rival) in rivals.iter().enumerate() {
        // What the added data are expected to hold if this one is true.
        let mut expected = both.clone();
        expected.vector += &added.matrix * rival.estimate.spread(data.vector.len());
        let mut anew: Vec<Option<Rival<'_>>> =
            rivals.iter().map(|rival| Rival::of(beside, rival.set, &expected)).collect();
        let Some(own) = anew.swap_remove(truth) else { continue };
        let lead = |other: &Rival<'_>| (own.weight - other.weight, own.estimate.drop - other.estimate.drop);
        let leads: Vec<(f64, f64)> = anew.iter().flatten().map(lead).collect();
        let Some(least) = leads.iter().map(|l| l.0).min_by(f64::total_cmp) else { continue };
        let share = (rival.weight - most).exp();
        odds += share * least;
        told += share * leads.iter().map(|l| probability_of_telling(*l, settings.sure)).fold(1.0, f64::min);
        sum += share;
    }
    let mean = |of: f64| (sum > 0.0).then(|| of / sum);
    let is_other = |id: &&str| find(id).is_some_and(|effect| !effect.is_base());
    let (shown, not_shown): (Vec<&str>, Vec<&str>) = beside
        .effects()
        .filter(is_other)
        .partition(|id| beside.detectability_in(&both, id) > settings.clear_misfit);
    let owned = |ids: Vec<&str>| ids.into_iter().map(str::to_owned).collect();
    ExpectedInformation {
        log_odds: mean(odds),
        told_apart: mean(told),
        shown: owned(shown),
        not_shown: owned(not_shown),
    }
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
