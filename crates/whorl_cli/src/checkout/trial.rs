//! What comes of working a part.

use nalgebra::Vector3;
use serde::Serialize;
use whorl_devices::checkout::Trial;
use whorl_dynamics::PlatformModel;
use whorl_node::Timestamp;

/// In which the wheels bring the platform to rest \[s\].
const DAMPING_S: f64 = 0.5;

/// Mean of a window's rates.
pub(super) struct Mean {
    /// Body axes [rad/s].
    pub(super) rate: Vector3<f64>,
    /// Standard deviation of each axis of that [rad/s].
    pub(super) noise: f64,
    /// The window's end, and the mean time of its samples from there \[s\].
    pub(super) end: Timestamp,
    pub(super) age_s: f64,
}

impl Mean {
    /// Time from an earlier one \[s\].
    pub(super) fn since(&self, earlier: &Self) -> f64 {
        self.end.seconds_since(earlier.end) + self.age_s - earlier.age_s
    }
}

/// What came of one attempt.
pub(super) struct Tried {
    pub(super) trial: Trial,
    /// The part worked, and samples came steadily. A busy computer may lose a command or a device's answer, and then nothing was
    /// tried; and where it read samples late their times are wrong.
    pub(super) is_good: bool,
}

/// How it was before a part worked.
pub(super) struct Since {
    pub(super) at: Timestamp,
    pub(super) on_time_s: Vec<f64>,
    pub(super) gimbal_angle_rad: Vec<f64>,
}

/// What was found of one part.
#[derive(Debug, Serialize)]
pub(super) struct Checked {
    pub(super) part: String,
    pub(super) is_right: bool,
    pub(super) said: String,
    /// Size over the model's, its standard deviation, and what the priors allow it to be off by; `None` where it did nothing or moved
    /// elsewhere.
    pub(super) size: Option<f64>,
    pub(super) stddev: Option<f64>,
    pub(super) tolerance: Option<f64>,
}

/// Torques of the wheels that bring the platform to rest, as they were found to answer.
pub(super) fn damping(model: &PlatformModel, answers: &[f64], rate_b_rad_s: &Vector3<f64>) -> Vec<f64> {
    let momentum = model.mass_properties.inertia_b_kg_m2() * rate_b_rad_s;
    let torque = |axis: &Vector3<f64>| axis.dot(&momentum) / DAMPING_S;
    let wheels = model.wheels().iter().zip(answers);
    let limited = wheels.map(|(wheel, answer)| {
        (answer * torque(&wheel.spin_axis_b)).clamp(-wheel.max_torque_n_m, wheel.max_torque_n_m)
    });
    limited.collect()
}
