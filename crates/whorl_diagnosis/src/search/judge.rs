//! An answer lowers the error, or is none: whether a set of effects makes the readings themselves likelier.
//!
//! Bins of a smoothed motion serve to find what may be missing, and first values. Within a bin a controller answers to the noise
//! of the readings, and a motion that is smoothed wrongly bends every formula along it: a set that explains the bins may therefore
//! explain nothing. The causal filter at the rate of the samples ([`whorl_prediction`]) has no bins: with it the platform's own
//! parameters are fitted alone, and beside each set that is nearly the most probable one.

use whorl_prediction::{Fitted, Noise, PredictionError, Prepared, Settings, follow};
use whorl_recording::Recording;

use crate::explanations::candidates::effect;
use crate::explanations::hypothesis::Member;
use crate::parameters::available::Available;
use crate::refit::{Entered, Refit};
use crate::search::Search;
use crate::search::standing::{Converged, Judged, Likelihoods};
use crate::{DiagnosisError, Progress};

/// Sets that are judged at most, besides that of no effects.
const MOST_JUDGED: usize = 6;

/// Recordings show a parameter if they leave it less than this share of its deviation: half a tenth of its information is theirs.
const UNSHOWN: f64 = 0.975;
/// Values stand when a step promises less than this (natural logarithm): a tenth of what is worth a mention.
const STANDS_NATS: f64 = 0.3;
/// Levels of noise are found anew so often at most. It bounds work: how far from the likeliest a fit may end by it was not measured.
const ROUNDS: usize = 3;

/// Recordings that sets are fitted to and tried on.
struct Judge<'a> {
    training: &'a [Recording],
    held_out: &'a [Recording],
    available: Available,
    threads: usize,
}

/// The platform's own parameters where they are likeliest alone.
struct Alone {
    /// In units of their deviations.
    units: Vec<f64>,
    /// Which of them the recordings show.
    shown: Vec<bool>,
}

fn numbers(fitted: &Fitted) -> usize {
    fitted.followed.iter().map(|run| run.likelihood_alone.numbers).sum()
}

