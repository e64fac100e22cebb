//! An answer lowers the error, or is none: whether a set of effects makes the readings themselves likelier.
//!
//! Bins of a smoothed motion serve to find what may be missing, and its values. Within a bin a controller answers to the noise of
//! the readings, and a motion that is smoothed wrongly bends every formula along it: a set that explains the bins may therefore
//! explain nothing. The causal filter at the rate of the samples ([`whorl_prediction`]) has no bins.

use whorl_prediction::{Followed, Noise, Prepared, Settings, follow, follow_again};
use whorl_recording::Recording;

use crate::search::Search;
use crate::search::standing::{Converged, Likelihoods};
use crate::{DiagnosisError, Progress};

/// Sets that are judged at most, besides that of no effects.
const MOST_JUDGED: usize = 4;

/// Recordings followed with a model.
struct Judge<'a> {
    training: &'a [Recording],
    held_out: &'a [Recording],
}

impl Search<'_> {
    /// Judges the most probable set beside that of no effects, and the next ones as long as they explain nothing.
    pub(crate) fn judge(
        &mut self,
        training: &[Recording],
        held_out: &[Recording],
        progress: &mut dyn FnMut(Progress),
    ) -> Result<(), DiagnosisError> {
        let judge = Judge { training, held_out };
        let mut of_base: Option<Vec<Followed>> = None;
        for k in 0..MOST_JUDGED {
            let Some(most) = self.most_probable().filter(|set| !set.names.is_empty()).cloned() else { break };
            if most.judged.is_some() {
                break;
            }
            let share = 0.85 + 0.1 * k as f64 / MOST_JUDGED as f64;
            progress(Progress { share, doing: "comparing every sample" });
            if of_base.is_none() {
                let Some(base) = self.fitted.get(&Vec::new()).cloned() else { break };
                let Some(followed) = DiagnosisError::possible(judge.followed(self, &base, None))? else {
                    break;
                };
                self.set_judged(&base, judge.likelihoods(&followed));
                of_base = Some(followed);
            }
            // A set with which no filter can be run is left to its bins.
            let found = DiagnosisError::possible(judge.followed(self, &most, of_base.as_deref()))?;
            let Some(followed) = found else { break };
            self.set_judged(&most, judge.likelihoods(&followed));
        }
        self.settle_most_probable()
    }

    fn set_judged(&mut self, set: &Converged, likelihoods: Likelihoods) {
        if let Some(set) = self.fitted.get_mut(&set.names) {
            set.judged = Some(likelihoods);
        }
    }
}

impl Judge<'_> {
    /// Every recording as the filter follows it with a set at its values; `base` with no effects.
    fn followed(
        &self,
        search: &Search<'_>,
        set: &Converged,
        base: Option<&[Followed]>,
    ) -> Result<Vec<Followed>, DiagnosisError> {
        let model = search.problem.reference.model_at(&set.point)?;
        let runs: Vec<(usize, &Recording)> = self.training.iter().chain(self.held_out).enumerate().collect();
        let followed = |(run, recording): &(usize, &Recording)| -> Result<Followed, DiagnosisError> {
            let case = Prepared::new(recording, &model, Settings::default())?;
            let stated = Noise::stated(&case)?;
            // A model with other hidden states is followed from the beginning.
            let same_states = |base: &&Followed| base.alone.start.layout.plant == case.tangent();
            let base = base.and_then(|base| base.get(*run)).filter(same_states);
            Ok(base.map_or_else(|| follow(&case, &stated), |base| follow_again(&case, &stated, base)))
        };
        crate::threads::map(search.options.threads, &runs, followed).into_iter().collect()
    }

    fn likelihoods(&self, followed: &[Followed]) -> Likelihoods {
        let (training, held_out) = followed.split_at(self.training.len().min(followed.len()));
        let sum = |runs: &[Followed]| runs.iter().map(Followed::log_likelihood).sum::<f64>();
        Likelihoods {
            training: sum(training),
            held_out: (!held_out.is_empty()).then(|| sum(held_out)),
            numbers: followed.iter().map(|run| run.likelihood_alone.numbers).sum(),
        }
    }
}
