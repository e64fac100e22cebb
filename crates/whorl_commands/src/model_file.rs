//! Changes of a model, written into its parameter file.

use std::path::Path;

use anyhow::Context;
use whorl_explain::changes::{Change, of_step};
use whorl_node::Timestamp;
use whorl_params::{ModelStep, set_in_text};
use whorl_recording::{KnownPlatform, read_model};

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
    write(file, &known.platform, &all)?;
    Ok(all.len())
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

/// Writes the file anew with all changes, or leaves it as it is.
fn write(file: &Path, platform: &str, changes: &[Change]) -> anyhow::Result<()> {
    let name = file.display().to_string();
    let mut text = whorl_files::read_text(file).with_context(|| format!("cannot read {name}"))?;
    for change in changes {
        let comment = (!change.comment.is_empty()).then_some(change.comment.as_str());
        text = set_in_text(&name, &text, &format!("/{platform}/**"), &change.key, &change.value, comment)
            .with_context(|| format!("cannot set {}", change.key))?;
    }
    whorl_files::write_file(file, text).with_context(|| format!("cannot write {name}"))
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeMap;

    use nalgebra::Vector3;
    use whorl_dynamics::MassProperties;
    use whorl_explain::changes::changes;

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
        write(&file, &known.platform, &changes).unwrap();
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
    }
}
