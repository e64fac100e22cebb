//! Parameters over many runs: what stays, what changed when, and what differs between two sets of runs.
//!
//! Each run is fitted alone. What the prior adds to an estimate is taken out again, so that an estimate is that run's own:
//! of a prior m +- s0 and a posterior m + d +- s, the data alone say m + d / w +- s / sqrt(w), with w = 1 - (s / s0)^2. A
//! step between two neighbouring runs is the slope of a weighted line over 0 before and 1 after, tested against "it stays" from both
//! sides; what drifts shows as a step in the middle. Where estimates scatter more than their standard deviations say, these are
//! widened until they fit (Birge's ratio). With N tests in all (parameters times places) a chance p becomes 1 - (1 - p)^N: that is the
//! significance after all that was looked at.

use whorl_dynamics::effects::catalogue;
use whorl_dynamics::{ModelPrior, PlatformModel};
use whorl_identification::{Options, fit};
use whorl_math::line::Line;
use whorl_math::statistics::{normal_probability, normal_quantile};
use whorl_recording::Recording;

use crate::{ExplainError, ProgressCallback};

/// An estimate of which less than this share is the data's is no measurement.
const INFORMED: f64 = 0.2;

/// A run and when it began.
#[derive(Debug, Clone, Copy)]
pub struct DatedRun<'a> {
    /// What was measured.
    pub recording: &'a Recording,
    /// When it began \[s since 1970, UTC\].
    pub began_s: f64,
}

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

