//! Changes of a platform's model by a fit or a calibration, as entries of its parameter file.

mod calibration;
mod step;

use std::collections::BTreeMap;

use nalgebra::Vector3;
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

impl Changes<'_> {
    fn number(&mut self, key: String, before: f64, after: f64, unit: &str, stddev: f64) {
        if differs(before, after) {
            let comment = format!("[{unit}] +- {}, adopted, was {}", short(stddev), short(before));
            self.all.push(Change { key, value: Value::Double(rounded(after, stddev)), comment });
        }
    }

    fn vector(&mut self, key: String, before: &Vector3<f64>, after: &Vector3<f64>, comment: String) {
        if (0..3).any(|i| differs(before[i], after[i])) {
            self.all.push(Change {
                key,
                value: Value::DoubleArray(after.iter().map(|x| rounded(*x, 1e-5)).collect()),
                comment,
            });
        }
    }

    fn prior(&mut self, key: String, before: f64, after: f64) {
        if differs(before, after) {
            self.all.push(Change {
                key: format!("model_prior.{key}"),
                value: Value::Double(rounded(after, 0.01 * after)),
                comment: "adopted".to_owned(),
            });
        }
    }

    fn source(&mut self, group: &str) {
        self.all.push(Change {
            key: format!("model_prior.{group}"),
            value: Value::String(format!("adopted: {}", self.provenance)),
            comment: String::new(),
        });
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

fn short(value: f64) -> String {
    three_digits(value)
}

/// All differences between `after` and `before`: mass properties, actuators, effects, and their standard
/// deviations. `provenance` names the source of the numbers.
#[must_use]
pub fn changes(
    (before, after): (&PlatformModel, &PlatformModel),
    (prior_before, prior): (&ModelPrior, &ModelPrior),
    provenance: &str,
) -> Vec<Change> {
    let mut c = Changes { provenance, all: Vec::new() };
    mass_properties(&mut c, before, after, prior_before, prior);
    actuators(&mut c, before, after, prior_before, prior);
    low_pass(&mut c, before, after);
    effects(&mut c, before, after, prior);
    c.all
}

/// The low-pass of inertial sensors that does not delay as stated.
fn low_pass(c: &mut Changes<'_>, before: &PlatformModel, after: &PlatformModel) {
    let of = |model: &PlatformModel| {
        [("gyro", model.sensors.gyro.errors), ("accelerometer", model.sensors.accelerometer.errors)]
    };
    for ((sensor, was), (_, is)) in of(before).into_iter().zip(of(after)) {
        if differs(was.time_constant_s, is.time_constant_s) {
            c.all.push(Change {
                key: format!("model.sensors.{sensor}.time_constant_s"),
                value: Value::Double(is.time_constant_s),
                comment: format!("[s] its samples are not late by it, was {}", short(was.time_constant_s)),
            });
        }
        if differs(was.averaging_window_s, is.averaging_window_s) {
            c.all.push(Change {
                key: format!("model.sensors.{sensor}.averaging_window_s"),
                value: Value::Double(is.averaging_window_s),
                comment: "[s] its samples are means over it, the stamp in its middle".to_owned(),
            });
        }
    }
}

fn mass_properties(
    c: &mut Changes<'_>,
    before: &PlatformModel,
    after: &PlatformModel,
    prior_before: &ModelPrior,
    prior: &ModelPrior,
) {
    let (old, new) = (&before.mass_properties, &after.mass_properties);
    let count = c.all.len();
    for (name, i, j) in [("xx", 0, 0), ("xy", 0, 1), ("xz", 0, 2), ("yy", 1, 1), ("yz", 1, 2), ("zz", 2, 2)] {
        let (a, b) = (old.inertia_b_kg_m2()[(i, j)], new.inertia_b_kg_m2()[(i, j)]);
        let stddev = prior.inertia_b_kg_m2[(i, j)];
        c.number(format!("model.inertia_kg_m2.{name}"), a, b, "kg m^2", stddev);
        c.prior(format!("inertia_kg_m2.{name}"), prior_before.inertia_b_kg_m2[(i, j)], stddev);
    }
    if c.all.len() > count {
        c.source("inertia_kg_m2.source");
    }
    let (a, b) = (old.gravity_offset_b_n_m(), new.gravity_offset_b_n_m());
    let stddev = prior.gravity_offset_b_n_m;
    let comment = format!("[N m] +- {}, {}, {}, adopted", short(stddev.x), short(stddev.y), short(stddev.z));
    c.vector("model.gravity_offset_n_m".to_owned(), a, b, comment);
    if (0..3).any(|i| differs(prior_before.gravity_offset_b_n_m[i], stddev[i])) {
        c.all.push(Change {
            key: "model_prior.gravity_offset_n_m".to_owned(),
            value: Value::DoubleArray(stddev.iter().map(|x| rounded(*x, 0.01 * x)).collect()),
            comment: "[N m] adopted".to_owned(),
        });
        c.source("gravity_offset_n_m_source");
    }
}

/// The estimated parameters of all actuators of every kind.
fn actuators(
    c: &mut Changes<'_>,
    before: &PlatformModel,
    after: &PlatformModel,
    prior_before: &ModelPrior,
    prior: &ModelPrior,
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
            let count = c.all.len();
            let (was, is) = (old.fields(0, j), new.fields(0, j));
            for key in known.keys() {
                let find = |fields: &[Field<'_>]| fields.iter().position(|field| field.key == *key);
                let (Some(was), Some(is)) =
                    (find(&was).and_then(|f| was.get(f)), find(&is).and_then(|f| is.get(f)))
                else {
                    continue;
                };
                let stddevs =
                    (known_before.stddev(key, j).unwrap_or(0.0), known.stddev(key, j).unwrap_or(0.0));
                let unit = |field: &Field<'_>| match &field.slot {
                    Slot::Number(value) if known.is_share(key) => **value,
                    _ => 1.0,
                };
                entry(c, &group, was, is, (stddevs.0 * unit(was), stddevs.1 * unit(is)));
            }
            if c.all.len() > count {
                c.source(&format!("{group}.source"));
            }
        }
    }
}

