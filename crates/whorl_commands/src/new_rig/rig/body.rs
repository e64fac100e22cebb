//! What acts on the body of the platform's file: weight, wheels.

use nalgebra::Vector3;
use whorl_math::GRAVITY_M_S2;

use super::{INERTIA_KG_M2, Parts};
use crate::new_rig::lines::{Lines, Origin, Sourced, list, number};
use crate::new_rig::measure::Measured;
use crate::new_rig::questions::{Ask, positive};

/// A wheel that nobody weighed: its share of the body's inertia \[1\].
pub(super) const WHEEL_SHARE: f64 = 0.01;
/// A centre of mass that nobody measured is this far off, standard deviation \[m\].
const ARM_M: f64 = 0.01;
/// A hinge this close to level or upright is so \[1\].
const LEVEL: f64 = 0.3;
/// Tilt of a bearing without a stop \[rad\].
const NO_STOP_RAD: f64 = 3.1;

/// Where the weight acts, and where the rig stops; returns how well the first is known [N m].
pub(super) fn weight(
    lines: &mut Lines,
    kind: &str,
    axis: usize,
    seen: &Measured,
    mass_kg: f64,
    inertia: &Sourced<[f64; 3]>,
) -> Option<f64> {
    let stddev = mass_kg * GRAVITY_M_S2 * ARM_M;
    if kind == "hinge" {
        let up = seen.up_b?;
        // About an upright hinge weight has no moment.
        let across = Vector3::from_fn(|k, _| if k == axis { 0.0 } else { up[k] });
        if across.norm() < 1.0 - LEVEL {
            return None;
        }
        let Some(swing_hz) = seen.swing_hz else {
            let words = "the hinge is level and nothing swings freely; weigh it";
            lines.add(3, "gravity_offset_n_m: [0.0, 0.0, 0.0]", Origin::Assumed, words);
            return Some(stddev);
        };
        // Of small swings: (2 pi f)^2 = m g r / J. The centre of mass hangs below the hinge.
        let about = inertia.value.get(axis).copied().unwrap_or(INERTIA_KG_M2);
        let moment_n_m = about * (std::f64::consts::TAU * swing_hz).powi(2);
        let offset = -moment_n_m * across.try_normalize(1e-9)?;
        let origin = if inertia.origin == Origin::Answered { Origin::Measured } else { Origin::Assumed };
        let words = format!(
            "hangs where it rests and swings at {} Hz, measured, with the inertia above: if that is wrong, so is this, in proportion",
            number(swing_hz)
        );
        lines.add(3, format!("gravity_offset_n_m: {}", list(offset.as_slice())), origin, words);
        return Some(0.2 * moment_n_m);
    }
    if kind != "on_bearing" {
        return None;
    }
    let words = "weight times the centre of mass from the bearing's centre: balanced; weigh it";
    lines.add(3, "gravity_offset_n_m: [0.0, 0.0, 0.0]", Origin::Assumed, words);
    let tilted = format!("no stop; it tilts by up to {} deg here", number(seen.most_tilt_rad.to_degrees()));
    let text = format!("tilt_limit: {{kind: cone, max_rad: {}}}", number(NO_STOP_RAD));
    lines.add(3, text, Origin::Assumed, tilted);
    Some(stddev)
}

pub(super) fn wheels(
    lines: &mut Lines,
    parts: &Parts,
    seen: &Measured,
    kind: &str,
    axis: usize,
    least_inertia: f64,
    ask: &mut dyn Ask,
) {
    if parts.wheels.is_empty() {
        return;
    }
    let suggested = match seen.wheel_inertia_kg_m2 {
        Some(measured) => Sourced::new(
            measured,
            if parts.torque_unit_is_assumed { Origin::Assumed } else { Origin::Measured },
            "commanded torque over what it does to the speed; as right as the torque's unit",
        ),
        None => Sourced::new(WHEEL_SHARE * least_inertia, Origin::Assumed, "weigh it"),
    };
    let inertia = positive(ask, "Inertia of a wheel about its axis [kg m^2]", suggested);
    lines.open(3, "wheel_defaults:");
    let text = format!("spin_inertia_kg_m2: {}", number(inertia.value));
    lines.add(4, text, inertia.origin, inertia.words);
    let (torque, from) = match seen.most_torque_n_m.filter(|torque| *torque > 0.0) {
        Some(torque) => (torque, "the largest that was commanded; see the motor's data sheet"),
        None => (0.1, "see the motor's data sheet"),
    };
    lines.add(4, format!("max_torque_n_m: {}", number(1.2 * torque)), Origin::Assumed, from);
    let (speed, from) = match seen.wheels.filter(|(_, most)| *most > 0.0) {
        Some((_, most)) => (most, "a fifth above the largest measured; see the motor's data sheet"),
        None => (500.0, "see the motor's data sheet"),
    };
    lines.add(4, format!("max_speed_rad_s: {}", number(1.2 * speed)), Origin::Assumed, from);
    lines.open(3, "wheels:");
    for (j, name) in parts.wheels.iter().enumerate() {
        let mut direction = [0.0; 3];
        let along = if parts.wheels.len() == 3 {
            j
        } else if kind == "hinge" {
            axis
        } else {
            j.min(2)
        };
        if let Some(component) = direction.get_mut(along) {
            *component = 1.0;
        }
        let (origin, words) = if parts.wheels_are_axes {
            (Origin::Stated, "by its name")
        } else {
            (Origin::Assumed, "look where it stands and which way round it turns")
        };
        lines.add(4, format!("{name}: {{spin_axis: {}}}", list(&direction)), origin, words);
    }
}
