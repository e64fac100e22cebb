//! Platforms that are not on a spherical bearing, and sensors that a platform does not have.

use nalgebra::{Unit, Vector3};
use whorl_dynamics::platform::TiltLimit;
use whorl_dynamics::{Freedom, PlatformModel};

use super::{read_error, tree};
use crate::{platform_model, platform_model_with_prior, read_shared};

const BODY: &str =
    "mass_kg: 2.0\n      inertia_kg_m2: {xx: 2.0e-6, xy: 0.0, xz: 0.0, yy: 2.0e-6, yz: 0.0, zz: 3.0e-6}";
const GYRO: &str = "gyro: {noise_stddev_rad_s: 1.0e-3, bias_turn_on_stddev_rad_s: 2.0e-3}";

/// A platform of these lines below `model:`, with a sample rate and these sensors.
fn text(lines: &str, sensors: &str) -> String {
    format!(
        "/rig/**:\n  ros__parameters:\n    model:\n      {lines}\n      sensors:\n        rate_hz: 0.5\n        {sensors}\n"
    )
}

fn model(lines: &str, sensors: &str) -> PlatformModel {
    let tree = tree(&text(lines, sensors));
    read_shared(&tree.for_node("/rig/estimator"), |r| platform_model(r, "model")).unwrap().unwrap()
}

fn error(lines: &str, sensors: &str) -> String {
    let tree = tree(&text(lines, sensors));
    read_error(&tree.for_node("/rig/estimator"), |r| platform_model(r, "model"))
}

#[test]
fn a_hinge_needs_neither_weight_nor_stop_nor_accelerometer() {
    let lines = format!("{BODY}\n      freedom: {{kind: hinge, axis: [0.0, 0.0, 2.0]}}");
    let found = model(
        &lines,
        &format!(
            "{GYRO}\n        vector: {{reference_direction: [0.0, 0.0, 1.0], noise_stddev_rad: 0.01, rate_hz: 0.025}}"
        ),
    );
    assert_eq!(found.freedom, Freedom::Hinge { axis_b: Vector3::z_axis() });
    assert_eq!(found.tilt_limit, TiltLimit::NONE);
    assert!(!found.sensors.accelerometer.fitted && found.sensors.gyro.axes == [true; 3]);
    assert_eq!(*found.mass_properties.gravity_offset_b_n_m(), Vector3::zeros());
    assert!(found.wheels().is_empty() && found.jets().is_empty());
    let one =
        model(&lines, "gyro: {axes: [z], noise_stddev_rad_s: 1.0e-3, bias_turn_on_stddev_rad_s: 2.0e-3}");
    assert_eq!(one.sensors.gyro.axes, [false, false, true]);
    let force = |axes: &str| {
        format!(
            "{GYRO}\n        accelerometer: {{{axes}noise_stddev_m_s2: 0.02, bias_turn_on_stddev_m_s2: 0.1, lever_arm_m: [0.0, 0.0, 0.0]}}"
        )
    };
    for (axes, there, vertical) in [
        ("", [true; 3], true),
        ("axes: [x, y, z], ", [true; 3], true),
        ("axes: [x], ", [true, false, false], false),
        ("axes: [x, z], ", [true, false, true], false),
    ] {
        let sensor = model(&lines, &force(axes)).sensors.accelerometer;
        assert!(sensor.fitted && sensor.axes == there && sensor.shows_vertical() == vertical, "{axes}");
    }
    let twice = error(&lines, &force("axes: [x, x], "));
    assert!(twice.contains("accelerometer.axes = [x, x]: allowed: a list of x, y, z"), "{twice}");
    let given = model(
        &format!(
            "{lines}\n      gravity_offset_n_m: [0.1, 0.0, 0.0]\n      tilt_limit: {{kind: cone, max_rad: 3.0}}"
        ),
        GYRO,
    );
    assert_eq!(given.mass_properties.gravity_offset_b_n_m().x, 0.1);
    assert_eq!(given.tilt_limit, TiltLimit::Cone { max_rad: 3.0 });
}

#[test]
fn a_spacecraft_has_no_weight_and_no_stop_even_if_its_file_speaks_of_them() {
    let lines = format!(
        "{BODY}\n      freedom: {{kind: free}}\n      gravity_offset_n_m: [0.0, 0.0, 0.0]\n      \
         tilt_limit: {{kind: cone, max_rad: 3.0}}"
    );
    let found = model(&lines, GYRO);
    assert_eq!((found.freedom, found.tilt_limit), (Freedom::Free, TiltLimit::NONE));
    let heavy = lines.replace("[0.0, 0.0, 0.0]", "[0.0, 0.0, -1.0]");
    assert_eq!(
        error(&heavy, GYRO),
        "p.yaml:7: model.gravity_offset_n_m = [0.0, 0.0, -1.0]: the weight of a free platform has no moment; \
         allowed: left out, or [0.0, 0.0, 0.0]"
    );
    let prior = format!("{}    model_prior: {{gravity_offset_n_m: [0.0, 0.0, 0.0]}}\n", text(&lines, GYRO));
    let read = |text: &str| {
        let tree = tree(text);
        read_shared(&tree.for_node("/rig/estimator"), platform_model_with_prior).unwrap().unwrap().1.prior
    };
    let prior = read(&prior);
    assert_eq!(prior.gravity_offset_b_n_m, Vector3::zeros());
    assert_eq!(prior, read(&text(&lines, GYRO)), "as without it");
}

