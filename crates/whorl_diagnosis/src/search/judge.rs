//! Tests sets of effects on the samples: a set is an answer only if it makes the readings themselves likelier.
//!
//! Bins of a smoothed motion serve to find what may be missing, and first values. Within a bin a controller answers to the noise
//! of the readings, and a motion that is smoothed wrongly bends every formula along it: a set that explains the bins may therefore
//! explain nothing. The causal filter at the rate of the samples ([`whorl_prediction`]) has no bins: with it the platform's own
//! parameters are fitted alone, and beside each set that is nearly the most probable one.

use std::collections::BTreeMap;
use std::sync::Arc;

use whorl_prediction::{
    Fitted, Followed, Noise, PredictionError, Prepared, Rival, Settings, follow, follow_again,
};
use whorl_recording::Recording;

use crate::explanations::candidates::effect;
use crate::explanations::hypothesis::Term;
use crate::parameters::available::Available;
use crate::refit::{Entered, Fit, Refit};
use crate::search::Search;
use crate::search::prior::log_prior;
use crate::search::sampled::{Beside, entered};
use crate::search::score::{Converged, Judged, JudgedFit, Likelihoods};
use crate::{DiagnosisError, Progress};

/// Sets that are judged at most, besides that of no effects.
const MOST_JUDGED: usize = 12;
/// To sets of so many effects the samples add no further one.
const MOST_EFFECTS: usize = 3;

/// Most updates of the noise levels in a fit. It bounds the work; how far from the optimum a fit may end because of it was not measured.
const ROUNDS: usize = 3;

/// Recordings that sets are fitted to and tried on.
pub(crate) struct Judge<'a> {
    pub training: &'a [Recording],
    pub held_out: &'a [Recording],
    pub available: Available,
    pub threads: usize,
}

/// The reference against which sets are judged: the platform alone.
pub(crate) struct Judgement<'a> {
    judge: Judge<'a>,
    base: Alone,
    /// Sets that may still be judged.
    left: usize,
}

/// The platform's own parameters where they are likeliest alone.
struct Alone {
    /// In units of their deviations.
    fit: Arc<JudgedFit>,
    /// Which of them the recordings show.
    shown: Vec<bool>,
}

/// What the samples have said of sets, which does not depend on how they are divided into bins.
#[derive(Default)]
pub(crate) struct Said {
    alone: Option<Alone>,
    judged: BTreeMap<Vec<String>, Judged>,
    besides: Vec<Beside>,
}

impl Said {
    /// In a search that has come to its end.
    pub fn in_search(search: Search<'_>, judgement: Option<Judgement<'_>>) -> Self {
        let Search { fitted, mut besides, said, .. } = search;
        besides.extend(said.besides);
        let mut judged = said.judged;
        judged.extend(fitted.into_iter().filter_map(|(names, set)| Some((names, set.judged?))));
        Self { alone: judgement.map(|judgement| judgement.base), judged, besides }
    }

    fn take_beside(&mut self, names: &[String]) -> Option<Beside> {
        let at = self.besides.iter().position(|beside| beside.names == names)?;
        Some(self.besides.swap_remove(at))
    }
}

