//! Changes of a platform's model by a fit, a calibration or a step of its history, as entries of its parameter file.

use std::collections::BTreeSet;

use whorl_dynamics::actuators::{Group, Slot};
use whorl_dynamics::effects::find;
use whorl_dynamics::{ModelPrior, PlatformModel};
use whorl_math::three_digits;

use crate::{ModelStep, Value};

/// One entry to write.
#[derive(Debug, Clone, PartialEq)]
pub struct Change {
    /// Key below the platform's section.
    pub key: String,
    /// Value.
    pub value: Value,
    /// Comment at the end of its line.
    pub comment: String,
}

/// A quantity as parameter files have it: key below `model.`, and of its standard deviations below `model_prior.`; of these one for all
/// numbers or one of each, or none where nothing is known; key below `model_prior.` of their source, if it is noted.
struct Entry {
    key: String,
    unit: String,
    numbers: Vec<f64>,
    stddevs: Vec<f64>,
    source: String,
}

impl Entry {
    fn new(key: impl Into<String>, unit: &str, numbers: &[f64], stddevs: &[f64], source: &str) -> Self {
        let (key, unit, source) = (key.into(), unit.to_owned(), source.to_owned());
        Self { key, unit, numbers: numbers.to_vec(), stddevs: stddevs.to_vec(), source }
    }

    /// The entries to write where it was something else, or nothing; `how` it was found.
    fn since(&self, was: Option<&Self>, how: &str) -> Vec<Change> {
        let Self { key, unit, numbers, stddevs, .. } = self;
        let is_other = |(a, b): (&f64, &f64)| (a - b).abs() > 1e-12 * a.abs().max(b.abs());
        let differs = |is: &[f64], was: &[f64]| is.len() != was.len() || is.iter().zip(was).any(is_other);
        let told = |of: &[f64]| of.iter().map(|x| three_digits(*x)).collect::<Vec<_>>().join(", ");
        let mut found = Vec::new();
        if was.is_none_or(|was| differs(numbers, &was.numbers)) {
            let known = if stddevs.is_empty() { String::new() } else { format!(" +- {},", told(stddevs)) };
            let was = was.map_or_else(String::new, |was| format!(", was {}", told(&was.numbers)));
            let stddev = |k: usize| stddevs.get(k).or(stddevs.first()).copied().unwrap_or(0.0);
            let numbers = numbers.iter().enumerate().map(|(k, x)| rounded(*x, stddev(k)));
            let (key, comment) = (format!("model.{key}"), format!("[{unit}]{known} {how}{was}"));
            found.push(Change { key, value: value(numbers.collect()), comment });
        }
        let is_known = stddevs.iter().any(|stddev| *stddev > 0.0);
        if is_known && was.is_none_or(|was| differs(stddevs, &was.stddevs)) {
            let stddevs = stddevs.iter().map(|stddev| rounded(*stddev, 0.01 * stddev)).collect();
            let (key, comment) = (format!("model_prior.{key}"), format!("[{unit}] {how}"));
            found.push(Change { key, value: value(stddevs), comment });
        }
        found
    }
}

fn value(numbers: Vec<f64>) -> Value {
    if let [one] = numbers[..] { Value::Double(one) } else { Value::DoubleArray(numbers) }
}

/// All differences between `after` and `before`: mass properties, actuators, low-passes that do not delay as stated, effects, and their
/// standard deviations. `provenance` names the source of the numbers.
#[must_use]
pub fn changes(
    (before, after): (&PlatformModel, &PlatformModel),
    (prior_before, prior): (&ModelPrior, &ModelPrior),
    provenance: &str,
) -> Vec<Change> {
    let was = entries(before, prior_before);
    let (mut all, mut sources) = (Vec::new(), BTreeSet::new());
    for entry in entries(after, prior) {
        let changed = entry.since(was.iter().find(|was| was.key == entry.key), "adopted");
        let source = (!changed.is_empty() && !entry.source.is_empty()).then_some(entry.source);
        sources.extend(source.map(|source| format!("model_prior.{source}")));
        all.extend(changed);
    }
    let value = Value::String(format!("adopted: {provenance}"));
    let noted = |key| Change { key, value: value.clone(), comment: String::new() };
    all.extend(sources.into_iter().map(noted));
    all
}

