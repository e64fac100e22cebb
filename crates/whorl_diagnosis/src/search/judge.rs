//! An answer lowers the error, or is none: whether a set of effects makes the readings themselves likelier.
//!
//! Bins of a smoothed motion serve to find what may be missing, and first values. Within a bin a controller answers to the noise
//! of the readings, and a motion that is smoothed wrongly bends every formula along it: a set that explains the bins may therefore
//! explain nothing. The causal filter at the rate of the samples ([`whorl_prediction`]) has no bins: with it the platform's own
//! parameters are fitted alone, and beside each set that is nearly the most probable one.

use whorl_prediction::{Fitted, Noise, PredictionError, Prepared, Settings, follow};
use whorl_recording::Recording;

use crate::explanations::candidates::effect;
use crate::parameters::available::Available;
use crate::refit::{Entered, Refit};
use crate::search::Search;
use crate::search::standing::{Converged, Likelihoods};
use crate::{DiagnosisError, Progress};

/// Sets that are judged at most, besides that of no effects.
const MOST_JUDGED: usize = 4;

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
    /// Judges the most probable set beside that of no effects, and the next ones as long as they explain nothing.
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
            let Some(most) = self.most_probable().filter(|set| !set.names.is_empty()).cloned() else { break };
            if most.judged.is_some() {
                break;
            }
            let share = 0.85 + 0.1 * k as f64 / MOST_JUDGED as f64;
            progress(Progress { share, doing: "comparing every sample" });
            if base.is_none() {
                let Some(without) = self.fitted.get(&Vec::new()).cloned() else { break };
                let Some((alone, found)) = DiagnosisError::possible(judge.alone(self, &without))? else {
                    break;
                };
                self.set_judged(&without, found);
                base = Some(alone);
            }
            let Some(base) = &base else { break };
            // A set with which no filter can be run is left to its bins.
            let Some(found) = DiagnosisError::possible(judge.beside(self, &most, base))? else { break };
            self.set_judged(&most, found);
            if k + 1 == MOST_JUDGED {
                self.forget_what_was_not_judged();
            }
        }
        self.settle_most_probable()
    }

    /// Beside sets that were judged none is believed that was not: bins may promise more than the samples hold.
    fn forget_what_was_not_judged(&mut self) {
        while let Some(most) = self.most_probable().filter(|set| set.judged.is_none()) {
            let names = most.names.clone();
            self.fitted.remove(&names);
        }
    }

    /// Nothing is surer than the samples say.
    fn set_judged(&mut self, set: &Converged, found: Likelihoods) {
        let base = self.fitted.get(&Vec::new()).map(|base| (base.judged, base.standing.log_evidence));
        let Some(set) = self.fitted.get_mut(&set.names) else { return };
        if let Some((Some(judged), log_evidence)) = base {
            let most = log_evidence + found.gain(&judged);
            set.standing.log_evidence = set.standing.log_evidence.min(most);
        }
        set.judged = Some(found);
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
    fn beside(
        &self,
        search: &Search<'_>,
        set: &Converged,
        alone: &Alone,
    ) -> Result<Likelihoods, DiagnosisError> {
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
        self.likelihoods(&refit, &fitted.at, fitted.log_evidence, numbers(&fitted))
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