impl Search<'_> {
    /// Judges the set of no effects, then sets with one effect more that the samples propose. `None` where no filter can be run.
    pub(crate) fn judge_first<'j>(
        &mut self,
        judge: Judge<'j>,
        progress: &mut dyn FnMut(Progress),
    ) -> Result<Option<Judgement<'j>>, DiagnosisError> {
        progress(Progress { share: 0.15, doing: "fitting the platform's own parameters to every sample" });
        let Some(base) = self.judge_alone(&judge)? else { return Ok(None) };
        let mut judgement = Judgement { judge, base, left: MOST_JUDGED };
        self.judge_asked_for(&mut judgement, progress)?;
        let most = self.most_probable_judged();
        let of_both = most.and_then(|most| Some((most.score.log_evidence, *self.of_bins.get(&most.names)?)));
        self.samples_over_bins = of_both.map_or(0.0, |(of_samples, of_bins)| of_samples - of_bins);
        Ok(Some(judgement))
    }

    /// Judges what bins propose as far as the samples do not rule it out: the most probable sets, and parts of them while they are more
    /// probable.
    pub(crate) fn judge_remaining(
        &mut self,
        judgement: Option<Judgement<'_>>,
        progress: &mut dyn FnMut(Progress),
    ) -> Result<(), DiagnosisError> {
        // Where no filter can be run bins are left alone.
        let Some(mut judgement) = judgement else { return self.settle_most_probable() };
        while let Some(set) = self.next_to_judge().or_else(|| self.next_rival()) {
            if self.is_ruled_out(&set.names) {
                self.forget(&set.names);
                continue;
            }
            let Some(fewer) = judgement.left.checked_sub(1) else { break };
            judgement.left = fewer;
            progress(judgement.progress());
            let entered = entered(&set, None);
            let Some(found) = self.said_of(&set, &entered, &judgement)? else { break };
            self.set_judged(set, found);
            self.judge_asked_for(&mut judgement, progress)?;
        }
        self.forget_what_was_not_judged();
        self.settle_most_probable()
    }

    /// Judges sets with one effect more than the most probable judged set, as the samples propose them, until none of these is more
    /// probable.
    fn judge_asked_for(
        &mut self,
        judgement: &mut Judgement<'_>,
        progress: &mut dyn FnMut(Progress),
    ) -> Result<(), DiagnosisError> {
        while let Some(most) = self.most_probable_judged().cloned() {
            if self.besides.iter().any(|beside| beside.names == most.names) {
                break;
            }
            let Some(fit) = most.judged.as_ref().map(|judged| &judged.fit) else { break };
            progress(judgement.progress());
            let beside = match self.said.take_beside(&most.names) {
                Some(said) => Some(said),
                None => {
                    DiagnosisError::possible(self.beside(&most, fit, judgement.judge.training))?.flatten()
                }
            };
            let Some(beside) = beside else { break };
            let asked = beside.asked(&self.options.settings);
            self.besides.push(beside);
            for asked in asked.iter().filter(|_| most.names.len() < MOST_EFFECTS) {
                let Some(fewer) = judgement.left.checked_sub(1) else { break };
                let larger = self.with_effect(&most, asked.id)?.filter(|set| set.judged.is_none());
                larger.iter().for_each(|set| self.note_bins(set));
                let Some(larger) = larger.filter(|set| !self.is_ruled_out(&set.names)) else { continue };
                judgement.left = fewer;
                progress(judgement.progress());
                let entered = entered(&larger, Some(asked));
                if let Some(found) = self.said_of(&larger, &entered, judgement)? {
                    self.set_judged(larger, found);
                }
            }
        }
        Ok(())
    }

    /// Models with the values of sets that were judged.
    pub(crate) fn fits_of(
        &self,
        sets: impl IntoIterator<Item = Vec<String>>,
    ) -> Result<BTreeMap<Vec<String>, Fit>, DiagnosisError> {
        let mut fits = BTreeMap::new();
        for names in sets {
            if let Some(judged) = self.fitted.get(&names).and_then(|set| set.judged.as_ref()) {
                let mut fit = judged.fit.refit(&self.problem.reference).described(&judged.fit.fitted)?;
                fit.followed.extend_from_slice(&judged.fit.held_out);
                fits.insert(names, fit);
            }
        }
        Ok(fits)
    }

    /// Of the sets that were judged the most probable one.
    pub(crate) fn most_probable_judged(&self) -> Option<&Converged> {
        let judged = self.admissible().filter(|set| set.judged.is_some());
        judged.max_by(|a, b| a.log_posterior().total_cmp(&b.log_posterior()))
    }

    /// A set has the log evidence of the samples, and where it shows in the bins not more than theirs: a fit to samples may end early
    /// where a stop that is touched makes the likelihood jump, a fit to bins where formulas are wrong.
    fn set_judged(&mut self, mut set: Converged, found: Judged) {
        let base = self.fitted.get(&Vec::new());
        let of_base =
            base.and_then(|base| Some((base.score.log_evidence, &base.judged.as_ref()?.likelihoods)));
        if let Some((log_evidence, base)) = of_base {
            let of_samples = found.likelihoods.gain(base);
            let of_bins = self.of_bins.get(&set.names).map(|of_set| of_set - log_evidence);
            let seen = of_bins.filter(|gain| *gain > self.options.settings.doubt_nats);
            set.score.log_evidence = log_evidence + seen.map_or(of_samples, |gain| gain.min(of_samples));
        }
        set.point = found.fit.refit(&self.problem.reference).point(&found.fit.fitted.at);
        set.judged = Some(found);
        self.fitted.insert(set.names.clone(), set);
    }

    /// Of the sets that are not much less probable than the most probable one, the first that was not judged.
    fn next_rival(&self) -> Option<Converged> {
        let least = self.most_probable()?.log_posterior() + self.options.settings.worth_mentioning.ln();
        let is_open =
            |set: &&Converged| set.judged.is_none() && !set.names.is_empty() && set.log_posterior() > least;
        let open = self.admissible().filter(is_open);
        open.max_by(|a, b| a.log_posterior().total_cmp(&b.log_posterior())).cloned()
    }

    /// What the samples say of a set; `None` where its filter cannot be run.
    fn said_of(
        &self,
        set: &Converged,
        entered: &BTreeMap<&'static str, Entered>,
        judgement: &Judgement<'_>,
    ) -> Result<Option<Judged>, DiagnosisError> {
        match self.said.judged.get(&set.names) {
            Some(said) => Ok(Some(said.clone())),
            None => DiagnosisError::possible(judgement.beside(self, set, entered)),
        }
    }

    /// Judges the set of no effects; `None` where no filter can be run.
    fn judge_alone(&mut self, judge: &Judge<'_>) -> Result<Option<Alone>, DiagnosisError> {
        let Some(without) = self.fitted.get(&Vec::new()).cloned() else { return Ok(None) };
        let likelihoods = self.said.judged.get(&without.names).map(|said| said.likelihoods);
        let found = match self.said.alone.take().zip(likelihoods) {
            Some(said) => Some(said),
            None => DiagnosisError::possible(judge.alone(self, &without))?,
        };
        let Some((alone, found)) = found else { return Ok(None) };
        let fit = Arc::clone(&alone.fit);
        self.set_judged(without, Judged { likelihoods: found, weakest: None, fit });
        Ok(Some(alone))
    }

    /// The most probable set, or if that was judged, the same without its weakest term: the bins of a smoothed motion may need
    /// effects beside the true one that the samples do not need.
    fn next_to_judge(&self) -> Option<Converged> {
        let most = self.most_probable().filter(|set| !set.names.is_empty())?;
        let Some(judged) = &most.judged else { return Some(most.clone()) };
        let weakest = judged.weakest.as_ref().filter(|_| most.names.len() > 1)?;
        let names: Vec<String> = most.names.iter().filter(|id| *id != weakest).cloned().collect();
        let known = self.fitted.get(&names).cloned();
        let set = known.unwrap_or_else(|| {
            let mut set = Converged { names: names.clone(), judged: None, ..most.clone() };
            let id = |term: &Term| set.design.candidates.get(term.candidate).map(|c| c.id);
            let is_kept = |term: &Term| id(term).is_some_and(|id| names.iter().any(|name| name == id));
            let terms: Vec<Term> = set.terms.iter().filter(|m| is_kept(m)).cloned().collect();
            let ids: Vec<&'static str> = terms.iter().filter_map(id).collect();
            set.terms = terms;
            self.keep_only(&mut set.point, &ids);
            set
        });
        set.judged.is_none().then_some(set)
    }

    /// Drops sets that were not judged and would compete with judged ones: bins may predict more than the samples show.
    fn forget_what_was_not_judged(&mut self) {
        while let Some(set) = self.next_rival() {
            self.forget(&set.names);
        }
    }
}

