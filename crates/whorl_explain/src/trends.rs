//! Parameters over many runs: what stays, what changed when, and what differs between two sets of runs.
//!
//! Each run is fitted alone, and what the prior adds is taken out again: of a prior m +- s0 and a posterior m + d +- s, the data alone say
//! m + d / w +- s / sqrt(w), with w = 1 - (s / s0)^2. A step between neighbouring runs is the slope of a weighted line over 0 before and 1 after,
//! tested against "it stays" from both sides; what drifts shows as a step in the middle. Deviations are widened where estimates scatter more
//! (Birge's ratio). After N tests in all (parameters times places) a chance p is one of 1 - (1 - p)^N.

use whorl_dynamics::effects::catalogue;
use whorl_dynamics::{ModelPrior, PlatformModel};
use whorl_identification::{FittedParameter, Options, fit};
use whorl_math::line::Line;
use whorl_math::statistics::{normal_probability, normal_quantile};
use whorl_recording::Recording;

use crate::{ExplainError, ProgressCallback};

#[cfg(test)]
mod tests;

/// An estimate of which less than this share is the data's is no measurement.
const INFORMED: f64 = 0.2;

/// One estimate of one parameter.
#[derive(Debug, Clone, PartialEq)]
pub struct Estimate {
    /// Place of the run among all runs in order of time.
    pub run: usize,
    /// The estimate, in the parameter's unit.
    pub value: f64,
    /// Its standard deviation, widened where the runs scatter more than that.
    pub stddev: f64,
}

/// Something that changed.
#[derive(Debug, Clone, PartialEq)]
pub struct Change {
    /// The first run of the new value.
    pub from: usize,
    /// By how much, in the parameter's unit.
    pub size: f64,
    /// Standard deviation of that.
    pub stddev: f64,
    /// Significance before looking elsewhere, in standard deviations.
    pub sigma: f64,
    /// Chance of such a change, or a larger one, somewhere among all that was looked at while nothing changes.
    pub chance: f64,
    /// The same in standard deviations of a normal law, both sides; 0 where it is as likely as not.
    pub sigma_after: f64,
}

/// One parameter over all runs.
#[derive(Debug, Clone, PartialEq)]
pub struct Trend {
    /// Effect id; `mass_properties` for the moments of inertia.
    pub group: String,
    /// Name within the group.
    pub name: String,
    /// Unit, "1" for none.
    pub unit: String,
    /// Value in the model.
    pub model: f64,
    /// Estimates of the runs that show it.
    pub estimates: Vec<Estimate>,
    /// Scatter of the estimates over their standard deviations, at least 1.
    pub scatter: f64,
    /// The change that is least likely by chance; `None` with fewer than two runs that show it.
    pub change: Option<Change>,
}

/// All parameters over all runs.
#[derive(Debug, Clone, PartialEq)]
pub struct Trends {
    /// Names of the runs in order of time, and when they began \[s since 1970, UTC\].
    pub runs: Vec<(String, f64)>,
    /// The parameters, those that changed most surely first.
    pub trends: Vec<Trend>,
    /// Tests that were made.
    pub tests: usize,
    /// Runs that could not be fitted, and why.
    pub left_out: Vec<(String, String)>,
}

/// Fits every run, given with when it began \[s since 1970, UTC\], alone, and tests what changed. With `since` only that place is tested:
/// what differs between the runs before it and those from it on (an index into the runs in order of time).
///
/// # Errors
/// When fewer than two runs can be fitted.
pub fn trends(
    runs: &[(&Recording, f64)],
    model: &PlatformModel,
    prior: &ModelPrior,
    since: Option<usize>,
    options: &Options,
    say: &mut ProgressCallback<'_>,
) -> Result<Trends, ExplainError> {
    let mut runs = runs.to_vec();
    runs.sort_by(|a, b| a.1.total_cmp(&b.1));
    let effects: Vec<&str> = model.effects.keys().map(String::as_str).collect();
    // What changed may have changed by more than a model that was adopted a week ago thinks possible.
    let prior = &widened(model, prior);
    let (mut trends, mut left_out) = (Vec::<Trend>::new(), Vec::new());
    for (index, (run, _)) in runs.iter().enumerate() {
        say(index as f64 / runs.len() as f64, &format!("fitting {}", run.name));
        let found = fit(std::slice::from_ref(*run), model, prior, &effects, options);
        left_out.extend(found.as_ref().err().map(|error| (run.name.clone(), error.to_string())));
        for p in found.into_iter().flat_map(|fit| fit.estimates) {
            let own = own(&p, index, options.settings.prior_margin);
            if let Some(trend) = trends.iter_mut().find(|t| t.group == p.group && t.name == p.name) {
                trend.estimates.extend(own);
                continue;
            }
            let FittedParameter { group, name, unit, before, .. } = p;
            let estimates = own.into_iter().collect();
            trends.push(Trend { group, name, unit, model: before, estimates, scatter: 1.0, change: None });
        }
    }
    trends.retain(|trend| !trend.estimates.is_empty());
    if runs.len() < left_out.len() + 2 {
        let why: Vec<String> = left_out.iter().map(|(run, why)| format!(". {run}: {why}")).collect();
        return Err(ExplainError::Refused(format!("a history needs at least two runs{}", why.concat())));
    }
    let tests = judge(&mut trends, since);
    let chance = |trend: &Trend| trend.change.as_ref().map_or(2.0, |change| change.chance);
    trends.sort_by(|a, b| chance(a).total_cmp(&chance(b)));
    let runs = runs.iter().map(|(run, began_s)| (run.name.clone(), *began_s)).collect();
    Ok(Trends { runs, trends, tests, left_out })
}

