//! What a definition must satisfy: form, dimensions, and how it behaves at states that a platform meets.

use std::f64::consts::PI;

use nalgebra::{UnitQuaternion, Vector3};

use super::expression::{Compiled, Refusal};
use super::{ActsOn, Axes, Definition, DefinitionError, Dimension, QUANTITIES, WrittenEffect};
use crate::effects::Effect;
use crate::{Environment, PlatformModel};

/// Longest equation, in characters.
const LONGEST: usize = 2_000;

/// Most parameters, states and curves.
const MOST: (usize, usize, usize) = (40, 4, 4);

/// Knots of a curve.
const KNOTS: std::ops::RangeInclusive<usize> = 2..=16;

/// Work that counts as none [W], as a share of the size of what does it.
const NO_WORK: f64 = 1e-12;

/// Names, numbers and lengths.
pub(super) fn form(definition: &Definition) -> Result<(), DefinitionError> {
    let refuse = |key: &str, problem: String| Err(DefinitionError::new(key, problem));
    is_name("id", &definition.id)?;
    let equations = std::iter::once(("equation".to_owned(), &definition.equation))
        .chain(definition.states.iter().map(|s| (format!("states.{}.derivative", s.name), &s.derivative)))
        .chain(definition.curves.iter().map(|c| (format!("curves.{}.of", c.name), &c.of)));
    for (key, text) in equations {
        if text.trim().is_empty() || text.len() > LONGEST {
            return refuse(
                &key,
                format!("an equation of 1 to {LONGEST} characters is needed, not {}", text.len()),
            );
        }
    }
    let counts = (definition.parameters.len(), definition.states.len(), definition.curves.len());
    if counts.0 > MOST.0 || counts.1 > MOST.1 || counts.2 > MOST.2 {
        return refuse(
            "parameters",
            format!("at most {} parameters, {} states and {} curves", MOST.0, MOST.1, MOST.2),
        );
    }
    if counts.0 + counts.2 == 0 {
        return refuse(
            "parameters",
            "an effect needs a parameter that makes it larger, zero where it is absent".into(),
        );
    }
    if !definition.states.is_empty() && definition.acts_on != ActsOn::Torque {
        return refuse("states", "only effects that act on the torque may have states".into());
    }
    if !definition.curves.is_empty() && definition.acts_on == ActsOn::WheelTorque {
        return refuse("curves", "an effect on wheels has no curves".into());
    }
    let mut seen: Vec<&str> = Vec::new();
    let all = definition.parameters.iter().map(|p| ("parameters", &p.name));
    let all = all.chain(definition.states.iter().map(|s| ("states", &s.name)));
    for (group, name) in all.chain(definition.curves.iter().map(|c| ("curves", &c.name))) {
        let key = format!("{group}.{name}");
        is_name(&key, name)?;
        if seen.contains(&name.as_str()) || name == "pi" || QUANTITIES.iter().any(|q| q.name == name) {
            return refuse(
                &key,
                format!("the name {name} is taken by a quantity or another parameter; choose another"),
            );
        }
        seen.push(name);
    }
    for p in &definition.parameters {
        let key = |what: &str| format!("parameters.{}.{what}", p.name);
        let (low, high) = p.range;
        if !(low.is_finite() && high.is_finite() && low < high) {
            return refuse(
                &key("range"),
                format!("{low} to {high} is no range; allowed: [smallest, largest], finite"),
            );
        }
        if !(p.neutral >= low && p.neutral <= high) {
            return refuse(&key("neutral"), format!("{} is outside the range {low} to {high}", p.neutral));
        }
        if !(p.prior.is_finite() && p.prior > 0.0) {
            return refuse(
                &key("prior"),
                format!("{} is no prior standard deviation; allowed: above 0", p.prior),
            );
        }
        if let Some(start) = p.starts.iter().find(|s| !(**s >= low && **s <= high)) {
            return refuse(&key("starts"), format!("{start} is outside the range {low} to {high}"));
        }
    }
    for curve in &definition.curves {
        let key = |what: &str| format!("curves.{}.{what}", curve.name);
        let rising = curve.knots.windows(2).all(|pair| pair[0] < pair[1]);
        if !KNOTS.contains(&curve.knots.len()) || !rising || curve.knots.iter().any(|k| !k.is_finite()) {
            let (least, most) = (KNOTS.start(), KNOTS.end());
            return refuse(&key("knots"), format!("allowed: {least} to {most} increasing numbers"));
        }
        if !(curve.largest.is_finite() && curve.largest > 0.0 && curve.prior.is_finite() && curve.prior > 0.0)
        {
            return refuse(&key("largest"), "largest and prior must be above 0".into());
        }
    }
    Ok(())
}

