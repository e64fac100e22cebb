//! Tables: channels and effects.

use std::path::PathBuf;

use pyo3::prelude::*;
use serde_json::json;
use whorl_bag::{Channel, Form};
use whorl_dynamics::effects::{catalogue, describe, find};
use whorl_dynamics::{Effect, PlatformModel};

use crate::errors::{error, refused};
use crate::platform::Platform;

/// The table of channels as JSON.
#[pyfunction]
pub fn channels() -> String {
    let row = |channel: &Channel| {
        let info = channel.info();
        let components: Option<Vec<&str>> = match info.form {
            Form::Axes | Form::Directions => Some(vec!["x", "y", "z"]),
            Form::Attitude => Some(vec!["w", "x", "y", "z"]),
            Form::Scalar => Some(vec![""]),
            Form::Wheels { .. } | Form::Gimbals { .. } | Form::Pulses => None,
        };
        json!({
            "key": info.key,
            "holds": info.holds,
            "unit": channel.unit(),
            "units": info.units.iter().map(|unit| unit.name).collect::<Vec<_>>(),
            "components": components,
            "column": [info.column.0, info.column.1],
            "is_held": info.is_held,
            "is_motion": info.is_motion,
            "sensors": channel.most_sensors(),
        })
    };
    json!(Channel::ALL.iter().map(row).collect::<Vec<_>>()).to_string()
}

fn of<'a>(platform: Option<&'a Bound<'_, Platform>>, otherwise: &'a PlatformModel) -> &'a PlatformModel {
    platform.map_or(otherwise, |platform| &platform.get().0.model)
}

/// The catalogue of effects as JSON.
#[pyfunction]
#[pyo3(signature = (platform=None))]
pub fn effects(platform: Option<&Bound<'_, Platform>>) -> String {
    let reference = PlatformModel::whorl_1_reference();
    let model = of(platform, &reference);
    let row = |effect: &&'static dyn Effect| {
        let info = effect.info();
        let parameters = effect.parameters(model).into_iter().map(|p| {
            json!({
                "name": p.name, "unit": p.unit, "min": p.min, "max": p.max, "neutral": p.neutral,
                "prior_stddev": p.prior_stddev, "known": p.known, "doc": p.doc,
            })
        });
        json!({
            "id": info.id, "title": info.title, "kind": info.kind.to_string(), "explanation": info.explanation,
            "equation": info.equation, "source": info.source, "confusable_with": info.confusable_with,
            "separated_by": info.separated_by, "parameters": parameters.collect::<Vec<_>>(),
        })
    };
    json!(catalogue().iter().map(row).collect::<Vec<_>>()).to_string()
}

/// An effect in words, as `whorl effects ID` prints it.
#[pyfunction]
#[pyo3(signature = (id, platform=None))]
pub fn describe_effect(id: &str, platform: Option<&Bound<'_, Platform>>) -> PyResult<String> {
    let reference = PlatformModel::whorl_1_reference();
    let effect =
        find(id).ok_or_else(|| refused(format!("there is no effect {id}; `whorl effects` lists them")))?;
    Ok(describe(effect, of(platform, &reference)))
}

/// Adds an effect written in YAML to the catalogue of this process, and returns its id.
#[pyfunction]
pub fn load_effect(path: PathBuf) -> PyResult<String> {
    whorl_params::load_effect(&path).map(|effect| effect.info().id.to_owned()).map_err(error)
}
