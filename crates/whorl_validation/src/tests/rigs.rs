//! Rigs that are not on a spherical bearing, of any size and at any rate.

use std::f64::consts::TAU;

use nalgebra::{Matrix3, Unit, UnitQuaternion, Vector3};
use whorl_dynamics::platform::{TiltLimit, Wheel};
use whorl_dynamics::{Freedom, InitialState, MassProperties, Plant, PlatformModel};
use whorl_recording::{Mounting, Recording, VectorChannel};

use super::compare;
use crate::Comparison;

/// How large and how fast a rig is.
struct Size {
    inertia_kg_m2: f64,
    samples: i64,
    rate_hz: f64,
    /// Of the body under the wheel's torque [rad/s^2].
    acceleration_rad_s2: f64,
}

const GIMBAL: Size = Size { inertia_kg_m2: 2e-6, samples: 2000, rate_hz: 2000.0, acceleration_rad_s2: 5.0 };
const CRAFT: Size = Size { inertia_kg_m2: 1e4, samples: 200, rate_hz: 0.5, acceleration_rad_s2: 2e-4 };

/// One wheel along body z, no jets, a gyro, and nothing else.
fn rig(freedom: Freedom, size: &Size) -> PlatformModel {
    let mut model = PlatformModel::whorl_1_reference();
    let inertia = Matrix3::from_diagonal(&Vector3::new(1.0, 1.1, 0.9)) * size.inertia_kg_m2;
    model.mass_properties = MassProperties::new(inertia, Vector3::zeros(), 1.0).unwrap();
    (model.freedom, model.tilt_limit) = (freedom, TiltLimit::NONE);
    model.jets_mut().clear();
    *model.wheels_mut() = vec![Wheel {
        name: "wheel".to_owned(),
        spin_axis_b: Vector3::z_axis(),
        spin_inertia_kg_m2: 0.01 * size.inertia_kg_m2,
        max_torque_n_m: 10.0 * size.inertia_kg_m2 * size.acceleration_rad_s2,
        max_speed_rad_s: 1e5,
        viscous_friction_n_m_s: 0.0,
        coulomb_friction_n_m: 0.0,
    }];
    model.sensors.rate_hz = size.rate_hz;
    model.sensors.gyro.errors.range = 1e3;
    model.sensors.accelerometer.fitted = false;
    model.sensors.gyro.errors.bias_turn_on_stddev = Vector3::zeros();
    model.sensors.gyro.errors.bias_walk = Vector3::zeros();
    model.sensors.gyro.errors.noise_stddev = Vector3::repeat(1e-2 * size.acceleration_rad_s2);
    model
}

/// The wheel is driven by two sines, slow against the sample rate; without a shaft a direction is seen as well.
fn record(truth: &PlatformModel, size: &Size) -> Recording {
    let start = InitialState {
        q_world_body: UnitQuaternion::from_euler_angles(0.3, -0.2, 0.4),
        omega_wb_b_rad_s: Vector3::new(0.1, -0.1, 0.2) * size.acceleration_rad_s2,
        wheel_speed_rad_s: vec![20.0],
        ..InitialState::default()
    };
    let mut plant = Plant::new(truth, &start, 3).unwrap();
    let mut r = Recording { name: "rig".to_owned(), ..Recording::default() };
    let one_axis = truth.freedom.hinge_axis_b().is_some();
    if one_axis {
        r.no_gyro_axis = [true, true, false];
    }
    let step_ns = (1e9 / size.rate_hz) as i64;
    let mut directions = Vec::new();
    for k in 0..size.samples {
        let t = k as f64 / size.rate_hz;
        plant.advance_to(k * step_ns).unwrap();
        let mut rate = plant.sample_imu().angular_velocity_rad_s;
        if one_axis {
            (rate.x, rate.y) = (0.0, 0.0);
        }
        if truth.freedom.turns() {
            r.gyro_b_rad_s.time_s.push(t);
            r.gyro_b_rad_s.value.push(rate);
        } else {
            r.mounting = Mounting::Clamped;
        }
        r.wheel_speed_rad_s.time_s.push(t);
        r.wheel_speed_rad_s.value.push(plant.sample_wheels().iter().map(|w| w.speed_rad_s).collect());
        if truth.freedom.axes() == 3 && k % 5 == 0 {
            directions.push((t, plant.sample_vector().unwrap().direction.into_inner()));
        }
        if k % 4 == 0 {
            let phase = TAU * t * size.rate_hz;
            let share = (phase / 400.0).sin() + 0.5 * (phase / 90.0 + 1.0).sin();
            let torque = vec![size.inertia_kg_m2 * size.acceleration_rad_s2 * share];
            plant.command_wheels(&torque).unwrap();
            r.wheel_torque_command_n_m.time_s.push(t);
            r.wheel_torque_command_n_m.value.push(torque);
        }
    }
    if truth.freedom.axes() == 3 {
        let reference_world = truth.sensors.vector.unwrap().reference_direction_world;
        r.vectors.push(VectorChannel { reference_world, direction_b: directions.into_iter().collect() });
    }
    r
}

