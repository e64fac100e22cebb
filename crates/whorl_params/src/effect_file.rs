//! Effects written in files: `effects/NAME.yaml` beside the parameter files, or any path.
//!
//! ```yaml
//! effect:
//!   title: "drag with the cube of the rate"
//!   explanation: "A turbulent wake brakes the faster the more."
//!   equation: "-d * norm(rate)^2 * rate"
//!   parameters:
//!     d: {unit: "N m s^3", range: [0.0, 10.0], prior: 0.1, meaning: "Drag per cubed rate."}
//!   passive: true
//!   source: "measured on our rig, 2026-05"
//! ```

use std::fmt::Write as _;
use std::path::{Path, PathBuf};

use whorl_dynamics::Effect;
use whorl_dynamics::effects::written::{
    ActsOn, Axes, CurveShape, Definition, WrittenCurve, WrittenEffect, WrittenParameter, WrittenState,
};
use whorl_dynamics::effects::{RegisterError, Role, catalogue, find, register, register_secret};

use crate::error::{Origin, ParameterError, ParameterErrors};
use crate::limits::{any, positive};
use crate::reader::Reader;
use crate::tree::ParameterTree;
use crate::value::Value;

/// Folder of effects beside parameter files.
pub const EFFECTS_FOLDER: &str = "effects";

/// Name of the section of an effect's file.
const SECTION: &str = "effect";

const ROLES: [(&str, Role); 3] =
    [("amplitude", Role::Amplitude), ("shape", Role::Shape), ("floating_shape", Role::FloatingShape)];
const AXES: [(&str, Axes); 2] = [("body", Axes::Body), ("world", Axes::World)];
const SHAPES: [(&str, CurveShape); 3] =
    [("free", CurveShape::Free), ("positive", CurveShape::Positive), ("increasing", CurveShape::Increasing)];

/// Reads and checks the file of an effect. Its id is the file's name without `.yaml`.
///
/// # Errors
/// What is wrong, with file, line, key and what is allowed.
pub fn read_effect(path: &Path) -> Result<WrittenEffect, ParameterErrors> {
    let parameters = ParameterTree::load_for(path, SECTION)?;
    let mut reader = Reader::new(&parameters);
    let mut definition = definition(&mut reader);
    definition.id = path.file_stem().unwrap_or_default().to_string_lossy().into_owned();
    let mut made = None;
    if reader.error_count() == 0 {
        match WrittenEffect::new(definition) {
            Ok(effect) => made = Some(effect),
            Err(error) if error.key == "id" => {
                let origin = Origin::File { file: path.display().to_string().into(), line: 0 };
                let problem = format!("the file's name is the effect's id: {}", error.problem);
                return Err(ParameterError::new(origin, problem).into());
            }
            Err(error) => reader.reject(&error.key, error.problem),
        }
    }
    reader.finish()?;
    made.ok_or_else(|| ParameterError::new(parameters.node_origin(), "it is incomplete").into())
}

/// Reads the file of an effect and adds it to the catalogue of this process.
///
/// # Errors
/// As [`read_effect`]; when another effect has its id.
pub fn load_effect(path: &Path) -> Result<&'static dyn Effect, ParameterErrors> {
    load_with(path, register)
}

fn load_with(
    path: &Path,
    register: impl FnOnce(WrittenEffect) -> Result<&'static dyn Effect, RegisterError>,
) -> Result<&'static dyn Effect, ParameterErrors> {
    let effect = read_effect(path)?;
    register(effect).map_err(|error| {
        let origin = Origin::File { file: path.display().to_string().into(), line: 0 };
        ParameterError::new(origin, error.to_string()).into()
    })
}

/// The files of effects that belong to parameter files: `effects/*.yaml` beside each of them and in the folder above, by
/// name.
#[must_use]
pub fn effect_files_beside(files: &[PathBuf]) -> Vec<PathBuf> {
    let mut found: Vec<PathBuf> = Vec::new();
    for folder in folders(files.iter().map(PathBuf::as_path)) {
        let Ok(entries) = std::fs::read_dir(&folder) else { continue };
        let paths = entries.filter_map(|entry| entry.ok().map(|e| e.path()));
        let mut own: Vec<PathBuf> =
            paths.filter(|p| p.extension().is_some_and(|e| e == "yaml") && p.is_file()).collect();
        own.sort();
        // What stands nearer to the files comes first.
        own.retain(|p| !found.iter().any(|f| f.file_name() == p.file_name()));
        found.append(&mut own);
    }
    found
}