/// What a run itself says of a parameter, if it does; the fit widens priors by `margin`.
fn own(p: &FittedParameter, run: usize, margin: f64) -> Option<Estimate> {
    let share = 1.0 - (p.posterior_stddev / (margin * p.prior_stddev)).powi(2);
    let is_measured = !p.at_bound && p.stddev > 0.0 && p.stddev.is_finite() && share > INFORMED;
    let value = p.before + (p.estimate - p.before) / share;
    is_measured.then(|| Estimate { run, value, stddev: p.posterior_stddev / share.sqrt() })
}

/// The prior with every uncertainty at least a typical one; what is exact stays so. What it adds to an estimate is taken out
/// again, so a wide one costs nothing, while beside one that an earlier fit has left a large change counts as noise.
fn widened(model: &PlatformModel, prior: &ModelPrior) -> ModelPrior {
    let typical = ModelPrior::typical(model);
    let mut wide = prior.clone();
    let larger = |own: f64, usual: f64| if own > 0.0 { own.max(usual) } else { own };
    wide.inertia_b_kg_m2 = prior.inertia_b_kg_m2.zip_map(&typical.inertia_b_kg_m2, larger);
    for effect in catalogue() {
        for spec in effect.parameters(model) {
            if let Some(base) = spec.base {
                let stddev = larger(base.stddev(prior, spec.part), base.stddev(&typical, spec.part));
                base.set_stddev(&mut wide, spec.part, stddev);
            }
            let of_effect = wide.effects.get_mut(effect.info().id);
            if let Some(own) = of_effect.and_then(|of_effect| of_effect.get_mut(&spec.name)) {
                *own = larger(*own, spec.prior_stddev);
            }
        }
    }
    wide
}

/// Finds the least likely change of each parameter; how many tests were made.
fn judge(trends: &mut [Trend], since: Option<usize>) -> usize {
    let found: Vec<_> = trends.iter().map(|trend| steps(&trend.estimates, since)).collect();
    let tests: usize = found.iter().map(Vec::len).sum();
    for (trend, steps) in trends.iter_mut().zip(found) {
        let surest = steps.into_iter().max_by(|a, b| a.0.sigma.total_cmp(&b.0.sigma));
        let Some((mut change, scatter)) = surest else { continue };
        trend.scatter = scatter;
        trend.estimates.iter_mut().for_each(|e| e.stddev *= scatter);
        let alone = 2.0 * normal_probability(-change.sigma);
        // 1 - (1 - p)^N without the loss of digits.
        change.chance = -(tests as f64 * (-alone).ln_1p()).exp_m1();
        change.sigma_after =
            if change.chance > 0.0 { (-normal_quantile(0.5 * change.chance)).max(0.0) } else { change.sigma };
        trend.change = Some(change);
    }
    tests
}

/// Steps at all runs but the first that shows a parameter, or at the one that is asked about, each with the scatter about it.
fn steps(estimates: &[Estimate], since: Option<usize>) -> Vec<(Change, f64)> {
    let neighbours = estimates.iter().zip(estimates.iter().skip(1)).map(|(a, b)| (a.run, b.run));
    let asked = neighbours.filter(|(a, b)| since.is_none_or(|from| *a < from && *b >= from));
    let step = |(_, from)| {
        let points = estimates.iter().map(|e| (f64::from(e.run >= from), e.value, e.stddev.powi(-2)));
        let line = Line::weighted(points.clone())?;
        let scatter = line.scatter(points).max(1.0);
        let (size, stddev) = (line.slope, line.spread.powf(-0.5) * scatter);
        let sigma = size.abs() / stddev;
        Some((Change { from, size, stddev, sigma, chance: 1.0, sigma_after: 0.0 }, scatter))
    };
    asked.filter_map(step).collect()
}