impl Search<'_> {
    /// Judges the most probable set beside that of no effects, parts of it while they are more probable, and the next ones as long as they
    /// explain nothing.
    pub(crate) fn judge(
        &mut self,
        training: &[Recording],
        held_out: &[Recording],
        progress: &mut dyn FnMut(Progress),
    ) -> Result<(), DiagnosisError> {
        let available = Available::of(&self.problem.runs);
        let judge = Judge { training, held_out, available, threads: self.options.threads };
        let mut base: Option<Alone> = None;
        for k in 0..MOST_JUDGED {
            let Some((set, larger)) = self.next_to_judge() else { break };
            let share = 0.85 + 0.1 * k as f64 / MOST_JUDGED as f64;
            progress(Progress { share, doing: "comparing every sample" });
            if base.is_none() {
                let Some(without) = self.fitted.get(&Vec::new()).cloned() else { break };
                let Some((alone, found)) = DiagnosisError::possible(judge.alone(self, &without))? else {
                    break;
                };
                self.set_judged(without, Judged { likelihoods: found, weakest: None }, None);
                base = Some(alone);
            }
            let Some(base) = &base else { break };
            // A set with which no filter can be run is left to its bins.
            let Some(found) = DiagnosisError::possible(judge.beside(self, &set, base))? else { break };
            self.set_judged(set, found, larger.as_deref());
        }
        if base.is_some() && self.most_probable().is_some_and(|most| most.judged.is_none()) {
            self.forget_what_was_not_judged();
        }
        self.settle_most_probable()
    }

    /// The most probable set; if it was judged that without its weakest member, and the names of the larger one. What bins of a smoothed motion
    /// need beside the true effect the samples may do without.
    fn next_to_judge(&self) -> Option<(Converged, Option<Vec<String>>)> {
        let most = self.most_probable().filter(|set| !set.names.is_empty())?;
        let Some(judged) = &most.judged else { return Some((most.clone(), None)) };
        let weakest = judged.weakest.as_ref().filter(|_| most.names.len() > 1)?;
        let names: Vec<String> = most.names.iter().filter(|id| *id != weakest).cloned().collect();
        let known = self.fitted.get(&names).cloned();
        let set = known.unwrap_or_else(|| {
            let mut set = Converged { names: names.clone(), judged: None, ..most.clone() };
            let id = |member: &Member| set.layout.candidates.get(member.candidate).map(|c| c.id);
            let is_kept = |member: &Member| id(member).is_some_and(|id| names.iter().any(|name| name == id));
            let members: Vec<Member> = set.members.iter().filter(|m| is_kept(m)).cloned().collect();
            let ids: Vec<&'static str> = members.iter().filter_map(id).collect();
            set.members = members;
            self.keep_only(&mut set.point, &ids);
            set
        });
        set.judged.is_none().then(|| (set, Some(most.names.clone())))
    }

    /// Beside sets that were judged none is believed that was not: bins may promise more than the samples hold.
    fn forget_what_was_not_judged(&mut self) {
        while let Some(most) = self.most_probable().filter(|set| set.judged.is_none()) {
            let names = most.names.clone();
            self.fitted.remove(&names);
        }
    }

    /// Nothing is surer than the samples say; and a part of a set that was judged is as much less sure than it as they say.
    fn set_judged(&mut self, mut set: Converged, found: Judged, larger: Option<&[String]>) {
        let gain_over = |other: Option<&Converged>| {
            let judged = other.and_then(|other| other.judged.as_ref())?;
            Some(other?.standing.log_evidence + found.likelihoods.gain(&judged.likelihoods))
        };
        let over_base = gain_over(self.fitted.get(&Vec::new()));
        if let Some(log_evidence) = larger.and_then(|names| gain_over(self.fitted.get(names))) {
            set.standing.log_evidence = log_evidence;
        } else if let Some(most) = over_base {
            set.standing.log_evidence = set.standing.log_evidence.min(most);
        }
        set.judged = Some(found);
        self.fitted.insert(set.names.clone(), set);
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
        let fitted = self.likeliest(&refit, &[refit.units_of(&without.point)])?;
        let found = self.likelihoods(&refit, &fitted.at, fitted.log_evidence, numbers(&fitted))?;
        let deviations = fitted.covariance.diagonal().map(f64::sqrt);
        let shown = deviations.iter().map(|deviation| *deviation < UNSHOWN).collect();
        Ok((Alone { units: fitted.at, shown }, found))
    }

    /// How likely a set beside them makes all recordings at its own likeliest values.
    fn beside(&self, search: &Search<'_>, set: &Converged, alone: &Alone) -> Result<Judged, DiagnosisError> {
        let mut refit = Refit::own(&search.problem.reference, &self.available);
        let own = alone.units.iter().zip(&alone.shown).take(refit.columns.len());
        refit.keep(&alone.shown);
        let entered = Entered::of(&set.layout, &set.members);
        for effect in set.names.iter().filter_map(|id| effect(id)) {
            refit.add(effect, &set.point, entered.get(effect.info().id));
        }
        // As the search found them, and the platform's own parameters where they are alone.
        let found = refit.units_of(&set.point);
        let mut beside = found.clone();
        let shown = own.filter(|(_, shown)| **shown);
        beside.iter_mut().zip(shown).for_each(|(from, (alone, _))| *from = *alone);
        let fitted = self.likeliest(&refit, &[found, beside])?;
        let likelihoods = self.likelihoods(&refit, &fitted.at, fitted.log_evidence, numbers(&fitted))?;
        // How many deviations an effect is from none.
        let distance = |id: &str| {
            let own =
                refit.columns.iter().enumerate().filter(|(_, column)| column.group == id && !column.is_shape);
            own.map(|(i, _)| fitted.at[i].abs() / fitted.covariance[(i, i)].sqrt()).fold(0.0, f64::max)
        };
        let weakest = set.names.iter().min_by(|a, b| distance(a).total_cmp(&distance(b))).cloned();
        Ok(Judged { likelihoods, weakest })
    }

    fn likeliest(&self, refit: &Refit<'_>, starts: &[Vec<f64>]) -> Result<Fitted, DiagnosisError> {
        let settings = Settings {
            threads: self.threads,
            fit_stands_nats: STANDS_NATS,
            fit_rounds: ROUNDS,
            ..Settings::default()
        };
        refit.likeliest(self.training, starts, &settings)
    }

    /// With held-out recordings as values that were fitted to the training ones make them.
    fn likelihoods(
        &self,
        refit: &Refit<'_>,
        units: &[f64],
        log_evidence: f64,
        numbers: usize,
    ) -> Result<Likelihoods, DiagnosisError> {
        let model = refit.model_at(units).ok_or(PredictionError::NoModel)?;
        let tried = |recording: &Recording| -> Result<(f64, usize), DiagnosisError> {
            let case = Prepared::new(recording, &model, Settings::default())?;
            let followed = follow(&case, &Noise::stated(&case)?);
            Ok((followed.log_likelihood(), followed.likelihood_alone.numbers))
        };
        let tried: Vec<(f64, usize)> = crate::threads::map(self.threads, self.held_out, tried)
            .into_iter()
            .collect::<Result<_, DiagnosisError>>()?;
        Ok(Likelihoods {
            training: log_evidence,
            held_out: (!tried.is_empty()).then(|| tried.iter().map(|(log, _)| log).sum()),
            numbers: numbers + tried.iter().map(|(_, numbers)| numbers).sum::<usize>(),
        })
    }
}
