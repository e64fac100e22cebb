//! Actuators of every kind, and the electrical bus.

use whorl_dynamics::actuators::{ActuatorKind, Actuators, Allowed, Field, Group, Slot};
use whorl_dynamics::platform::BusVoltage;

use crate::limits::{Limits, any, non_negative, positive, range};
use crate::reader::Reader;

/// Every kind's groups, members in file order.
pub(super) fn read(r: &mut Reader<'_>) -> Actuators {
    let mut actuators = Actuators::default();
    for kind in actuators.kinds_mut() {
        for (g, group) in kind.groups().iter().enumerate() {
            match group {
                Group::Members { name, defaults } => members(r, kind, g, name, defaults),
                // If left out, the kind's default applies.
                Group::One { name } if r.has(name) => r.group(name, |r| {
                    for field in kind.fields(g, 0) {
                        let key = field.key;
                        entry(r, field, key);
                    }
                }),
                Group::One { .. } => {}
            }
        }
    }
    actuators
}

fn members(r: &mut Reader<'_>, kind: &mut dyn ActuatorKind, group: usize, name: &str, defaults: &str) {
    for (j, member) in r.children(name).into_iter().enumerate() {
        let path = format!("{name}.{member}");
        kind.add(member);
        for field in kind.fields(group, j) {
            let own = format!("{path}.{}", field.key);
            if !field.shared {
                entry(r, field, &own);
                continue;
            }
            let number = shared(r, &field, &own, &format!("{defaults}.{}", field.key));
            if let Slot::Number(value) = field.slot {
                *value = number;
            }
        }
    }
}

/// The member's own value, else the shared one. The overlay decides between model and truth for each of the two
/// keys, so a member's own value in the model overrides a shared value of the truth.
fn shared(r: &mut Reader<'_>, field: &Field<'_>, own: &str, common: &str) -> f64 {
    let (limits, doc) = (limits(field.allowed), field.description());
    if let Some(default) = field.default
        && !r.has(own)
        && !r.has(common)
    {
        return r.f64_or(own, default, limits, &doc);
    }
    let shared = r.optional_f64(common, limits, &doc);
    // `has` and not the value: a shared value that was refused is reported once, as itself.
    if r.has(own) || !r.has(common) {
        r.f64(own, limits, &doc)
    } else {
        r.optional_f64(own, limits, &doc).or(shared).unwrap_or_else(|| limits.placeholder())
    }
}

fn entry(r: &mut Reader<'_>, field: Field<'_>, key: &str) {
    let (limits, doc) = (limits(field.allowed), field.description());
    match (field.slot, field.default) {
        (Slot::Number(value), None) => *value = r.f64(key, limits, &doc),
        (Slot::Number(value), Some(default)) => *value = r.f64_or(key, default, limits, &doc),
        (Slot::Vector(value), _) => *value = r.vector3(key, limits, &doc),
        (Slot::Direction(value), _) => *value = r.direction(key, &doc),
    }
}

fn limits(allowed: Allowed) -> Limits<f64> {
    match allowed {
        Allowed::Any => any(),
        Allowed::Positive => positive(),
        Allowed::NonNegative => non_negative(),
        Allowed::Between(from, to) => range(from..=to),
    }
}

/// A platform without the group has a steady supply.
pub(super) fn bus(r: &mut Reader<'_>) -> BusVoltage {
    if !r.has("bus") {
        return BusVoltage { initial_v: 24.0, full_v: 24.0, discharge_v_s: 0.0, sag_v_n_m: 0.0 };
    }
    r.group("bus", |r| {
        let initial_v = r.f64("initial_v", positive(), "bus voltage at the start of a run [V]");
        BusVoltage {
            initial_v,
            full_v: initial_v,
            discharge_v_s: r.f64_or("discharge_v_s", 0.0, non_negative(), "fall of the bus voltage [V/s]"),
            sag_v_n_m: r.f64_or("sag_v_n_m", 0.0, non_negative(), "drop per total wheel torque [V/(N m)]"),
        }
    })
}
