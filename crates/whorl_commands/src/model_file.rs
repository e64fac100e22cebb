//! Changes of a model, written into its parameter file.

use std::path::{Path, PathBuf};

use anyhow::{Context, bail};
use sha2::{Digest, Sha256};
use whorl_node::Timestamp;
use whorl_params::changes::{Change, of_step};
use whorl_params::{ModelStep, set_in_text};
use whorl_recording::{KnownPlatform, read_model};

/// Folder beside a parameter file in which its text before each step is kept.
const KEPT: &str = "history";

/// Writes the changes into an existing file and notes them there as the next step of the model's history. `step` has
/// neither number nor date; `now` \[UTC\] becomes its date. Returns how many entries were written.
///
/// # Errors
/// When the file cannot be written; then it is as before.
pub fn write_step(
    file: &Path,
    known: &KnownPlatform,
    changes: &[Change],
    step: ModelStep,
    now: Timestamp,
) -> anyhow::Result<usize> {
    // A file without a whole model has the history of the model that it changes.
    let history =
        read_model(file, Some(&known.platform)).map_or_else(|_| known.history.clone(), |k| k.history);
    let number = history.last().map_or(1, |last| last.number.saturating_add(1));
    let date = Some(whorl_bag::utc(now));
    let all = [changes, of_step(&ModelStep { number, date, ..step }).as_slice()].concat();
    write(file, &known.platform, &all, number)?;
    Ok(all.len())
}

/// Takes the last step of a model's history back: the file is as it was before, to the letter. Returns that step.
///
/// # Errors
/// When there is none; when the file was changed since, or its text before is not kept.
pub fn undo_step(file: &Path, platform: Option<&str>) -> anyhow::Result<ModelStep> {
    let known = read_model(file, platform)?;
    let name = file.display();
    let Some(step) = known.history.last().cloned() else {
        bail!("{name} has no history: nothing was adopted into it");
    };
    let number = step.number;
    let kept = kept_file(file, number);
    let (head, before) = text_before(file, number)?;
    let now = whorl_files::read_text(file).with_context(|| format!("cannot read {name}"))?;
    if !head.ends_with(&hash(&now)) {
        bail!(
            "{name} was changed after step {number}, which cannot be taken back by itself; its text before is {}: compare the \
             two and change it by hand",
            kept.display()
        );
    }
    whorl_files::write_file(file, &before).with_context(|| format!("cannot write {name}"))?;
    std::fs::remove_file(&kept).with_context(|| format!("cannot remove {}", kept.display()))?;
    Ok(step)
}

/// What is kept of a model's file before a step: a line on the step, and the text.
///
/// # Errors
/// When it is not kept.
pub fn text_before(file: &Path, number: u32) -> anyhow::Result<(String, String)> {
    let kept = kept_file(file, number);
    let text = whorl_files::read_text(&kept).with_context(|| {
        format!("the text of {} before step {number} is not kept in {}", file.display(), kept.display())
    })?;
    let (head, before) = text.split_once('\n').unwrap_or((&text, ""));
    Ok((head.to_owned(), before.to_owned()))
}

/// `params/history/whorl_1_before_step_3.yaml` of `params/whorl_1.yaml`.
fn kept_file(file: &Path, number: u32) -> PathBuf {
    let stem = file.file_stem().unwrap_or_default().to_string_lossy();
    file.with_file_name(KEPT).join(format!("{stem}_before_step_{number}.yaml"))
}

fn hash(text: &str) -> String {
    Sha256::digest(text).iter().map(|byte| format!("{byte:02x}")).collect()
}

/// Makes sure that there is a file to write into: a copy of the model's where there is none.
///
/// # Errors
/// When nothing can be copied there.
pub fn prepare_out(out: &Path, known: &KnownPlatform) -> anyhow::Result<()> {
    if out.exists() {
        return Ok(());
    }
    let has_model =
        |file: &&std::path::PathBuf| whorl_files::read_text(file).is_ok_and(|text| text.contains("model:"));
    let file = known.files.iter().rev().find(has_model);
    let file = file.context("no file of the model to copy; name an existing --out")?;
    // The text and not the file: its permissions may be those of a template.
    let text = std::fs::read(file).with_context(|| format!("cannot read {}", file.display()))?;
    whorl_files::write_file(out, text)
        .with_context(|| format!("cannot copy {} to {}", file.display(), out.display()))
}

