//! Names of hidden effects, from recordings of a plant whose constants the model has wrong.

use nalgebra::Vector3;
use whorl_dynamics::PlatformModel;

use super::generator::{Extra, map, normal, random, record, wrong_model};
use crate::{Diagnosis, Options, Verdict, diagnose};

type Effects<'a> = &'a [(&'a str, &'a [(&'a str, f64)])];

fn diagnosis_of(effects: Effects<'_>, seed: u64, duration_s: f64) -> Diagnosis {
    let mut truth = PlatformModel::whorl_1_reference();
    truth.effects = map(effects);
    let runs: Vec<_> = (0..2).map(|i| record(&truth, seed * 10 + i, duration_s, None)).collect();
    let (model, prior) = wrong_model(&truth, seed);
    diagnose(&runs, &[], &model, &prior, &Options::default(), &mut |_| {}).unwrap()
}

#[test]
fn nothing_is_named_where_nothing_is_missing() {
    let diagnosis = diagnosis_of(&[], 1, 50.0);
    assert_eq!(diagnosis.verdict, Verdict::NothingMissing, "{:?}", diagnosis.effects);
    assert!(diagnosis.effects.is_empty() && diagnosis.unknown.is_none());
    assert_that_no_other_gains(&diagnosis);
}

/// The table does not contradict the answer: no effect gains beside it what its prior probability of 0.005 costs.
fn assert_that_no_other_gains(diagnosis: &Diagnosis) {
    for row in diagnosis.candidates.iter().filter(|row| !diagnosis.effects.contains(&row.effect)) {
        assert!(row.delta_log_evidence < -(0.005f64.ln()), "{row:?}");
    }
}

#[test]
#[ignore = "slow: the diagnosis of a friction"]
fn a_friction_is_named_with_its_size() {
    let diagnosis = diagnosis_of(&[("bearing_viscous_friction", &[("c_n_m_s", 0.05)])], 3, 50.0);
    assert_eq!(diagnosis.verdict, Verdict::Named, "{:?}", diagnosis.candidates.first());
    assert_eq!(diagnosis.effects, ["bearing_viscous_friction"]);
    assert_eq!(diagnosis.kind.as_deref(), Some("torque"));
    let parameter = &diagnosis.candidates[0].parameters[0];
    assert!((parameter.estimate - 0.05).abs() < 4.0 * parameter.stddev, "{parameter:?}");
    assert!(parameter.stddev < 0.005);
    assert_that_no_other_gains(&diagnosis);
    // It is all that is missing.
    assert!(diagnosis.candidates[0].share_of_excess > 0.9, "{}", diagnosis.candidates[0].share_of_excess);
    let json = serde_json::to_value(&diagnosis).unwrap();
    assert_eq!(json["schema"], 3);
    assert_eq!(json["verdict"], "named");
    let back: Diagnosis = serde_json::from_value(json).unwrap();
    assert_eq!(back.effects, diagnosis.effects);
}

/// The jets fired, and the recording does not say so.
#[test]
#[ignore = "slow: the diagnosis of a run whose jets were not recorded"]
fn nothing_is_named_where_unrecorded_jets_may_have_pushed() {
    let truth = PlatformModel::whorl_1_reference();
    let mut run = record(&truth, 5, 50.0, None);
    assert!(run.jet_pulses.iter().flatten().count() > 10);
    run.jet_pulses.clear();
    let (model, prior) = wrong_model(&truth, 5);
    let diagnosis = diagnose(&[run], &[], &model, &prior, &Options::default(), &mut |_| {}).unwrap();
    assert!(diagnosis.effects.is_empty(), "{:?}", diagnosis.effects);
    let says = |remark: &String| remark.contains("it is assumed that no jet fired");
    assert!(diagnosis.remarks.iter().any(says), "{:?}", diagnosis.remarks);
}

/// So plainly that the residual of the regression has the wheel's periodicity, too.
#[test]
#[ignore = "slow: the diagnosis of an unbalanced wheel"]
fn an_unbalanced_wheel_is_named_however_plainly_it_shows() {
    let diagnosis = diagnosis_of(&[("wheel_imbalance", &[("wheel_z_kg_m2", 1e-4)])], 23, 50.0);
    assert_eq!(diagnosis.verdict, Verdict::Named, "{:?}", diagnosis.unknown);
    assert_eq!(diagnosis.effects, ["wheel_imbalance"]);
}

#[test]
#[ignore = "slow: the diagnosis of a sensor"]
fn a_sensor_is_told_from_a_torque() {
    let diagnosis = diagnosis_of(&[("gyro_misalignment", &[("xz_rad", 0.03)])], 21, 50.0);
    assert_eq!(diagnosis.effects, ["gyro_misalignment"]);
    assert_eq!(diagnosis.kind.as_deref(), Some("sensor"));
}

/// A model without it takes the inertia for what moves at once.
#[test]
#[ignore = "slow: the diagnosis of an appendage"]
fn an_appendage_of_half_the_platform_is_named() {
    let inertia_kg_m2 = PlatformModel::whorl_1_reference().mass_properties.inertia_b_kg_m2()[(0, 0)];
    let panel = [
        ("participation_x_sqrt_kg_m", (0.5 * inertia_kg_m2).sqrt()),
        ("frequency_hz", 1.5),
        ("damping_ratio", 0.01),
    ];
    let diagnosis = diagnosis_of(&[("flexible_mode", &panel)], 27, 30.0);
    assert_eq!(diagnosis.verdict, Verdict::Named, "{:?}", diagnosis.unknown);
    assert_eq!(diagnosis.effects, ["flexible_mode"]);
    for ((name, truth), found) in panel.iter().zip(&diagnosis.candidates[0].parameters) {
        assert_eq!(*name, found.name);
        assert!((found.estimate.abs() - truth).abs() < 4.0 * found.stddev, "{found:?}");
    }
}

/// A random torque that changes over half a minute does nearly what it does, and no pass beside that torque shows it.
#[test]
#[ignore = "slow: the diagnosis of a faint cable"]
fn a_faint_cable_is_not_taken_for_a_slow_random_torque() {
    let cable = [("k_n_m_rad", 1.5e-4), ("yaw0_rad", -0.5)];
    let diagnosis = diagnosis_of(&[("harness_spring", &cable)], 42, 50.0);
    assert_ne!(diagnosis.verdict, Verdict::NothingMissing);
    assert_eq!(diagnosis.background.stddev_n_m, 0.0);
    let row = diagnosis.candidates.iter().find(|row| row.effect == "harness_spring").unwrap();
    assert!(row.delta_log_evidence > 5.0, "{row:?}");
}

/// Nobody knows the field in another room: its direction about the axes of the world is found with the dipole.
#[test]
#[ignore = "slow: the diagnosis of a dipole in another field"]
fn a_dipole_is_named_alone_whatever_the_direction_of_the_field() {
    let magnet = [
        ("dipole_x_a_m2", 100.0),
        ("dipole_y_a_m2", -60.0),
        ("dipole_z_a_m2", 120.0),
        ("field_x_t", 19e-6),
        ("field_y_t", -15e-6),
        ("field_z_t", -45e-6),
    ];
    let diagnosis = diagnosis_of(&[("magnetic_torque", &magnet)], 25, 50.0);
    assert_eq!(diagnosis.verdict, Verdict::Named, "{:?}", diagnosis.unknown);
    assert_eq!(diagnosis.effects, ["magnetic_torque"]);
}

/// Its position is wrong by metres, as one that was stated in another unit.
#[test]
#[ignore = "slow: the diagnosis of a misplaced accelerometer"]
fn an_accelerometer_far_from_its_place_is_named_with_its_position() {
    let arm = [("d_x_m", 2.5), ("d_y_m", -1.9), ("d_z_m", 1.2)];
    let diagnosis = diagnosis_of(&[("accel_lever_arm", &arm)], 24, 50.0);
    assert_eq!(diagnosis.verdict, Verdict::Named, "{:?}", diagnosis.unknown);
    assert_eq!(diagnosis.effects, ["accel_lever_arm"]);
    for ((name, metres), found) in arm.iter().zip(&diagnosis.candidates[0].parameters) {
        assert_eq!(*name, found.name);
        assert!((found.estimate - metres).abs() < 4.0 * found.stddev && found.stddev < 0.1, "{found:?}");
    }
}

/// A sample and a half late: the edges of pulses lie between what is compared.
#[test]
#[ignore = "slow: the diagnosis of a long latency"]
fn a_long_latency_is_named_with_its_size_and_explains_the_data() {
    let diagnosis = diagnosis_of(&[("imu_latency", &[("t_s", 0.015)])], 22, 50.0);
    // Late valves may be left beside it.
    assert_eq!(diagnosis.effects, ["imu_latency"], "{:?}", diagnosis.confounded_with);
    let latency = &diagnosis.candidates[0].parameters[0];
    assert!((latency.estimate - 0.015).abs() < 3.0 * latency.stddev && latency.stddev < 1e-3, "{latency:?}");
    let slow = &diagnosis.slow_residual;
    assert!(slow.after < 1.03, "{slow:?}");
}

fn diagnosis_with(extra: Extra<'_>, seed: u64) -> Diagnosis {
    let truth = PlatformModel::whorl_1_reference();
    let runs: Vec<_> = (0..2).map(|i| record(&truth, seed * 10 + i, 50.0, Some(extra))).collect();
    let (model, prior) = wrong_model(&truth, seed);
    diagnose(&runs, &[], &model, &prior, &Options::default(), &mut |_| {}).unwrap()
}

#[test]
#[ignore = "slow: the diagnosis of a torque that comes and goes"]
fn a_torque_that_comes_and_goes_follows_time_and_has_no_name() {
    // On and off at odd times, as a valve that sticks now and then; no period comes near them.
    let on = [(2.0, 3.5), (7.0, 15.0), (21.0, 22.0), (30.0, 41.0)];
    let diagnosis = diagnosis_with(
        &|t, _, _| {
            let open = on.iter().any(|(from, to)| (*from..*to).contains(&t));
            Vector3::new(0.0, 0.0, if open { 8e-3 } else { 0.0 })
        },
        5,
    );
    assert_eq!(diagnosis.verdict, Verdict::Unknown, "{:?}", diagnosis.effects);
    let unknown = diagnosis.unknown.unwrap();
    assert_eq!((unknown.variable.as_str(), unknown.axis.as_str()), ("time", "z"), "{unknown:?}");
}

#[test]
#[ignore = "slow: the diagnosis of a line that turns with the body"]
fn a_line_that_turns_with_the_body_is_no_vibration_of_the_sensors() {
    let diagnosis = diagnosis_with(
        &|t, _, _| Vector3::new(0.0, 4e-3 * (std::f64::consts::TAU * 0.43 * t + 0.4).sin(), 0.0),
        6,
    );
    assert_eq!(diagnosis.effects, ["periodic_torque"]);
    let found = diagnosis.candidates[0].parameters.iter().find(|p| p.unit == "Hz").unwrap();
    assert!((found.estimate - 0.43).abs() < 0.01, "{found:?}");
}

#[test]
#[ignore = "slow: a diagnosis that is left open"]
fn one_torque_under_two_names_is_left_open() {
    // A draught about the vertical is a turbine about it, g = t k: no data can tell.
    let diagnosis = diagnosis_of(&[("bearing_turbine", &[("vertical_n_m", 0.004)])], 17, 50.0);
    assert_eq!(diagnosis.verdict, Verdict::Confounded, "{:?}", diagnosis.candidates.first());
    let mut sets = vec![diagnosis.effects.clone()];
    sets.extend(diagnosis.confounded_with.clone());
    for name in ["bearing_turbine", "air_current"] {
        assert!(sets.contains(&vec![name.to_owned()]), "{sets:?}");
    }
    assert_eq!(diagnosis.contenders(), sets);
}

/// Converters clip before filters and electronics add their noise, so nothing piles up at the limit.
#[test]
#[ignore = "slow: the diagnosis of a gyro that clips"]
fn a_range_below_the_noise_is_found() {
    let truth = PlatformModel::whorl_1_reference();
    let limit = 0.075;
    let runs: Vec<_> = (0..2)
        .map(|i| {
            let mut run = record(&truth, 310 + i, 50.0, None);
            let mut rng = random(77 + i);
            let noise = truth.sensors.gyro.errors.noise_stddev;
            for w in &mut run.gyro_b_rad_s.value {
                for axis in 0..3 {
                    if w[axis].abs() > limit {
                        w[axis] = limit.copysign(w[axis]) + noise[axis] * normal(&mut rng);
                    }
                }
            }
            run
        })
        .collect();
    let (model, prior) = wrong_model(&truth, 31);
    let diagnosis = diagnose(&runs, &[], &model, &prior, &Options::default(), &mut |_| {}).unwrap();
    // A second name may stand beside it: the slow regression sees the clipped turns too.
    assert!(diagnosis.effects.iter().any(|id| id == "gyro_saturation"), "{:?}", diagnosis.effects);
    for found in diagnosis.candidates.iter().filter(|c| c.effect == "gyro_saturation") {
        let range = found.parameters.iter().find(|p| p.name == "range_rad_s").unwrap();
        assert!((range.estimate - limit).abs() < 0.02 * limit, "{range:?}");
    }
}
