//! The measured channels of one platform.

use nalgebra::{Unit, UnitQuaternion, Vector3};

use whorl_bag::{Channel, Form};
use whorl_dynamics::PlatformModel;

use crate::component::Component;
use crate::series::{ChannelSeries, Series};

/// How the platform was held during a run.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Mounting {
    /// Free on its bearing.
    #[default]
    OnBearing,
    /// Clamped: only the wheels move (bench test).
    Clamped,
}

/// A valve's commanded pulse: switched on at `on_s`, off at `off_s`; the valve's own delays come after.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct OnInterval {
    /// Switched on, time since the start of the run \[s\].
    pub on_s: f64,
    /// Switched off \[s\], > `on_s`.
    pub off_s: f64,
}

/// A sensor of a direction that is fixed in the world.
#[derive(Debug, Clone, PartialEq)]
pub struct VectorChannel {
    /// The direction in the world (east, north, up).
    pub reference_world: Unit<Vector3<f64>>,
    /// The direction in body axes, of length one; never NaN: missing samples are left out.
    pub direction_b: Series<Vector3<f64>>,
}

/// True motion, where it is known (simulation, motion capture). Used for scoring only, never in fits.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct TrueMotion {
    /// Attitude, v_world = q v_body.
    pub q_world_body: Series<UnitQuaternion<f64>>,
    /// Body rate, body axes [rad/s].
    pub omega_wb_b_rad_s: Series<Vector3<f64>>,
}

/// What was measured of one platform in one run. Missing samples are left out of a series, so every
/// value is finite; an empty series is a channel that was not recorded. All times are measurement
/// stamps in seconds since the start of the run.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Recording {
    /// Name of the run, for messages and reports.
    pub name: String,
    /// The platform.
    pub platform: String,
    /// How it was held.
    pub mounting: Mounting,
    /// Rate gyro, body axes [rad/s]; zero on the axes that it does not have.
    pub gyro_b_rad_s: Series<Vector3<f64>>,
    /// Which of the body's axes the gyro does not have.
    pub no_gyro_axis: [bool; 3],
    /// Accelerometer: specific force, body axes [m/s^2], +9.81 on z at rest; zero on the axes that it does not have.
    pub specific_force_b_m_s2: Series<Vector3<f64>>,
    /// Which of the body's axes the accelerometer does not have.
    pub no_force_axis: [bool; 3],
    /// Vector sensors.
    pub vectors: Vec<VectorChannel>,
    /// Measured wheel speeds relative to the body [rad/s], one per wheel of the platform.
    pub wheel_speed_rad_s: Series<Vec<f64>>,
    /// Commanded motor torques [N m], one per wheel; each holds until the next.
    pub wheel_torque_command_n_m: Series<Vec<f64>>,
    /// Measured motor currents \[A\], one per wheel, positive where the torque is.
    pub wheel_current_a: Series<Vec<f64>>,
    /// Measured gimbal angles of control moment gyros \[rad\], one per gyro of the platform.
    pub gimbal_angle_rad: Series<Vec<f64>>,
    /// Measured gimbal rates [rad/s], one per gyro.
    pub gimbal_rate_rad_s: Series<Vec<f64>>,
    /// Torques of the gimbals' motors about their axes [N m], one per gyro.
    pub gimbal_torque_n_m: Series<Vec<f64>>,
    /// Commanded pulses of each jet, in order of time; empty if the jets' commands were not recorded.
    pub jet_pulses: Vec<Vec<OnInterval>>,
    /// Known torque on the body from other actuators, body axes [N m]; each holds until the next.
    pub body_torque_b_n_m: Series<Vector3<f64>>,
    /// Bus voltage \[V\].
    pub bus_voltage_v: Series<f64>,
    /// Tank pressure \[Pa\].
    pub tank_pressure_pa: Series<f64>,
    /// Temperature \[K\].
    pub temperature_k: Series<f64>,
    /// Commanded moment of the linear mass actuators, weight times displacement, body axes [N m];
    /// each holds until the next.
    pub ballast_moment_b_n_m: Series<Vector3<f64>>,
    /// Whether a controller was running: actuator gains are then priors in fits, not free.
    pub closed_loop: bool,
    /// True motion, where it is known.
    pub truth: Option<TrueMotion>,
    /// Warnings from reading it, one sentence each: messages dropped, channels unusable.
    pub remarks: Vec<String>,
}

