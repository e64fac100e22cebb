//! Sets of effects, fitted to every sample of the training runs and tried on the held-out ones.

use std::collections::BTreeMap;
use std::time::Instant;

use nalgebra::DVector;
use whorl_dynamics::PlatformModel;
use whorl_dynamics::effects::{Role, find};
use whorl_math::normal_equations::Estimate;
use whorl_math::threads;
use whorl_prediction::{
    Disturbance, Fitted, Followed, Noise, PredictionError, Prepared, Rival, Settings, follow_like, hints,
};
use whorl_recording::Recording;

use crate::Outcome;
use crate::fitting::refit::{Entered, Fit, Refit, about};
use crate::parameter_space::available::Available;
use crate::parameter_space::{Column, Point, Reference};
use crate::selection::log_prior;
use crate::verdict::diagnosis::ParameterEstimate;

/// A set of effects, and how each enters; by default none.
#[derive(Debug, Clone, Default)]
pub(crate) struct Hypothesis {
    /// In alphabetical order.
    pub effects: Vec<&'static str>,
    pub point: Point,
    pub entered: BTreeMap<&'static str, Entered>,
    /// By how much it may be likelier than where it was proposed \[natural logarithm\].
    pub doubt_nats: f64,
    /// Whether it was proposed without the random torques of the set beside which it was, and is fitted from there.
    pub quiet: bool,
}

impl Hypothesis {
    pub fn leave_out(&mut self, id: &str) {
        self.effects.retain(|own| *own != id);
        self.entered.remove(id);
        self.point.remove(id);
    }

    fn choices_nats(&self) -> f64 {
        self.entered.values().map(|entered| entered.choice_nats).sum()
    }
}

/// A hypothesis where it is likeliest.
#[derive(Debug, Clone)]
pub(crate) struct Evaluated {
    pub hypothesis: Hypothesis,
    pub fitted: Fitted,
    /// What was fitted, and the standard deviation known before, in their units.
    pub columns: Vec<Column>,
    pub stddevs: Vec<f64>,
    /// Held-out runs as the filter follows them with it; of a set that gains nothing those of no effect.
    pub held_out: Vec<Followed>,
    /// log p of the training runs, values integrated out, with the penalty of how the effects enter.
    pub log_evidence: f64,
    /// log p of the training runs and the values without random torques, at the values that are likeliest then; of a set that gains nothing none.
    pub quiet_log_posterior: f64,
    /// log p of the held-out runs with these values, less what the levels of random torques cost,
    pub held_out_log: f64,
    /// and by how much they should be likelier than with no effect, if the set is what there is; `None`: that is not known.
    pub held_out_expected: Option<f64>,
    /// Smaller sets, and by how much it is likelier than each with the same levels, where that is no quadratic: readings beside the edge of a pulse.
    pub gains_at_levels: Vec<(Vec<&'static str>, f64)>,
    pub seconds: f64,
}

impl Evaluated {
    pub fn names(&self) -> &[&'static str] {
        &self.hypothesis.effects
    }

    pub fn owned_names(&self) -> Vec<String> {
        self.names().iter().map(|id| (*id).to_owned()).collect()
    }

    /// Share of what it explains that its formulas may leave.
    pub fn shape_error(&self, settings: &crate::Settings) -> f64 {
        let are_exact = self.names().iter().all(|id| find(id).is_some_and(|effect| effect.is_exact()));
        if are_exact { settings.misspecification.powi(2) } else { settings.misspecification }
    }

    pub fn columns_of(&self, id: &str) -> Vec<usize> {
        (0..self.columns.len()).filter(|i| self.columns[*i].group == id).collect()
    }

    pub fn model(&self, reference: &Reference) -> Result<PlatformModel, PredictionError> {
        self.refit(reference).model_at(&self.fitted.at).ok_or(PredictionError::NoModel)
    }

    pub fn parameter(&self, reference: &Reference, i: usize) -> ParameterEstimate {
        let column = &self.columns[i];
        let value = column.value_at(&self.refit(reference).point(&self.fitted.at));
        let stddev = self.fitted.covariance[(i, i)].max(0.0).sqrt() * column.scale;
        let at_bound = self.is_at_bound(i);
        ParameterEstimate { at_bound, ..ParameterEstimate::new(&column.name, column.unit, value, stddev) }
    }