#[test]
fn a_bench_needs_its_wheels_only() {
    let wheel = "wheels: {w: {spin_axis: [0.0, 0.0, 1.0], spin_inertia_kg_m2: 1.0e-7, max_torque_n_m: 1.0e-4, max_speed_rad_s: 900.0}}";
    let found = model(
        &format!("freedom: {{kind: clamped}}\n      {wheel}"),
        "wheel_speed: {noise_stddev_rad_s: 0.1}",
    );
    assert_eq!(found.freedom, Freedom::Clamped);
    assert_eq!(found.sensors.gyro.axes, [false; 3]);
    assert_eq!(found.wheels()[0].spin_inertia_kg_m2, 1e-7);
    let on_bearing = error(wheel, "wheel_speed: {noise_stddev_rad_s: 0.1}");
    for key in [
        "mass_kg",
        "inertia_kg_m2.xx",
        "gravity_offset_n_m",
        "tilt_limit.kind",
        "sensors.gyro.noise_stddev_rad_s",
    ] {
        assert!(on_bearing.contains(&format!("model.{key}: missing")), "{key}: {on_bearing}");
    }
}

#[test]
fn freedoms_and_axes_that_make_no_sense_are_refused() {
    let hinge = format!("{BODY}\n      freedom: {{kind: hinge, axis: [0.0, 0.0, 1.0]}}");
    let gyro = |axes: &str| {
        format!("gyro: {{axes: {axes}, noise_stddev_rad_s: 1.0e-3, bias_turn_on_stddev_rad_s: 2.0e-3}}")
    };
    for (lines, sensors, expected) in [
        (
            hinge.clone(),
            gyro("[x]"),
            "p.yaml:9: model.sensors.gyro.axes = [x]: none of them sees the turn about freedom.axis; allowed: an axis along \
             it, among others",
        ),
        (
            hinge.clone(),
            gyro("[z, z]"),
            "p.yaml:9: model.sensors.gyro.axes = [z, z]: allowed: a list of x, y, z, at least one and each at most once",
        ),
        (
            format!("{BODY}\n      freedom: {{kind: hinge}}"),
            gyro("[z]"),
            "/rig/estimator: model.freedom.axis: missing; needed: three numbers [x, y, z], not all zero (the hinge's axis, body \
             axes; where it points in the world follows from the attitude at the start); looked in p.yaml",
        ),
        (
            format!("{BODY}\n      freedom: {{kind: hinged, axis: [0.0, 0.0, 1.0]}}"),
            gyro("[z]"),
            "model.freedom.kind = hinged: allowed: one of on_bearing, hinge, clamped, free",
        ),
    ] {
        let found = error(&lines, &sensors);
        assert!(found.contains(expected), "{found}");
    }
}

/// Nothing in a model refuses a platform for its size.
#[test]
fn platforms_of_any_size_are_read() {
    for (scale, rate_hz) in [(1e-6, 2000.0), (1.0, 100.0), (1e4, 0.01)] {
        let lines = format!(
            "mass_kg: {scale:e}\n      inertia_kg_m2: {{xx: {scale:e}, xy: 0.0, xz: 0.0, yy: {scale:e}, yz: 0.0, zz: {scale:e}}}\n      \
             freedom: {{kind: hinge, axis: [1.0, 1.0, 0.0]}}"
        );
        let text = text(&lines, GYRO).replace("rate_hz: 0.5", &format!("rate_hz: {rate_hz}"));
        let tree = tree(&text);
        let found =
            read_shared(&tree.for_node("/rig/estimator"), platform_model_with_prior).unwrap().unwrap();
        let (model, prior) = (found.0, found.1.prior);
        assert_eq!(model.freedom.hinge_axis_b(), Some(Unit::new_normalize(Vector3::new(1.0, 1.0, 0.0))));
        assert_eq!(model.sensors.rate_hz, rate_hz);
        // The typical prior follows the platform's size: m g r with r a share of the radius of gyration.
        assert!((prior.gravity_offset_b_n_m.x / (7e-5 * 9.81 * scale) - 1.0).abs() < 1e-12);
    }
}
