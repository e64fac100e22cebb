//! How far a model is from recorded runs.

use rayon::iter::{IndexedParallelIterator, IntoParallelIterator, ParallelIterator};
use whorl_identification::usable_readings;
use whorl_prediction::Followed;
use whorl_recording::Recording;
use whorl_validation::Comparison;

use crate::{Case, ExplainError, ProgressCallback};

/// A run that was compared.
#[derive(Debug, Clone)]
pub struct ComparedRun {
    /// The numbers.
    pub comparison: Comparison,
    /// Whether the run was kept out of every fit.
    pub held_out: bool,
}

/// Compares every run with the given model, training runs first, on all cores.
///
/// # Errors
/// When a run cannot be compared, with what would help.
pub fn compare(case: &Case<'_>, say: &mut ProgressCallback<'_>) -> Result<Vec<ComparedRun>, ExplainError> {
    compare_fitted(case, &[], say)
}

/// The same of a model that was fitted, with the runs as the fit has followed them, as far as it has.
pub(crate) fn compare_fitted(
    case: &Case<'_>,
    followed: &[Followed],
    say: &mut ProgressCallback<'_>,
) -> Result<Vec<ComparedRun>, ExplainError> {
    let all: Vec<&Recording> = case.training.iter().chain(case.held_out).collect();
    let names: Vec<&str> = all.iter().map(|run| run.name.as_str()).collect();
    say(0.0, &format!("comparing {}", names.join(", ")));
    let compared = |(i, run): (usize, &Recording)| -> Result<ComparedRun, ExplainError> {
        let (usable, left_out) = usable_readings(run, case.model);
        let mut comparison = whorl_validation::compare_as(&usable, case.model, followed.get(i))?;
        comparison.remarks.extend(left_out);
        Ok(ComparedRun { comparison, held_out: i >= case.training.len() })
    };
    let results: Vec<_> = all.into_par_iter().enumerate().map(compared).collect();
    // The first error in the order of the runs.
    results.into_iter().collect()
}

/// Prediction error of a model, over all training or all held-out runs; `None` if no run is long enough. 1 = as good as the
/// model says: noise alone.
///
/// It is the root of the mean square of all prediction errors, each over the deviation that the model predicts for it: of every sample of
/// gyro, accelerometer, vector sensors and wheel speeds, over stretches of 10 s (a quarter of the run for shorter ones), each predicted
/// by the model and the recorded commands alone from what a filter with this model knows at its beginning.
#[must_use]
pub fn prediction_error(runs: &[ComparedRun], held_out: bool) -> Option<f64> {
    let asked = runs.iter().filter(|run| run.held_out == held_out);
    whorl_validation::prediction_error(asked.map(|run| &run.comparison))
}
