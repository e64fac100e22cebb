//! The truth plant: a platform that moves in simulated time, obeys commands and is measured.
//!
//! Time is whole nanoseconds. The equations are integrated by classical Runge-Kutta steps of at
//! most [`DEFAULT_STEP_NS`] that end exactly at every valve edge, whatever the phase of the step.

mod command;
mod derivatives;
mod integrator;
mod motion;
mod noise;
mod sampling;
mod tangent;
mod window;

pub use crate::actuators::jets::{JetFailure, Pulse};
pub use command::CommandError;
pub use motion::Acts;
pub use tangent::{LinearisedPlant, RATE, ROTATION, Tangent};
pub use window::MeanInputs;

use nalgebra::{UnitQuaternion, Vector3};
use thiserror::Error;

use crate::actuators::{Forces, Instant};
use crate::gyrostat::{Derivative, Drive};
use crate::platform::TriaxialErrors;
use crate::sensing::History;
use crate::{Environment, Gyrostat, GyrostatError, PlatformModel, State, TrueImu};
use integrator::Work;
use noise::{Normal, Stream, TriaxialSensor};

/// Largest integration step \[ns\]: 1 kHz.
pub const DEFAULT_STEP_NS: i64 = 1_000_000;

/// Why a plant cannot be made or moved.
#[derive(Debug, Clone, PartialEq, Error)]
pub enum PlantError {
    /// The platform cannot be simulated.
    #[error(transparent)]
    Gyrostat(#[from] GyrostatError),
    /// A number of the initial state is NaN or infinite.
    #[error("the initial state holds a number that is not finite")]
    NotFinite,
    /// Wheel speeds for another number of wheels.
    #[error("{given} initial wheel speeds for {wheels} wheels")]
    WheelCount {
        /// Speeds given.
        given: usize,
        /// Wheels of the platform.
        wheels: usize,
    },
    /// Simulated time cannot run backwards.
    #[error("cannot go back from {now_ns} ns to {asked_ns} ns")]
    BackInTime {
        /// Current time.
        now_ns: i64,
        /// Time asked for.
        asked_ns: i64,
    },
    /// The motion grew beyond all bounds, as with a stiff effect and a step too long for it.
    #[error("the motion at {time_ns} ns is not finite: a parameter is too extreme for the step")]
    Diverged {
        /// When it was noticed.
        time_ns: i64,
    },
}

/// Where a run starts.
#[derive(Debug, Clone, PartialEq)]
pub struct InitialState {
    /// Time of the start \[ns\].
    pub time_ns: i64,
    /// Attitude, v_world = q v_body.
    pub q_world_body: UnitQuaternion<f64>,
    /// Body rate seen from the world, body axes [rad/s]; only its share along the axes that are free counts.
    pub omega_wb_b_rad_s: Vector3<f64>,
    /// Wheel speeds relative to the body [rad/s]; empty = all stopped.
    pub wheel_speed_rad_s: Vec<f64>,
}

impl Default for InitialState {
    /// Level, heading east, at rest, at time zero.
    fn default() -> Self {
        Self {
            time_ns: 0,
            q_world_body: UnitQuaternion::identity(),
            omega_wb_b_rad_s: Vector3::zeros(),
            wheel_speed_rad_s: Vec::new(),
        }
    }
}

/// The true state, for records and tests; no sensor sees it.
#[derive(Debug, Clone, PartialEq)]
pub struct Truth {
    /// Time \[ns\].
    pub time_ns: i64,
    /// Attitude, v_world = q v_body.
    pub q_world_body: UnitQuaternion<f64>,
    /// Body rate seen from the world, body axes [rad/s].
    pub omega_wb_b_rad_s: Vector3<f64>,
    /// Its derivative [rad/s^2].
    pub omega_dot_wb_b_rad_s2: Vector3<f64>,
    /// Wheel speeds relative to the body [rad/s].
    pub wheel_speed_rad_s: Vec<f64>,
    /// Total angular momentum about the centre of rotation, body axes [N m s].
    pub momentum_b_n_m_s: Vector3<f64>,
    /// Whole bias of the gyro now [rad/s].
    pub gyro_bias_rad_s: Vector3<f64>,
    /// Whole bias of the accelerometer now [m/s^2].
    pub accelerometer_bias_m_s2: Vector3<f64>,
    /// Gas left \[kg\].
    pub gas_kg: f64,
    /// Tank pressure \[Pa\].
    pub tank_pressure_pa: f64,
    /// Bus voltage \[V\].
    pub bus_voltage_v: f64,
    /// Temperature \[K\].
    pub temperature_k: f64,
    /// Time each valve has really been open since the start \[s\].
    pub valve_open_s: Vec<f64>,
    /// Hidden states of effects.
    pub hidden: Vec<f64>,
}

/// What an estimator estimates, as it really is.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TrueMotion {
    /// Attitude, v_world = q v_body.
    pub q_world_body: UnitQuaternion<f64>,
    /// Body rate seen from the world, body axes [rad/s].
    pub omega_wb_b_rad_s: Vector3<f64>,
    /// Whole bias of the gyro [rad/s].
    pub gyro_bias_rad_s: Vector3<f64>,
}

