//! Answers of `adopt`: as JSON, and written into the parameter file unless there is an objection.

use std::path::Path;

use anyhow::{Context, bail};
use serde_json::json;
use whorl_dynamics::effects::registered;
use whorl_explain::{Adoption, Version};
use whorl_identification::Fit;
use whorl_math::words::shell_word;
use whorl_node::Timestamp;
use whorl_params::changes::changes;
use whorl_params::{EFFECTS_FOLDER, effect_files_beside, effect_yaml};

use crate::model_file;
use crate::pointing::Pointing;
use crate::runs::Runs;

/// Version of the JSON output.
const SCHEMA: u32 = 2;

/// Writes the last version into the parameter file and reports it; `now` \[UTC\] is the date of the step.
///
/// # Errors
/// An objection, unless `anyway`; a file that cannot be written.
pub fn write(
    out: Option<&Path>,
    anyway: bool,
    runs: &Runs,
    adoption: &Adoption,
    provenance: &str,
    now: Timestamp,
) -> anyhow::Result<String> {
    let Some(out) = out else { bail!("name the file to write with --out") };
    let case = runs.case();
    if let Some(objection) = adoption.objection().filter(|_| !anyway) {
        bail!("{objection}. Nothing was written; --anyway overrides this");
    }
    let fit = adoption.versions.last().and_then(|version| version.fit.as_ref());
    let of = |fit: &Fit| changes((case.model, &fit.model), (case.prior, &fit.prior), provenance);
    let changes = fit.map(of).unwrap_or_default();
    if changes.is_empty() {
        bail!("the fit changed nothing, so nothing was written");
    }
    if !out.exists() {
        let source = runs.known.files.last().context("there is no parameter file to start from")?;
        let text =
            whorl_files::read_text(source).with_context(|| format!("cannot read {}", source.display()))?;
        whorl_files::write_file(out, text).with_context(|| format!("cannot write {}", out.display()))?;
    }
    write_effects(out, adoption, provenance)?;
    let written = model_file::write_step(out, &runs.known, &changes, adoption.step(provenance), now)?;
    let file = out.display();
    let named = shell_word(&file.to_string());
    Ok(format!(
        "{file}: {written} entries written; `whorl history {named}` lists what was adopted, `whorl adopt --undo --out {named}` \
         takes it back."
    ))
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
        whorl_files::write_file(&path, effect_yaml(definition, provenance))
            .with_context(|| format!("cannot write {}", path.display()))?;
    }
    Ok(())
}

/// What the model that was written into `out` is worth in control, and a sentence on it, or on why nothing could be simulated.
#[must_use]
pub fn pointing(runs: &Runs, out: &Path) -> (Option<Pointing>, String) {
    match Pointing::simulated(&runs.known, out) {
        Ok(pointing) => {
            let words = pointing.in_words();
            (Some(pointing), words)
        }
        Err(error) => {
            let platform = &runs.known.platform;
            (None, format!("Pointing of {platform} was not simulated: {}.", crate::in_words(&error)))
        }
    }
}

/// Every version with its parameters and errors, and the simulated pointing errors.
///
/// # Errors
/// When a number cannot be serialised.
pub fn as_json(
    platform: &str,
    versions: &[Version],
    answer: &[String],
    provenance: &str,
    pointing: Option<&Pointing>,
) -> anyhow::Result<serde_json::Value> {
    let mut list = Vec::new();
    for version in versions {
        let parameters = version.fit.as_ref().map_or_else(Vec::new, |fit| {
            let estimates = fit.estimates.iter();
            estimates
                .map(|p| {
                    json!({"of": p.group, "name": p.name, "unit": p.unit, "before": p.before,
                           "estimate": p.estimate, "stddev": p.stddev, "at_bound": p.at_bound})
                })
                .collect()
        });
        let mut compared = Vec::new();
        for run in &version.runs {
            let mut value = serde_json::to_value(&run.comparison)?;
            if let Some(object) = value.as_object_mut() {
                object.insert("held_out".to_owned(), json!(run.held_out));
            }
            compared.push(value);
        }
        list.push(json!({
            "name": version.name,
            "effects": version.effects,
            "prediction_error": version.prediction_error(false),
            "held_out_prediction_error": version.prediction_error(true),
            "parameters": parameters,
            "runs": compared,
        }));
    }
    Ok(json!({
        "schema": SCHEMA,
        "platform": platform,
        "answer": answer,
        "provenance": provenance,
        "versions": list,
        "pointing": pointing,
    }))
}

