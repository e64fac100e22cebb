//! What the three-dimensional view draws of the platforms, read from their parameters.

use whorl_math::rad_from_deg;
use whorl_params::{Kind, NodeParameters, ParameterTree, Value};
use whorl_report::{JetShape, KeepOut, PlatformShape, TiltLimit};

/// The shapes of these platforms; what their parameters do not say is left out.
#[must_use]
pub fn shapes<S: AsRef<str>>(tree: &ParameterTree, platforms: &[S]) -> Vec<PlatformShape> {
    let coordinator = tree.for_node("/coordinator");
    platforms.iter().map(|name| shape(tree, &coordinator, name.as_ref())).collect()
}

fn shape(tree: &ParameterTree, coordinator: &NodeParameters, name: &str) -> PlatformShape {
    let p = tree.for_node(&format!("/{name}/local_control"));
    let plain = PlatformShape::unknown(name);
    let keep_out = format!("law.members.{name}.keep_out");
    let wheel = |key: &str| {
        let of_one = |w: &&str| number(&p, &format!("model.wheels.{w}.{key}"));
        let default = number(&p, &format!("model.wheel_defaults.{key}"));
        p.children("model.wheels").iter().filter_map(|w| of_one(w).or(default)).reduce(f64::max)
    };
    let speed = wheel("max_speed_rad_s");
    PlatformShape {
        tilt: text(&p, "model.tilt_limit.kind")
            .zip(number(&p, "model.tilt_limit.max_rad"))
            .map(|(kind, max_rad)| TiltLimit { kind, max_rad }),
        boresight: vector(coordinator, &format!("{keep_out}.boresight_body")).unwrap_or(plain.boresight),
        keep_out: vector(coordinator, &format!("{keep_out}.direction_world"))
            .zip(number(coordinator, &format!("{keep_out}.half_angle_deg")))
            .map(|(direction_world, deg)| KeepOut { direction_world, half_angle_rad: rad_from_deg(deg) }),
        jets: p
            .children("model.jets")
            .iter()
            .filter_map(|jet| {
                Some(JetShape {
                    position_m: vector(&p, &format!("model.jets.{jet}.position_m"))?,
                    force_direction: vector(&p, &format!("model.jets.{jet}.force_direction"))?,
                })
            })
            .collect(),
        momentum_max_n_m_s: speed.zip(wheel("spin_inertia_kg_m2")).map(|(speed, inertia)| speed * inertia),
        wheel_speed_max_rad_s: speed,
        ..plain
    }
}

/// A number among the parameters of a node.
#[must_use]
pub fn number(p: &NodeParameters, key: &str) -> Option<f64> {
    match p.get(key)?.value.converted(Kind::Double)? {
        Value::Double(x) if x.is_finite() => Some(x),
        _ => None,
    }
}

fn vector(p: &NodeParameters, key: &str) -> Option<[f64; 3]> {
    match p.get(key)?.value.converted(Kind::DoubleArray)? {
        Value::DoubleArray(v) => v.try_into().ok(),
        _ => None,
    }
}

fn text(p: &NodeParameters, key: &str) -> Option<String> {
    match &p.get(key)?.value {
        Value::String(s) => Some(s.clone()),
        _ => None,
    }
}
