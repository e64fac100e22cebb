//! Changes of a platform's model by a fit or a calibration, as entries of its parameter file.

mod calibration;
mod step;

use std::collections::BTreeMap;

use whorl_dynamics::actuators::{Field, Group, Slot};
use whorl_dynamics::{ModelPrior, PlatformModel};
use whorl_math::three_digits;
use whorl_params::Value;

pub use calibration::of_calibration;
pub use step::of_step;

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

/// Collects changes.
struct Changes<'a> {
    provenance: &'a str,
    all: Vec<Change>,
}

/// A number before and after, and how well it is known then.
type Number = (f64, f64, f64);

impl Changes<'_> {
    fn push(&mut self, key: String, numbers: &[Number], comment: String) {
        let values: Vec<f64> = numbers.iter().map(|(_, is, stddev)| rounded(*is, *stddev)).collect();
        let value = if let [one] = values[..] { Value::Double(one) } else { Value::DoubleArray(values) };
        self.all.push(Change { key, value, comment });
    }

    /// One entry, or an array, where a number differs.
    fn add(&mut self, key: String, numbers: &[Number], comment: impl FnOnce() -> String) {
        if numbers.iter().any(|(was, is, _)| differs(*was, *is)) {
            self.push(key, numbers, comment());
        }
    }

    fn number(&mut self, key: String, (was, is, stddev): Number, unit: &str) {
        let comment = || format!("[{unit}] +- {}, adopted, was {}", three_digits(stddev), three_digits(was));
        self.add(key, &[(was, is, stddev)], comment);
    }

    /// Standard deviations before and after.
    fn prior(&mut self, key: &str, numbers: &[(f64, f64)], unit: &str) {
        let numbers: Vec<Number> = numbers.iter().map(|(was, is)| (*was, *is, 0.01 * is)).collect();
        self.add(format!("model_prior.{key}"), &numbers, || format!("{unit}adopted"));
    }

    /// What is written with one source, which is said where anything was.
    fn group(&mut self, source: &str, write: impl FnOnce(&mut Self)) {
        let count = self.all.len();
        write(self);
        if self.all.len() > count {
            let value = Value::String(format!("adopted: {}", self.provenance));
            self.all.push(Change { key: format!("model_prior.{source}"), value, comment: String::new() });
        }
    }
}

fn differs(before: f64, after: f64) -> bool {
    (before - after).abs() > 1e-12 * before.abs().max(after.abs())
}

/// Digits down to a hundredth of the standard deviation; more would be meaningless.
pub(crate) fn rounded(value: f64, stddev: f64) -> f64 {
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
    let mut c = Changes { provenance, all: Vec::new() };
    let (old, new) = (&before.mass_properties, &after.mass_properties);
    c.group("inertia_kg_m2.source", |c| {
        for (name, at) in
            [("xx", (0, 0)), ("xy", (0, 1)), ("xz", (0, 2)), ("yy", (1, 1)), ("yz", (1, 2)), ("zz", (2, 2))]
        {
            let stddev = prior.inertia_b_kg_m2[at];
            let number = (old.inertia_b_kg_m2()[at], new.inertia_b_kg_m2()[at], stddev);
            c.number(format!("model.inertia_kg_m2.{name}"), number, "kg m^2");
            c.prior(&format!("inertia_kg_m2.{name}"), &[(prior_before.inertia_b_kg_m2[at], stddev)], "");
        }
    });
    let (a, b) = (old.gravity_offset_b_n_m(), new.gravity_offset_b_n_m());
    let (known_before, known) = (&prior_before.gravity_offset_b_n_m, &prior.gravity_offset_b_n_m);
    c.add("model.gravity_offset_n_m".to_owned(), &[0, 1, 2].map(|i| (a[i], b[i], TO_DIGITS)), || {
        format!("[N m] +- {}, adopted", [known.x, known.y, known.z].map(three_digits).join(", "))
    });
    c.group("gravity_offset_n_m_source", |c| {
        c.prior("gravity_offset_n_m", &[0, 1, 2].map(|i| (known_before[i], known[i])), "[N m] ");
    });
    actuators(&mut c, (before, after), (prior_before, prior));
    for (sensor, was, is) in [
        ("gyro", &before.sensors.gyro.errors, &after.sensors.gyro.errors),
        ("accelerometer", &before.sensors.accelerometer.errors, &after.sensors.accelerometer.errors),
    ] {
        let key = format!("model.sensors.{sensor}.time_constant_s");
        c.add(key, &[(was.time_constant_s, is.time_constant_s, 0.0)], || {
            format!("[s] its samples are not late by it, was {}", three_digits(was.time_constant_s))
        });
        let key = format!("model.sensors.{sensor}.averaging_window_s");
        c.add(key, &[(was.averaging_window_s, is.averaging_window_s, 0.0)], || {
            "[s] its samples are means over it, the stamp in its middle".to_owned()
        });
    }
    effects(&mut c, before, after, prior);
    c.all
}

