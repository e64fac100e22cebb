//! Whether the samples need a law that no effect of the catalogue has.
//!
//! Bins of a smoothed motion propose such laws as they propose effects. At the rate of the samples each is a column of the causal filter
//! beside the parameters of the set ([`whorl_prediction::hints`]), with the slow random torque and the noise that the samples show:
//! what a law gains there is all that it may claim.

use whorl_prediction::Law;
use whorl_recording::Recording;

use crate::DiagnosisError;
use crate::evidence::regression::Estimate;
use crate::explanations::shapes::{At, columns_of, laws, push, shapes};
use crate::search::Search;
use crate::search::nameless::{Nameless, beside};
use crate::search::standing::{Converged, JudgedFit};

impl Search<'_> {
    /// Takes from laws beside a set what the samples do not say.
    pub(crate) fn judge_laws(
        &self,
        at: &Converged,
        found: &mut Vec<Nameless>,
        training: &[Recording],
    ) -> Result<(), DiagnosisError> {
        let least = at.standing.log_evidence + self.options.settings.worth_mentioning.ln();
        let is_likely = |law: &Nameless| law.log_evidence > least;
        if !found.iter().any(is_likely) {
            return Ok(());
        }
        let Some(fit) = at.judged.as_ref().map(|judged| &judged.fit) else { return Ok(()) };
        let is_large = self.problem.is_large_torque(fit.torque_n_m());
        let Some(gains) = DiagnosisError::possible(self.gains_of_laws(at, fit, training))? else {
            return Ok(());
        };
        found.retain_mut(|one| {
            let Some(law) = one.law else { return is_large };
            let most = gains.get(law).copied().flatten();
            let most = most.map_or(f64::NEG_INFINITY, |gain| at.standing.log_evidence + gain + one.log_prior);
            one.log_evidence = one.log_evidence.min(most);
            one.log_evidence.is_finite()
        });
        found.sort_by(|a, b| b.log_evidence.total_cmp(&a.log_evidence));
        Ok(())
    }

    /// Log evidence that each law brings beside a set that was fitted to the samples, without its price.
    fn gains_of_laws(
        &self,
        at: &Converged,
        fit: &JudgedFit,
        training: &[Recording],
    ) -> Result<Vec<Option<f64>>, DiagnosisError> {
        let problem = &self.problem;
        let groups = shapes(self.place());
        let columns = columns_of(&groups);
        let of_run = |(run, motion)| -> Vec<Box<Law<'_>>> {
            let law = |column| -> Box<Law<'_>> {
                let (groups, torques) = (&groups, &problem.torques);
                Box::new(move |plant| push(groups, column, &At::plant(run, motion, plant), torques))
            };
            columns.iter().map(law).collect()
        };
        let of_runs: Vec<_> = problem.runs.iter().zip(at.motions.iter()).map(of_run).collect();
        let refit = fit.refit(&problem.reference);
        let normal = fit.normal(&refit, &of_runs, training, self.options.threads)?;
        let own: Vec<usize> = (0..refit.columns.len()).collect();
        let known = |i: usize| refit.stddevs.get(i).map(|stddev| stddev.powi(2));
        let Some(without) = Estimate::new(&normal, &own, |i| known(i).unwrap_or(1.0)) else {
            return Ok(Vec::new());
        };
        let gain = |law: &_| Some(beside(&normal, &own, law, &known)?.log_evidence - without.log_evidence);
        Ok(crate::threads::map(problem.threads, &laws(&groups, &columns), gain))
    }
}
