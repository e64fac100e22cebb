//! Generates recordings with the truth plant.

use std::f64::consts::TAU;

use nalgebra::{UnitQuaternion, Vector3};
use whorl_dynamics::{InitialState, Plant, PlatformModel};
use whorl_recording::{OnInterval, Recording, Series, TrueMotion, VectorChannel};

/// Inputs of a run.
pub struct Manoeuvre {
    pub duration_s: f64,
    pub seed: u64,
    /// Amplitude of the wheels' multisine [N m].
    pub wheel_torque_n_m: f64,
    /// Amplitude of a slow torque of wheel z that swings the platform in yaw [N m].
    pub yaw_swing_n_m: f64,
    /// A jet of each pair pulses every so often [s]; 0: never.
    pub jet_period_s: f64,
    pub rate_rad_s: Vector3<f64>,
}

impl Default for Manoeuvre {
    fn default() -> Self {
        Self {
            duration_s: 60.0,
            seed: 1,
            wheel_torque_n_m: 0.05,
            yaw_swing_n_m: 0.0,
            jet_period_s: 2.0,
            rate_rad_s: Vector3::new(0.01, -0.01, 0.05),
        }
    }
}

/// Balanced near level, wide tilt limits, no random biases that are unknown to the model.
pub fn platform() -> PlatformModel {
    let mut model = PlatformModel::whorl_1_reference();
    model.tilt_limit = whorl_dynamics::platform::TiltLimit::Cone { max_rad: 0.6 };
    for wheel in model.wheels_mut() {
        wheel.coulomb_friction_n_m = 0.0;
    }
    model
}

/// Runs the manoeuvre on a plant and records it at 100 Hz, vector at 10 Hz.
pub fn record(truth: &PlatformModel, manoeuvre: &Manoeuvre) -> Recording {
    let start = InitialState {
        q_world_body: UnitQuaternion::from_euler_angles(0.05, -0.02, 0.4),
        omega_wb_b_rad_s: manoeuvre.rate_rad_s,
        wheel_speed_rad_s: vec![20.0, -30.0, 40.0],
        ..InitialState::default()
    };
    let mut plant = Plant::new(truth, &start, manoeuvre.seed).unwrap();
    let mut r = Recording {
        name: format!("run_{}", manoeuvre.seed),
        platform: "whorl_1".to_owned(),
        vectors: vec![VectorChannel {
            reference_world: truth.sensors.vector.unwrap().reference_direction_world,
            direction_b: Series::default(),
        }],
        jet_pulses: vec![Vec::new(); truth.jets().len()],
        ..Recording::default()
    };
    let mut true_motion = TrueMotion::default();
    let (mut gyro, mut force, mut speed, mut torque) = (vec![], vec![], vec![], vec![]);
    let mut directions = vec![];
    for k in 0..(manoeuvre.duration_s * 100.0) as i64 {
        let (t, now) = (k as f64 * 0.01, k * 10_000_000);
        plant.advance_to(now).unwrap();
        let imu = plant.sample_imu();
        gyro.push((t, imu.angular_velocity_rad_s));
        force.push((t, imu.specific_force_m_s2));
        speed.push((t, plant.sample_wheels().iter().map(|w| w.speed_rad_s).collect::<Vec<f64>>()));
        if k % 10 == 0 {
            directions.push((t, plant.sample_vector().unwrap().direction.into_inner()));
        }
        let truth = plant.truth();
        true_motion.q_world_body.time_s.push(t);
        true_motion.q_world_body.value.push(truth.q_world_body);
        true_motion.omega_wb_b_rad_s.time_s.push(t);
        true_motion.omega_wb_b_rad_s.value.push(truth.omega_wb_b_rad_s);
        if k % 2 == 0 {
            let u: Vec<f64> = (0..3)
                .map(|j| {
                    let phase = TAU * (0.11 + 0.07 * j as f64) * t + j as f64;
                    let swing = if j == 2 { manoeuvre.yaw_swing_n_m * (TAU * t / 40.0).cos() } else { 0.0 };
                    manoeuvre.wheel_torque_n_m * (phase.sin() + 0.5 * (2.7 * phase).sin()) + swing
                })
                .collect();
            plant.command_wheels(&u).unwrap();
            torque.push((t, u));
        }
        let period = (manoeuvre.jet_period_s * 100.0) as i64;
        if period > 0 && k % period == 0 && k > 0 {
            let jet = ((k / period) as usize * 5) % 12;
            let on_s = 0.06;
            plant.command_jet_pulse(jet, now, on_s).unwrap();
            r.jet_pulses[jet].push(OnInterval { on_s: t, off_s: t + on_s });
        }
    }
    r.gyro_b_rad_s = gyro.into_iter().collect();
    r.specific_force_b_m_s2 = force.into_iter().collect();
    r.wheel_speed_rad_s = speed.into_iter().collect();
    r.wheel_torque_command_n_m = torque.into_iter().collect();
    r.vectors[0].direction_b = directions.into_iter().collect();
    r.truth = Some(true_motion);
    r
}

/// Both directions of yaw, several times.
pub fn turning() -> Manoeuvre {
    Manoeuvre {
        duration_s: 90.0,
        yaw_swing_n_m: 0.25,
        jet_period_s: 0.0,
        rate_rad_s: Vector3::new(0.01, -0.01, 0.0),
        ..Manoeuvre::default()
    }
}
