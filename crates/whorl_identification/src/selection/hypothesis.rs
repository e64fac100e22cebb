//! Sets of effects, fitted to every sample of the training runs and tried on the held-out ones.

use std::collections::BTreeMap;
use std::time::Instant;

use nalgebra::DVector;
use whorl_dynamics::PlatformModel;
use whorl_dynamics::effects::{Role, find};
use whorl_prediction::{
    Fitted, Followed, Noise, PredictionError, Prepared, Rival, Settings, follow, follow_again, hints,
};
use whorl_recording::Recording;

use crate::fitting::refit::{Entered, Fit, Refit};
use crate::parameter_space::available::Available;
use crate::parameter_space::{Column, Point, Reference};
use crate::selection::prior::log_prior;
use crate::verdict::diagnosis::ParameterEstimate;
use crate::{DiagnosisError, threads};

/// Most updates of the noise levels in a fit. It bounds the work.
const ROUNDS: usize = 6;

/// A set of effects, and how each enters.
#[derive(Debug, Clone)]
pub(crate) struct Hypothesis {
    /// In alphabetical order.
    pub effects: Vec<&'static str>,
    /// First values.
    pub point: Point,
    pub entered: BTreeMap<&'static str, Entered>,
    /// Minus the logarithm of the prior probability of the ways and sizes in which they enter.
    pub choices_nats: f64,
}

impl Hypothesis {
    /// No effect.
    pub fn none(reference: &Reference) -> Self {
        Self { effects: Vec::new(), point: reference.point(), entered: BTreeMap::new(), choices_nats: 0.0 }
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
    /// log p of the held-out runs with these values,
    pub held_out_log: f64,
    /// and by how much they should be likelier than with no effect, if the set is what there is: on average, beside the random torque that they need without
    /// it; `None`: that is not known.
    pub held_out_expected: Option<f64>,
    pub seconds: f64,
}

impl Evaluated {
    pub fn names(&self) -> &[&'static str] {
        &self.hypothesis.effects
    }

    pub fn owned_names(&self) -> Vec<String> {
        self.names().iter().map(|id| (*id).to_owned()).collect()
    }

    /// Columns of an effect.
    pub fn columns_of(&self, id: &str) -> Vec<usize> {
        (0..self.columns.len()).filter(|i| self.columns[*i].group == id).collect()
    }

    /// The model with the fitted values.
    pub fn model(&self, reference: &Reference) -> Result<PlatformModel, PredictionError> {
        self.refit(reference).model_at(&self.fitted.at).ok_or(PredictionError::NoModel)
    }

    /// A fitted parameter.
    pub fn parameter(&self, reference: &Reference, i: usize) -> ParameterEstimate {
        let column = &self.columns[i];
        let value = reference.value_at(&self.refit(reference).point(&self.fitted.at), column);
        let stddev = self.fitted.covariance[(i, i)].max(0.0).sqrt() * column.scale;
        let at_bound = self.fitted.at_bound.get(i).copied().unwrap_or(false);
        ParameterEstimate { at_bound, ..ParameterEstimate::new(&column.name, column.unit, value, stddev) }
    }

