//! The group `model_prior`.

use nalgebra::Vector3;
use whorl_dynamics::ModelPrior;

use super::read_error;
use crate::{NodeParameters, ParameterTree, PriorEntry, platform_model_with_prior, read_shared};

/// Whorl-I without the priors of its file, and with these lines, which start on line 4.
fn parameters(lines: &str) -> NodeParameters {
    let platform = include_str!("../../../../params/whorl_1.yaml");
    let (before, after) = platform.split_once("    model_prior:\n").unwrap();
    let (_, after) = after.split_once("\n# What references").unwrap();
    let platform = format!("{before}\n# What references{after}");
    let indented: String = lines.lines().map(|line| format!("      {line}\n")).collect();
    let text = format!("/whorl_1/**:\n  ros__parameters:\n    model_prior:\n{indented}");
    let texts = [("w.yaml", platform.as_str()), ("p.yaml", &text)];
    ParameterTree::from_texts(&texts, &[]).unwrap().for_node("/whorl_1/estimator")
}

fn error(lines: &str) -> String {
    read_error(&parameters(lines), platform_model_with_prior)
}

#[test]
fn what_is_given_is_taken_and_the_rest_is_typical() {
    let lines = "inertia_kg_m2: {zz: 0.3, xy: 0.07, source: CAD, zz_source: pendulum test}
gravity_offset_n_m: 0.05
wheel_defaults: {spin_inertia_kg_m2: 4.0e-4, spin_axis: 0.003, viscous_friction_n_m_s: 6.0e-6}
wheel_defaults.source: data sheet
wheels.wheel_y: {spin_inertia_kg_m2: 2.0e-5, coulomb_friction_n_m: 3.0e-4}
jets.jet_2: {thrust_n: 0.1, force_direction: 0.02, opening_delay_s: 0.004}
sensors.gyro.scale: [0.001, 0.002, 0.003]
tank.specific_impulse_s: 5
tank.specific_impulse_s_source: calibration
";
    let (model, known) = read_shared(&parameters(lines), platform_model_with_prior).unwrap().unwrap();
    let mut expected = ModelPrior::typical(&model);
    expected.inertia_b_kg_m2[(2, 2)] = 0.3;
    expected.inertia_b_kg_m2[(0, 1)] = 0.07;
    expected.inertia_b_kg_m2[(1, 0)] = 0.07;
    expected.gravity_offset_b_n_m = Vector3::repeat(0.05);
    // Shares of 0.02 kg m^2 and 0.4 N.
    expected.actuators.wheels.spin_inertia = vec![0.02, 0.001, 0.02];
    expected.actuators.wheels.axis_rad = vec![0.003; 3];
    // In their own units: a friction may be zero.
    expected.actuators.wheels.viscous_friction_n_m_s = vec![6.0e-6; 3];
    expected.actuators.wheels.coulomb_friction_n_m = vec![0.0, 3.0e-4, 0.0];
    expected.actuators.jets.thrust[1] = 0.25;
    expected.actuators.jets.direction_rad[1] = 0.02;
    expected.actuators.jets.opening_delay_s[1] = 0.004;
    for (given, expected) in
        known.prior.actuators.wheels.spin_inertia.iter().zip(&expected.actuators.wheels.spin_inertia)
    {
        assert!((given - expected).abs() < 1e-15);
    }
    expected.actuators.wheels.spin_inertia.clone_from(&known.prior.actuators.wheels.spin_inertia);
    assert_eq!(known.prior, expected);
    let entry = |key: &str| known.entries.iter().find(|entry| entry.key == key).unwrap();
    assert_eq!(
        *entry("sensors.gyro.scale"),
        PriorEntry { key: "sensors.gyro.scale".into(), stddev: vec![0.001, 0.002, 0.003], source: None }
    );
    assert_eq!(entry("inertia_kg_m2.zz").source.as_deref(), Some("pendulum test"));
    assert_eq!(entry("inertia_kg_m2.xy").source.as_deref(), Some("CAD"));
    assert_eq!(entry("wheel_defaults.spin_axis").source.as_deref(), Some("data sheet"));
}

#[test]
fn every_key_must_be_that_of_a_model_parameter() {
    let table = [
        (
            "inertia_kg_m2.zz: -0.2",
            "p.yaml:4: model_prior.inertia_kg_m2.zz = -0.2: allowed: a number of at least 0 (standard deviation of the model parameter's prior, in that parameter's unit)",
        ),
        (
            "inertia_kg_m2: {zy: 0.1}",
            "p.yaml:4: model_prior.inertia_kg_m2.zy = 0.1: there is no model parameter inertia_kg_m2.zy; did you mean inertia_kg_m2.xy?",
        ),
        (
            "jets.jet_1.thrust: 0.1",
            "p.yaml:4: model_prior.jets.jet_1.thrust = 0.1: there is no model parameter jets.jet_1.thrust; did you mean jets.jet_1.thrust_n?",
        ),
        (
            "jets.jet_13.thrust_n: 0.1",
            "p.yaml:4: model_prior.jets.jet_13.thrust_n = 0.1: there is no model parameter jets.jet_13.thrust_n; did you mean jets.jet_1.thrust_n?",
        ),
        (
            "inertia_kg_m2: 0.1",
            "p.yaml:4: model_prior.inertia_kg_m2 = 0.1: is a group of model parameters; allowed: the key of one parameter",
        ),
        (
            "mass_kg: [1.0, 2.0, 3.0]",
            "p.yaml:4: model_prior.mass_kg = [1.0, 2.0, 3.0]: allowed: a number of at least 0 (standard deviation of the model parameter's prior, in that parameter's unit)",
        ),
        (
            "tilt_limit.kind: 1.0",
            "p.yaml:4: model_prior.tilt_limit.kind = 1.0: is a word and not a number: it has no standard deviation",
        ),
        (
            "effects.harness_spring.k_n_m_rad: 0.1",
            "p.yaml:4: model_prior.effects.harness_spring.k_n_m_rad = 0.1: there is no model parameter effects.harness_spring.k_n_m_rad; the model has no effect harness_spring: add model.effects.harness_spring first",
        ),
        (
            "mass_source: CAD",
            "p.yaml:4: model_prior.mass_source = CAD: there is no model parameter mass; allowed: the keys of the group model",
        ),
        (
            "tank.source: 5",
            "p.yaml:4: model_prior.tank.source = 5: allowed: a text (where the standard deviations are from)",
        ),
    ];
    for (lines, expected) in table {
        assert_eq!(error(lines), expected, "{lines}");
    }
}

#[test]
fn the_files_of_both_platforms_give_every_part_a_source() {
    for (name, text) in [
        ("whorl_1", include_str!("../../../../params/whorl_1.yaml")),
        ("whorl_2", include_str!("../../../../params/whorl_2.yaml")),
    ] {
        let tree = ParameterTree::from_texts(&[("p.yaml", text)], &[]).unwrap();
        let node = tree.for_node(&format!("/{name}/estimator"));
        let (model, known) = read_shared(&node, platform_model_with_prior).unwrap().unwrap();
        assert!(known.entries.len() >= 15);
        assert!(known.entries.iter().all(|entry| entry.source.is_some()), "{:?}", known.entries);
        let typical = ModelPrior::typical(&model);
        let inertia = known.prior.inertia_b_kg_m2 - typical.inertia_b_kg_m2;
        assert!(inertia.abs().max() < 0.05, "{inertia}");
    }
}