/// One entry of one actuator, and its standard deviation before and after, in its unit.
fn entry(c: &mut Changes<'_>, group: &str, was: &Field<'_>, is: &Field<'_>, (before, after): (f64, f64)) {
    let key = format!("{group}.{}", is.key);
    let comment = || format!("+- {} rad, adopted", short(after));
    match (&was.slot, &is.slot) {
        (Slot::Number(a), Slot::Number(b)) => {
            c.number(format!("model.{key}"), **a, **b, is.unit, after);
            c.prior(key, before, after);
        }
        (Slot::Direction(a), Slot::Direction(b)) => {
            c.vector(format!("model.{key}"), a, b, comment());
            c.prior(key, before, after);
        }
        (Slot::Vector(a), Slot::Vector(b)) => {
            c.vector(format!("model.{key}"), a, b, comment());
            c.prior(key, before, after);
        }
        _ => {}
    }
}

fn effects(c: &mut Changes<'_>, before: &PlatformModel, after: &PlatformModel, prior: &ModelPrior) {
    let none = BTreeMap::new();
    for (id, parameters) in &after.effects {
        let old = before.effects.get(id).unwrap_or(&none);
        let deviations = prior.effects.get(id).unwrap_or(&none);
        let units = whorl_dynamics::effects::find(id).map(|e| e.parameters(after)).unwrap_or_default();
        let count = c.all.len();
        for (name, value) in parameters {
            let stddev = deviations.get(name).copied().unwrap_or(0.0);
            let unit = units.iter().find(|p| p.name == *name).map_or("1", |p| p.unit);
            if old.get(name).is_none_or(|o| differs(*o, *value)) {
                c.all.push(Change {
                    key: format!("model.effects.{id}.{name}"),
                    value: Value::Double(rounded(*value, stddev)),
                    comment: format!("[{unit}] +- {}, adopted", short(stddev)),
                });
            }
        }
        for (name, stddev) in
            deviations.iter().filter(|(name, s)| **s > 0.0 && parameters.contains_key(*name))
        {
            if c.all.len() > count {
                c.all.push(Change {
                    key: format!("model_prior.effects.{id}.{name}"),
                    value: Value::Double(rounded(*stddev, 0.01 * stddev)),
                    comment: "adopted".to_owned(),
                });
            }
        }
        if c.all.len() > count {
            c.source(&format!("effects.{id}.source"));
        }
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
