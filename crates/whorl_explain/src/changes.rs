//! Changes of a platform's model by a fit, a calibration or a step of its history, as entries of its parameter file.

use whorl_calibration::ImuCalibration;
use whorl_dynamics::actuators::{Group, Slot};
use whorl_dynamics::effects::find;
use whorl_dynamics::{ModelPrior, PlatformModel};
use whorl_math::three_digits;
use whorl_params::{ModelStep, Value};

/// Numbers of vectors and directions are known to this at best, as far as digits in a file are concerned.
const TO_DIGITS: f64 = 1e-5;

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

/// A quantity as parameter files have it.
struct Entry {
    /// Key below `model.`, and of its standard deviations below `model_prior.`.
    key: String,
    unit: String,
    numbers: Vec<f64>,
    /// One for all numbers or one of each; empty where nothing is known of it.
    stddevs: Vec<f64>,
    /// Key below `model_prior.` under which the source of these is noted; empty: it is not.
    source: String,
}

impl Entry {
    fn new(key: impl Into<String>, unit: &str, numbers: &[f64], stddevs: &[f64], source: &str) -> Self {
        Self {
            key: key.into(),
            unit: unit.to_owned(),
            numbers: numbers.to_vec(),
            stddevs: stddevs.to_vec(),
            source: source.to_owned(),
        }
    }

    /// The entries to write where it was something else, or nothing; `how` it was found.
    fn since(&self, was: Option<&Self>, how: &str) -> Vec<Change> {
        let differs = |is: &[f64], was: Option<&[f64]>| {
            let of_each = |(a, b): (&f64, &f64)| (a - b).abs() > 1e-12 * a.abs().max(b.abs());
            was.is_none_or(|was| was.len() != is.len() || is.iter().zip(was).any(of_each))
        };
        let said = |of: &[f64]| of.iter().map(|x| three_digits(*x)).collect::<Vec<_>>().join(", ");
        let mut found = Vec::new();
        if differs(&self.numbers, was.map(|was| &*was.numbers)) {
            let mut comment = format!("[{}]", self.unit);
            if !self.stddevs.is_empty() {
                comment.push_str(&format!(" +- {},", said(&self.stddevs)));
            }
            comment.push_str(&format!(" {how}"));
            if let Some(was) = was {
                comment.push_str(&format!(", was {}", said(&was.numbers)));
            }
            let largest = if self.numbers.len() > 1 { TO_DIGITS } else { f64::INFINITY };
            let stddevs = self.stddevs.iter().map(|stddev| stddev.min(largest)).cycle();
            let rounded = self.numbers.iter().zip(stddevs).map(|(x, stddev)| rounded(*x, stddev));
            let numbers = if self.stddevs.is_empty() { self.numbers.clone() } else { rounded.collect() };
            found.push(Change { key: format!("model.{}", self.key), value: value(numbers), comment });
        }
        let is_known = self.stddevs.iter().any(|stddev| *stddev > 0.0);
        if is_known && differs(&self.stddevs, was.map(|was| &*was.stddevs)) {
            let stddevs = self.stddevs.iter().map(|stddev| rounded(*stddev, 0.01 * stddev)).collect();
            let (key, comment) = (format!("model_prior.{}", self.key), format!("[{}] {how}", self.unit));
            found.push(Change { key, value: value(stddevs), comment });
        }
        found
    }
}

fn value(numbers: Vec<f64>) -> Value {
    if let [one] = numbers[..] { Value::Double(one) } else { Value::DoubleArray(numbers) }
}

/// Digits down to a hundredth of the standard deviation; more would be meaningless.
fn rounded(value: f64, stddev: f64) -> f64 {
    if !(stddev > 0.0 && stddev.is_finite() && value.is_finite()) {
        return value;
    }
    let step = 10f64.powf((stddev * 0.01).log10().floor());
    let steps = (value / step).round();
    // Rounded via text, so that the file shows no binary rounding error.
    let digits = usize::try_from((-step.log10()).round().max(0.0) as i64).unwrap_or(0).min(15);
    format!("{:.digits$}", steps * step).parse().unwrap_or(value)
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
    let mut all = Vec::new();
    for group in entries(after, prior).chunk_by(|a, b| a.source == b.source) {
        let of_entry = |entry: &Entry| entry.since(was.iter().find(|was| was.key == entry.key), "adopted");
        let changed: Vec<Change> = group.iter().flat_map(of_entry).collect();
        let source =
            group.first().map(|entry| &entry.source).filter(|of| !of.is_empty() && !changed.is_empty());
        all.extend(changed);
        all.extend(source.map(|source| Change {
            key: format!("model_prior.{source}"),
            value: Value::String(format!("adopted: {provenance}")),
            comment: String::new(),
        }));
    }
    all
}

