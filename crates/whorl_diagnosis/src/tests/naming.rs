//! Names of hidden effects, from recordings of a plant whose constants the model has wrong.

use whorl_dynamics::PlatformModel;

use super::generator::{map, record, wrong_model};
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
    assert!(
        matches!(diagnosis.verdict, Verdict::NothingMissing | Verdict::NotEnoughInformation),
        "{:?} {:?}",
        diagnosis.verdict,
        diagnosis.effects
    );
    assert!(diagnosis.effects.is_empty() && diagnosis.unknown.is_none());
}

#[test]
fn a_friction_is_named_with_its_size() {
    let diagnosis = diagnosis_of(&[("bearing_viscous_friction", &[("c_n_m_s", 0.05)])], 3, 50.0);
    assert_eq!(diagnosis.verdict, Verdict::Named, "{:?}", diagnosis.candidates.first());
    assert_eq!(diagnosis.effects, ["bearing_viscous_friction"]);
    assert_eq!(diagnosis.kind.as_deref(), Some("torque"));
    let parameter = &diagnosis.candidates[0].parameters[0];
    assert!((parameter.estimate - 0.05).abs() < 4.0 * parameter.stddev, "{parameter:?}");
    assert!(parameter.stddev < 0.005);
    let json = serde_json::to_value(&diagnosis).unwrap();
    assert_eq!(json["schema"], 1);
    assert_eq!(json["verdict"], "named");
    let back: Diagnosis = serde_json::from_value(json).unwrap();
    assert_eq!(back.effects, diagnosis.effects);
}

#[test]
fn a_sensor_is_told_from_a_torque() {
    let diagnosis = diagnosis_of(&[("gyro_misalignment", &[("xz_rad", 0.03)])], 21, 50.0);
    assert_eq!(diagnosis.effects, ["gyro_misalignment"]);
    assert_eq!(diagnosis.kind.as_deref(), Some("sensor"));
}

/// Prints what every effect comes to; for work on the engine.
#[test]
fn survey() {
    let Ok(only) = std::env::var("WHORL_SURVEY") else { return };
    let cases: &[(&str, Effects<'_>)] = &[
        ("none", &[]),
        ("viscous", &[("bearing_viscous_friction", &[("c_n_m_s", 0.03)])]),
        ("coulomb", &[("bearing_coulomb_friction", &[("torque_n_m", 0.003)])]),
        (
            "quadratic",
            &[("air_drag_quadratic", &[("dx_n_m_s2", 0.2), ("dy_n_m_s2", 0.2), ("dz_n_m_s2", 0.2)])],
        ),
        ("air", &[("air_current", &[("t_x_n_m", 0.002), ("t_y_n_m", -0.001), ("t_z_n_m", 0.001)])]),
        (
            "periodic",
            &[(
                "air_current_periodic",
                &[("amplitude_x_n_m", 0.003), ("frequency_hz", 0.13), ("phase_rad", 1.0)],
            )],
        ),
        ("turbine", &[("bearing_turbine", &[("body_z_n_m", 0.003)])]),
        ("magnetic", &[("magnetic_torque", &[("dipole_x_a_m2", 60.0)])]),
        ("sag", &[("anisoelastic_sag", &[("cxx_m_n", 8e-7)])]),
        ("shift", &[("mass_shift", &[("shift_x_n_m_kg", 2.0)])]),
        ("strength", &[("thruster_strength", &[("jet_3", -0.4)])]),
        ("misaligned", &[("thruster_misalignment", &[("jet_3_a_rad", 0.1)])]),
        ("delay", &[("thruster_delay", &[("t_on_s", 0.02), ("t_off_s", 0.02)])]),
        ("rise", &[("thruster_rise", &[("tau_s", 0.03)])]),
        ("leak", &[("thruster_leak", &[("jet_9_n", 0.008)])]),
        ("wheel_friction", &[("wheel_friction", &[("wheel_z_viscous_n_m_s", 3e-4)])]),
        ("wheel_axis", &[("wheel_misalignment", &[("wheel_z_a_rad", 0.03)])]),
        ("wheel_inertia", &[("wheel_inertia", &[("wheel_z", 0.08)])]),
        ("windage", &[("wheel_windage", &[("wheel_z_n_m_s2", 5e-6)])]),
        ("gyro_scale", &[("gyro_scale", &[("scale_z", 0.02)])]),
        ("gyro_axes", &[("gyro_misalignment", &[("xz_rad", 0.02)])]),
        ("gyro_g", &[("gyro_g_sensitivity", &[("xx_s_m", 1e-3)])]),
        ("lever", &[("accel_lever_arm", &[("d_x_m", 0.3)])]),
        ("accel_bias", &[("accel_bias", &[("bias_x_m_s2", 0.1)])]),
        ("latency", &[("imu_latency", &[("t_s", 0.03)])]),
        ("vector", &[("vector_sensor_misalignment", &[("m_x_rad", 0.02)])]),
        ("spring", &[("harness_spring", &[("k_n_m_rad", 0.01), ("yaw0_rad", 0.5)])]),
        ("slosh", &[("slosh", &[("mass_ratio", 0.01), ("frequency_hz", 0.8)])]),
        ("flexible", &[("flexible_mode", &[("participation_z_sqrt_kg_m", 0.5), ("frequency_hz", 2.0)])]),
    ];
    for (i, (name, effects)) in cases.iter().enumerate() {
        if only == "all" || only.split(',').any(|o| o == *name) {
            let diagnosis = diagnosis_of(effects, 1 + i as u64, 90.0);
            println!(
                "{name}: {:?} {:?} or {:?}",
                diagnosis.verdict, diagnosis.effects, diagnosis.confounded_with
            );
            for c in diagnosis.candidates.iter().take(4) {
                println!("    {:28} {:9.2} lambda {:9.2}", c.effect, c.delta_log_evidence, c.detectability);
            }
        }
    }
}
