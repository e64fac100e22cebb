//! What a demonstration has found, and what was hidden.

use std::path::Path;

use anyhow::{Context, bail};
use whorl_explain::{Case, compare, prediction_error};
use whorl_math::deg_from_rad;
use whorl_recording::{ReadOptions, read_model, read_run_with};

use super::PLATFORM;
use super::secret::Secret;
use super::session::Session;
use crate::output::say;

/// A number with the model as it was, and with the one that was adopted.
#[derive(Debug, Default)]
pub struct Fall {
    /// `None`: it did not come to that.
    pub before: Option<f64>,
    /// Likewise.
    pub after: Option<f64>,
}

/// As far as it came.
#[derive(Debug, Default)]
pub struct Outcome {
    /// `None`: nothing was hidden yet.
    pub secret: Option<Secret>,
    /// Effects that were named, or the file of the law.
    pub found: Vec<String>,
    /// Prediction error of the last run, relative to the noise.
    pub prediction: Fall,
    /// Pointing error, RMS \[rad\].
    pub pointing_rad: Fall,
}

impl Outcome {
    /// What was hidden, what was found, and the errors.
    pub fn print(&self, session: &Session) {
        let Some(secret) = &self.secret else { return };
        session.headline("the secret was");
        say!("  {}: {}", secret.effect, secret.parameters);
        say!("  {}", secret.equation);
        match self.found.as_slice() {
            [] => say!("found: nothing so far"),
            found => say!("found: {}", found.join(" and ")),
        }
        if self.found.len() > 1 && self.found.contains(&secret.effect) {
            say!("more was found than the secret: what its formula leaves");
        }
        if self.pointing_rad.before.is_none() {
            return;
        }
        say!("\n{:<44} {:>10} {:>10}", "", "before", "after");
        let row = |what: &str, fall: &Fall, digits: usize, shown: fn(f64) -> f64| {
            let [before, after] = [fall.before, fall.after]
                .map(|value| value.map_or("-".to_owned(), |value| format!("{:.digits$}", shown(value))));
            say!("{what:<44} {before:>10} {after:>10}");
        };
        row("prediction error of the new run (1 = noise)", &self.prediction, 2, |error| error);
        row("pointing error [deg RMS]", &self.pointing_rad, 4, deg_from_rad);
    }

    /// Whether both errors fell.
    pub fn judged(&self) -> anyhow::Result<()> {
        for (fall, what) in [(&self.prediction, "prediction"), (&self.pointing_rad, "pointing")] {
            if !fall.before.zip(fall.after).is_some_and(|(before, after)| after < before) {
                bail!("the {what} error did not fall");
            }
        }
        Ok(())
    }
}

/// Prediction error of a model on a run, relative to the noise.
pub fn prediction(run: &Path, model: &Path) -> anyhow::Result<f64> {
    let known = read_model(model, Some(PLATFORM))?;
    let options = ReadOptions { platform: Some(PLATFORM), model: Some(&known.model), channels: None };
    let runs = read_run_with(run, &options)?;
    let case = Case { training: &runs, held_out: &[], model: &known.model, prior: &known.prior };
    prediction_error(&compare(&case, &mut |_, _| {})?, false)
        .with_context(|| format!("{} cannot be predicted", run.display()))
}