impl Truth {
    /// The part of it that an estimator estimates.
    #[must_use]
    pub fn motion(&self) -> TrueMotion {
        TrueMotion {
            q_world_body: self.q_world_body,
            omega_wb_b_rad_s: self.omega_wb_b_rad_s,
            gyro_bias_rad_s: self.gyro_bias_rad_s,
        }
    }
}

/// A simulated platform. The same model, initial state, seed and calls give the same numbers.
#[derive(Debug, Clone)]
pub struct Plant {
    pub(crate) gyrostat: Gyrostat,
    step_ns: i64,
    /// The same while something touches, or nearly does.
    contact_step_ns: i64,
    start_ns: i64,
    pub(crate) now_ns: i64,
    pub(crate) state: State,
    pub(crate) drive: Drive,
    history: History,
    /// A sensor of the inertial unit has a low-pass.
    has_filter: bool,
    /// What is behind it follows the motion; a plant that takes over another's motion step by step takes over this as well.
    carries_filter: bool,
    /// Steps are by the midpoint rule.
    by_midpoint: bool,
    behind_filter: TrueImu,
    /// Over the window of the accelerometer's reading, where that is not an instant.
    mean_inputs: Option<MeanInputs>,
    gyro: TriaxialSensor,
    accelerometer: TriaxialSensor,
    vector_noise: Normal,
    pub(crate) wheel_noise: Normal,
    bus_noise: Normal,
    pub(crate) pressure_noise: Normal,
    temperature_noise: Normal,
    effect_noise: Normal,
    hidden_noise_intensity: Vec<f64>,
    /// `None` before the first step.
    work: Option<Box<Work>>,
}

impl Plant {
    /// A platform in its initial state; `seed` decides every random number of the run.
    ///
    /// # Errors
    /// When the platform cannot be simulated, or the initial state does not fit it.
    pub fn new(model: &PlatformModel, initial: &InitialState, seed: u64) -> Result<Self, PlantError> {
        let gyrostat = Gyrostat::new(model)?;
        let (now_ns, wheels) = (initial.time_ns, model.wheels().len());
        let speeds = &initial.wheel_speed_rad_s;
        if !(speeds.is_empty() || speeds.len() == wheels) {
            return Err(PlantError::WheelCount { given: speeds.len(), wheels });
        }
        let numbers = initial.q_world_body.coords.iter().chain(&initial.omega_wb_b_rad_s).chain(speeds);
        if !numbers.copied().all(f64::is_finite) {
            return Err(PlantError::NotFinite);
        }
        let mut state = State::at_rest(initial.q_world_body, &gyrostat.model().actuators).normalised();
        state.omega_wb_b_rad_s = model.freedom.share(&initial.omega_wb_b_rad_s);
        state.set_wheel_speed_rad_s(speeds);
        let sensors = gyrostat.model().sensors;
        let oldest_s = |errors: &TriaxialErrors| errors.latency_s + 0.5 * errors.averaging_window_s;
        let latest_s = [
            oldest_s(&sensors.gyro.errors),
            oldest_s(&sensors.accelerometer.errors),
            sensors.vector.map_or(0.0, |v| v.latency_s),
        ]
        .into_iter()
        .fold(0.0, f64::max);
        let mut hidden_noise_intensity = vec![0.0; gyrostat.effects().hidden_states()];
        gyrostat.effects().hidden_noise(&mut hidden_noise_intensity);
        if hidden_noise_intensity.iter().all(|x| *x == 0.0) {
            hidden_noise_intensity.clear();
        }
        let mut plant = Self {
            step_ns: DEFAULT_STEP_NS,
            contact_step_ns: DEFAULT_STEP_NS,
            start_ns: now_ns,
            now_ns,
            drive: Drive::idle(&gyrostat, now_ns),
            history: History::new(ns_from_s(latest_s)),
            has_filter: [sensors.gyro.errors, sensors.accelerometer.errors]
                .iter()
                .any(|e| e.time_constant_s > 0.0),
            carries_filter: true,
            by_midpoint: false,
            behind_filter: TrueImu {
                angular_velocity_b_rad_s: Vector3::zeros(),
                specific_force_b_m_s2: Vector3::zeros(),
            },
            mean_inputs: None,
            gyro: TriaxialSensor::new(sensors.gyro.errors, Normal::new(seed, Stream::Gyro), now_ns),
            accelerometer: TriaxialSensor::new(
                sensors.accelerometer.errors,
                Normal::new(seed, Stream::Accelerometer),
                now_ns,
            ),
            vector_noise: Normal::new(seed, Stream::Vector),
            wheel_noise: Normal::new(seed, Stream::WheelSpeed),
            bus_noise: Normal::new(seed, Stream::BusVoltage),
            pressure_noise: Normal::new(seed, Stream::TankPressure),
            temperature_noise: Normal::new(seed, Stream::Temperature),
            effect_noise: Normal::new(seed, Stream::Effects),
            hidden_noise_intensity,
            work: None,
            state,
            gyrostat,
        };
        plant.set_out();
        Ok(plant)
    }