/// Everything of a model that fits estimate.
fn entries(model: &PlatformModel, prior: &ModelPrior) -> Vec<Entry> {
    let mut all = Vec::new();
    let (mass, known) = (&model.mass_properties, &prior.inertia_b_kg_m2);
    for (name, at) in
        [("xx", (0, 0)), ("xy", (0, 1)), ("xz", (0, 2)), ("yy", (1, 1)), ("yz", (1, 2)), ("zz", (2, 2))]
    {
        let (key, number) = (format!("inertia_kg_m2.{name}"), mass.inertia_b_kg_m2()[at]);
        all.push(Entry::new(key, "kg m^2", &[number], &[known[at]], "inertia_kg_m2.source"));
    }
    let (offset, known) = (mass.gravity_offset_b_n_m(), &prior.gravity_offset_b_n_m);
    let source = "gravity_offset_n_m_source";
    all.push(Entry::new("gravity_offset_n_m", "N m", offset.as_slice(), known.as_slice(), source));
    // Actuators give mutable access to their values, so a copy is used.
    let mut actuators = model.actuators.clone();
    for (kind, known) in actuators.kinds_mut().into_iter().zip(prior.actuators.kinds()) {
        let Some(Group::Members { name, .. }) = kind.groups().first() else { continue };
        let members: Vec<String> = kind.names().into_iter().map(str::to_owned).collect();
        for (j, member) in members.iter().enumerate() {
            for field in kind.fields(0, j).iter().filter(|field| known.keys().contains(&field.key)) {
                let (numbers, unit) = match &field.slot {
                    Slot::Number(x) => (vec![**x], if known.is_share(field.key) { **x } else { 1.0 }),
                    Slot::Direction(axis) => (axis.as_slice().to_vec(), 1.0),
                    Slot::Vector(vector) => (vector.as_slice().to_vec(), 1.0),
                };
                let stddev = known.stddev(field.key, j).unwrap_or(0.0) * unit;
                let (key, source) =
                    (format!("{name}.{member}.{}", field.key), format!("{name}.{member}.source"));
                all.push(Entry::new(key, field.unit, &numbers, &[stddev], &source));
            }
        }
    }
    let sensors = &model.sensors;
    for (sensor, of) in [("gyro", &sensors.gyro.errors), ("accelerometer", &sensors.accelerometer.errors)] {
        for (key, x) in
            [("time_constant_s", of.time_constant_s), ("averaging_window_s", of.averaging_window_s)]
        {
            all.push(Entry::new(format!("sensors.{sensor}.{key}"), "s", &[x], &[], ""));
        }
    }
    for (id, parameters) in &model.effects {
        let specs = find(id).map(|effect| effect.parameters(model)).unwrap_or_default();
        for (name, value) in parameters {
            let unit = specs.iter().find(|spec| spec.name == *name).map_or("1", |spec| spec.unit);
            let known = prior.effects.get(id).and_then(|of| of.get(name));
            let (key, source) = (format!("effects.{id}.{name}"), format!("effects.{id}.source"));
            all.push(Entry::new(key, unit, &[*value], known.map_or(&[][..], std::slice::from_ref), &source));
        }
    }
    all
}

/// Entries of numbers that were measured, by their key below `model.`, with standard deviations, one for all or one of each; `how` they were found.
#[must_use]
pub fn measured(
    key: impl Into<String>,
    unit: &str,
    numbers: &[f64],
    stddevs: &[f64],
    how: &str,
) -> Vec<Change> {
    Entry::new(key, unit, numbers, stddevs, "").since(None, how)
}

/// Entries that note a step of a model's history; errors with three decimals, as `adopt` prints them.
#[must_use]
pub fn of_step(step: &ModelStep) -> Vec<Change> {
    let text = |text: &Option<String>| text.clone().map(Value::String);
    let decimals = |pair: [f64; 2]| Value::DoubleArray(pair.map(|x| (x * 1000.0).round() / 1000.0).to_vec());
    let entries = [
        ("date", text(&step.date)),
        ("effects", (!step.effects.is_empty()).then(|| Value::StringArray(step.effects.clone()))),
        ("prediction_error", step.prediction_error.map(decimals)),
        ("held_out_prediction_error", step.held_out_prediction_error.map(decimals)),
        ("source", text(&step.source)),
    ];
    let given = entries.into_iter().filter_map(|(key, value)| Some((step.key(key), value?)));
    given.map(|(key, value)| Change { key, value, comment: String::new() }).collect()
}

/// A number with the digits that its standard deviation is worth, down to a hundredth of it; with all where nothing is known of it.
pub(crate) fn rounded(value: f64, stddev: f64) -> f64 {
    let digits = (2.0 - stddev.log10()).ceil();
    let text = format!("{value:.*}", digits.clamp(0.0, 15.0) as usize);
    if digits.is_finite() { text.parse().unwrap_or(value) } else { value }
}