/// Everything of a model that fits estimate. Entries of one source stand together.
fn entries(model: &PlatformModel, prior: &ModelPrior) -> Vec<Entry> {
    let (mass, known) = (&model.mass_properties, &prior.inertia_b_kg_m2);
    let elements =
        [("xx", (0, 0)), ("xy", (0, 1)), ("xz", (0, 2)), ("yy", (1, 1)), ("yz", (1, 2)), ("zz", (2, 2))];
    let element = |(name, at): (&str, (usize, usize))| {
        let (key, source) = (format!("inertia_kg_m2.{name}"), "inertia_kg_m2.source");
        Entry::new(key, "kg m^2", &[mass.inertia_b_kg_m2()[at]], &[known[at]], source)
    };
    let mut all: Vec<Entry> = elements.into_iter().map(element).collect();
    let (offset, known) = (mass.gravity_offset_b_n_m(), &prior.gravity_offset_b_n_m);
    let source = "gravity_offset_n_m_source";
    all.push(Entry::new("gravity_offset_n_m", "N m", offset.as_slice(), known.as_slice(), source));
    // Actuators give mutable access to their values, so a copy is used.
    let mut actuators = model.actuators.clone();
    for (kind, known) in actuators.kinds_mut().into_iter().zip(prior.actuators.kinds()) {
        let Some(Group::Members { name, .. }) = kind.groups().first() else { continue };
        let members: Vec<String> = kind.names().into_iter().map(str::to_owned).collect();
        for (j, member) in members.iter().enumerate() {
            let source = format!("{name}.{member}.source");
            for field in kind.fields(0, j).iter().filter(|field| known.keys().contains(&field.key)) {
                let (numbers, unit) = match &field.slot {
                    Slot::Number(x) => (vec![**x], if known.is_share(field.key) { **x } else { 1.0 }),
                    Slot::Direction(axis) => (axis.as_slice().to_vec(), 1.0),
                    Slot::Vector(vector) => (vector.as_slice().to_vec(), 1.0),
                };
                let stddev = known.stddev(field.key, j).unwrap_or(0.0) * unit;
                let key = format!("{name}.{member}.{}", field.key);
                all.push(Entry::new(key, field.unit, &numbers, &[stddev], &source));
            }
        }
    }
    let sensors = &model.sensors;
    for (sensor, errors) in [("gyro", &sensors.gyro.errors), ("accelerometer", &sensors.accelerometer.errors)]
    {
        let low_pass =
            [("time_constant_s", errors.time_constant_s), ("averaging_window_s", errors.averaging_window_s)];
        all.extend(
            low_pass.map(|(key, x)| Entry::new(format!("sensors.{sensor}.{key}"), "s", &[x], &[], "")),
        );
    }
    for (id, parameters) in &model.effects {
        let specs = find(id).map(|effect| effect.parameters(model)).unwrap_or_default();
        for (name, value) in parameters {
            let unit = specs.iter().find(|spec| spec.name == *name).map_or("1", |spec| spec.unit);
            let known: Vec<f64> =
                prior.effects.get(id).and_then(|of| of.get(name)).copied().into_iter().collect();
            let (key, source) = (format!("effects.{id}.{name}"), format!("effects.{id}.source"));
            all.push(Entry::new(key, unit, &[*value], &known, &source));
        }
    }
    all
}

/// Entries for every quantity that a calibration has determined on all axes, with its standard deviations.
#[must_use]
pub fn of_calibration(found: &ImuCalibration) -> Vec<Change> {
    let mut all = Vec::new();
    for (name, unit, sensor) in found.sensors() {
        for quantity in
            sensor.quantities(unit).iter().filter(|quantity| quantity.of.determined() == [true; 3])
        {
            let Some(ending) = &quantity.ending else { continue };
            let key = format!("sensors.{name}.{}{ending}", quantity.key);
            let (numbers, stddevs) = (quantity.of.value.as_slice(), quantity.of.stddev.as_slice());
            let entry = Entry::new(key, &quantity.unit, numbers, stddevs, "");
            all.extend(entry.since(None, "calibrated"));
        }
    }
    all
}

/// Entries that note a step of a model's history; errors with three decimals, as `adopt` prints them.
#[must_use]
pub fn of_step(step: &ModelStep) -> Vec<Change> {
    let text = |text: &Option<String>| text.clone().map(Value::String);
    let pair = |pair: Option<[f64; 2]>| {
        pair.map(|pair| Value::DoubleArray(pair.map(|x| (x * 1000.0).round() / 1000.0).to_vec()))
    };
    let entries = [
        ("date", text(&step.date)),
        ("effects", (!step.effects.is_empty()).then(|| Value::StringArray(step.effects.clone()))),
        ("prediction_error", pair(step.prediction_error)),
        ("held_out_prediction_error", pair(step.held_out_prediction_error)),
        ("source", text(&step.source)),
    ];
    let given = entries.into_iter().filter_map(|(key, value)| Some((key, value?)));
    given.map(|(key, value)| Change { key: step.key(key), value, comment: String::new() }).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_are_rounded_to_a_hundredth_of_their_deviation() {
        assert_eq!(rounded(0.020_123_456, 4e-4), 0.020_123);
        assert_eq!(rounded(-2.098_765, 0.03), -2.0988);
        assert_eq!(rounded(1234.5678, 0.0), 1234.5678);
    }
}
