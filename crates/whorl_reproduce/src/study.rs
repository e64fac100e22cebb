//! The study of section 4.6.4: how the body is driven, with which sensors, and how its tables are printed.

use nalgebra::Vector3;
use whorl_dynamics::PlatformModel;
use whorl_dynamics::mass_parameters::MASS_PARAMETERS;

use crate::data::level;
use crate::regression::StateSeries;
use crate::rigid_body::simulate_rigid_body;

/// Printed: estimate and percent error, torque method then momentum integral.
pub type Printed = [[&'static str; 4]; MASS_PARAMETERS];

/// Bang-bang of +-0.01 N m about x with a period of 10 s (section 4.6.4).
pub fn bang_bang(t: f64) -> Vector3<f64> {
    Vector3::new(if t.rem_euclid(10.0) < 5.0 { 0.01 } else { -0.01 }, 0.0, 0.0)
}

/// Sensors of the study: read at 10 Hz, with this share of the MotionPak's noise, offsets calibrated out.
pub fn quieten(model: &mut PlatformModel, share: f64) {
    let sensors = &mut model.sensors;
    sensors.rate_hz = 10.0;
    for errors in [&mut sensors.gyro.errors, &mut sensors.accelerometer.errors] {
        errors.noise_stddev *= share;
        errors.bias_turn_on_stddev.fill(0.0);
        errors.bias_walk.fill(0.0);
    }
    if let Some(vector) = &mut sensors.vector {
        vector.noise_stddev_rad *= share;
        vector.rate_hz = 10.0;
    }
}

/// The run of Tables 4.2 to 4.4: the printed torques on a rigid platform.
pub fn printed_run(model: &PlatformModel) -> StateSeries {
    simulate_rigid_body(&model.mass_properties, (level(), Vector3::zeros()), &bang_bang, 0.1, 1001, 20)
}

/// Seeds of the sensors' noise and biases.
pub const SEEDS: [u128; 5] = [11, 12, 13, 14, 15];