#[cfg(test)]
mod tests {
    use whorl_explain::adopt;
    use whorl_identification::Options;

    use crate::runs::RunSources;
    use crate::simulate::record_quietly;

    const EFFECT: &str = "bearing_turbine";
    const TORQUE_N_M: f64 = 0.03;

    /// A platform that stands upright turns about the vertical and about its own axis alike.
    #[test]
    #[ignore = "slow: a minute is simulated, and fitted three times"]
    fn torques_about_one_axis_are_adopted_as_their_sum() {
        let folder = tempfile::tempdir().unwrap();
        let at = |name: &str| folder.path().join(name);
        let params = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("../../params");
        for inner in ["truth", "experiments"] {
            std::fs::create_dir(at(inner)).unwrap();
        }
        for file in ["common.yaml", "whorl_1.yaml"] {
            std::fs::copy(params.join(file), at(file)).unwrap();
        }
        let truth = "/whorl_1/driver:\n  ros__parameters:\n    truth:\n      effects:\n";
        std::fs::write(
            at("truth/whorl_1.yaml"),
            format!("{truth}        {EFFECT}: {{vertical_n_m: {TORQUE_N_M}}}\n"),
        )
        .unwrap();
        let swing = std::fs::read_to_string(params.join("experiments/swing.yaml")).unwrap();
        let alone = "\n/**:\n  ros__parameters:\n    formation: {platforms: [whorl_1]}\n";
        std::fs::write(at("experiments/swing.yaml"), swing + alone).unwrap();
        record_quietly(&at("experiments/swing.yaml"), None, &at("run"), 1).unwrap();
        let sources = RunSources {
            runs: vec![at("run")],
            model: Some(at("whorl_1.yaml")),
            platform: Some("whorl_1".to_owned()),
            ..RunSources::default()
        };
        let runs = sources.read().unwrap();
        let case = runs.case();
        let adoption = adopt(&case, &[vec![EFFECT.to_owned()]], &Options::default(), &mut |_, _| {}).unwrap();

        let fit = adoption.versions.last().and_then(|version| version.fit.as_ref()).unwrap();
        let [tie] = fit.ties.as_slice() else { panic!("{:?}: {:?}", fit.ties, fit.estimates) };
        assert_eq!(tie.combination(), "body_z_n_m + vertical_n_m");
        let off = (tie.value - TORQUE_N_M) / tie.stddev;
        assert!(off.abs() < 4.0 && tie.stddev < 0.02 * TORQUE_N_M, "{off} deviations off: {tie:?}");
        assert!(tie.stddevs.iter().all(|alone| *alone > TORQUE_N_M / 10.0), "{tie:?}");

        // The row says what is known, and the file leaves open which of the two it is.
        let row = fit.estimates.iter().find(|p| p.name == tie.combination()).unwrap();
        assert_eq!((row.estimate, row.stddev), (tie.value, tie.stddev));
        let written: f64 = fit.model.effects[EFFECT].values().sum();
        assert!((written - tie.value).abs() < tie.stddev, "{:?}", fit.model.effects);
        for name in ["body_z_n_m", "vertical_n_m"] {
            assert!(fit.prior.effects[EFFECT][name] > TORQUE_N_M / 10.0, "{:?}", fit.prior.effects);
        }
        let said = adoption.answer().join("\n");
        assert!(
            said.contains("do not tell body_z_n_m and vertical_n_m") && said.contains("tilted"),
            "{said}"
        );
    }
}
