//! What is uncertain of readings and motion: the numbers that a filter is run with.

use serde::Serialize;
use whorl_recording::{Channel, Component};

use crate::error::PredictionError;
use crate::prepared::Prepared;

/// Standard deviations of one reading, and of what pushes the platform that its model does not have.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Noise {
    /// Gyro, by axis [rad/s].
    pub gyro_rad_s: [f64; 3],
    /// Accelerometer, by axis [m/s^2].
    pub force_m_s2: [f64; 3],
    /// Each vector sensor, about each of two axes across the direction \[rad\].
    pub vector_rad: Vec<f64>,
    /// Tachometers [rad/s].
    pub wheel_speed_rad_s: f64,
    /// Torque on the body that the model does not have, body axes [N m].
    pub disturbance: Disturbance,
}

/// A torque that nobody predicts: first-order Markov, dT/dt = -T/tau + white noise.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Disturbance {
    /// Standard deviation about each body axis [N m]; zero: none.
    pub stddev_b_n_m: [f64; 3],
    /// Correlation time tau \[s\], > 0.
    pub correlation_s: f64,
}

impl Disturbance {
    /// None.
    pub const NONE: Self = Self { stddev_b_n_m: [0.0; 3], correlation_s: 1.0 };

    /// Whether there is one.
    #[must_use]
    pub fn is_some(&self) -> bool {
        self.stddev_b_n_m.iter().any(|x| *x > 0.0)
    }
}

impl Noise {
    /// As the model's sensor parameters state it; steps of the digits included, without any torque besides what the model has.
    ///
    /// # Errors
    /// A sensor that was recorded has no noise: nothing could be weighed against anything.
    pub fn stated(case: &Prepared<'_>) -> Result<Self, PredictionError> {
        let (sensors, recording) = (&case.model().sensors, case.recording());
        let noise = Self {
            gyro_rad_s: sensors.gyro.errors.one_sample_stddev().into(),
            force_m_s2: sensors.accelerometer.errors.one_sample_stddev().into(),
            vector_rad: vec![sensors.vector.map_or(0.0, |v| v.noise_stddev_rad); recording.vectors.len()],
            wheel_speed_rad_s: sensors.wheel_speed.one_sample_stddev_rad_s(),
            disturbance: Disturbance::NONE,
        };
        let wheels: Vec<&str> = case.model().wheels().iter().map(|wheel| wheel.name.as_str()).collect();
        let mut components = case.tracks().iter().flat_map(|track| &track.components);
        match components.find(|component| !noise.of(**component).is_normal()) {
            None => Ok(noise),
            Some(component) => Err(PredictionError::NoNoise {
                run: recording.name.clone(),
                channel: component.name(&wheels),
            }),
        }
    }

    /// Standard deviation of one component, in its channel's unit; NaN where nothing of it is known.
    #[must_use]
    pub fn of(&self, component: Component) -> f64 {
        let index = component.index();
        let found = match component.channel {
            Channel::Gyro => self.gyro_rad_s.get(index),
            Channel::Accelerometer => self.force_m_s2.get(index),
            Channel::Vector => self.vector_rad.get(component.sensor()),
            Channel::WheelSpeed => Some(&self.wheel_speed_rad_s),
            _ => None,
        };
        found.copied().unwrap_or(f64::NAN)
    }
}