/// Adds every effect that belongs to parameter files ([`effect_files_beside`]) to the catalogue of this process.
///
/// # Errors
/// As [`load_effect`].
pub fn load_effects_beside(files: &[PathBuf]) -> Result<(), ParameterErrors> {
    effect_files_beside(files).iter().try_for_each(|path| load_effect(path).map(|_| ()))
}

fn folders<'p>(files: impl Iterator<Item = &'p Path>) -> Vec<PathBuf> {
    let mut folders: Vec<PathBuf> = Vec::new();
    for file in files {
        let beside = file.parent().unwrap_or(Path::new(""));
        let above = if beside.as_os_str().is_empty() { Some(Path::new("..")) } else { beside.parent() };
        for folder in std::iter::once(beside).chain(above) {
            let folder = folder.join(EFFECTS_FOLDER);
            if !folders.contains(&folder) {
                folders.push(folder);
            }
        }
    }
    folders
}

/// The effect with this id: of the catalogue, or from its file beside these parameter files. `None`: there is no such
/// file. One that only a truth has (`of_truth`) does not get into the catalogue.
pub(crate) fn find_or_load<'f>(
    id: &str,
    files: impl Iterator<Item = &'f str>,
    of_truth: bool,
) -> Option<Result<&'static dyn Effect, ParameterErrors>> {
    let known = if of_truth { find(id) } else { catalogue().iter().copied().find(|e| e.info().id == id) };
    if let Some(effect) = known {
        return Some(Ok(effect));
    }
    let is_plain = id.chars().all(|c| c.is_ascii_alphanumeric() || c == '_');
    let folders = folders(files.map(Path::new));
    let path =
        folders.into_iter().map(|folder| folder.join(format!("{id}.yaml"))).find(|path| path.is_file())?;
    is_plain.then(|| if of_truth { load_with(&path, register_secret) } else { load_effect(&path) })
}