    pub fn refit<'a>(&self, reference: &'a Reference) -> Refit<'a> {
        Refit { reference, columns: self.columns.clone(), stddevs: self.stddevs.clone() }
    }

    /// The model with the fitted values, and what these are worth.
    pub fn fit(&self, reference: &Reference) -> Result<Fit, DiagnosisError> {
        let mut fit = self.refit(reference).described(&self.fitted)?;
        fit.followed.extend_from_slice(&self.held_out);
        Ok(fit)
    }

    /// Log posterior, up to a constant that all sets share. Held-out runs, with values that were fitted to others, may count against a set
    /// and not for it: what they would add scatters by as much as it is.
    pub fn log_posterior(&self, base: &Self, reference: &Reference) -> f64 {
        let held = (self.held_out_log - base.held_out_log).min(0.0);
        self.log_evidence + held + log_prior(self.names(), &reference.settings)
    }

    /// Standard deviation of the slow random torque beside it, root mean square of all axes and runs [N m].
    pub fn torque_n_m(&self) -> f64 {
        let runs = &self.fitted.followed;
        let squares = runs.iter().flat_map(|run| run.noise.disturbance.body_stddev_b_n_m()).map(|x| x * x);
        (squares.sum::<f64>() / (3 * runs.len()).max(1) as f64).sqrt()
    }

    /// log p of training and held-out runs as the model predicts them without random torques.
    pub fn log_without_random_torques(&self) -> f64 {
        let runs = self.fitted.followed.iter().chain(&self.held_out);
        runs.map(|run| run.undisturbed_likelihood.log).sum()
    }

    /// Whether one of its effects would have to be larger than any platform has it.
    pub fn is_at_the_end_of_a_range(&self) -> bool {
        let amplitudes =
            self.names().iter().flat_map(|id| self.columns_of(id)).filter(|i| self.is_amplitude(*i));
        let is_at_end = |i: usize| self.fitted.at_bound.get(i).copied().unwrap_or(false);
        amplitudes.filter(|i| is_at_end(*i)).any(|i| self.fitted.at[i] != 0.0)
    }

    /// Without its amplitudes an effect does nothing, whatever shape it has.
    fn is_amplitude(&self, i: usize) -> bool {
        self.columns[i].role == Role::Amplitude
    }

    /// Log evidence of what it holds beside a smaller set, at the shapes that were found, and the squared distance of that from none in
    /// deviations, by its fit alone: the prior density of no effect over the posterior one (Dickey 1971). `None` where that
    /// cannot be said, of effects that have no amplitude.
    pub fn brought_beside(&self, smaller: &[&str]) -> Option<(f64, f64)> {
        let more = self.names().iter().filter(|id| !smaller.contains(id));
        let more: Vec<usize> = more.flat_map(|id| self.columns_of(id)).collect();
        let places: Vec<usize> = (0..more.len()).filter(|k| self.is_amplitude(more[*k])).collect();
        let covariance = self.fitted.covariance.select_rows(&more).select_columns(&more);
        let all = covariance.cholesky()?.inverse();
        let precision = all.select_rows(&places).select_columns(&places);
        let at = DVector::from_iterator(places.len(), places.iter().map(|k| self.fitted.at[more[*k]]));
        let distance = at.dot(&(&precision * &at));
        let prior: f64 = places.iter().map(|k| self.stddevs[more[*k]].ln()).sum();
        let log_evidence = 0.5 * (distance - precision.determinant().ln()) - prior;
        (!places.is_empty()).then_some((log_evidence, distance))
    }

    /// Half that distance: what these effects gain by themselves. Infinite where that cannot be said.
    pub fn gain_of_effects_beside(&self, smaller: &[&str]) -> f64 {
        self.brought_beside(smaller).map_or(f64::INFINITY, |(_, distance)| 0.5 * distance)
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
            fit_rounds: ROUNDS,
            cell_s: if self.each_reading { 0.0 } else { settings.prediction.cell_s },
            ..settings.prediction
        }
    }

    /// Fits a hypothesis beside `others` that were fitted, of which the first is that of no effect: from its own first values, and from
    /// theirs with and without its effects, so that it is never less likely than a set that it holds.
    pub fn evaluate(
        &self,
        hypothesis: Hypothesis,
        others: &[&Evaluated],
    ) -> Result<Evaluated, DiagnosisError> {
        let begun = Instant::now();
        let reference = self.reference;
        let (base, settings) = (others.first(), &reference.settings);
        let mut refit = Refit::own(reference, self.available);
        if let Some(base) = base {
            let deviations = base.fitted.covariance.diagonal().map(f64::sqrt);
            let shown: Vec<bool> = deviations.iter().map(|d| *d < settings.unshown).collect();
            refit.keep(&shown);
        }
        for id in &hypothesis.effects {
            if let Some(effect) = find(id) {
                refit.add(effect, &hypothesis.point, hypothesis.entered.get(id));
            }
        }
        let starts = starts(&refit, &hypothesis, others);
        let rival = others.last().map_or(Rival::NONE, |from| Rival {
            followed: &from.fitted.followed,
            log_posterior_needed: from.fitted.log_posterior - log_prior(&hypothesis.effects, settings)
                + log_prior(from.names(), settings),
        });
        let fitted = refit.likeliest(self.training, &starts, rival, &self.prediction())?;
        let mut found = Evaluated {
            log_evidence: fitted.log_evidence - hypothesis.choices_nats,
            held_out_log: 0.0,
            held_out_expected: None,
            held_out: Vec::new(),
            hypothesis,
            columns: refit.columns,
            stddevs: refit.stddevs,
            fitted,
            seconds: 0.0,
        };
        match base.filter(|base| found.fitted.log_posterior <= base.fitted.log_posterior) {
            Some(base) => found.held_out.clone_from(&base.held_out),
            None => {
                self.follow_held_out(&mut found, base.map_or(&[], |base| &base.held_out))?;
                let expected = base.map(|base| self.expected_of_held_out(&found, base)).transpose()?;
                found.held_out_expected = expected.flatten();
            }
        }
        found.held_out_log = found.held_out.iter().map(Followed::log_likelihood).sum();
        found.seconds = begun.elapsed().as_secs_f64();
        Ok(found)
    }

    /// A set fitted again from its values and the noise levels of another one.
    pub fn refitted(&self, set: &Evaluated, other: &Evaluated) -> Result<Evaluated, DiagnosisError> {
        let begun = Instant::now();
        let rival = Rival { followed: &other.fitted.followed, log_posterior_needed: f64::NEG_INFINITY };
        let starts = std::slice::from_ref(&set.fitted.at);
        let mut again = set.clone();
        again.fitted =
            set.refit(self.reference).likeliest(self.training, starts, rival, &self.prediction())?;
        again.log_evidence = again.fitted.log_evidence - set.hypothesis.choices_nats;
        self.follow_held_out(&mut again, &set.held_out)?;
        again.held_out_log = again.held_out.iter().map(Followed::log_likelihood).sum();
        again.seconds += begun.elapsed().as_secs_f64();
        Ok(again)
    }

    /// By how much held-out recordings should be likelier with these values than with those of no effect. With d how far the two are apart and G the
    /// information of the recordings on the values, that is d G d/2 on average. Of effects with states of their own it is not found.
    fn expected_of_held_out(&self, set: &Evaluated, base: &Evaluated) -> Result<Option<f64>, DiagnosisError> {
        let refit = set.refit(self.reference);
        if self.held_out.is_empty() || has_hidden_states(&refit, &set.hypothesis) {
            return Ok(None);
        }
        let units = &set.fitted.at;
        let apart = refit.columns.iter().zip(units).map(|(column, units)| {
            let known = base.columns.iter().position(|own| own.is(column));
            match (known, column.role) {
                (Some(k), _) => units - base.fitted.at[k],
                (None, Role::Amplitude) => *units,
                // What no amplitude makes does nothing.
                (None, _) => 0.0,
            }
        });
        let apart = DVector::from_iterator(units.len(), apart);
        let (parameters, model_at) = (refit.parameters(), |units: &[f64]| refit.model_at(units));
        let (held_out, settings) = (&base.held_out, self.prediction());
        let all = hints(self.held_out, &parameters, &model_at, units, held_out, &[], &settings)?;
        Ok(Some(all.iter().map(|of_run| 0.5 * apart.dot(&(&of_run.information * &apart))).sum()))
    }

    /// Held-out recordings with values that were fitted to the training ones; `before`: with another model close by, or none.
    fn follow_held_out(&self, set: &mut Evaluated, before: &[Followed]) -> Result<(), DiagnosisError> {
        let model = set.model(self.reference)?;
        let runs: Vec<usize> = (0..self.held_out.len()).collect();
        let tried = |run: &usize| -> Result<Followed, DiagnosisError> {
            let case = Prepared::new(&self.held_out[*run], &model, self.prediction())?;
            let stated = Noise::stated(&case)?;
            Ok(before
                .get(*run)
                .map_or_else(|| follow(&case, &stated), |before| follow_again(&case, &stated, before)))
        };
        set.held_out = threads::map(self.threads, &runs, tried).into_iter().collect::<Result<_, _>>()?;
        Ok(())
    }
}