fn is_name(key: &str, name: &str) -> Result<(), DefinitionError> {
    let starts = name.starts_with(|c: char| c.is_ascii_lowercase());
    let plain = name.chars().all(|c| c.is_ascii_lowercase() || c.is_ascii_digit() || c == '_');
    if starts && plain && name.len() <= 60 {
        return Ok(());
    }
    Err(DefinitionError::new(
        key,
        format!("`{name}` is no name; allowed: a small letter, then small letters, digits and _, at most 60"),
    ))
}

/// An error of an equation with the place in it.
pub(super) fn located(key: &str, text: &str, refusal: &Refusal) -> DefinitionError {
    let before = text.get(..refusal.at).unwrap_or("").chars().count();
    let here: String = text.chars().skip(before).take(24).collect();
    let place =
        if here.trim().is_empty() { "at its end".to_owned() } else { format!("at `{}`", here.trim()) };
    DefinitionError::new(key, format!("{place}: {}", refusal.problem))
}

/// The axes of the result, and whether it is what it is added to.
pub(super) fn result(definition: &Definition, compiled: &Compiled) -> Result<Axes, DefinitionError> {
    let (expected, is_vector, what) = match definition.acts_on {
        ActsOn::Torque => (Dimension::TORQUE, true, "torque"),
        ActsOn::WheelTorque => (Dimension::TORQUE, false, "torque"),
        ActsOn::Thrust => (Dimension::NONE, false, "share of the thrust"),
        ActsOn::Gyro => (Dimension::RATE, true, "rate"),
        ActsOn::Accelerometer => (Dimension::ACCELERATION, true, "acceleration"),
    };
    if let Some(found) = compiled.dimension.filter(|d| *d != expected) {
        let unit = if expected == Dimension::RATE { "rad/s".to_owned() } else { expected.to_string() };
        return Err(DefinitionError::new(
            "equation",
            format!("{} gives {found}: not a {what} ({unit})", definition.equation.trim()),
        ));
    }
    match (compiled.vector, is_vector) {
        (None, true) => Err(DefinitionError::new(
            "equation",
            format!(
                "it gives a number; a {what} of the body is a vector: multiply with a direction, as in ... * vertical or ... * (0, 0, 1)"
            ),
        )),
        (Some(_), false) => {
            Err(DefinitionError::new("equation", format!("it gives a vector; the {what} here is a number")))
        }
        (None, false) => Ok(Axes::Body),
        (Some(found), true) => match (found, definition.axes) {
            (Some(found), Some(stated)) if found != stated => Err(DefinitionError::new(
                "axes",
                "the equation's vector is in the other axes; turn it with world(v) or body(v), or leave `axes` out",
            )),
            (found, stated) => Ok(found.or(stated).unwrap_or(Axes::Body)),
        },
    }
}

/// Every parameter must do something.
pub(super) fn names_are_used(effect: &WrittenEffect) -> Result<(), DefinitionError> {
    let programs = || std::iter::once(&effect.equation).chain(&effect.derivatives);
    for (i, p) in effect.definition.parameters.iter().enumerate() {
        if !programs().any(|program| program.uses_parameter(i)) {
            return Err(DefinitionError::new(
                format!("parameters.{}", p.name),
                "no equation uses it; remove it, or write it into the equation",
            ));
        }
    }
    let count = |program: &super::Program| program.curves.len();
    if effect.definition.curves.len() > programs().map(count).sum() {
        return Err(DefinitionError::new("curves", "no equation uses one of the curves"));
    }
    Ok(())
}

/// States of a platform over what it meets: at rest, and 60 others.
fn probes(model: &PlatformModel) -> Vec<(Probe, Environment<'_>)> {
    let mut state = 0.5_f64;
    // Additive recurrence of the golden section: even, and the same every time.
    let mut next = || {
        state = (state + 0.618_033_988_749_894_9).fract();
        2.0 * state - 1.0
    };
    let mut list = Vec::new();
    for i in 0..61 {
        let at_rest = i == 0;
        let scale: f64 = if at_rest { 0.0 } else { [1e-3, 0.1, 3.0][i % 3] };
        let attitude =
            UnitQuaternion::from_euler_angles(0.5 * next() * scale.min(1.0), 0.5 * next(), PI * next());
        let attitude = if at_rest { UnitQuaternion::identity() } else { attitude };
        let rate = Vector3::new(next(), next(), next()) * scale;
        let rate = if at_rest { Vector3::zeros() } else { rate };
        let probe = Probe {
            speeds: (0..8).map(|_| 300.0 * next() * scale.min(1.0)).collect(),
            torques: (0..8).map(|_| next() * scale.min(1.0)).collect(),
            valves: (0..16).map(|_| (next() * scale.min(1.0)).max(0.0)).collect(),
            hidden: (0..8).map(|_| 0.1 * next() * scale.min(1.0)).collect(),
        };
        let environment = Environment {
            time_s: 300.0 * (1.0 + next()),
            omega_dot_wb_b_rad_s2: Vector3::new(next(), next(), next()) * scale,
            tank_pressure_pa: model.tank().reference_pressure_pa * 0.5 * (1.0 + next()),
            gas_used_kg: 0.05 * (1.0 + next()),
            bus_voltage_v: model.bus.initial_v * (1.0 - 0.1 * (1.0 + next())),
            temperature_k: model.sensors.ambient_temperature_k + 15.0 * next(),
            ballast_direction: Vector3::new(next().round(), next().round(), next().round()),
            ..Environment::new(model, attitude, rate)
        };
        list.push((probe, environment));
    }
    list
}