/// Writes the file anew with all changes, or leaves it as it is. What it was before this step is kept.
fn write(file: &Path, platform: &str, changes: &[Change], number: u32) -> anyhow::Result<()> {
    let name = file.display().to_string();
    let before = whorl_files::read_text(file).with_context(|| format!("cannot read {name}"))?;
    let mut text = before.clone();
    for change in changes {
        let comment = (!change.comment.is_empty()).then_some(change.comment.as_str());
        text = set_in_text(&name, &text, &format!("/{platform}/**"), &change.key, &change.value, comment)
            .with_context(|| format!("cannot set {}", change.key))?;
    }
    let kept = kept_file(file, number);
    let folder = kept.parent().unwrap_or(Path::new(KEPT));
    std::fs::create_dir_all(folder).with_context(|| format!("cannot create {}", folder.display()))?;
    let head = format!(
        "# {name} before step {number}, for `whorl adopt --undo`; hash (SHA-256) of the file after it: {}\n",
        hash(&text)
    );
    whorl_files::write_file(&kept, head + &before)
        .with_context(|| format!("cannot write {}", kept.display()))?;
    whorl_files::write_file(file, text).with_context(|| format!("cannot write {name}"))
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeMap;

    use nalgebra::Vector3;
    use whorl_dynamics::MassProperties;
    use whorl_params::changes::changes;

    use super::*;

    #[test]
    fn an_adopted_effect_is_read_back_and_comments_stay() {
        let directory = tempfile::tempdir().unwrap();
        let file = directory.path().join("whorl_1.yaml");
        let source = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../params/whorl_1.yaml");
        std::fs::copy(source, &file).unwrap();
        let known = whorl_recording::read_model(&file, None).unwrap();
        let (mut model, mut prior) = (known.model.clone(), known.prior.clone());
        let parameters = BTreeMap::from([("torque_n_m".to_owned(), 0.020_012_3)]);
        model.effects.insert("bearing_coulomb_friction".to_owned(), parameters);
        let deviations = BTreeMap::from([("torque_n_m".to_owned(), 3e-4)]);
        prior.effects.insert("bearing_coulomb_friction".to_owned(), deviations);
        let mut inertia = *model.mass_properties.inertia_b_kg_m2();
        inertia[(2, 2)] = 12.284_567;
        let offset = Vector3::new(-0.0212, -0.0733, -2.087);
        model.mass_properties =
            MassProperties::new(inertia, offset, model.mass_properties.mass_kg()).unwrap();
        prior.inertia_b_kg_m2[(2, 2)] = 0.02;
        model.wheels_mut()[1].spin_inertia_kg_m2 = 0.020_15;
        prior.actuators.wheels.spin_inertia[1] = 0.002;
        model.jets_mut()[4].thrust_n = 0.391;
        let changes = changes((&known.model, &model), (&known.prior, &prior), "run a, sha256 1234");
        let before = std::fs::read_to_string(&file).unwrap();
        let step = ModelStep {
            effects: vec!["bearing_coulomb_friction".into()],
            ..ModelStep::of_source("run a".into())
        };
        write_step(&file, &known, &changes, step, Timestamp(0)).unwrap();
        let again = whorl_recording::read_model(&file, None).unwrap();
        assert!((again.model.effects["bearing_coulomb_friction"]["torque_n_m"] - 0.020_012).abs() < 1e-9);
        assert!((again.model.mass_properties.inertia_b_kg_m2()[(2, 2)] - 12.2846).abs() < 1e-9);
        assert!((again.model.mass_properties.gravity_offset_b_n_m() - offset).norm() < 1e-6);
        assert!((again.model.wheels()[1].spin_inertia_kg_m2 - 0.020_15).abs() < 1e-9);
        assert_eq!(again.model.wheels()[0], known.model.wheels()[0]);
        assert!((again.model.jets()[4].thrust_n - 0.391).abs() < 1e-9);
        assert!((again.prior.effects["bearing_coulomb_friction"]["torque_n_m"] - 3e-4).abs() < 1e-12);
        assert!((again.prior.inertia_b_kg_m2[(2, 2)] - 0.02).abs() < 1e-12);
        assert!((again.prior.actuators.wheels.spin_inertia[1] - 0.002).abs() < 1e-6);
        let entry = again.prior_entries.iter().find(|e| e.key.starts_with("effects.")).unwrap();
        assert_eq!(entry.source.as_deref(), Some("adopted: run a, sha256 1234"));
        let (old, new) = (
            std::fs::read_to_string(Path::new(env!("CARGO_MANIFEST_DIR")).join("../../params/whorl_1.yaml"))
                .unwrap(),
            std::fs::read_to_string(&file).unwrap(),
        );
        let comments = |text: &str| text.lines().filter(|l| l.trim_start().starts_with('#')).count();
        assert!(comments(&new) >= comments(&old));
        assert!(new.contains("adopted, was 12.1"), "{new}");

        // What somebody wrote since is not lost; else it is taken back to the letter.
        std::fs::write(&file, format!("{new}# by hand\n")).unwrap();
        let error = undo_step(&file, None).unwrap_err().to_string();
        assert!(error.contains("history/whorl_1_before_step_1.yaml"), "{error}");
        std::fs::write(&file, &new).unwrap();
        let undone = undo_step(&file, None).unwrap();
        assert_eq!((undone.number, undone.effects), (1, vec!["bearing_coulomb_friction".to_owned()]));
        assert_eq!(std::fs::read_to_string(&file).unwrap(), before);
        assert!(undo_step(&file, None).unwrap_err().to_string().contains("has no history"));
    }
}