/// Numbers of vectors and directions are written to this.
const TO_DIGITS: f64 = 1e-5;

/// The estimated parameters of all actuators of every kind.
fn actuators(
    c: &mut Changes<'_>,
    (before, after): (&PlatformModel, &PlatformModel),
    (prior_before, prior): (&ModelPrior, &ModelPrior),
) {
    // The entries give mutable access to their values, so copies are used.
    let (mut old, mut new) = (before.actuators.clone(), after.actuators.clone());
    let kinds = old.kinds_mut().into_iter().zip(new.kinds_mut());
    let priors = prior_before.actuators.kinds().into_iter().zip(prior.actuators.kinds());
    for ((old, new), (known_before, known)) in kinds.zip(priors) {
        let Some(Group::Members { name, .. }) = old.groups().first() else { continue };
        let members: Vec<String> = old.names().into_iter().map(str::to_owned).collect();
        for (j, member) in members.iter().enumerate().take(new.names().len()) {
            let group = format!("{name}.{member}");
            let (was, is) = (old.fields(0, j), new.fields(0, j));
            c.group(&format!("{group}.source"), |c| {
                for key in known.keys() {
                    let is_key = |field: &&Field<'_>| field.key == *key;
                    let Some((was, is)) = was.iter().find(is_key).zip(is.iter().find(is_key)) else {
                        continue;
                    };
                    // In the entry's unit.
                    let unit = |field: &Field<'_>| match &field.slot {
                        Slot::Number(value) if known.is_share(key) => **value,
                        _ => 1.0,
                    };
                    let stddev = known.stddev(key, j).unwrap_or(0.0) * unit(is);
                    let stddev_before = known_before.stddev(key, j).unwrap_or(0.0) * unit(was);
                    let own = format!("{group}.{key}");
                    let vector = match (&was.slot, &is.slot) {
                        (Slot::Number(a), Slot::Number(b)) => {
                            c.number(format!("model.{own}"), (**a, **b, stddev), is.unit);
                            None
                        }
                        (Slot::Direction(a), Slot::Direction(b)) => Some((a.into_inner(), b.into_inner())),
                        (Slot::Vector(a), Slot::Vector(b)) => Some((**a, **b)),
                        _ => continue,
                    };
                    if let Some((a, b)) = vector {
                        c.add(format!("model.{own}"), &[0, 1, 2].map(|i| (a[i], b[i], TO_DIGITS)), || {
                            format!("+- {} rad, adopted", three_digits(stddev))
                        });
                    }
                    c.prior(&own, &[(stddev_before, stddev)], "");
                }
            });
        }
    }
}

fn effects(c: &mut Changes<'_>, before: &PlatformModel, after: &PlatformModel, prior: &ModelPrior) {
    let none = BTreeMap::new();
    for (id, parameters) in &after.effects {
        let old = before.effects.get(id).unwrap_or(&none);
        let deviations = prior.effects.get(id).unwrap_or(&none);
        let units = whorl_dynamics::effects::find(id).map(|e| e.parameters(after)).unwrap_or_default();
        c.group(&format!("effects.{id}.source"), |c| {
            let count = c.all.len();
            for (name, value) in parameters {
                let stddev = deviations.get(name).copied().unwrap_or(0.0);
                let unit = units.iter().find(|p| p.name == *name).map_or("1", |p| p.unit);
                if old.get(name).is_none_or(|o| differs(*o, *value)) {
                    let comment = format!("[{unit}] +- {}, adopted", three_digits(stddev));
                    c.push(format!("model.effects.{id}.{name}"), &[(0.0, *value, stddev)], comment);
                }
            }
            let has_changed = c.all.len() > count;
            let known = deviations.iter().filter(|(name, s)| **s > 0.0 && parameters.contains_key(*name));
            for (name, stddev) in known.filter(|_| has_changed) {
                let key = format!("model_prior.effects.{id}.{name}");
                c.push(key, &[(0.0, *stddev, 0.01 * stddev)], "adopted".to_owned());
            }
        });
    }
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
