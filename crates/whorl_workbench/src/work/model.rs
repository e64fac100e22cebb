//! The model's file: shown, changed, and taken back.

use std::path::Path;

use anyhow::{Context as _, Result, bail};
use nalgebra::{Matrix3, Vector3};
use whorl_bag::CsvMap;
use whorl_commands::history;
use whorl_commands::model_file::{undo_step, write_step};
use whorl_dynamics::{Freedom, PlatformModel};
use whorl_params::changes::Change;
use whorl_params::{ModelStep, ParameterTree, Value};
use whorl_recording::{KnownPlatform, platform_parts, read_model};

use super::adopt::now;
use crate::api::{Arrow, FileChange, FileKind, ParameterRow, Platform};
use crate::bench::{Workbench, change_of};

/// Groups of the file that are numbers of the model and of its prior.
const MODEL: &str = "model.";
const PRIOR: &str = "model_prior.";
/// Longest value that is written.
const LONGEST: usize = 400;

/// The chosen platform.
///
/// # Errors
/// When its model cannot be read.
pub fn platform(bench: &Workbench) -> Result<Platform> {
    let known = bench.known()?;
    let model = &known.model;
    let moments = Matrix3::symmetric_eigen(*model.mass_properties.inertia_b_kg_m2());
    Ok(Platform {
        platform: known.platform.clone(),
        freedom: match model.freedom {
            Freedom::OnBearing => "on_bearing",
            Freedom::Free => "free",
            Freedom::Hinge { .. } => "hinge",
            Freedom::Clamped => "clamped",
        }
        .to_owned(),
        hinge_axis: model.freedom.hinge_axis_b().map(|axis| axis.into_inner().into()),
        gravity_offset_n_m: (*model.mass_properties.gravity_offset_b_n_m()).into(),
        principal_moments_kg_m2: moments.eigenvalues.into(),
        principal_axes: [0, 1, 2].map(|k| moments.eigenvectors.column(k).into_owned().into()),
        arrows: arrows(model),
        parameters: parameters(bench.folder(), &known)?,
        history: history::as_json(&known),
    })
}

/// Wheels, jets and sensors; of gyro and accelerometer each axis that they measure.
fn arrows(model: &PlatformModel) -> Vec<Arrow> {
    let arrow = |kind: &str, name: &str, at_m, direction: Vector3<f64>| Arrow {
        kind: kind.to_owned(),
        name: name.to_owned(),
        at_m,
        direction: direction.into(),
    };
    let measured = |axes: [bool; 3]| (0..3).filter(move |k| axes[*k]).map(|k| Vector3::ith(k, 1.0));
    let sensors = &model.sensors;
    let wheels =
        model.wheels().iter().map(|wheel| arrow("wheel", &wheel.name, None, wheel.spin_axis_b.into_inner()));
    let jets = model.jets().iter().map(|jet| {
        arrow("jet", &jet.name, Some(jet.position_b_m.into()), jet.force_direction_b.into_inner())
    });
    let gyro = measured(sensors.gyro.axes).map(|axis| arrow("gyro", "gyro", None, axis));
    let accelerometer = &sensors.accelerometer;
    let forces = measured(accelerometer.axes)
        .filter(|_| accelerometer.fitted)
        .map(|axis| arrow("accelerometer", "accelerometer", Some(accelerometer.lever_arm_b_m.into()), axis));
    let seen = sensors.vector.iter().map(|vector| {
        arrow("vector", "vector sensor's target", None, vector.reference_direction_world.into_inner())
    });
    wheels.chain(jets).chain(gyro).chain(forces).chain(seen).collect()
}

/// Every number of the model as its files have it, with its prior.
fn parameters(folder: &Path, known: &KnownPlatform) -> Result<Vec<ParameterRow>> {
    let tree = ParameterTree::load(&known.files, &[])?;
    let entries = tree.for_node(&format!("/{}/estimator", known.platform));
    let text = |value: &Value| value.to_string();
    let prior = |key: &str| entries.get(&format!("{PRIOR}{key}")).map(|entry| text(&entry.value));
    let source = |key: &str| {
        let named = |prior: &&whorl_params::PriorEntry| prior.key == key;
        known.prior_entries.iter().find(named).and_then(|prior| prior.source.clone())
    };
    let rows = entries.iter().filter_map(|entry| {
        let key = entry.key.strip_prefix(MODEL)?;
        Some(ParameterRow {
            key: entry.key.clone(),
            value: text(&entry.value),
            stddev: prior(key),
            source: source(key),
            origin: entry.origin.to_string().replace(&format!("{}/", folder.display()), ""),
        })
    });
    Ok(rows.collect())
}