    /// The same with another largest step \[ns\], at least 1 us; for studies of the integrator.
    #[must_use]
    pub fn with_step_ns(mut self, step_ns: i64) -> Self {
        self.step_ns = step_ns.max(1_000);
        self.contact_step_ns = self.step_ns;
        self
    }

    /// The same with shorter steps at most \[ns\], at least 1 us, while something touches or could within a step: contacts are as stiff as
    /// they are whatever the rest of the motion is.
    #[must_use]
    pub fn with_contact_step_ns(mut self, step_ns: i64) -> Self {
        self.contact_step_ns = step_ns.max(1_000).min(self.step_ns);
        self
    }

    /// The same without the random torques that effects state: the mean of the motion, which a prediction is.
    #[must_use]
    pub fn without_random_torque(mut self) -> Self {
        self.hidden_noise_intensity.clear();
        self
    }

    /// The same for differences from another plant after single steps from the same state ([`Self::take_motion_of`]), in less time:
    /// by the midpoint rule, whose error both have; and with what is behind the sensors' low-pass carried on only if `its_filter` is not
    /// the other's.
    #[must_use]
    pub fn for_differences(mut self, its_filter: bool) -> Self {
        self.by_midpoint = true;
        self.carries_filter = its_filter;
        self
    }

    /// Current time \[ns\].
    #[must_use]
    pub fn now_ns(&self) -> i64 {
        self.now_ns
    }

    /// The equations that the plant follows.
    #[must_use]
    pub fn gyrostat(&self) -> &Gyrostat {
        &self.gyrostat
    }

    /// The continuous state.
    #[must_use]
    pub fn state(&self) -> &State {
        &self.state
    }

    /// What effects see now, angular acceleration included.
    #[must_use]
    pub fn environment(&self) -> Environment<'_> {
        let mut environment = self.gyrostat.environment(self.time_s(), &self.state, &self.drive);
        environment.omega_dot_wb_b_rad_s2 = self.angular_acceleration_b_rad_s2();
        environment
    }

    /// The true state now.
    #[must_use]
    pub fn truth(&self) -> Truth {
        let environment = self.environment();
        let wheel_speed_rad_s = environment.wheel_speed_rad_s.to_vec();
        Truth {
            time_ns: self.now_ns,
            q_world_body: self.state.q_world_body,
            omega_wb_b_rad_s: self.state.omega_wb_b_rad_s,
            omega_dot_wb_b_rad_s2: environment.omega_dot_wb_b_rad_s2,
            momentum_b_n_m_s: self.gyrostat.total_momentum_b_n_m_s(&self.state),
            wheel_speed_rad_s,
            gyro_bias_rad_s: *self.gyro.bias(),
            accelerometer_bias_m_s2: *self.accelerometer.bias(),
            gas_kg: self.state.gas_kg(),
            tank_pressure_pa: environment.tank_pressure_pa,
            bus_voltage_v: environment.bus_voltage_v,
            temperature_k: environment.temperature_k,
            valve_open_s: self.valve_open_s(),
            hidden: self.state.hidden.iter().copied().take(self.gyrostat.effects().hidden_states()).collect(),
        }
    }

    /// The true motion now: the part of [`Self::truth`] that costs nothing.
    #[must_use]
    pub fn true_motion(&self) -> TrueMotion {
        TrueMotion {
            q_world_body: self.state.q_world_body,
            omega_wb_b_rad_s: self.state.omega_wb_b_rad_s,
            gyro_bias_rad_s: *self.gyro.bias(),
        }
    }

    /// Time since the start of the run \[s\].
    #[must_use]
    pub fn time_s(&self) -> f64 {
        (self.now_ns - self.start_ns) as f64 * 1e-9
    }

    fn instant(&self, offset_s: f64) -> Instant {
        Instant { now_ns: self.now_ns, offset_s, time_s: self.time_s() + offset_s }
    }

    /// Angular acceleration now, body axes [rad/s^2].
    #[must_use]
    pub fn angular_acceleration_b_rad_s2(&self) -> Vector3<f64> {
        let (mut forces, mut derivative) = (Forces::default(), Derivative::zero());
        self.gyrostat.derivative(&self.instant(0.0), &self.state, &self.drive, &mut forces, &mut derivative);
        derivative.omega
    }
}

/// Seconds to the nearest nanosecond; saturates.
pub(crate) fn ns_from_s(seconds: f64) -> i64 {
    (seconds * 1e9).round() as i64
}
