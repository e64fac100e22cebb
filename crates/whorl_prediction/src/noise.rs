//! What is uncertain of readings and motion: the numbers that a filter is run with.

use std::ops::Range;

use serde::Serialize;
use whorl_dynamics::EffectSet;
use whorl_dynamics::plant::Tangent;
use whorl_dynamics::platform::SensorSuite;
use whorl_recording::{Channel, Component, Why};

use crate::{PredictionError, Prepared};

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
    pub fn is_some(&self) -> bool {
        self.count() > 0
    }

    /// All standard deviations: of the body's torques by process and axis, then of the motors' [N m].
    pub(crate) fn stddevs_n_m(&self) -> impl Iterator<Item = f64> + '_ {
        self.body.iter().flat_map(|of| of.stddev_b_n_m).chain(self.motors_n_m.iter().copied())
    }

    pub(crate) fn stddevs_n_m_mut(&mut self) -> impl Iterator<Item = &mut f64> {
        self.body.iter_mut().flat_map(|of| &mut of.stddev_b_n_m).chain(&mut self.motors_n_m)
    }

    /// How many of them are not zero.
    pub(crate) fn count(&self) -> usize {
        self.stddevs_n_m().filter(|stddev| *stddev > 0.0).count()
    }

    /// With processes of all these correlation times \[s\], each about each axis as strong at least as any other where both are fast, if it is the
    /// shorter one, or where both are slow: what is much smaller than its best beside others would stay hidden behind them.
    pub(crate) fn spread(&self, times_s: &[f64]) -> Self {
        let of_time = |correlation_s: &f64| {
            // Density of a first-order Markov process is 2 sigma^2 tau/(1 + omega^2 tau^2).
            let share = |tau_s: f64| (tau_s / correlation_s).min(correlation_s / tau_s).sqrt();
            let stddev = |axis: usize| {
                let all = self.body.iter().map(|of| of.stddev_b_n_m[axis] * share(of.correlation_s));
                all.fold(0.0, f64::max)
            };
            RandomTorque { stddev_b_n_m: [0, 1, 2].map(stddev), correlation_s: *correlation_s }
        };
        let mut spread = Self { body: times_s.iter().map(of_time).collect(), ..self.clone() };
        spread.forget_silent();
        spread
    }

    /// As strong about each axis as about that one about which it is strongest: what another run of the platform may show.
    #[must_use]
    pub fn about_all_axes(mut self) -> Self {
        for of in &mut self.body {
            of.stddev_b_n_m = [of.stddev_b_n_m.iter().copied().fold(0.0, f64::max); 3];
        }
        self
    }

    pub(crate) fn forget_silent(&mut self) {
        self.body.retain(|of| of.stddev_b_n_m.iter().any(|x| *x > 0.0));
        if self.motors_n_m.iter().all(|x| *x == 0.0) {
            self.motors_n_m.clear();
        }
    }

    /// Standard deviation of the whole torque on the body, about each of its axes [N m].
    pub fn body_stddev_b_n_m(&self) -> [f64; 3] {
        [0, 1, 2].map(|axis| self.body.iter().map(|of| of.stddev_b_n_m[axis].powi(2)).sum::<f64>().sqrt())
    }

    /// Coordinates of a layout that are torques of it, each with its standard deviation [N m] and correlation time \[s\].
    pub(crate) fn coordinates(&self, layout: Layout) -> impl Iterator<Item = (usize, f64, f64)> + Clone + '_ {
        let body = self.body.iter().flat_map(|of| of.stddev_b_n_m.map(|stddev| (stddev, of.correlation_s)));
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
        let Some(silent) = case.components().find(|component| !noise.of(*component).is_normal()) else {
            return Ok(noise);
        };
        let what = format!("{} was recorded, and its noise is stated as zero", silent.name(&wheels));
        let advice = "state in the platform's file what one sample scatters by";
        Err(Why::Unusable(what, advice).of(recording).into())
    }

    /// Standard deviation of one component, in its channel's unit; NaN where nothing of it is known.
    pub fn of(&self, component: Component) -> f64 {
        let found = match component.channel {
            Channel::Gyro => self.gyro_rad_s.get(component.index()),
            Channel::Accelerometer => self.force_m_s2.get(component.index()),
            Channel::Vector => self.vector_rad.get(component.sensor()),
            Channel::WheelSpeed => Some(&self.wheel_speed_rad_s),
            _ => None,
        };
        found.copied().unwrap_or(f64::NAN)
    }

    pub(crate) fn slot(&mut self, component: Component) -> Option<&mut f64> {
        match component.channel {
            Channel::Gyro => self.gyro_rad_s.get_mut(component.index()),
            Channel::Accelerometer => self.force_m_s2.get_mut(component.index()),
            Channel::Vector => self.vector_rad.get_mut(component.sensor()),
            Channel::WheelSpeed => Some(&mut self.wheel_speed_rad_s),
            _ => None,
        }
    }
}

/// Coordinates of an estimate's error: those of the plant ([`Tangent`]), then the disturbance torque on the body
/// and that of each motor [N m], the biases of gyro [rad/s] and accelerometer [m/s^2], as far as there are any.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Layout {
    /// Of the plant.
    pub plant: Tangent,
    /// Where disturbances of the body, of motors, the gyro's bias and the accelerometer's end.
    ends: [usize; 4],
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
        let counts = [3 * disturbances, motors, 3 * usize::from(gyro_bias), 3 * usize::from(force_bias)];
        let mut end = plant.size();
        let ends = counts.map(|count| {
            end += count;
            end
        });
        Self { plant, ends }
    }

    /// The disturbance torques on the body, about three axes each.
    pub fn disturbance(&self) -> Range<usize> {
        self.plant.size()..self.ends[0]
    }

    /// The disturbance torque of each motor.
    pub fn motors(&self) -> Range<usize> {
        self.ends[0]..self.ends[1]
    }

    /// Bias of the gyro.
    pub fn gyro_bias(&self) -> Range<usize> {
        self.ends[1]..self.ends[2]
    }

    /// Bias of the accelerometer.
    pub fn force_bias(&self) -> Range<usize> {
        self.ends[2]..self.ends[3]
    }

    /// What moves: the plant and its disturbances. The rest stays as it is, or walks.
    pub fn moving(&self) -> usize {
        self.ends[1]
    }

    /// Variance that each coordinate gains in a second by its own random walk.
    pub(crate) fn walks(&self, sensors: &SensorSuite, effects: &EffectSet) -> Vec<f64> {
        let mut hidden_noise = vec![0.0; effects.hidden_states()];
        effects.hidden_noise(&mut hidden_noise);
        let mut walks = vec![0.0; self.size()];
        let gyro = self.gyro_bias().zip(&sensors.gyro.errors.bias_walk);
        let force = self.force_bias().zip(&sensors.accelerometer.errors.bias_walk);
        let all = self.plant.hidden().zip(&hidden_noise).chain(gyro).chain(force);
        all.for_each(|(i, walk)| walks[i] = walk * walk);
        walks
    }

    pub(crate) fn own(&self) -> impl Iterator<Item = usize> + Clone {
        (0..self.plant.size()).chain(self.moving()..self.size())
    }

    /// How many coordinates there are.
    pub fn size(&self) -> usize {
        self.ends[3]
    }
}