impl Judge<'_> {
    /// The platform's own parameters alone, and how likely they make all recordings.
    fn alone(
        &self,
        search: &Search<'_>,
        without: &Converged,
    ) -> Result<(Alone, Likelihoods), DiagnosisError> {
        let refit = Refit::own(&search.problem.reference, &self.available);
        let fitted = self.likeliest(&refit, &[refit.units_of(&without.point)], Rival::NONE)?;
        let held_out = self.follow_held_out(&refit, &fitted.at, &[])?;
        let found = likelihoods(&fitted, &held_out);
        let deviations = fitted.covariance.diagonal().map(f64::sqrt);
        let shown = deviations.iter().map(|deviation| *deviation < search.options.settings.unshown).collect();
        Ok((Alone { fit: judged_fit(refit, fitted, held_out), shown }, found))
    }

    fn likeliest(
        &self,
        refit: &Refit<'_>,
        starts: &[Vec<f64>],
        rival: Rival<'_>,
    ) -> Result<Fitted, DiagnosisError> {
        let settings = Settings {
            threads: self.threads,
            fit_stands_nats: refit.reference.settings.converged_nats,
            fit_rounds: ROUNDS,
            ..Settings::default()
        };
        refit.likeliest(self.training, starts, rival, &settings)
    }

    /// Held-out recordings with values that were fitted to the training ones; `before`: with another model close by, or none.
    fn follow_held_out(
        &self,
        refit: &Refit<'_>,
        units: &[f64],
        before: &[Followed],
    ) -> Result<Vec<Followed>, DiagnosisError> {
        let model = refit.model_at(units).ok_or(PredictionError::NoModel)?;
        let runs: Vec<usize> = (0..self.held_out.len()).collect();
        let tried = |run: &usize| -> Result<Followed, DiagnosisError> {
            let case = Prepared::new(&self.held_out[*run], &model, Settings::default())?;
            let stated = Noise::stated(&case)?;
            let before = before.get(*run);
            Ok(before.map_or_else(|| follow(&case, &stated), |before| follow_again(&case, &stated, before)))
        };
        crate::threads::map(self.threads, &runs, tried).into_iter().collect()
    }
}

