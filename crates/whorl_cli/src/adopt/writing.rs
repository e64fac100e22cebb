//! Writes the parameter file with the effect, unless there is an objection.

use std::path::Path;

use anyhow::{Context, bail};
use whorl_explain::Adoption;

use crate::model_file;
use crate::runs::Runs;

/// Writes the last version into the parameter file and reports it.
pub fn write(
    out: Option<&Path>,
    anyway: bool,
    runs: &Runs,
    adoption: &Adoption,
    provenance: &str,
) -> anyhow::Result<String> {
    let Some(out) = out else { bail!("name the file to write with --out") };
    let case = runs.case();
    if let Some(objection) = adoption.objection(&case).filter(|_| !anyway) {
        bail!("{objection}. Nothing was written; --anyway overrides this");
    }
    let changes = adoption.changes(&case, provenance);
    if changes.is_empty() {
        bail!("the fit changed nothing, so nothing was written");
    }
    if !out.exists() {
        let source = runs.known.files.last().context("there is no parameter file to start from")?;
        std::fs::copy(source, out).with_context(|| format!("cannot write {}", out.display()))?;
    }
    let written = model_file::write_step(out, &runs.known, &changes, adoption.step(provenance))?;
    let file = out.display();
    Ok(format!("{file}: {written} entries written; `whorl history {file}` lists what was adopted."))
}
