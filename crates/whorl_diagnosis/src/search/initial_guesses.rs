//! Fits of the same set from other initial guesses.
//!
//! The density is not convex in values and noise together: a fit can end where no step of its own leads on, although a better
//! end is known to exist. Two initial guesses are known to lead to such ends: the noise that the base model needs, and the end of
//! a larger set.

use std::sync::Arc;

use crate::DiagnosisError;
use crate::evidence::nuisance::Nuisance;
use crate::explanations::hypothesis::Term;
use crate::search::Search;
use crate::search::converge::InitialGuess;
use crate::search::noise_optimisation::Sizes;
use crate::search::prior::smaller_sets;
use crate::search::score::Converged;

impl Search<'_> {
    /// Fits the likeliest of some sets, admissible or not, once more from its own optimum with the noise that the base model
    /// needs: without noise, a set that cannot yet follow the data is forced to wrong values.
    pub(crate) fn fit_beside_noise(&mut self, of: &[Converged]) -> Result<(), DiagnosisError> {
        let noise = self.score(&self.base).map_or(Nuisance::default(), |base| base.nuisance);
        let likeliest = of.iter().max_by(|a, b| a.log_posterior().total_cmp(&b.log_posterior()));
        let Some(likeliest) = likeliest.filter(|_| noise != Nuisance::default()) else { return Ok(()) };
        self.fit_again(likeliest, likeliest.names.clone(), noise)
    }

    /// Fits each smaller set that a set holds from the optimum of the larger one: the additional effect may be near zero, and
    /// then only the fit of the smaller set had not converged.
    pub(crate) fn fit_smaller_sets(&mut self, of: &Converged) -> Result<(), DiagnosisError> {
        for names in smaller_sets(&of.names) {
            self.fit_again(of, names, of.score.nuisance)?;
        }
        Ok(())
    }

    /// Fits those effects of a set from where it ended, with this noise.
    fn fit_again(
        &mut self,
        of: &Converged,
        names: Vec<String>,
        noise: Nuisance,
    ) -> Result<(), DiagnosisError> {
        let id_of = |m: &Term| of.design.candidates.get(m.candidate).map(|c| c.id);
        let is_kept = |id: &str| names.iter().any(|name| name == id);
        let terms: Vec<_> = of.terms.iter().filter(|m| id_of(m).is_some_and(is_kept)).cloned().collect();
        let ids: Vec<&'static str> = terms.iter().filter_map(id_of).collect();
        let mut point = of.point.clone();
        self.keep_only(&mut point, &ids);
        let mut problem = self.problem.clone();
        problem.motions = Arc::clone(&of.motions);
        problem.nuisance = noise;
        let from = InitialGuess { point, design: of.design.clone(), terms };
        if let Some(found) = self.fitted_with(problem, from, &ids, f64::NEG_INFINITY, Sizes::Any)? {
            self.remember(found);
        }
        Ok(())
    }
}
