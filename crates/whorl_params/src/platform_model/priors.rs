//! The shared group `model_prior`: how well the model's parameters are known.
//!
//! `model_prior.<key>` is the standard deviation of `model.<key>` in that parameter's unit, of a direction the
//! angle about each of two axes across it \[rad\]. `source` in a group says where the values of that group are
//! from, `<parameter>_source` where one value is from.

use whorl_dynamics::actuators::{Actuators, Group, Slot};
use whorl_dynamics::{ModelPrior, PlatformModel};
use whorl_math::words::nearest;

use crate::limits::non_negative;
use crate::reader::{Absent, Reader, Request};
use crate::shared_groups::{MODEL_GROUP, PRIOR_GROUP};
use crate::value::{Kind, Value};

const SOURCE: &str = "source";
/// The model parameters that are words.
const TEXTS: [&str; 3] = ["tilt_limit.kind", "freedom.kind", "sensors.gyro.axes"];

/// How well a platform is known, and from where.
#[derive(Debug, Clone, PartialEq)]
pub struct PlatformPrior {
    /// For fits: priors of the file, and typical ones for the rest.
    pub prior: ModelPrior,
    /// Priors of the file, in its order.
    pub entries: Vec<PriorEntry>,
}

/// One standard deviation from a parameter file.
#[derive(Debug, Clone, PartialEq)]
pub struct PriorEntry {
    /// Key of the parameter below `model`; `wheel_defaults` and `jet_defaults` stand for all wheels and jets.
    pub key: String,
    /// One for the parameter, or one for each axis, in the parameter's unit; of a direction in rad.
    pub stddev: Vec<f64>,
    /// Where it is from: CAD, a calibration, an adopted effect's fit.
    pub source: Option<String>,
}

/// Reads the group's entries after the model, so that the existing parameters are known.
pub(super) fn read(r: &mut Reader<'_>, model_is_whole: bool) -> Vec<PriorEntry> {
    let prefix = format!("{PRIOR_GROUP}.");
    let keys: Vec<String> = r
        .parameters()
        .iter()
        .filter_map(|entry| entry.key.strip_prefix(&prefix))
        .map(str::to_owned)
        .collect();
    let (sources, stddevs): (Vec<String>, Vec<String>) =
        keys.into_iter().partition(|key| source_of(key).is_some());
    let mut texts: Vec<(Source, String)> = Vec::new();
    for key in sources {
        let Some(of) = source_of(&key) else { continue };
        let full = format!("{PRIOR_GROUP}.{key}");
        let there_is = match &of {
            Source::Group(group) => group.is_empty() || is_group(r, group),
            Source::Parameter(key) => exists(r, key, model_is_whole),
        };
        if !there_is {
            let (Source::Group(name) | Source::Parameter(name)) = &of;
            let hint = hint(r, name);
            r.reject_group(&full, format!("there is no model parameter {name}; {hint}"));
        } else if let Some(text) = r.optional_string(&full, "where the standard deviations are from") {
            texts.push((of, text));
        }
    }
    let mut entries = Vec::new();
    for key in stddevs {
        let full = format!("{PRIOR_GROUP}.{key}");
        if !exists(r, &key, model_is_whole) {
            let problem = if TEXTS.contains(&key.as_str()) {
                "is a word and not a number: it has no standard deviation".to_owned()
            } else if is_group(r, &key) {
                "is a group of model parameters; allowed: the key of one parameter".to_owned()
            } else {
                format!("there is no model parameter {key}; {}", hint(r, &key))
            };
            r.reject_group(&full, problem);
            continue;
        }
        if let Some(stddev) = stddev(r, &full, per_axis(&key)) {
            let nearest = texts.iter().filter_map(|(of, text)| Some((of.nearness(&key)?, text)));
            let source = nearest.max_by_key(|(near, _)| *near).map(|(_, text)| text.clone());
            entries.push(PriorEntry { key, stddev, source });
        }
    }
    entries
}

/// Parameter or group that a source text refers to.
#[derive(Debug, PartialEq, Eq)]
enum Source {
    Group(String),
    Parameter(String),
}

fn source_of(key: &str) -> Option<Source> {
    let (group, last) = key.rsplit_once('.').unwrap_or(("", key));
    if last == SOURCE {
        return Some(Source::Group(group.to_owned()));
    }
    key.strip_suffix("_source").map(|parameter| Source::Parameter(parameter.to_owned()))
}

impl Source {
    /// `None` when it is not of this key; the largest is the nearest.
    fn nearness(&self, key: &str) -> Option<usize> {
        match self {
            Self::Parameter(of) => (of == key).then_some(usize::MAX),
            Self::Group(of) if of.is_empty() => Some(0),
            Self::Group(of) => key.strip_prefix(of.as_str())?.starts_with('.').then_some(of.len()),
        }
    }
}

fn stddev(r: &mut Reader<'_>, full: &str, per_axis: bool) -> Option<Vec<f64>> {
    let limits = non_negative();
    let request = Request {
        key: full,
        kind: Kind::Double,
        allowed: if per_axis {
            "a number of at least 0 for all axes, or three of them".into()
        } else {
            "a number of at least 0".into()
        },
        range: None,
        choices: Vec::new(),
        doc: "standard deviation of the model parameter's prior, in that parameter's unit",
    };
    r.request(request, Absent::Leave, |value| {
        let list = match value.converted(Kind::Double).or_else(|| value.converted(Kind::DoubleArray))? {
            Value::Double(x) => vec![x],
            Value::DoubleArray(xs) if per_axis && xs.len() == 3 => xs,
            _ => return None,
        };
        list.iter().all(|x| limits.allows(*x)).then_some(list)
    })
}

