//! The log likelihood of a linear rig, and its states given all readings, are those of a dense multivariate normal, built without
//! any filter by `dense/make.py`: several rates and latencies, missing readings, a torque that nobody knows and a bias that walks.

#![expect(clippy::unwrap_used, reason = "a test stops at a broken precondition")]

use nalgebra::{DMatrix, Matrix3, UnitQuaternion, Vector3};
use serde_json::Value;
use whorl_dynamics::platform::{TiltLimit, Wheel};
use whorl_dynamics::{Freedom, MassProperties, PlatformModel};
use whorl_prediction::{Disturbance, Noise, Prepared, RandomTorque, Settings, Start, predict, smoothed};
use whorl_recording::{Recording, VectorChannel};

fn disturbance() -> Disturbance {
    let body = vec![RandomTorque { stddev_b_n_m: [0.0, 0.0, 0.02], correlation_s: 0.7 }];
    Disturbance { body, ..Disturbance::NONE }
}

fn turntable() -> PlatformModel {
    let mut model = PlatformModel::whorl_1_reference();
    let inertia = Matrix3::from_diagonal(&Vector3::new(1.5, 1.6, 2.0));
    model.mass_properties = MassProperties::new(inertia, Vector3::zeros(), 10.0).unwrap();
    (model.freedom, model.tilt_limit) = (Freedom::Hinge { axis_b: Vector3::z_axis() }, TiltLimit::NONE);
    model.jets_mut().clear();
    *model.wheels_mut() = vec![Wheel {
        name: "wheel".to_owned(),
        spin_axis_b: Vector3::z_axis(),
        spin_inertia_kg_m2: 0.05,
        max_torque_n_m: 10.0,
        max_speed_rad_s: 1e6,
        viscous_friction_n_m_s: 0.004,
        coulomb_friction_n_m: 0.0,
    }];
    let sensors = &mut model.sensors;
    sensors.accelerometer.fitted = false;
    let gyro = &mut sensors.gyro.errors;
    gyro.noise_stddev = Vector3::repeat(0.003);
    gyro.bias_turn_on_stddev = Vector3::new(0.0, 0.0, 0.01);
    gyro.bias_walk = Vector3::new(0.0, 0.0, 0.002);
    gyro.latency_s = 0.013;
    let vector = sensors.vector.as_mut().unwrap();
    vector.noise_stddev_rad = 0.01;
    vector.latency_s = 0.021;
    sensors.wheel_speed.noise_stddev_rad_s = 0.2;
    model
}

fn numbers(value: &Value) -> Vec<f64> {
    value.as_array().unwrap().iter().map(|x| x.as_f64().unwrap()).collect()
}

fn recording(reference: &Value) -> Recording {
    let pairs = |key: &str| -> Vec<(f64, f64)> {
        numbers(&reference[key][0]).into_iter().zip(numbers(&reference[key][1])).collect()
    };
    // Of world x, seen from a table that has turned by an angle.
    let direction = |(t, angle): (f64, f64)| {
        (t, UnitQuaternion::from_axis_angle(&Vector3::z_axis(), -angle) * Vector3::x())
    };
    Recording {
        name: "turntable".to_owned(),
        no_gyro_axis: [true, true, false],
        gyro_b_rad_s: pairs("gyro").into_iter().map(|(t, y)| (t, Vector3::new(0.0, 0.0, y))).collect(),
        wheel_speed_rad_s: pairs("wheel").into_iter().map(|(t, y)| (t, vec![y])).collect(),
        wheel_torque_command_n_m: reference["commands"]
            .as_array()
            .unwrap()
            .iter()
            .map(|pair| (pair[0].as_f64().unwrap(), vec![pair[1].as_f64().unwrap()]))
            .collect(),
        vectors: vec![VectorChannel {
            reference_world: Vector3::x_axis(),
            direction_b: pairs("vector").into_iter().map(direction).collect(),
        }],
        ..Recording::default()
    }
}