/// Fits every run alone and tests what changed. With `since` only that place is tested: what differs between the runs
/// before it and those from it on (an index into the runs in order of time).
///
/// # Errors
/// When fewer than two runs can be fitted.
pub fn trends(
    runs: &[DatedRun<'_>],
    model: &PlatformModel,
    prior: &ModelPrior,
    since: Option<usize>,
    options: &Options,
    say: &mut ProgressCallback<'_>,
) -> Result<Trends, ExplainError> {
    let mut runs = runs.to_vec();
    runs.sort_by(|a, b| a.began_s.total_cmp(&b.began_s));
    let effects: Vec<&str> = model.effects.keys().map(String::as_str).collect();
    // What changed may have changed by more than a model that was adopted a week ago thinks possible.
    let prior = &widened(model, prior);
    let (mut trends, mut left_out, mut last_error) = (Vec::<Trend>::new(), Vec::new(), None);
    for (index, run) in runs.iter().enumerate() {
        say(index as f64 / runs.len() as f64, &format!("fitting {}", run.recording.name));
        let found = match fit(std::slice::from_ref(run.recording), model, prior, &effects, options) {
            Ok(found) => found,
            Err(error) => {
                left_out.push((run.recording.name.clone(), error.to_string()));
                last_error = Some(error);
                continue;
            }
        };
        for p in found.estimates.iter().filter(|p| !p.at_bound && p.stddev > 0.0 && p.stddev.is_finite()) {
            let width = options.settings.prior_margin * p.prior_stddev;
            let own = 1.0 - (p.posterior_stddev / width).powi(2);
            if own <= INFORMED {
                continue;
            }
            let value = p.before + (p.estimate - p.before) / own;
            let estimate = Estimate { run: index, value, stddev: p.posterior_stddev / own.sqrt() };
            match trends.iter_mut().find(|t| t.group == p.group && t.name == p.name) {
                Some(trend) => trend.estimates.push(estimate),
                None => trends.push(Trend {
                    group: p.group.clone(),
                    name: p.name.clone(),
                    unit: p.unit.clone(),
                    model: p.before,
                    estimates: vec![estimate],
                    scatter: 1.0,
                    change: None,
                }),
            }
        }
    }
    if runs.len() - left_out.len() < 2 {
        return Err(last_error.map_or(ExplainError::TooFewRuns, ExplainError::from));
    }
    let tests = judge(&mut trends, since);
    let chance = |trend: &Trend| trend.change.as_ref().map_or(2.0, |change| change.chance);
    trends.sort_by(|a, b| chance(a).total_cmp(&chance(b)));
    let runs = runs.iter().map(|run| (run.recording.name.clone(), run.began_s)).collect();
    Ok(Trends { runs, trends, tests, left_out })
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

/// The runs from which on a parameter may be another: all but the first that show it, or the one that is asked about.
fn places(trend: &Trend, since: Option<usize>) -> Vec<usize> {
    let neighbours = trend.estimates.iter().zip(trend.estimates.iter().skip(1));
    let is_asked = |before: usize, after: usize| since.is_none_or(|from| before < from && after >= from);
    neighbours.filter(|(a, b)| is_asked(a.run, b.run)).map(|(_, after)| after.run).collect()
}

/// Finds the least likely change of each parameter; how many tests were made.
fn judge(trends: &mut [Trend], since: Option<usize>) -> usize {
    let tests: usize = trends.iter().map(|trend| places(trend, since).len()).sum();
    for trend in trends {
        let found = places(trend, since).into_iter().filter_map(|from| step(trend, from));
        let best = found.max_by(|a, b| a.0.sigma.total_cmp(&b.0.sigma));
        let Some((mut change, scatter)) = best else { continue };
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

/// The step at a run, not yet held against others, and the scatter about it.
fn step(trend: &Trend, from: usize) -> Option<(Change, f64)> {
    let points =
        trend.estimates.iter().map(|e| (if e.run >= from { 1.0 } else { 0.0 }, e.value, e.stddev.powi(-2)));
    let line = Line::weighted(points.clone())?;
    let scatter = line.scatter(points).max(1.0);
    let (size, stddev) = (line.slope, line.spread.powf(-0.5) * scatter);
    Some((Change { from, size, stddev, sigma: size.abs() / stddev, chance: 1.0, sigma_after: 0.0 }, scatter))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn trend(values: &[f64], stddev: f64) -> Trend {
        let estimate = |(run, value): (usize, &f64)| Estimate { run, value: *value, stddev };
        Trend {
            group: "thruster_strength".to_owned(),
            name: "jet_4".to_owned(),
            unit: "1".to_owned(),
            model: 0.0,
            estimates: values.iter().enumerate().map(estimate).collect(),
            scatter: 1.0,
            change: None,
        }
    }

    /// A model that was adopted knows each jet to a thousandth; a valve that loses a tenth is far outside.
    #[test]
    fn what_an_earlier_fit_left_is_widened_to_what_is_typical() {
        let model = PlatformModel::whorl_1_reference();
        let typical = ModelPrior::typical(&model);
        let mut adopted = typical.clone().with_mass_properties_scaled(0.01);
        adopted.actuators.jets.thrust.iter_mut().for_each(|s| *s = 1e-3);
        adopted.inertia_b_kg_m2[(0, 1)] = 0.0;
        adopted.gravity_offset_b_n_m.z = 10.0;
        adopted
            .effects
            .entry("bearing_viscous_friction".to_owned())
            .or_default()
            .insert("c_n_m_s".to_owned(), 1e-9);
        let wide = widened(&model, &adopted);
        assert_eq!(wide.actuators.jets.thrust, typical.actuators.jets.thrust);
        assert_eq!(wide.inertia_b_kg_m2[(0, 0)], typical.inertia_b_kg_m2[(0, 0)]);
        assert_eq!(wide.gravity_offset_b_n_m.x, typical.gravity_offset_b_n_m.x);
        // What is exact, and what is wider still, stay.
        assert_eq!((wide.inertia_b_kg_m2[(0, 1)], wide.gravity_offset_b_n_m.z), (0.0, 10.0));
        assert!(wide.effects["bearing_viscous_friction"]["c_n_m_s"] > 1e-4);
    }

    /// Three runs at 0 and three at -0.12, each known to 0.03: 0.12 over 0.03 sqrt(2/3) are 4.9 standard deviations, and
    /// with five tests the chance is five times as large.
    #[test]
    fn a_step_is_found_where_it_is_with_its_chance_after_all_tests() {
        let mut own = [trend(&[0.0, 0.0, 0.0, -0.12, -0.12, -0.12], 0.03)];
        judge(&mut own, None);
        let found = own[0].change.as_ref().unwrap();
        assert_eq!(found.from, 3);
        let sigma = 0.12 / (0.03 * (2.0_f64 / 3.0).sqrt());
        assert!((found.size + 0.12).abs() < 1e-12 && (found.sigma - sigma).abs() < 1e-12);
        let expected = 5.0 * 2.0 * normal_probability(-sigma);
        assert!((found.chance / expected - 1.0).abs() < 1e-5, "{} {expected}", found.chance);
    }

    #[test]
    fn a_steady_motion_is_a_step_in_the_middle() {
        let mut own = [trend(&[0.0, 0.1, 0.2, 0.3, 0.4, 0.5], 0.01)];
        judge(&mut own, None);
        let found = own[0].change.as_ref().unwrap();
        assert!(found.from == 3 && (found.size - 0.3).abs() < 1e-12 && found.chance < 0.05, "{found:?}");
    }

    /// The same step among runs that scatter four times as much as they say is no discovery.
    #[test]
    fn scatter_beyond_the_standard_deviations_widens_them() {
        let mut own = [trend(&[0.12, -0.12, 0.0, 0.0, -0.24, -0.12], 0.03)];
        judge(&mut own, None);
        let found = own[0].change.as_ref().unwrap();
        assert!(own[0].scatter > 2.5 && found.chance > 0.05, "{found:?}");
        // Two sets of runs, one test.
        let mut own = [trend(&[0.0, 0.0, 0.0, -0.12, -0.12, -0.12], 0.03)];
        judge(&mut own, Some(2));
        let found = own[0].change.as_ref().unwrap();
        assert_eq!(found.from, 2);
        assert!((found.chance - 2.0 * normal_probability(-found.sigma)).abs() < 1e-9);
    }
}