/// The file of the chosen model, if it is the page's to write.
fn model_file(bench: &Workbench) -> Result<(String, std::path::PathBuf)> {
    if bench.is_writing() {
        bail!("the model's file is being written: wait, or stop it first");
    }
    let file = bench.choice().model.context("no platform's file is chosen")?;
    let path = bench.listed(&file, FileKind::Model)?;
    Ok((file, path))
}

/// Writes a value into the model's file, as a step of its history.
///
/// # Errors
/// A key that is none of the model, a value that is not allowed; then the file is as before.
pub fn set_parameter(bench: &Workbench, key: &str, value: &str) -> Result<Option<FileChange>> {
    let (file, path) = model_file(bench)?;
    if !key.starts_with(MODEL) && !key.starts_with(PRIOR) {
        bail!("{key} is no number of a model; allowed: {MODEL}..., {PRIOR}...");
    }
    if value.len() > LONGEST || value.contains(['\n', '\r', '#']) {
        bail!("{key}: a number, a word, or a list such as [0.0, 0.0, 1.0] is allowed");
    }
    let known = bench.known()?;
    let node = format!("/{}/**", known.platform);
    let text = format!("{node}:\n  ros__parameters:\n    model:\n      value: {value}\n");
    let tree = ParameterTree::from_texts(&[("the value", text.as_str())], &[])?;
    let parsed = tree.for_node(&format!("/{}/estimator", known.platform));
    let parsed = parsed.get("model.value").map(|entry| entry.value.clone());
    let parsed = parsed.with_context(|| format!("{key}: {value:?} is no value"))?;
    let before = whorl_files::read_text(&path)?;
    let change = Change { key: key.to_owned(), value: parsed, comment: String::new() };
    let step = ModelStep::of_source(format!("{key} = {value}, written in whorl open"));
    write_step(&path, &known, &[change], step, now())?;
    if let Err(error) = read_model(&path, Some(&known.platform)) {
        whorl_files::write_file(&path, &before)?;
        return Err(error.into());
    }
    Ok(change_of(bench.folder(), &file, Some(before)))
}

/// Takes the last step of the model's history back.
///
/// # Errors
/// When there is none, or the file was changed since.
pub fn undo(bench: &Workbench) -> Result<(Option<FileChange>, String)> {
    let (file, path) = model_file(bench)?;
    let before = whorl_files::read_text(&path)?;
    let step = undo_step(&path, bench.choice().platform.as_deref())?;
    let what = match step.effects.as_slice() {
        [] => step.source.unwrap_or_default(),
        effects => effects.join(" and "),
    };
    let said = format!("{file} is as before step {}: {what}.", step.number);
    Ok((change_of(bench.folder(), &file, Some(before)), said))
}

/// Replaces the text of a platform's file or of a map, if it can be read then.
///
/// # Errors
/// What is wrong with it, with its line; then the file is as before.
pub fn set_text(bench: &Workbench, file: &str, text: &str) -> Result<Option<FileChange>> {
    if bench.is_writing() {
        bail!("a file is being written: wait, or stop it first");
    }
    let model = bench.listed(file, FileKind::Model);
    let (path, is_model) = match model {
        Ok(path) => (path, true),
        Err(_) => (bench.listed(file, FileKind::Map)?, false),
    };
    let before = whorl_files::read_text(&path)?;
    let check = || -> Result<()> {
        if is_model {
            read_model(&path, bench.choice().platform.as_deref())?;
        } else if text.lines().any(|line| line.trim_end() == "csv:") {
            CsvMap::load_for(&path, &platform_parts(&bench.known()?))?;
        }
        Ok(())
    };
    whorl_files::write_file(&path, text)?;
    if let Err(error) = check() {
        whorl_files::write_file(&path, &before)?;
        return Err(error);
    }
    Ok(change_of(bench.folder(), file, Some(before)))
}