    pub fn refit<'a>(&self, reference: &'a Reference) -> Refit<'a> {
        Refit { reference, columns: self.columns.clone(), stddevs: self.stddevs.clone() }
    }

    pub fn fit(&self, reference: &Reference) -> Outcome<Fit> {
        let mut fit = self.refit(reference).described(&self.fitted)?;
        fit.followed.extend_from_slice(&self.held_out);
        Ok(fit)
    }

    /// Standard deviation of the slow random torque beside it, root mean square of all axes and runs [N m].
    pub fn torque_n_m(&self) -> f64 {
        let runs = &self.fitted.followed;
        let squares = runs.iter().flat_map(|run| run.noise.disturbance.body_stddev_b_n_m()).map(|x| x * x);
        (squares.sum::<f64>() / (3 * runs.len()).max(1) as f64).sqrt()
    }

    /// Random torques as large as a training run has them, about all axes: of no effect those from which levels of held-out runs find their way down.
    pub fn loudest_torques(&self) -> Disturbance {
        let size = |of: &&Disturbance| of.body_stddev_b_n_m().iter().sum::<f64>();
        let all = self.fitted.followed.iter().map(|run| &run.noise.disturbance);
        let loudest = all.max_by(|a, b| size(a).total_cmp(&size(b))).cloned();
        loudest.unwrap_or(Disturbance::NONE).about_all_axes()
    }

    /// Whether one of its effects would have to be larger than any platform has it.
    pub fn is_at_the_end_of_a_range(&self) -> bool {
        let mut all = self.names().iter().flat_map(|id| self.columns_of(id));
        all.any(|i| self.amplitude(i) != 0.0 && self.is_at_bound(i))
    }

    fn is_at_bound(&self, i: usize) -> bool {
        self.fitted.at_bound.get(i).copied().unwrap_or(false)
    }

    /// Value of an amplitude, without which an effect does nothing, whatever shape it has; 0 of other columns.
    pub fn amplitude(&self, i: usize) -> f64 {
        if self.columns[i].role == Role::Amplitude { self.fitted.at[i] } else { 0.0 }
    }

    /// Log evidence of what it holds beside a smaller set, at the shapes that were found, and the squared distance of that from none in deviations, by
    /// its fit alone: the prior density of no effect over the posterior one (Dickey 1971). `None` where that cannot be said, without amplitudes.
    pub fn brought_beside(&self, smaller: &[&str]) -> Option<(f64, f64)> {
        let more = self.names().iter().filter(|id| !smaller.contains(id));
        let mut more: Vec<usize> = more.flat_map(|id| self.columns_of(id)).collect();
        more.sort_by_key(|i| self.columns[*i].role != Role::Amplitude);
        let count = more.iter().filter(|i| self.columns[**i].role == Role::Amplitude).count();
        let covariance = self.fitted.covariance.select_rows(&more).select_columns(&more);
        let precision = covariance.cholesky()?.inverse().view((0, 0), (count, count)).into_owned();
        let at = DVector::from_fn(count, |k, _| self.fitted.at[more[k]]);
        let distance = at.dot(&(&precision * &at));
        let prior: f64 = more[..count].iter().map(|i| self.stddevs[*i].ln()).sum();
        let log_evidence = 0.5 * (distance - precision.determinant().ln()) - prior;
        (count > 0).then_some((log_evidence, distance))
    }

    /// Half that distance, or what was found with the same levels: what these effects gain by themselves. Infinite where that cannot be said.
    pub fn gain_of_effects_beside(&self, smaller: &[&str]) -> f64 {
        let found = self.gains_at_levels.iter().filter(|(names, _)| names == smaller).map(|(_, nats)| *nats);
        let by_size = self.brought_beside(smaller).map_or(f64::INFINITY, |(_, distance)| 0.5 * distance);
        found.fold(by_size, f64::max)
    }
}

/// Recordings that sets are fitted to and tried on.
#[derive(Clone, Copy)]
pub(crate) struct Runs<'a> {
    pub training: &'a [Recording],
    pub held_out: &'a [Recording],
    pub reference: &'a Reference,
    pub available: &'a Available,
    pub threads: usize,
    /// No readings are taken in together: something fast shows.
    pub each_reading: bool,
}

