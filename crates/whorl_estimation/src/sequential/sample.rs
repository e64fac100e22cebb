//! What the joint filters are given: means of samples around one time, and the torques until the next.

use nalgebra::{Unit, Vector3};
use whorl_dynamics::PlatformModel;
use whorl_dynamics::platform::TiltLimit;

/// Within this of the bearing's stop counts as touching it \[rad\], and for this long before and after \[s\].
const CONTACT_MARGIN_RAD: f64 = 0.002;
/// See there.
pub const CONTACT_LASTS_S: f64 = 0.3;

/// A direction seen by a vector sensor, moved to the time of its point.
#[derive(Debug, Clone, PartialEq)]
pub struct Direction {
    /// Seen in body axes, length one.
    pub direction_b: Vector3<f64>,
    /// The same in the world.
    pub reference_world: Unit<Vector3<f64>>,
}

/// Means of the samples around one time, and the torques that act until the next point.
#[derive(Debug, Clone, PartialEq)]
pub struct AveragedSample {
    /// Time since the start of the run \[s\].
    pub time_s: f64,
    /// Mean of the gyro samples, body axes [rad/s].
    pub gyro_b_rad_s: Vector3<f64>,
    /// How many.
    pub gyro_samples: f64,
    /// Mean of the accelerometer samples, body axes [m/s^2], and how many.
    pub specific_force_b_m_s2: Option<(Vector3<f64>, f64)>,
    /// Vector sensors' samples.
    pub directions: Vec<Direction>,
    /// Wheel speeds relative to the body [rad/s].
    pub wheel_speed_rad_s: Vec<f64>,
    /// Their rate of change [rad/s^2].
    pub wheel_acceleration_rad_s2: Vec<f64>,
    /// Mean thrust of each jet until the next point, as a share of its nominal thrust.
    pub jet_share: Vec<f64>,
    /// Mean of other known torques until the next point, body axes [N m].
    pub body_torque_b_n_m: Vector3<f64>,
    /// Known moment of the linear mass actuators, added to the gravity offset [N m].
    pub ballast_moment_b_n_m: Vector3<f64>,
    /// Gas, voltage, temperature, moving masses.
    pub surroundings: Surroundings,
}

/// Surroundings of the platform at one time of a run.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Surroundings {
    /// Tank pressure \[Pa\].
    pub tank_pressure_pa: f64,
    /// Gas gone from the full tank \[kg\].
    pub gas_used_kg: f64,
    /// Bus voltage \[V\].
    pub bus_voltage_v: f64,
    /// Temperature of the platform \[K\].
    pub temperature_k: f64,
    /// Sense of the last travel of the linear mass actuators along body x, y, z: -1, 0 (never moved), 1.
    pub ballast_direction: Vector3<f64>,
}

impl Surroundings {
    /// A full tank, a full battery and a platform as warm as the room.
    #[must_use]
    pub fn at_start(model: &PlatformModel) -> Self {
        Self {
            tank_pressure_pa: model.tank().initial_pressure_pa,
            gas_used_kg: 0.0,
            bus_voltage_v: model.bus.initial_v,
            temperature_k: model.sensors.ambient_temperature_k,
            ballast_direction: Vector3::zeros(),
        }
    }
}

/// Whether the specific force says that the platform is at its stop, or nearly.
#[must_use]
pub fn touches(force_b_m_s2: &Vector3<f64>, limit: TiltLimit) -> bool {
    let force = force_b_m_s2;
    match limit {
        TiltLimit::Cone { max_rad } => force.x.hypot(force.y).atan2(force.z) > max_rad - CONTACT_MARGIN_RAD,
        TiltLimit::Pitch { max_rad } => {
            force.x.atan2(force.y.hypot(force.z)).abs() > max_rad - CONTACT_MARGIN_RAD
        }
    }
}
