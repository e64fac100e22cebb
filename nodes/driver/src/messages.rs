//! Messages of what was measured, the same for every backend.

use nalgebra::Vector3;
use whorl_dynamics::TrueMotion;
use whorl_dynamics::actuators::{Actuators, Kind};
use whorl_dynamics::platform::SensorSuite;
use whorl_msgs::sensor_msgs::{BatteryState, Imu};
use whorl_msgs::std_msgs::Header;
use whorl_msgs::topics::Topic;
use whorl_msgs::whorl::AttitudeEstimate;
use whorl_node::Timestamp;

/// Of each kind of actuator that has motors: the topic of its joint states, and the joints' names. Wheels have their topic
/// even on a platform without any; the other kinds only on platforms that have them.
pub(crate) fn joint_names(actuators: &Actuators) -> Vec<(Kind, Topic, Vec<String>)> {
    let kinds = Kind::ALL.into_iter().zip(actuators.kinds());
    let measured = kinds.filter_map(|(kind, row)| {
        let topic = Topic::find(row.channel()?.state_topic, true)?;
        if kind != Kind::Wheels && row.names().is_empty() {
            return None;
        }
        Some((kind, topic, row.names().into_iter().map(str::to_owned).collect()))
    });
    measured.collect()
}

/// What the platform's inertial sensors send: NaN on axes that they do not have, and an accelerometer that it does
/// not have marked as such (`sensor_msgs/Imu`). Body axes [rad/s], [m/s^2].
pub(crate) fn imu_message(
    header: &Header,
    sensors: &SensorSuite,
    mut rate_b_rad_s: Vector3<f64>,
    mut specific_force_b_m_s2: Vector3<f64>,
) -> Imu {
    let rates = rate_b_rad_s.iter_mut().zip(sensors.gyro.axes);
    for (x, fitted) in rates.chain(specific_force_b_m_s2.iter_mut().zip(sensors.accelerometer.axes)) {
        if !fitted {
            *x = f64::NAN;
        }
    }
    let mut force_covariance = [0.0; 9];
    force_covariance[0] = -1.0;
    let diagonal =
        |sigma: &Vector3<f64>| [sigma.x.powi(2), 0., 0., 0., sigma.y.powi(2), 0., 0., 0., sigma.z.powi(2)];
    let mut orientation_covariance = [0.0; 9];
    orientation_covariance[0] = -1.0;
    if sensors.accelerometer.fitted {
        force_covariance = diagonal(&sensors.accelerometer.errors.noise_stddev);
    } else {
        specific_force_b_m_s2.fill(f64::NAN);
    }
    let mut rate_covariance = diagonal(&sensors.gyro.errors.noise_stddev);
    if sensors.gyro.axes == [false; 3] {
        rate_covariance[0] = -1.0;
    }
    Imu {
        header: header.clone(),
        orientation_covariance,
        angular_velocity: rate_b_rad_s.into(),
        angular_velocity_covariance: rate_covariance,
        linear_acceleration: specific_force_b_m_s2.into(),
        linear_acceleration_covariance: force_covariance,
        ..Imu::default()
    }
}

/// The power bus at this voltage \[V\], full at `initial_v`. Unmeasured fields are NaN, as the message's definition requires.
pub(crate) fn battery(header: &Header, voltage: f64, initial_v: f64) -> BatteryState {
    BatteryState {
        header: header.clone(),
        voltage: voltage as f32,
        temperature: f32::NAN,
        current: f32::NAN,
        charge: f32::NAN,
        capacity: f32::NAN,
        design_capacity: f32::NAN,
        percentage: (voltage / initial_v).clamp(0.0, 1.0) as f32,
        power_supply_status: BatteryState::POWER_SUPPLY_STATUS_DISCHARGING,
        present: true,
        ..BatteryState::default()
    }
}

/// The true state of a simulated platform.
#[must_use]
pub fn truth_message(truth: &TrueMotion, now: Timestamp, sequence: u64) -> AttitudeEstimate {
    AttitudeEstimate {
        header: Header { stamp: now.into(), frame_id: "world".to_owned() },
        sequence,
        q_world_body: truth.q_world_body.into(),
        omega_wb_b_rad_s: truth.omega_wb_b_rad_s.into(),
        gyro_bias_b_rad_s: truth.gyro_bias_rad_s.into(),
        nis: f64::NAN,
        health: AttitudeEstimate::HEALTH_OK,
        ..AttitudeEstimate::default()
    }
}
