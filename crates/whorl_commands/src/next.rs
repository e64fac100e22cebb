//! The manoeuvre that separates explanations best.

use std::path::{Path, PathBuf};

use whorl_explain::{ProgressCallback, Proposal, propose};
use whorl_identification::{Diagnosis, NextManoeuvre, Options, Verdict};
use whorl_recording::KnownPlatform;

use crate::rehearsal::{Stage, own_text};
use crate::runs::Runs;

/// What `whorl diagnose` recommends as the next run: the best manoeuvre, if several explanations remain or the data
/// could not have shown any. `None` if nothing needs to be separated or no manoeuvre can be simulated.
#[must_use]
pub fn suggestion(
    runs: &Runs,
    diagnosis: &Diagnosis,
    options: &Options,
    say: &mut ProgressCallback<'_>,
) -> Option<NextManoeuvre> {
    if !matches!(diagnosis.verdict, Verdict::Confounded | Verdict::NotEnoughInformation) {
        return None;
    }
    let common = common_file(&runs.known, None)?;
    let proposal = proposal(runs, &common, diagnosis, options, say).ok()?;
    let best = proposal.judged.first()?;
    Some(NextManoeuvre {
        manoeuvre: format!(
            "{} {} ({}); `whorl next` writes it as an experiment",
            runs.known.platform, best.manoeuvre.words, best.manoeuvre.name
        ),
        expected_log_odds: best.expected.log_odds.unwrap_or(0.0),
    })
}

/// Simulates the manoeuvres on the fitted platform and evaluates them. `common` is the parameter file that all
/// nodes share.
///
/// # Errors
/// When no manoeuvre can be simulated.
pub fn proposal(
    runs: &Runs,
    common: &Path,
    diagnosis: &Diagnosis,
    options: &Options,
    say: &mut ProgressCallback<'_>,
) -> anyhow::Result<Proposal> {
    let (case, known) = (runs.case(), &runs.known);
    let truth = diagnosis.fits.get(&diagnosis.effects).map_or(case.model, |fit| &fit.model);
    let stage = Stage::new(known, &own_text(known)?, common, truth)?;
    let rehearse = |name: &str, yaml: &str| {
        stage.rehearse(name, yaml, &known.model).map_err(|error| crate::in_words(&error))
    };
    Ok(propose(&case, &known.platform, diagnosis, options, &rehearse, say)?)
}

/// The parameters that all nodes share: beside the model, in `folder`, or in the working directory's `params`.
#[must_use]
pub fn common_file(known: &KnownPlatform, folder: Option<&Path>) -> Option<PathBuf> {
    let beside = known.files.iter().find(|f| f.file_name().is_some_and(|n| n == "common.yaml")).cloned();
    let there = [folder, Some(Path::new("params"))];
    beside.or_else(|| there.into_iter().flatten().map(|f| f.join("common.yaml")).find(|f| f.is_file()))
}