/// The field of each channel: with `mut`, to be changed. `$vector` and `$truth` are those that have the fields of
/// one vector sensor and of the true motion.
macro_rules! series_of {
    ($channel:expr, $recording:tt, $vector:expr, $truth:expr $(, $mutable:tt)?) => {{
        let series: &$($mutable)? dyn ChannelSeries = match $channel {
            Channel::Gyro => &$($mutable)? $recording.gyro_b_rad_s,
            Channel::Accelerometer => &$($mutable)? $recording.specific_force_b_m_s2,
            Channel::Vector => &$($mutable)? $vector.direction_b,
            Channel::WheelSpeed => &$($mutable)? $recording.wheel_speed_rad_s,
            Channel::WheelTorqueCommand => &$($mutable)? $recording.wheel_torque_command_n_m,
            Channel::WheelCurrent => &$($mutable)? $recording.wheel_current_a,
            Channel::GimbalAngle => &$($mutable)? $recording.gimbal_angle_rad,
            Channel::GimbalRate => &$($mutable)? $recording.gimbal_rate_rad_s,
            Channel::GimbalTorque => &$($mutable)? $recording.gimbal_torque_n_m,
            // Pulses are no samples.
            Channel::Jets => return None,
            Channel::BodyTorque => &$($mutable)? $recording.body_torque_b_n_m,
            Channel::BallastMoment => &$($mutable)? $recording.ballast_moment_b_n_m,
            Channel::BusVoltage => &$($mutable)? $recording.bus_voltage_v,
            Channel::TankPressure => &$($mutable)? $recording.tank_pressure_pa,
            Channel::Temperature => &$($mutable)? $recording.temperature_k,
            Channel::TrueAttitude => &$($mutable)? $truth.q_world_body,
            Channel::TrueRate => &$($mutable)? $truth.omega_wb_b_rad_s,
        };
        Some(series)
    }};
}

impl Recording {
    /// The series of a channel; vector sensors count from 0, of other channels there is only 0. `None` for a sensor
    /// or truth that is not there, and for jets, which have pulses.
    #[must_use]
    pub fn series(&self, channel: Channel, sensor: usize) -> Option<&dyn ChannelSeries> {
        series_of!(channel, self, self.vectors.get(sensor)?, self.truth.as_ref()?)
    }

    /// The same, to be filled; a truth that is not there is made.
    pub(crate) fn series_mut(&mut self, channel: Channel, sensor: usize) -> Option<&mut dyn ChannelSeries> {
        series_of!(channel, self, self.vectors.get_mut(sensor)?, self.truth.get_or_insert_default(), mut)
    }

    /// Which of the body's axes the gyro measures.
    #[must_use]
    pub fn gyro_axes(&self) -> [bool; 3] {
        self.no_gyro_axis.map(|missing| !missing)
    }

    /// Which of the body's axes the accelerometer measures.
    #[must_use]
    pub fn force_axes(&self) -> [bool; 3] {
        self.no_force_axis.map(|missing| !missing)
    }

    /// Which of the body's axes a channel's sensor does not have: zero stands there, and says nothing.
    #[must_use]
    pub fn lacks(&self, channel: Channel) -> [bool; 3] {
        match channel {
            Channel::Gyro => self.no_gyro_axis,
            Channel::Accelerometer => self.no_force_axis,
            _ => [false; 3],
        }
    }

    /// Says which axes a sensor does not have.
    pub(crate) fn set_lacks(&mut self, channel: Channel, missing: [bool; 3]) {
        match channel {
            Channel::Gyro => self.no_gyro_axis = missing,
            Channel::Accelerometer => self.no_force_axis = missing,
            _ => {}
        }
    }