struct Probe {
    speeds: Vec<f64>,
    torques: Vec<f64>,
    valves: Vec<f64>,
    hidden: Vec<f64>,
}

/// Finite everywhere, nothing at neutral values, no work if it is passive.
pub(super) fn behaviour(effect: &WrittenEffect) -> Result<(), DefinitionError> {
    let model = PlatformModel::whorl_1_reference();
    let specs = &effect.specs;
    let neutral: Vec<f64> = specs.iter().map(|s| s.neutral).collect();
    let moved =
        |by: f64| -> Vec<f64> { specs.iter().map(|s| s.limited(s.neutral + by * s.prior_stddev)).collect() };
    let end = |pick: fn(&crate::ParameterSpec) -> f64| -> Vec<f64> { specs.iter().map(pick).collect() };
    let sets = [
        ("at neutral values", neutral),
        ("one prior standard deviation up", moved(1.0)),
        ("one prior standard deviation down", moved(-1.0)),
        ("at the smallest values", end(|s| s.min)),
        ("at the largest values", end(|s| s.max)),
    ];
    for (which, values) in &sets {
        let is_neutral = *which == "at neutral values";
        for (probe, environment) in probes(&model) {
            let environment = Environment {
                wheel_speed_rad_s: &probe.speeds,
                wheel_motor_torque_n_m: &probe.torques,
                valve_fraction: &probe.valves,
                ..environment
            };
            let hidden = probe.hidden.get(..effect.derivatives.len()).unwrap_or(&[]);
            let words = || {
                let rate = environment.omega_wb_b_rad_s;
                format!("{which}, at a rate of ({:.3}, {:.3}, {:.3}) rad/s", rate.x, rate.y, rate.z)
            };
            let given = effect.result(values, &environment, hidden, 1);
            if !given.iter().all(|x| x.is_finite()) {
                return Err(DefinitionError::new(
                    "equation",
                    format!(
                        "it is not finite {}: {:?}. A divisor may be zero there: give it a smallest size, as unit(rate, 1e-3 [rad/s]) does",
                        words(),
                        given.as_slice()
                    ),
                ));
            }
            let mut derivative = vec![0.0; effect.derivatives.len()];
            effect.hidden_derivative(values, &environment, hidden, &mut derivative);
            if let Some(at) = derivative.iter().position(|x| !x.is_finite()) {
                let key = effect
                    .definition
                    .states
                    .get(at)
                    .map_or("states".into(), |s| format!("states.{}", s.name));
                return Err(DefinitionError::new(key, format!("the derivative is not finite {}", words())));
            }
            if is_neutral && given.amax() > 0.0 {
                return Err(DefinitionError::new(
                    "equation",
                    format!(
                        "with every parameter at its neutral value it is {:?} instead of zero ({}); the effect must be absent there",
                        given.as_slice(),
                        words()
                    ),
                ));
            }
            let power_w = match effect.definition.acts_on {
                ActsOn::WheelTorque => given.x * environment.wheel_speed(1),
                _ => given.dot(&environment.omega_wb_b_rad_s),
            };
            let allowed_w = NO_WORK
                * given.norm()
                * environment.omega_wb_b_rad_s.norm().max(environment.wheel_speed(1).abs());
            let mechanical = matches!(effect.definition.acts_on, ActsOn::Torque | ActsOn::WheelTorque);
            // What a state holds may come back.
            if effect.definition.is_passive && mechanical && hidden.is_empty() && power_w > allowed_w {
                return Err(DefinitionError::new(
                    "passive",
                    format!(
                        "it says that it never does work, but {} it does {power_w:.3e} W; correct sign or range, or say `passive: false`",
                        words()
                    ),
                ));
            }
        }
    }
    Ok(())
}