fn one_of<T: Copy>(choices: &[(&'static str, T)], name: &str) -> Option<T> {
    choices.iter().find(|(known, _)| *known == name).map(|(_, value)| *value)
}

fn words<T>(choices: &[(&'static str, T)]) -> Vec<&'static str> {
    choices.iter().map(|(name, _)| *name).collect()
}

fn definition(r: &mut Reader<'_>) -> Definition {
    let mut d = Definition {
        title: r.string("title", "a few words"),
        explanation: r.string_or(
            "explanation",
            "",
            "a sentence: the mechanism, and how it shows in the data",
        ),
        equation: r.string("equation", "what it adds; `whorl effects --quantities` lists what it may name"),
        is_passive: r.bool_or("passive", false, "it never does positive work; this is checked"),
        source: r.string_or("source", "not stated", "where the equation comes from"),
        confusable_with: r.string_array_or(
            "confusable_with",
            &[],
            "effects that typical data cannot tell from it",
        ),
        separated_by: r.string_or("separated_by", "", "what tells it from those"),
        ..Definition::default()
    };
    let acts_on = r.choice_or(
        "acts_on",
        ActsOn::Torque.name(),
        &words(&ActsOn::ALL),
        "what the equation's result is added to",
    );
    d.acts_on = one_of(&ActsOn::ALL, acts_on).unwrap_or_default();
    if r.has("axes") {
        d.axes = one_of(&AXES, r.choice("axes", &words(&AXES), "axes of the vector that the equation gives"));
    }
    if r.has("fed_forward") {
        d.is_fed_forward = Some(r.bool("fed_forward", "local control counters it from the model"));
    }
    let unit_doc = "unit in SI units without prefixes, \"1\" for none";
    r.group("parameters", |r| {
        for name in r.children("") {
            let parameter = r.group(&name, |r| {
                let range = r.f64_array("range", any(), "smallest and largest plausible value");
                let range = match range.as_slice() {
                    [low, high] => (*low, *high),
                    _ => {
                        r.reject("range", "allowed: [smallest, largest]");
                        (0.0, 1.0)
                    }
                };
                let role = r.choice_or("role", "amplitude", &words(&ROLES), "amplitude: zero where the effect is absent; shape: shapes it about a usual value; floating_shape: shapes it, anywhere in the range");
                let role = one_of(&ROLES, role).unwrap_or(Role::Amplitude);
                let usual = if role == Role::Amplitude { 0.0 } else { 0.5 * (range.0 + range.1) };
                WrittenParameter {
                    name: name.clone(),
                    unit: r.string_or("unit", "1", unit_doc),
                    range,
                    neutral: r.f64_or("neutral", usual, any(), "value at which the effect is absent, and the default"),
                    prior: r.f64("prior", positive(), "prior standard deviation about the neutral value"),
                    role,
                    known: r.bool_or("known", false, "known beforehand and never fitted"),
                    starts: r.f64_array_or("starts", &[], any(), "values of a shape from which a fit is tried"),
                    meaning: r.string_or("meaning", "", "a sentence"),
                }
            });
            d.parameters.push(parameter);
        }
    });
    r.group("states", |r| {
        for name in r.children("") {
            let state = r.group(&name, |r| WrittenState {
                name: name.clone(),
                unit: r.string_or("unit", "1", unit_doc),
                derivative: r.string("derivative", "an equation of its derivative; it starts at zero"),
            });
            d.states.push(state);
        }
    });
    r.group("curves", |r| {
        for name in r.children("") {
            let curve = r.group(&name, |r| {
                let largest = r.f64("largest", positive(), "largest plausible coefficient");
                let shape = r.choice_or(
                    "shape",
                    "free",
                    &words(&SHAPES),
                    "positive: never below zero; increasing: from zero, never falls",
                );
                WrittenCurve {
                    name: name.clone(),
                    of: r.string("of", "what the curve is over, an equation that gives a number"),
                    of_unit: r.string_or("of_unit", "1", unit_doc),
                    knots: r.f64_array("knots", any(), "where its cubic pieces meet, increasing"),
                    unit: r.string_or("unit", "1", unit_doc),
                    largest,
                    prior: r.f64_or(
                        "prior",
                        0.2 * largest,
                        positive(),
                        "prior standard deviation of each coefficient",
                    ),
                    shape: one_of(&SHAPES, shape).unwrap_or(CurveShape::Free),
                }
            });
            d.curves.push(curve);
        }
    });
    d
}

/// The file of an effect, to be written as `NAME.yaml` with the id as its name. `comment` goes on top.
#[must_use]
pub fn effect_yaml(d: &Definition, comment: &str) -> String {
    let mut text = String::new();
    let quoted = |of: &str| Value::String(of.to_owned()).to_string();
    let list = |of: &[f64]| Value::DoubleArray(of.to_vec()).to_string();
    let number = |of: f64| Value::Double(of).to_string();
    let name_of = |shape: CurveShape| SHAPES.iter().find(|(_, s)| *s == shape).map_or("free", |(n, _)| *n);
    for line in comment.lines() {
        let _ = writeln!(text, "# {line}");
    }
    let _ = writeln!(text, "effect:\n  title: {}", quoted(&d.title));
    let _ = writeln!(text, "  explanation: {}", quoted(&d.explanation));
    let _ = writeln!(text, "  acts_on: {}", d.acts_on.name());
    if let Some(axes) = d.axes {
        let _ = writeln!(text, "  axes: {}", if axes == Axes::World { "world" } else { "body" });
    }
    let _ = writeln!(text, "  equation: {}", quoted(&d.equation));
    if !d.parameters.is_empty() {
        let _ = writeln!(text, "  parameters:");
    }
    for p in &d.parameters {
        let _ = writeln!(text, "    {}:\n      unit: {}", p.name, quoted(&p.unit));
        let _ = writeln!(text, "      range: {}", list(&[p.range.0, p.range.1]));
        let _ = writeln!(text, "      neutral: {}\n      prior: {}", number(p.neutral), number(p.prior));
        let role = ROLES.iter().find(|(_, role)| *role == p.role).map_or("amplitude", |(name, _)| *name);
        let _ = writeln!(text, "      role: {role}");
        if p.known {
            let _ = writeln!(text, "      known: true");
        }
        if !p.starts.is_empty() {
            let _ = writeln!(text, "      starts: {}", list(&p.starts));
        }
        let _ = writeln!(text, "      meaning: {}", quoted(&p.meaning));
    }
    if !d.states.is_empty() {
        let _ = writeln!(text, "  states:");
    }
    for s in &d.states {
        let _ = writeln!(
            text,
            "    {}:\n      unit: {}\n      derivative: {}",
            s.name,
            quoted(&s.unit),
            quoted(&s.derivative)
        );
    }
    if !d.curves.is_empty() {
        let _ = writeln!(text, "  curves:");
    }
    for c in &d.curves {
        let _ = writeln!(
            text,
            "    {}:\n      of: {}\n      of_unit: {}",
            c.name,
            quoted(&c.of),
            quoted(&c.of_unit)
        );
        let _ = writeln!(text, "      knots: {}\n      unit: {}", list(&c.knots), quoted(&c.unit));
        let _ = writeln!(
            text,
            "      largest: {}\n      prior: {}\n      shape: {}",
            number(c.largest),
            number(c.prior),
            name_of(c.shape)
        );
    }
    let _ = writeln!(text, "  passive: {}", d.is_passive);
    if let Some(is_fed_forward) = d.is_fed_forward {
        let _ = writeln!(text, "  fed_forward: {is_fed_forward}");
    }
    let _ = writeln!(text, "  source: {}", quoted(&d.source));
    if !d.confusable_with.is_empty() {
        let _ = writeln!(text, "  confusable_with: {}", Value::StringArray(d.confusable_with.clone()));
    }
    if !d.separated_by.is_empty() {
        let _ = writeln!(text, "  separated_by: {}", quoted(&d.separated_by));
    }
    text
}

#[cfg(test)]
mod tests {
    use super::*;

    const FILE: &str = r#"effect:
  title: "drag with the cube of the rate"
  equation: "-d * norm(rate)^2 * rate - brake * unit(rate, tiny)"
  parameters:
    d: {unit: "N m s^3", range: [0.0, 10.0], prior: 0.1, meaning: "Drag."}
    tiny: {unit: "rad/s", range: [0.001, 0.1], prior: 0.01, neutral: 0.01, role: shape, starts: [0.01, 0.05]}
  curves:
    brake: {of: "norm(rate)", of_unit: "rad/s", knots: [0.0, 0.1, 0.3], unit: "N m", largest: 0.5, shape: increasing}
  passive: true
"#;

    fn written(folder: &Path, name: &str, text: &str) -> PathBuf {
        let path = folder.join(name);
        std::fs::write(&path, text).unwrap();
        path
    }

    #[test]
    fn a_file_is_read_and_written_back() {
        let folder = tempfile::tempdir().unwrap();
        let effect = read_effect(&written(folder.path(), "cubic_drag.yaml", FILE)).unwrap();
        let definition = effect.definition();
        assert_eq!(definition.id, "cubic_drag");
        assert!(definition.is_passive && definition.curves[0].prior == 0.1);
        let again = written(
            folder.path(),
            "cubic_drag.yaml",
            &effect_yaml(definition, "written by a test\nin two lines"),
        );
        assert_eq!(read_effect(&again).unwrap().definition(), definition);
    }

    #[test]
    fn mistakes_have_file_and_line() {
        let folder = tempfile::tempdir().unwrap();
        let error = |from: &str, to: &str| {
            let path = written(folder.path(), "wrong.yaml", &FILE.replace(from, to));
            read_effect(&path).unwrap_err().to_string()
        };
        let found = error("N m s^3", "N m/V");
        assert!(found.contains("wrong.yaml:3: equation = "), "{found}");
        let found = error("N m s^3", "N q");
        assert!(
            found.contains("wrong.yaml:5: parameters.d.unit = \"N q\": ") && found.contains("no unit"),
            "{found}"
        );
        let found = error("passive: true", "pasive: true");
        assert!(found.contains("wrong.yaml:9") && found.contains("passive"), "{found}");
        let found = error("range: [0.0, 10.0]", "range: [0.0]");
        assert!(found.contains("wrong.yaml:5") && found.contains("[smallest, largest]"), "{found}");
        let found = error("-d * norm", "d * norm");
        assert!(found.contains("wrong.yaml:9: passive"), "{found}");
        let found = read_effect(&written(folder.path(), "Bad.yaml", FILE)).unwrap_err().to_string();
        assert!(found.contains("Bad.yaml: the file's name is the effect's id"), "{found}");
        let found = read_effect(&folder.path().join("absent.yaml")).unwrap_err().to_string();
        assert!(found.contains("absent.yaml: does not exist"), "{found}");
    }

    #[test]
    fn effects_beside_and_above_a_file_belong_to_it() {
        let folder = tempfile::tempdir().unwrap();
        let root = folder.path();
        for inner in ["effects", "truth/effects"] {
            std::fs::create_dir_all(root.join(inner)).unwrap();
        }
        written(root, "effects/a.yaml", FILE);
        written(root, "effects/b.yaml", FILE);
        written(root, "truth/effects/b.yaml", FILE);
        let found = effect_files_beside(&[root.join("truth/whorl_1.yaml")]);
        assert_eq!(found, [root.join("truth/effects/b.yaml"), root.join("effects/a.yaml")]);
        assert_eq!(effect_files_beside(&[root.join("whorl_1.yaml")]).len(), 2);
    }
}
