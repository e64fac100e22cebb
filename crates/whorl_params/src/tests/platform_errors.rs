//! Errors in platform models, with their exact text.

use super::read_error;
use crate::{ParameterTree, platform_model, truth_model};

/// The file of a platform with one line replaced.
fn whorl_1_with(line: &str, by: &str) -> ParameterTree {
    let text = include_str!("../../../../params/whorl_1.yaml");
    assert!(text.contains(line), "{line}");
    ParameterTree::from_texts(&[("w.yaml", &text.replacen(line, by, 1))], &[]).unwrap()
}

fn model_error(line: &str, by: &str) -> String {
    let error =
        read_error(&whorl_1_with(line, by).for_node("/whorl_1/estimator"), |r| platform_model(r, "model"));
    // Lines of the platform's file may move: keep what does not depend on them.
    let numbered: Vec<&str> = error.lines().collect();
    let line_of =
        |text: &str| include_str!("../../../../params/whorl_1.yaml").lines().position(|l| l.contains(text));
    let first = line_of(line.lines().next().unwrap()).unwrap() + 1;
    let marker = format!("w.yaml:{first}: ");
    numbered.iter().map(|l| l.strip_prefix(&marker).unwrap_or(l)).collect::<Vec<_>>().join("\n")
}

#[test]
fn platform_models_are_checked_beyond_ranges() {
    let table = [
        (
            "xx: 6.2",
            "xx: -6.2",
            "model.inertia_kg_m2.xx = -6.2: allowed: a number above 0 (matrix element of the inertia about the centre of rotation, wheels included, body axes [kg m^2])",
        ),
        (
            "xy: -0.9 ",
            "xyz: -0.9 ",
            "/whorl_1/estimator: model.inertia_kg_m2.xy: missing; needed: a number (matrix element (the product of inertia with its sign in the matrix), body axes [kg m^2]); looked in w.yaml\nmodel.inertia_kg_m2.xyz = -0.9: unknown parameter of /whorl_1/estimator; did you mean model.inertia_kg_m2.xy?",
        ),
        (
            "wheel_x: {spin_axis: [1.0, 0.0, 0.0]}",
            "wheel_x: {spin_axis: [0.0, 0.0, 0.0]}",
            "model.wheels.wheel_x.spin_axis = [0.0, 0.0, 0.0]: allowed: three numbers [x, y, z], not all zero (spin axis, body axes; positive speed is right-handed about it)",
        ),
        (
            "min_on_time_s: 0.010",
            "min_on_time_s: -0.010",
            "model.jet_defaults.min_on_time_s = -0.01: allowed: a number from 0 to 1 (shortest pulse of the valve [s])",
        ),
        (
            "{kind: cone, max_rad: 0.0873}",
            "{kind: sphere, max_rad: 0.0873}",
            "model.tilt_limit.kind = sphere: allowed: one of cone, pitch (cone: angle between body z and the vertical; pitch: elevation of body x)",
        ),
        (
            "{kind: cone, max_rad: 0.0873}",
            "{kind: pitch, max_rad: 1.6}",
            "model.tilt_limit.max_rad = 1.6: allowed: a number above 0 and below 1.5707963267948966 (where the bearing stops [rad], below pi/2)",
        ),
        (
            "reference_direction: [1.0, 0.0, 0.0]",
            "reference_direction: [0.0, 0.0, 2.0]",
            "model.sensors.vector.reference_direction = [0.0, 0.0, 2.0]: is vertical, which leaves yaw unseen; allowed: at least 6 deg off the vertical",
        ),
        (
            "volume_m3: 1.11e-3",
            "volume_m3: .inf",
            "model.tank.volume_m3 = .inf: allowed: a number above 0 (volume of the tank [m^3])",
        ),
    ];
    for (line, by, expected) in table {
        assert_eq!(model_error(line, by), expected, "{by}");
    }
}

#[test]
fn impossible_inertia_is_reported_at_its_first_key() {
    let table = [
        ("zz: 12.1", "zz: 15.0", "model.inertia_kg_m2: no rigid body has these principal moments "),
        (
            "xy: -0.9",
            "xy: -9.0",
            "model.inertia_kg_m2: the inertia matrix is not positive definite (smallest principal moment ",
        ),
    ];
    let first =
        include_str!("../../../../params/whorl_1.yaml").lines().position(|l| l.contains("xx: 6.2")).unwrap()
            + 1;
    for (line, by, expected) in table {
        let tree = whorl_1_with(line, by);
        let error = read_error(&tree.for_node("/whorl_1/estimator"), |r| platform_model(r, "model"));
        assert!(error.starts_with(&format!("w.yaml:{first}: {expected}")), "{error}");
        assert!(
            error.ends_with(
                "; allowed: symmetric, positive definite, no principal moment above the sum of the other two"
            ),
            "{error}"
        );
    }
}

#[test]
fn effects_are_checked_against_the_catalogue() {
    // The devices of the driver's section are read by the driver.
    let file = include_str!("../../../../params/whorl_1.yaml");
    let platform = file.split("# Devices of the platform").next().unwrap();
    let table = [
        (
            "bearing_viscous_friktion: {c_n_m_s: 0.1}",
            "t.yaml:5: truth.effects.bearing_viscous_friktion: unknown effect, and there is no effects/bearing_viscous_friktion.yaml beside the file; did you mean bearing_viscous_friction?",
        ),
        (
            "bearing_viscous_friction: {c_nms: 0.1}",
            "t.yaml:5: truth.effects.bearing_viscous_friction.c_nms = 0.1: unknown parameter of /whorl_1/driver; did you mean truth.effects.bearing_viscous_friction.c_n_m_s?",
        ),
        (
            "bearing_viscous_friction: {c_n_m_s: -0.1}",
            "t.yaml:5: truth.effects.bearing_viscous_friction.c_n_m_s = -0.1: allowed: a number from 0 to 5 (viscous friction of the bearing: Torque per body rate. [N m s])",
        ),
    ];
    for (effect, expected) in table {
        let truth =
            format!("/whorl_1/driver:\n  ros__parameters:\n    truth:\n      effects:\n        {effect}\n");
        let tree = ParameterTree::from_texts(&[("w.yaml", platform), ("t.yaml", &truth)], &[]).unwrap();
        assert_eq!(read_error(&tree.for_node("/whorl_1/driver"), truth_model), expected);
    }
}
