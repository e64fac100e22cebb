//! Writes the parameter file with the effect, unless there is an objection.

use std::path::Path;

use anyhow::{Context, bail};
use whorl_dynamics::effects::registered;
use whorl_explain::Adoption;
use whorl_params::{EFFECTS_FOLDER, effect_files_beside, effect_yaml};

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
    write_effects(out, adoption, provenance)?;
    let written = model_file::write_step(out, &runs.known, &changes, adoption.step(provenance))?;
    let file = out.display();
    Ok(format!("{file}: {written} entries written; `whorl history {file}` lists what was adopted."))
}

/// Puts the file of every written effect of the new model into `effects/` beside it, where readers of the model look,
/// unless it is there.
fn write_effects(out: &Path, adoption: &Adoption, provenance: &str) -> anyhow::Result<()> {
    let Some(model) = adoption.versions.last().and_then(|v| v.fit.as_ref()).map(|fit| &fit.model) else {
        return Ok(());
    };
    let beside = effect_files_beside(&[out.to_owned()]);
    let folder = out.parent().unwrap_or(Path::new("")).join(EFFECTS_FOLDER);
    for effect in registered() {
        let definition = effect.definition();
        let name = format!("{}.yaml", definition.id);
        let is_there = beside.iter().any(|path| path.file_name().is_some_and(|file| *file == *name));
        if is_there || !model.effects.contains_key(&definition.id) {
            continue;
        }
        std::fs::create_dir_all(&folder).with_context(|| format!("cannot create {}", folder.display()))?;
        let path = folder.join(name);
        std::fs::write(&path, effect_yaml(definition, provenance))
            .with_context(|| format!("cannot write {}", path.display()))?;
    }
    Ok(())
}
