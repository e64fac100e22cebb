//! The measured channels of one platform.

use nalgebra::{Unit, UnitQuaternion, Vector3};

use crate::Series;

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

/// True motion, where it is known (simulation, motion capture). Judges use it; no fit may.
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
    /// Rate gyro, body axes [rad/s].
    pub gyro_b_rad_s: Series<Vector3<f64>>,
    /// Accelerometer: specific force, body axes [m/s^2], +9.81 on z at rest.
    pub specific_force_b_m_s2: Series<Vector3<f64>>,
    /// Vector sensors.
    pub vectors: Vec<VectorChannel>,
    /// Measured wheel speeds relative to the body [rad/s], one per wheel of the platform.
    pub wheel_speed_rad_s: Series<Vec<f64>>,
    /// Commanded motor torques [N m], one per wheel; each holds until the next.
    pub wheel_torque_command_n_m: Series<Vec<f64>>,
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
    /// What reading it met that a person should know, one sentence each: messages dropped, channels unusable.
    pub remarks: Vec<String>,
}

impl Recording {
    /// From the first to the last sample of any inertial or wheel channel \[s\].
    #[must_use]
    pub fn duration_s(&self) -> f64 {
        let spans =
            [&self.gyro_b_rad_s.time_s, &self.specific_force_b_m_s2.time_s, &self.wheel_speed_rad_s.time_s];
        let first = spans.iter().filter_map(|t| t.first()).copied().fold(f64::INFINITY, f64::min);
        let last = spans.iter().filter_map(|t| t.last()).copied().fold(f64::NEG_INFINITY, f64::max);
        (last - first).max(0.0)
    }
    /// When anything was first measured or commanded \[s\].
    #[must_use]
    pub fn first_time_s(&self) -> Option<f64> {
        let truth = self.truth.as_ref();
        let series = [
            self.gyro_b_rad_s.time_s.first(),
            self.specific_force_b_m_s2.time_s.first(),
            self.wheel_speed_rad_s.time_s.first(),
            self.wheel_torque_command_n_m.time_s.first(),
            self.body_torque_b_n_m.time_s.first(),
            self.bus_voltage_v.time_s.first(),
            self.tank_pressure_pa.time_s.first(),
            self.temperature_k.time_s.first(),
            self.ballast_moment_b_n_m.time_s.first(),
            truth.and_then(|truth| truth.q_world_body.time_s.first()),
            truth.and_then(|truth| truth.omega_wb_b_rad_s.time_s.first()),
        ];
        let vectors = self.vectors.iter().map(|vector| vector.direction_b.time_s.first());
        let pulses = self.jet_pulses.iter().map(|pulses| pulses.first().map(|pulse| &pulse.on_s));
        series.into_iter().chain(vectors).chain(pulses).flatten().copied().min_by(f64::total_cmp)
    }
}