/// Where a fit begins.
fn starts(refit: &Refit<'_>, hypothesis: &Hypothesis, others: &[&Evaluated]) -> Vec<Vec<f64>> {
    let found = refit.units_of(&hypothesis.point);
    let mut starts = vec![found.clone()];
    for other in others {
        let mut with = found.clone();
        for (units, column) in with.iter_mut().zip(&refit.columns) {
            if let Some(k) = other.columns.iter().position(|own| own.is(column)) {
                *units = other.fitted.at[k];
            }
        }
        let mut without = with.clone();
        for (units, column) in without.iter_mut().zip(&refit.columns) {
            let is_new = hypothesis.effects.contains(&column.group) && !other.names().contains(&column.group);
            if is_new && column.role == Role::Amplitude {
                *units = 0.0;
            }
        }
        starts.extend([with, without]);
    }
    starts.dedup();
    // With states of its own no levels of another set fit, and each start would have to find its own.
    if has_hidden_states(refit, hypothesis) {
        starts.truncate(2);
        starts.drain(..starts.len().saturating_sub(1));
    }
    starts
}

fn has_hidden_states(refit: &Refit<'_>, hypothesis: &Hypothesis) -> bool {
    let mut effects = hypothesis.effects.iter().filter_map(|id| find(id));
    effects.any(|effect| effect.hidden_states(&refit.reference.model) > 0)
}
