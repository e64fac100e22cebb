//! Expected information of further data: the basis of choosing the next manoeuvre.
//!
//! T-optimality (Atkinson and Fedorov, Biometrika 62, 1975): data are worth as much as the log odds that they are expected to bring between the
//! explanations that are left. About a fit the samples are a linear regression, in which that needs no noise drawn: if explanation A is true, further
//! data with the normal matrix N have the expected right-hand side N theta_A, and every explanation is fitted again to all data.

use nalgebra::DMatrix;
use whorl_dynamics::effects::find;
use whorl_dynamics::{ModelPrior, PlatformModel};
use whorl_math::normal_equations::{Estimate, Normal};
use whorl_recording::Recording;

use crate::case::Case;
use crate::parameter_space::available::Available;
use crate::selection::{Beside, Runs, SIZES, Selection, log_prior, looked_for, size_penalty_nats};
use crate::{DiagnosisError, Options, Outcome};

/// Information in data on which explanation is true: as it is, or as it is expected to be.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct ExpectedInformation {
    /// Log odds between the leading explanation and the next, `None` with fewer than two. With the data at hand: the present ones. With further
    /// data: the expected lead of the true explanation, averaged over which one is true. A diagnosis names one alone from about 3 (20 to 1).
    pub log_odds: Option<f64>,
    /// Effects that would show at their ordinary size (one standard deviation of the catalogue's prior).
    pub shown: Vec<String>,
    /// Effects that were looked at and would not.
    pub not_shown: Vec<String>,
}

/// Information in the data at hand, and what it is expected to be with each of the `further` recordings, real or simulated, of which only motion
/// and inputs count, not readings. `explanations` are sets of effects, ids of the catalogue; an empty set is the model without any.
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
) -> Outcome<(ExpectedInformation, Vec<ExpectedInformation>)> {
    for id in explanations.iter().flatten() {
        find(id).ok_or_else(|| DiagnosisError::UnknownEffect(id.clone()))?;
    }
    // Low-passes are as stated where nobody has found otherwise.
    let delaying = options.delaying.as_ref().unwrap_or(model);
    let as_stated = Options { delaying: Some(delaying.clone()), ..options.clone() };
    let mut case = Case::new(training, further, model, prior, &as_stated)?;
    // Actuators and sensors that only the further recordings have make more effects testable.
    case.available = Available::of(training.iter().chain(further), delaying);
    let selection = Selection::begun(Runs { held_out: &[], ..case.runs() }, options)?;
    let leading = explanations.first().into_iter().flatten();
    let leading: Vec<&'static str> = leading.filter_map(|id| Some(find(id)?.info().id)).collect();
    // That of no effects where it cannot enter.
    let leading = if leading.is_empty() { None } else { selection.with(&leading)? };
    let (set, runs) = (leading.as_ref().unwrap_or(selection.base()), &selection.runs);
    let Some(beside) = selection.beside_of(set, looked_for(options))? else {
        let nothing = ExpectedInformation::default();
        return Ok((nothing.clone(), vec![nothing; further.len()]));
    };
    let with = beside
        .hints(&case.held_out, &runs.follow(&case.held_out, set, &selection.base().loudest_torques())?)?;
    let at_hand = |set| Explained::of(&beside, set, beside.normal());
    let all: Vec<Explained<'_>> = explanations.iter().filter_map(|set| at_hand(set)).collect();
    let mut weights: Vec<f64> = all.iter().map(|of| of.weight).collect();
    weights.sort_by(|a, b| b.total_cmp(a));
    let log_odds = weights.first().zip(weights.get(1)).map(|(first, second)| first - second);
    let count = beside.normal().vector.len();
    let now = ExpectedInformation { log_odds, ..expected_of(&beside, &DMatrix::zeros(count, count), &all) };
    Ok((now, with.iter().map(|further| expected_of(&beside, &further.information, &all)).collect()))
}