/// What the dense normal says of the state at the first reading.
fn start(case: &Prepared<'_>, noise: &Noise) -> Start {
    let mut start = Start::wide(case, noise);
    start.q_world_body = UnitQuaternion::from_axis_angle(&Vector3::z_axis(), 0.3);
    start.omega_wb_b_rad_s = Vector3::new(0.0, 0.0, 0.1);
    start.wheel_speed_rad_s = vec![20.0];
    let layout = start.layout;
    let mut stddev = nalgebra::DVector::zeros(layout.size());
    (stddev[2], stddev[5], stddev[layout.plant.wheels().start]) = (0.05, 0.02, 2.0);
    (stddev[layout.disturbance().start + 2], stddev[layout.gyro_bias().start + 2]) = (0.02, 0.01);
    start.covariance = DMatrix::from_diagonal(&stddev.map(|s| s * s));
    start
}

#[test]
fn the_likelihood_is_that_of_a_dense_normal() {
    let reference: Value = serde_json::from_str(include_str!("dense/turntable.json")).unwrap();
    let (model, recording) = (turntable(), recording(&reference));
    let case = Prepared::new(&recording, &model, Settings::default()).unwrap();
    let noise = Noise { disturbance: disturbance(), ..Noise::stated(&case).unwrap() };
    let start = start(&case, &noise);
    let found = predict(&case, &noise, &start, &[], &mut |_| {});
    let expected = reference["log_likelihood"].as_f64().unwrap();
    assert_eq!(found.numbers as u64, reference["numbers"].as_u64().unwrap());
    let off = (found.log / expected - 1.0).abs();
    println!(
        "measured: log likelihood {} by the filter, {expected} by the dense normal: {off:.1e} apart",
        found.log
    );
    assert!(off < 1e-9, "{} for {expected}", found.log);
    // The test can fail: a hundredth of the noise is seen.
    let other = Noise { vector_rad: vec![0.0101], ..noise.clone() };
    assert!((predict(&case, &other, &start, &[], &mut |_| {}).log / expected - 1.0).abs() > 1e-6);
}

#[test]
fn smoothed_states_are_those_of_the_dense_normal_given_all_readings() {
    let reference: Value = serde_json::from_str(include_str!("dense/turntable.json")).unwrap();
    let (model, recording) = (turntable(), recording(&reference));
    let case = Prepared::new(&recording, &model, Settings::default()).unwrap();
    let noise = Noise { disturbance: disturbance(), ..Noise::stated(&case).unwrap() };
    let found = smoothed(&case, &noise, &start(&case, &noise), 0.0).unwrap();
    let expected = reference["smoothed"].as_array().unwrap();
    let mut worst = 0f64;
    for at in expected {
        let (mean, stddev) = (numbers(&at["mean"]), numbers(&at["stddev"]));
        let time_s = at["time_s"].as_f64().unwrap();
        let state = found.iter().find(|state| (state.time_s - time_s).abs() < 1e-7).unwrap();
        let z = |v: nalgebra::Vector3<f64>| v.z;
        let pairs = [
            (z(state.q_world_body.scaled_axis()), z(state.attitude_stddev_b_rad)),
            (z(state.omega_wb_b_rad_s), z(state.omega_stddev_b_rad_s)),
            (state.wheel_speed_rad_s[0], state.wheel_speed_stddev_rad_s[0]),
            (state.torque_b_n_m.z, state.torque_covariance_b[(2, 2)].sqrt()),
        ];
        for ((x, sigma), (mean, stddev)) in pairs.into_iter().zip(mean.into_iter().zip(stddev)) {
            worst = worst.max((x - mean).abs() / stddev).max((sigma / stddev - 1.0).abs());
        }
        // The table holds the body about the other axes.
        assert_eq!((state.torque_b_n_m.x, state.torque_b_n_m.y), (0.0, 0.0));
    }
    println!("measured: smoothed states and deviations {worst:.1e} of a deviation from the dense normal's");
    assert!(expected.len() > 8 && worst < 1e-6, "{worst}");
    // States further apart are the same ones.
    let few = smoothed(&case, &noise, &start(&case, &noise), 0.1).unwrap();
    assert!(few.len() < 10 && few.len() > 4, "{}", few.len());
    for state in few {
        let same = found.iter().find(|other| other.time_s == state.time_s).unwrap();
        assert!((same.torque_b_n_m - state.torque_b_n_m).norm() < 1e-9, "{state:?} {same:?}");
    }
}