    /// Whether this component of a channel is measured at all: gyro and accelerometer may lack axes.
    #[must_use]
    pub fn measures(&self, component: Component) -> bool {
        self.lacks(component.channel).get(component.index()) != Some(&true)
    }

    /// Whether there is an accelerometer that measures all three axes: one that shows the vertical by itself.
    #[must_use]
    pub fn has_whole_accelerometer(&self) -> bool {
        !self.specific_force_b_m_s2.is_empty() && self.no_force_axis == [false; 3]
    }

    /// Whether the gyro measures all three axes.
    #[must_use]
    pub fn has_whole_gyro(&self) -> bool {
        self.no_gyro_axis == [false; 3]
    }

    /// How many sensors of a channel the platform has.
    fn sensors(&self, channel: Channel) -> usize {
        if channel.info().form == Form::Directions { self.vectors.len() } else { 1 }
    }

    /// Everything that was sampled: channel, number of its sensor from 0, series. Jets are apart, in
    /// [`Self::jet_pulses`].
    pub fn sampled(&self) -> impl Iterator<Item = (Channel, usize, &dyn ChannelSeries)> {
        let sensors =
            |channel: &'static Channel| (0..self.sensors(*channel)).map(move |sensor| (*channel, sensor));
        let all = Channel::ALL.iter().flat_map(sensors);
        all.filter_map(|(channel, sensor)| Some((channel, sensor, self.series(channel, sensor)?)))
            .filter(|(.., series)| !series.time_s().is_empty())
    }

    /// Whether the body was held, so that only wheels moved; a model says so too of one that cannot turn.
    #[must_use]
    pub fn is_clamped(&self, model: &PlatformModel) -> bool {
        self.mounting == Mounting::Clamped || !model.freedom.turns()
    }

    /// Whether any channel measures motion; without one, nothing can be explained.
    #[must_use]
    pub fn has_motion(&self) -> bool {
        self.sampled().any(|(channel, ..)| channel.info().is_motion)
    }

    /// From the first to the last sample of any channel that tells of motion \[s\].
    #[must_use]
    pub fn duration_s(&self) -> f64 {
        let motion = || self.sampled().filter(|(channel, ..)| channel.info().is_motion);
        let first = motion().filter_map(|(.., series)| series.time_s().first().copied());
        let last = motion().filter_map(|(.., series)| series.time_s().last().copied());
        (last.fold(f64::NEG_INFINITY, f64::max) - first.fold(f64::INFINITY, f64::min)).max(0.0)
    }

    /// When anything was first measured or commanded \[s\].
    #[must_use]
    pub fn first_time_s(&self) -> Option<f64> {
        let samples = self.sampled().filter_map(|(.., series)| series.time_s().first());
        let pulses = self.jet_pulses.iter().filter_map(|pulses| pulses.first().map(|pulse| &pulse.on_s));
        samples.chain(pulses).copied().min_by(f64::total_cmp)
    }
}

/// Which axes of these samples never have a number; they become zero in all. A sample that lacks a number on another axis
/// is taken out, and one of a sensor without any axis.
pub(crate) fn take_out_missing_axes(samples: &mut Vec<(i64, Vec<f64>)>) -> [bool; 3] {
    let missing = missing_axes(samples.iter().map(|(_, v)| v.as_slice()));
    samples.retain_mut(|(_, v)| is_whole(v, missing));
    if missing == [true; 3] { [false; 3] } else { missing }
}

/// Axes without a single number.
pub(crate) fn missing_axes<'a>(samples: impl Iterator<Item = &'a [f64]>) -> [bool; 3] {
    let mut missing = [true; 3];
    for sample in samples {
        for (missing, x) in missing.iter_mut().zip(sample) {
            *missing &= !x.is_finite();
        }
        if missing == [false; 3] {
            break;
        }
    }
    missing
}

/// Whether a sample has all the numbers that it should; the others become zero.
pub(crate) fn is_whole(sample: &mut [f64], missing: [bool; 3]) -> bool {
    for (x, missing) in sample.iter_mut().zip(missing) {
        if missing {
            *x = 0.0;
        }
    }
    missing != [true; 3] && sample.iter().all(|x| x.is_finite())
}