impl Judgement<'_> {
    /// How far the search is when so many sets were judged: few searches judge all that they may.
    fn progress(&self) -> Progress {
        let judged = (MOST_JUDGED - self.left.min(MOST_JUDGED)) as f64 / MOST_JUDGED as f64;
        Progress { share: 0.3 + 0.6 * judged.sqrt(), doing: "comparing every sample" }
    }

    /// How likely a set beside them makes all recordings at its own likeliest values.
    fn beside(
        &self,
        search: &Search<'_>,
        set: &Converged,
        entered: &BTreeMap<&'static str, Entered>,
    ) -> Result<Judged, DiagnosisError> {
        let (judge, alone) = (&self.judge, &self.base);
        let mut refit = Refit::own(&search.problem.reference, &judge.available);
        let own = alone.fit.fitted.at.iter().zip(&alone.shown).take(refit.columns.len());
        refit.keep(&alone.shown);
        for effect in set.names.iter().filter_map(|id| effect(id)) {
            refit.add(effect, &set.point, entered.get(effect.info().id));
        }
        // As the search found them; with the platform's own parameters where they are alone; and those without any effect, which is
        // as likely as the platform alone.
        let found = refit.units_of(&set.point);
        let mut beside = found.clone();
        let shown = own.filter(|(_, shown)| **shown);
        let mut counted = 0;
        for (from, (alone, _)) in beside.iter_mut().zip(shown) {
            *from = *alone;
            counted += 1;
        }
        let mut without = beside.clone();
        without.iter_mut().skip(counted).for_each(|units| *units = 0.0);
        let rival = Rival {
            followed: &alone.fit.fitted.followed,
            log_posterior_needed: alone.fit.fitted.log_posterior
                - log_prior(&set.names, &search.options.settings),
        };
        let fitted = judge.likeliest(&refit, &[found, beside, without], rival)?;
        // A set that gains nothing needs no test on held-out recordings.
        let gains = fitted.log_posterior > alone.fit.fitted.log_posterior;
        let held_out =
            if gains { judge.follow_held_out(&refit, &fitted.at, &alone.fit.held_out)? } else { Vec::new() };
        let likelihoods = likelihoods(&fitted, if gains { &held_out } else { &alone.fit.held_out });
        // Distance of an effect from zero, in standard deviations.
        let distance = |id: &str| {
            let own =
                refit.columns.iter().enumerate().filter(|(_, column)| column.group == id && !column.is_shape);
            own.map(|(i, _)| fitted.at[i].abs() / fitted.covariance[(i, i)].sqrt()).fold(0.0, f64::max)
        };
        let weakest = set.names.iter().min_by(|a, b| distance(a).total_cmp(&distance(b))).cloned();
        Ok(Judged { likelihoods, weakest, fit: judged_fit(refit, fitted, held_out) })
    }
}

fn judged_fit(refit: Refit<'_>, fitted: Fitted, held_out: Vec<Followed>) -> Arc<JudgedFit> {
    Arc::new(JudgedFit { fitted, columns: refit.columns, stddevs: refit.stddevs, held_out })
}

/// How likely recordings are.
fn likelihoods(fitted: &Fitted, held_out: &[Followed]) -> Likelihoods {
    let all = fitted.followed.iter().chain(held_out);
    let held_log: f64 = held_out.iter().map(Followed::log_likelihood).sum();
    Likelihoods {
        training: fitted.log_evidence,
        held_out: (!held_out.is_empty()).then_some(held_log),
        numbers: all.map(|run| run.undisturbed_likelihood.numbers).sum(),
    }
}