/// An explanation fitted to data.
struct Explained<'b> {
    set: &'b [String],
    estimate: Estimate,
    /// Log posterior, up to a constant.
    weight: f64,
}

impl<'b> Explained<'b> {
    /// Each effect in the way, and of the size, that these data like best; `None` if one cannot enter.
    fn of(beside: &Beside<'_>, set: &'b [String], data: &Normal) -> Option<Self> {
        let settings = beside.settings();
        // With columns that entered, each with its size.
        let fit = |active: &[usize], sizes: &[(usize, f64)]| {
            Estimate::new(data, active, |i| {
                let size = sizes.iter().find(|(column, _)| *column == i);
                size.map_or_else(|| beside.prior_variance(i), |(_, size)| beside.entering_variance(i, *size))
            })
        };
        let leading = beside.set.names();
        // Effects of the leading explanation take no part but where they are in the set.
        let others = leading.iter().filter(|id| set.iter().all(|own| own != *id));
        let left_out: Vec<usize> = others.flat_map(|id| beside.set.columns_of(id)).collect();
        let own: Vec<usize> = (0..beside.own()).filter(|i| !left_out.contains(i)).collect();
        let (mut sizes, mut choices_nats, mut estimate) = (Vec::new(), 0.0, fit(&own, &[])?);
        for id in set.iter().filter(|id| !leading.contains(&id.as_str())) {
            let options = beside.options(id);
            let tried = options.iter().flat_map(|option| SIZES.map(|size| (option, size)));
            let entered = tried.filter_map(|(option, size)| {
                let (mut active, mut sizes) = (estimate.active.clone(), sizes.clone());
                active.extend(option.iter().filter(|i| !estimate.active.contains(i)));
                sizes.extend(option.iter().map(|i| (*i, size)));
                let nats = (options.len() as f64).ln() + size_penalty_nats(size, settings);
                Some((nats, fit(&active, &sizes)?, sizes))
            });
            let worth = |(nats, estimate, _): &(f64, Estimate, _)| estimate.log_evidence - nats;
            let (nats, with, of_these) = entered.max_by(|a, b| worth(a).total_cmp(&worth(b)))?;
            (sizes, choices_nats, estimate) = (of_these, choices_nats + nats, with);
        }
        let weight = estimate.log_evidence - choices_nats + log_prior(set, settings);
        Some(Self { set, estimate, weight })
    }
}

/// What the data at hand are expected to say with others that have this information.
fn expected_of(beside: &Beside<'_>, added: &DMatrix<f64>, all: &[Explained<'_>]) -> ExpectedInformation {
    let mut both = beside.normal().clone();
    both.matrix += added;
    let most = all.iter().map(|of| of.weight).fold(f64::NEG_INFINITY, f64::max);
    let (mut odds, mut sum) = (0.0, 0.0);
    for (k, truth) in all.iter().enumerate() {
        // What the added data are expected to hold if this one is true.
        let mut expected = both.clone();
        expected.vector += added * truth.estimate.spread(both.vector.len());
        let weight = |of: &Explained<'_>| Some(Explained::of(beside, of.set, &expected)?.weight);
        let mut anew: Vec<Option<f64>> = all.iter().map(weight).collect();
        let Some(own) = anew.swap_remove(k) else { continue };
        let leads = anew.into_iter().flatten().map(|other| own - other);
        let Some(least) = leads.min_by(f64::total_cmp) else { continue };
        let share = (truth.weight - most).exp();
        (odds, sum) = (odds + share * least, sum + share);
    }
    let is_shown = |id: &&str| beside.detectability(&both, id) > beside.settings().clear_misfit;
    let (shown, not_shown) = beside.tested().partition::<Vec<&str>, _>(is_shown);
    let [shown, not_shown] = [shown, not_shown].map(|ids| ids.into_iter().map(str::to_owned).collect());
    ExpectedInformation { log_odds: (sum > 0.0).then(|| odds / sum), shown, not_shown }
}