impl Runs<'_> {
    pub fn prediction(&self) -> Settings {
        let settings = &self.reference.settings;
        Settings {
            threads: self.threads,
            fit_stands_nats: settings.converged_nats,
            // Most updates of the noise levels: bounds the work.
            fit_rounds: 6,
            cell_s: if self.each_reading { 0.0 } else { settings.prediction.cell_s },
            ..settings.prediction
        }
    }

    /// Fits a hypothesis beside `others` that were fitted, of which the first is that of no effect: from its own first values, and from
    /// theirs with and without its effects, so that it is never less likely than a set that it holds.
    pub fn evaluate(&self, hypothesis: Hypothesis, others: &[&Evaluated]) -> Outcome<Evaluated> {
        let (begun, reference, settings) = (Instant::now(), self.reference, &self.reference.settings);
        let base = others.first();
        let mut refit = Refit::own(reference, self.available);
        if let Some(base) = base {
            let deviations = base.fitted.covariance.diagonal().map(f64::sqrt);
            refit.keep(&deviations.iter().map(|d| *d < settings.unshown).collect::<Vec<bool>>());
        }
        for effect in hypothesis.effects.iter().filter_map(|id| find(id)) {
            refit.add(effect, &hypothesis.point, hypothesis.entered.get(effect.info().id));
        }
        let starts = starts(&refit, &hypothesis, others);
        let rival = others.last().map_or(Rival::NONE, |from| Rival {
            followed: &from.fitted.followed,
            log_posterior_needed: from.fitted.log_posterior - from.fitted.levels_nats
                + log_prior(from.names(), settings)
                - log_prior(&hypothesis.effects, settings)
                - hypothesis.doubt_nats,
            quiet: hypothesis.quiet,
        });
        let fitted = refit.likeliest(self.training, &starts, rival, &self.prediction())?;
        let mut found = Evaluated {
            log_evidence: fitted.log_evidence - hypothesis.choices_nats(),
            quiet_log_posterior: f64::NEG_INFINITY,
            held_out_log: base.map_or(0.0, |base| base.held_out_log),
            held_out_expected: None,
            gains_at_levels: Vec::new(),
            held_out: base.map_or_else(Vec::new, |base| base.held_out.clone()),
            hypothesis,
            columns: refit.columns,
            stddevs: refit.stddevs,
            fitted,
            seconds: 0.0,
        };
        if base.is_none_or(|base| found.fitted.log_posterior > base.fitted.log_posterior) {
            found.quiet_log_posterior = self.quiet_log_posterior(&found)?;
            let torques = base.copied().unwrap_or(&found).loudest_torques();
            self.follow_held_out(&mut found, &torques)?;
            let expected = base.map(|base| self.expected_of_held_out(&found, base)).transpose()?;
            found.held_out_expected = expected.flatten();
        }
        found.seconds = begun.elapsed().as_secs_f64();
        Ok(found)
    }

    /// A set fitted again from its values and the noise levels of another one; `torques`: with which held-out runs begin.
    pub fn refitted(&self, set: &Evaluated, other: &Evaluated, torques: &Disturbance) -> Outcome<Evaluated> {
        let (begun, mut again, starts) = (Instant::now(), set.clone(), [set.fitted.at.clone()]);
        let rival = Rival { followed: &other.fitted.followed, ..Rival::NONE };
        again.fitted =
            set.refit(self.reference).likeliest(self.training, &starts, rival, &self.prediction())?;
        again.log_evidence = again.fitted.log_evidence - set.hypothesis.choices_nats();
        again.quiet_log_posterior = self.quiet_log_posterior(&again)?;
        self.follow_held_out(&mut again, torques)?;
        again.seconds += begun.elapsed().as_secs_f64();
        Ok(again)
    }

    /// By how much held-out recordings should be likelier with these values than with those of no effect. With d how far the two are apart and G the
    /// information of the recordings on the values, that is d G d/2 on average. Of effects with states of their own it is not found.
    fn expected_of_held_out(&self, set: &Evaluated, base: &Evaluated) -> Outcome<Option<f64>> {
        let refit = set.refit(self.reference);
        if self.held_out.is_empty() || has_hidden_states(&refit, &set.hypothesis) {
            return Ok(None);
        }
        let apart = DVector::from_fn(set.columns.len(), |i, _| {
            let known = base.columns.iter().position(|own| own.is(&set.columns[i]));
            // What no amplitude makes does nothing.
            known.map_or_else(|| set.amplitude(i), |k| set.fitted.at[i] - base.fitted.at[k])
        });
        let (parameters, model_at) = (refit.parameters(), |units: &[f64]| refit.model_at(units));
        let (held_out, settings) = (&base.held_out, self.prediction());
        let all = hints(self.held_out, &parameters, &model_at, &set.fitted.at, held_out, &[], &settings)?;
        Ok(Some(all.iter().map(|of_run| 0.5 * apart.dot(&(&of_run.information * &apart))).sum()))
    }

    /// See [`Evaluated::quiet_log_posterior`].
    fn quiet_log_posterior(&self, set: &Evaluated) -> Outcome<f64> {
        if !set.fitted.followed.iter().any(|run| run.noise.disturbance.is_some()) {
            return Ok(set.fitted.log_posterior);
        }
        let quiet: Vec<Followed> = set.fitted.followed.iter().map(Followed::without_disturbance).collect();
        self.log_posterior_with(set, &quiet)
    }

    /// log p of the training runs and the values of a set with other levels: by a step from its own values, of which its levels hide errors.
    pub fn log_posterior_with(&self, set: &Evaluated, followed: &[Followed]) -> Outcome<f64> {
        let (refit, at) = (set.refit(self.reference), &set.fitted.at);
        let (parameters, model_at) = (refit.parameters(), |units: &[f64]| refit.model_at(units));
        let all = hints(self.training, &parameters, &model_at, at, followed, &[], &self.prediction())?;
        let of_prior: f64 = at.iter().zip(&set.stddevs).map(|(x, stddev)| -0.5 * (x / stddev).powi(2)).sum();
        let (normal, own) = (about(&all, at, &parameters), (0..at.len()).collect::<Vec<_>>());
        let step = Estimate::new(&normal, &own, |i| set.stddevs[i].powi(2)).map_or(0.0, |of| 0.5 * of.drop);
        Ok(all.iter().map(|of_run| of_run.log_likelihood).sum::<f64>() + of_prior + step)
    }

    /// Held-out recordings with the values of a set: from its noise of readings, and random torques from which levels find their way down.
    pub fn follow(
        &self,
        held_out: &[Recording],
        set: &Evaluated,
        torques: &Disturbance,
    ) -> Outcome<Vec<Followed>> {
        let model = set.model(self.reference)?;
        let runs: Vec<usize> = (0..held_out.len()).collect();
        let followed = |run: &usize| -> Outcome<Followed> {
            let case = Prepared::new(&held_out[*run], &model, self.prediction())?;
            let stated = Noise::stated(&case)?;
            let is_alike = |noise: &&Noise| noise.vector_rad.len() == stated.vector_rad.len();
            let like = set.fitted.followed.iter().map(|run| &run.noise).find(is_alike).unwrap_or(&stated);
            Ok(follow_like(&case, &stated, Noise { disturbance: torques.clone(), ..like.clone() }))
        };
        threads::map(self.threads, &runs, followed).into_iter().collect()
    }

    fn follow_held_out(&self, set: &mut Evaluated, torques: &Disturbance) -> Outcome<()> {
        set.held_out = self.follow(self.held_out, set, torques)?;
        let settings = self.prediction();
        let log = |run: &Followed| run.log_likelihood() - run.levels_nats(&settings);
        set.held_out_log = set.held_out.iter().map(log).sum();
        Ok(())
    }
}

