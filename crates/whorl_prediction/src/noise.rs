//! What is uncertain of readings and motion: the numbers that a filter is run with.

use std::ops::Range;

use serde::Serialize;
use whorl_dynamics::plant::Tangent;
use whorl_dynamics::platform::SensorSuite;
use whorl_recording::{Channel, Component};

use crate::prepared::Prepared;
use crate::refusal::{PredictionError, Why};

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

/// Torques that nobody predicts: each a sum of first-order Markov processes, dT/dt = -T/tau + white noise.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Disturbance {
    /// On the body.
    pub body: Vec<RandomTorque>,
    /// Of the torque of each wheel's motor beyond the model's, about its axis [N m]; empty: none.
    pub motors_n_m: Vec<f64>,
    /// Correlation time tau of these \[s\], > 0.
    pub motors_correlation_s: f64,
}

/// A random torque on the body.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct RandomTorque {
    /// Standard deviation about each body axis [N m]; zero: none.
    pub stddev_b_n_m: [f64; 3],
    /// Correlation time tau \[s\], > 0.
    pub correlation_s: f64,
}

impl Disturbance {
    /// None.
    pub const NONE: Self = Self { body: Vec::new(), motors_n_m: Vec::new(), motors_correlation_s: 1.0 };

    /// Whether there is one.
    #[must_use]
    pub fn is_some(&self) -> bool {
        self.processes().next().is_some() || self.motors() > 0
    }

    /// The same with all standard deviations larger by a factor.
    #[must_use]
    pub fn scaled(&self, factor: f64) -> Self {
        let body = self
            .body
            .iter()
            .map(|of| RandomTorque { stddev_b_n_m: of.stddev_b_n_m.map(|x| x * factor), ..*of });
        let motors = self.motors_n_m.iter().map(|x| x * factor);
        Self { body: body.collect(), motors_n_m: motors.collect(), ..*self }
    }

    /// With processes of all these correlation times \[s\], each about each axis this share of the largest about it at least.
    pub(crate) fn spread(&self, times_s: &[f64], share: f64) -> Self {
        let most = [0, 1, 2].map(|axis| self.body.iter().map(|of| of.stddev_b_n_m[axis]).fold(0.0, f64::max));
        let of_time = |correlation_s: &f64| {
            let now = self.body.iter().find(|of| of.correlation_s == *correlation_s);
            let stddev = |axis: usize| now.map_or(0.0, |of| of.stddev_b_n_m[axis]).max(share * most[axis]);
            RandomTorque { stddev_b_n_m: [0, 1, 2].map(stddev), correlation_s: *correlation_s }
        };
        let mut spread = Self { body: times_s.iter().map(of_time).collect(), ..self.clone() };
        spread.forget_silent();
        spread
    }

    /// Without processes that push nothing.
    pub(crate) fn forget_silent(&mut self) {
        self.body.retain(|of| of.stddev_b_n_m.iter().any(|x| *x > 0.0));
        if self.motors() == 0 {
            self.motors_n_m.clear();
        }
    }

    /// Those that push the body at all.
    pub(crate) fn processes(&self) -> impl Iterator<Item = &RandomTorque> + Clone {
        self.body.iter().filter(|process| process.stddev_b_n_m.iter().any(|x| *x > 0.0))
    }

    /// Standard deviation of the whole torque on the body, about each of its axes [N m].
    #[must_use]
    pub fn body_stddev_b_n_m(&self) -> [f64; 3] {
        [0, 1, 2].map(|axis| self.body.iter().map(|of| of.stddev_b_n_m[axis].powi(2)).sum::<f64>().sqrt())
    }

    /// How many motors have one.
    pub(crate) fn motors(&self) -> usize {
        if self.motors_n_m.iter().any(|x| *x > 0.0) { self.motors_n_m.len() } else { 0 }
    }

    /// How many standard deviations there are that are not zero.
    pub(crate) fn count(&self) -> usize {
        let all = self.body.iter().flat_map(|of| &of.stddev_b_n_m).chain(&self.motors_n_m);
        all.filter(|stddev| **stddev > 0.0).count()
    }

