//! Recordings from the truth plant.

use nalgebra::{Matrix3, Unit, UnitQuaternion, Vector3};
use whorl_dynamics::{InitialState, MassProperties, ModelPrior, Plant, PlatformModel};
use whorl_math::attitude_from_vertical;
use whorl_recording::{Recording, Series, VectorChannel};

/// Sines on the x and y wheels beside the pendulum's resonance at 0.57 rad/s, steps on the z wheel that
/// yaw the platform by +-15 deg/s. Tilt stays below 5 deg, momentum below 4 of the wheels' 16 N m s.
pub fn swinging(t: f64) -> Vec<f64> {
    vec![
        0.03 * (1.0 * t).sin(),
        0.04 * (1.3 * t).sin(),
        0.4 * if (0.2 * t).cos() >= 0.0 { 1.0 } else { -1.0 },
    ]
}

/// The attitude in which the platform hangs still.
pub fn at_balance(model: &PlatformModel) -> UnitQuaternion<f64> {
    let up = Unit::new_normalize(-model.mass_properties.gravity_offset_b_n_m());
    attitude_from_vertical(up, 0.0)
}

/// A model a tenth off in everything.
pub fn wrong_model(truth: &PlatformModel) -> PlatformModel {
    let mass = &truth.mass_properties;
    let signs = Matrix3::new(1.0, -1.0, 1.0, -1.0, -1.0, 1.0, 1.0, 1.0, 1.0);
    let inertia = mass.inertia_b_kg_m2().component_mul(&signs.map(|sign| 1.0 + 0.1 * sign));
    let offset = mass.gravity_offset_b_n_m().component_mul(&Vector3::new(1.1, 0.9, 1.1));
    let mut model = truth.clone();
    model.mass_properties = MassProperties::new(inertia, offset, mass.mass_kg()).unwrap();
    model
}

/// Wheels known exactly, mass properties to 15 %.
pub fn prior(model: &PlatformModel) -> ModelPrior {
    let mut prior = ModelPrior::typical(model);
    prior.inertia_b_kg_m2 *= 3.0;
    let offset = model.mass_properties.gravity_offset_b_n_m();
    prior.gravity_offset_b_n_m = offset.map(|x| (0.2 * x.abs()).max(0.02));
    prior.actuators.wheels.spin_inertia.fill(0.0);
    prior.actuators.wheels.axis_rad.fill(0.0);
    prior
}

/// Whorl-I with an accelerometer that was calibrated on a level table.
pub fn truth() -> PlatformModel {
    let mut truth = PlatformModel::whorl_1_reference();
    truth.sensors.accelerometer.errors.bias_turn_on_stddev.fill(1.5e-3);
    truth
}

fn push<T>(series: &mut Series<T>, time_s: f64, value: T) {
    series.time_s.push(time_s);
    series.value.push(value);
}

/// Runs the plant under open-loop wheel torques from rest at `start`.
pub fn record(
    truth: &PlatformModel,
    start: UnitQuaternion<f64>,
    duration_s: f64,
    seed: u64,
    wheels: &dyn Fn(f64) -> Vec<f64>,
) -> Recording {
    let initial = InitialState { q_world_body: start, ..InitialState::default() };
    let mut plant = Plant::new(truth, &initial, seed).unwrap();
    let mut run =
        Recording { name: format!("run {seed}"), platform: "whorl_1".into(), ..Recording::default() };
    let vector = truth.sensors.vector;
    let mut directions = Series::default();
    let rate_hz = truth.sensors.rate_hz;
    let samples = (duration_s * rate_hz) as i64;
    for k in 0..samples {
        let now_ns = (k as f64 / rate_hz * 1e9).round() as i64;
        let time_s = now_ns as f64 * 1e-9;
        plant.advance_to(now_ns).unwrap();
        let torque = wheels(time_s);
        plant.command_wheels(&torque).unwrap();
        let imu = plant.sample_imu();
        push(&mut run.gyro_b_rad_s, time_s, imu.angular_velocity_rad_s);
        push(&mut run.specific_force_b_m_s2, time_s, imu.specific_force_m_s2);
        let speeds = plant.sample_wheels().iter().map(|w| w.speed_rad_s).collect();
        push(&mut run.wheel_speed_rad_s, time_s, speeds);
        push(&mut run.wheel_torque_command_n_m, time_s, torque);
        if k % 10 == 0
            && let Some(sample) = plant.sample_vector()
        {
            push(&mut directions, time_s, sample.direction.into_inner());
        }
    }
    if let Some(sensor) = vector {
        run.vectors = vec![VectorChannel {
            reference_world: sensor.reference_direction_world,
            direction_b: directions,
        }];
    }
    run
}