/// Where a fit begins: as proposed, and so with what other sets have in common with it as it is there, with and without what is new.
pub(super) fn starts(refit: &Refit<'_>, hypothesis: &Hypothesis, others: &[&Evaluated]) -> Vec<Vec<f64>> {
    let found = refit.units_of(&hypothesis.point);
    let from = |other: &Evaluated, with_new: bool| -> Vec<f64> {
        let units = |(column, found): (&Column, &f64)| {
            let is_new = hypothesis.effects.contains(&column.group) && !other.names().contains(&column.group);
            if is_new && !with_new && column.role == Role::Amplitude {
                return 0.0;
            }
            other.columns.iter().position(|own| own.is(column)).map_or(*found, |k| other.fitted.at[k])
        };
        refit.columns.iter().zip(&found).map(units).collect()
    };
    let of_others = others.iter().flat_map(|other| [from(other, true), from(other, false)]);
    let mut starts: Vec<Vec<f64>> = std::iter::once(found.clone()).chain(of_others).collect();
    starts.dedup();
    // With states of its own no levels of another set fit, and each start would have to find its own. Beside values that another set has bent to what it
    // lacks, a platform may have no room for the effect; together they were found to.
    if has_hidden_states(refit, hypothesis) {
        starts.truncate(2);
        let last_possible = starts.iter().rposition(|at| refit.model_at(at).is_some());
        starts = vec![starts.swap_remove(last_possible.unwrap_or(0))];
    }
    starts
}

fn has_hidden_states(refit: &Refit<'_>, hypothesis: &Hypothesis) -> bool {
    hypothesis.effects.iter().any(|id| refit.reference.is_hidden(id))
}