fn share(comparison: &Comparison) -> f64 {
    comparison.absolute.chi_squared_per_degree
}

/// The model that made the data leaves noise; one with a twentieth less inertia does not.
#[test]
fn the_right_model_of_a_shaft_of_any_size_leaves_noise_and_a_wrong_one_does_not() {
    let hinge = Freedom::Hinge { axis_b: Unit::new_normalize(Vector3::new(0.0, 0.6, 0.8)) };
    for (freedom, size) in [(hinge, &GIMBAL), (hinge, &CRAFT)] {
        let model = rig(freedom, size);
        let recording = record(&model, size);
        let right = compare(&recording, &model).unwrap();
        assert!(right.is_noise() && share(&right) > 0.9, "{freedom:?}: {:?}", right.absolute);
        let names: Vec<&str> = right.channels.iter().map(|channel| channel.name.as_str()).collect();
        assert_eq!(names[0], if freedom == hinge { "gyro_z" } else { "gyro_x" }, "{names:?}");
        let mut wrong = model.clone();
        wrong.wheels_mut()[0].spin_inertia_kg_m2 *= 1.05;
        let mass = &model.mass_properties;
        let lighter = mass.inertia_b_kg_m2() * 0.95;
        wrong.mass_properties = MassProperties::new(lighter, Vector3::zeros(), 1.0).unwrap();
        let wrong = compare(&recording, &wrong).unwrap();
        assert!(share(&wrong) > 2.0 * share(&right), "{freedom:?}: {:?}", wrong.absolute);
    }
}

/// A bench gives its wheels' channels alone.
#[test]
fn a_bench_is_compared_by_its_wheels() {
    let model = rig(Freedom::Clamped, &GIMBAL);
    let mut recording = record(&model, &GIMBAL);
    // The platform's file says so, whatever the run does.
    recording.mounting = Mounting::OnBearing;
    let right = compare(&recording, &model).unwrap();
    assert!(right.is_noise(), "{:?}", right.absolute);
    assert_eq!(right.channels.len(), 1);
    let mut wrong = model.clone();
    wrong.wheels_mut()[0].viscous_friction_n_m_s = 1e-7 * GIMBAL.inertia_kg_m2 / 2e-6;
    assert!(!compare(&recording, &wrong).unwrap().is_noise());
}

/// The residual torque of a rig on a shaft acts about it: of friction that the model lacks, c w.
#[test]
fn the_residual_torque_of_a_shaft_is_along_it() {
    let axis_b = Unit::new_normalize(Vector3::new(0.0, 0.6, 0.8));
    let mut model = rig(Freedom::Hinge { axis_b }, &GIMBAL);
    model.sensors.gyro.errors.noise_stddev /= 10.0;
    let mut truth = model.clone();
    let friction_n_m_s = 2e-6;
    truth.effects.insert(
        "bearing_viscous_friction".to_owned(),
        std::collections::BTreeMap::from([("c_n_m_s".to_owned(), friction_n_m_s)]),
    );
    let found = crate::unexplained_torques(&record(&truth, &GIMBAL), &model, None).unwrap();
    let (mut product, mut square) = (0.0, 0.0);
    for state in &found.states {
        let (torque, rate) = (&state.torque_b_n_m, &state.omega_wb_b_rad_s);
        assert!((torque - axis_b.into_inner() * axis_b.dot(torque)).norm() < 1e-15);
        product -= axis_b.dot(torque) * axis_b.dot(rate);
        square += axis_b.dot(rate).powi(2);
    }
    assert!((product / square / friction_n_m_s - 1.0).abs() < 0.3, "{}", product / square);
}