    /// Coordinates of a layout that are torques of it, each with its standard deviation [N m] and correlation time \[s\].
    pub(crate) fn coordinates(&self, layout: Layout) -> impl Iterator<Item = (usize, f64, f64)> + Clone + '_ {
        let body = self.processes().flat_map(|of| of.stddev_b_n_m.map(|stddev| (stddev, of.correlation_s)));
        let motors = self.motors_n_m.iter().map(|stddev| (*stddev, self.motors_correlation_s));
        let all = layout.disturbance().zip(body).chain(layout.motors().zip(motors));
        all.map(|(i, (stddev, correlation_s))| (i, stddev, correlation_s))
    }
}

impl Noise {
    /// As the model's sensor parameters state it; steps of the digits included, without any torque besides what the model has.
    ///
    /// # Errors
    /// A sensor that was recorded has no noise: nothing could be weighted against anything.
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
        let mut components = case.tracks.iter().flat_map(|track| &track.components);
        match components.find(|component| !noise.of(**component).is_normal()) {
            None => Ok(noise),
            Some(component) => Err(Why::NoNoise(component.name(&wheels)).of(recording).into()),
        }
    }

    /// Sets the level of one component, in its channel's unit.
    pub(crate) fn set(&mut self, component: Component, stddev: f64) {
        let index = component.index();
        let to = match component.channel {
            Channel::Gyro => self.gyro_rad_s.get_mut(index),
            Channel::Accelerometer => self.force_m_s2.get_mut(index),
            Channel::Vector => self.vector_rad.get_mut(component.sensor()),
            Channel::WheelSpeed => Some(&mut self.wheel_speed_rad_s),
            _ => None,
        };
        if let Some(to) = to {
            *to = stddev;
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

/// Coordinates of an estimate's error: those of the plant ([`Tangent`]), then the disturbance torque on the body
/// and that of each motor [N m], the biases of gyro [rad/s] and accelerometer [m/s^2], as far as there are any.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Layout {
    /// Of the plant.
    pub plant: Tangent,
    disturbance: usize,
    motors: usize,
    gyro_bias: usize,
    force_bias: usize,
}

impl Layout {
    /// With so many random torques on the body, of so many motors, and the biases of the two sensors.
    pub(crate) fn new(
        plant: Tangent,
        disturbances: usize,
        motors: usize,
        gyro_bias: bool,
        force_bias: bool,
    ) -> Self {
        let three = |there| if there { 3 } else { 0 };
        Self {
            plant,
            disturbance: 3 * disturbances,
            motors,
            gyro_bias: three(gyro_bias),
            force_bias: three(force_bias),
        }
    }

    /// The disturbance torques on the body, about three axes each.
    #[must_use]
    pub fn disturbance(&self) -> Range<usize> {
        after(self.plant.size(), self.disturbance)
    }

    /// The disturbance torque of each motor.
    #[must_use]
    pub fn motors(&self) -> Range<usize> {
        after(self.disturbance().end, self.motors)
    }

    /// Bias of the gyro.
    #[must_use]
    pub fn gyro_bias(&self) -> Range<usize> {
        after(self.motors().end, self.gyro_bias)
    }

    /// Bias of the accelerometer.
    #[must_use]
    pub fn force_bias(&self) -> Range<usize> {
        after(self.gyro_bias().end, self.force_bias)
    }

    /// What moves: the plant and its disturbances. The rest stays as it is, or walks.
    #[must_use]
    pub fn moving(&self) -> usize {
        self.motors().end
    }

    /// Variance that each coordinate gains in a second by its own random walk.
    pub(crate) fn walks(&self, sensors: &SensorSuite, hidden_noise: &[f64]) -> Vec<f64> {
        let mut walks = vec![0.0; self.size()];
        let gyro = self.gyro_bias().zip(&sensors.gyro.errors.bias_walk);
        let force = self.force_bias().zip(&sensors.accelerometer.errors.bias_walk);
        let all = self.plant.hidden().zip(hidden_noise).chain(gyro).chain(force);
        all.for_each(|(i, walk)| walks[i] = walk * walk);
        walks
    }

    /// What is not of disturbances: plant and biases.
    pub(crate) fn own(&self) -> impl Iterator<Item = usize> + Clone {
        (0..self.plant.size()).chain(self.moving()..self.size())
    }

    /// How many coordinates there are.
    #[must_use]
    pub fn size(&self) -> usize {
        self.force_bias().end
    }
}

fn after(start: usize, count: usize) -> Range<usize> {
    start..start + count
}