/// Groups of actuators of one kind, each with the group of what its members share.
fn member_groups() -> impl Iterator<Item = (&'static str, &'static str)> {
    let groups: Vec<Group> =
        Actuators::default().kinds().into_iter().flat_map(|kind| kind.groups()).copied().collect();
    groups.into_iter().filter_map(|group| match group {
        Group::Members { name, defaults } => Some((name, defaults)),
        Group::One { .. } => None,
    })
}

/// Keys of the actuators' entries that are vectors.
fn actuator_vectors() -> impl Iterator<Item = &'static str> {
    let mut actuators = Actuators::default();
    let mut keys = Vec::new();
    for kind in actuators.kinds_mut() {
        kind.add(String::new());
        let vectors = kind.fields(0, 0).into_iter().filter(|field| matches!(field.slot, Slot::Vector(_)));
        keys.extend(vectors.map(|field| field.key));
    }
    keys.into_iter()
}

/// Parameters of three axes.
fn per_axis(key: &str) -> bool {
    let last = key.rsplit_once('.').map_or(key, |(_, last)| last);
    let sensor = key.starts_with("sensors.gyro.") || key.starts_with("sensors.accelerometer.");
    let of_axes = ["noise", "bias", "scale", "misalignment", "skew", "lever_arm"];
    last == "gravity_offset_n_m"
        || actuator_vectors().any(|known| known == last)
        || key == "sensors.vector.misalignment_rad"
        || sensor && of_axes.iter().any(|start| last.starts_with(start))
}

/// Whether the model has a number under this key; `wheel_defaults.x` if any wheel has an x.
fn exists(r: &Reader<'_>, key: &str, model_is_whole: bool) -> bool {
    let asked = |key: &str| r.known_below(MODEL_GROUP).any(|known| known == key);
    let of_members = |defaults: &str, members: &str| {
        key.strip_prefix(defaults).is_some_and(|name| {
            r.children(&format!("{MODEL_GROUP}.{members}"))
                .first()
                .is_some_and(|first| asked(&format!("{members}.{first}.{name}")))
        })
    };
    // Effects are read last, and not at all when the rest is invalid: no second error for that.
    asked(key) && !TEXTS.contains(&key)
        || member_groups().any(|(members, defaults)| of_members(&format!("{defaults}."), members))
        || !model_is_whole && key.starts_with("effects.")
}

fn is_group(r: &Reader<'_>, key: &str) -> bool {
    let dot = format!("{key}.");
    member_groups().any(|(_, defaults)| key == defaults)
        || r.known_below(MODEL_GROUP).any(|known| known.starts_with(&dot))
}

fn hint(r: &Reader<'_>, key: &str) -> String {
    if let Some(id) = key.strip_prefix("effects.").and_then(|rest| rest.split('.').next())
        && !is_group(r, &format!("effects.{id}"))
    {
        return format!("the model has no effect {id}: add model.effects.{id} first");
    }
    nearest(key, r.known_below(MODEL_GROUP)).map_or_else(
        || "allowed: the keys of the group model".to_owned(),
        |near| format!("did you mean {near}?"),
    )
}

/// The prior of a model: its entries, and [`ModelPrior::typical`] for parameters without one.
pub(super) fn prior(model: &PlatformModel, entries: &[PriorEntry]) -> ModelPrior {
    let mut prior = ModelPrior::typical(model);
    let one = |key: &str| {
        entries.iter().find(|entry| entry.key == key).and_then(|entry| entry.stddev.first()).copied()
    };
    for (i, row) in ["x", "y", "z"].into_iter().enumerate() {
        for (j, column) in ["x", "y", "z"].into_iter().enumerate().skip(i) {
            if let Some(stddev) = one(&format!("inertia_kg_m2.{row}{column}")) {
                prior.inertia_b_kg_m2[(i, j)] = stddev;
                prior.inertia_b_kg_m2[(j, i)] = stddev;
            }
        }
    }
    if let Some(offset) = entries.iter().find(|entry| entry.key == "gravity_offset_n_m") {
        for (slot, stddev) in prior.gravity_offset_b_n_m.iter_mut().zip(offset.stddev.iter().cycle()) {
            *slot = *stddev;
        }
    }
    let mut actuators = model.actuators.clone();
    for (kind, prior) in actuators.kinds_mut().into_iter().zip(prior.actuators.kinds_mut()) {
        let Some(Group::Members { name: group, defaults }) = kind.groups().first() else { continue };
        let members: Vec<String> = kind.names().into_iter().map(str::to_owned).collect();
        for (j, member) in members.iter().enumerate() {
            for field in kind.fields(0, j) {
                // A member's own value wins over the shared one.
                let given = one(&format!("{group}.{member}.{}", field.key))
                    .or_else(|| one(&format!("{defaults}.{}", field.key)));
                match (given, &field.slot) {
                    (Some(x), Slot::Number(value)) if prior.is_share(field.key) => {
                        prior.set_stddev(field.key, j, x / **value);
                    }
                    (Some(x), _) => prior.set_stddev(field.key, j, x),
                    (None, _) => {}
                }
            }
        }
    }
    for (id, values) in &model.effects {
        for name in values.keys() {
            if let Some(stddev) = one(&format!("effects.{id}.{name}")) {
                prior.effects.entry(id.clone()).or_default().insert(name.clone(), stddev);
            }
        }
    }
    prior
}
