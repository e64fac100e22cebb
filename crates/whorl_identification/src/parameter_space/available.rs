//! What recordings hold, as far as it decides which effects can be tested.

use std::f64::consts::PI;

use nalgebra::Vector3;
use whorl_dynamics::effects::Need;
use whorl_dynamics::{Effect, PlatformModel};
use whorl_math::noise::typical_step_s;
use whorl_recording::Recording;

use crate::signals::clamped::is_clamped;
use crate::signals::digits::digits_of_gyro;

/// What recordings hold.
#[derive(Debug, Clone, Copy, Default)]
pub(crate) struct Available {
    pub body: bool,
    pub jets: bool,
    pub wheels: bool,
    pub wheel_command: bool,
    pub gimbals: bool,
    pub accel: bool,
    pub vector: bool,
    pub temperature: bool,
    pub voltage: bool,
    pub ballast: bool,
    /// Largest angle between two instants of a run, turned about an axis of the body \[rad\].
    pub largest_turn_rad: f64,
    /// The gyro's readings pile up at a limit.
    pub clips: bool,
    /// Typical time between the readings of what is read fastest \[s\].
    pub sample_s: f64,
}

impl Available {
    pub fn of(recordings: &[Recording], model: &PlatformModel) -> Self {
        let free = |run: &Recording| !is_clamped(run, model);
        let any = |test: &dyn Fn(&Recording) -> bool| recordings.iter().any(test);
        let has_wheels = !model.wheels().is_empty();
        Self {
            body: any(&free),
            jets: any(&|r| free(r) && r.jet_pulses.iter().any(|pulses| !pulses.is_empty())),
            wheels: has_wheels
                && any(&|r| !r.wheel_torque_command_n_m.is_empty() || !r.wheel_speed_rad_s.is_empty()),
            wheel_command: has_wheels && any(&|r| !r.wheel_torque_command_n_m.is_empty()),
            gimbals: any(&|r| free(r) && r.gimbal_rate_rad_s.value.iter().flatten().any(|rate| *rate != 0.0)),
            accel: any(&|r| free(r) && !r.specific_force_b_m_s2.is_empty()),
            vector: any(&|r| free(r) && r.vectors.iter().any(|v| !v.direction_b.is_empty())),
            temperature: any(&|r| r.temperature_k.len() > 1),
            voltage: any(&|r| r.bus_voltage_v.len() > 1),
            ballast: any(&|r| moves(&r.ballast_moment_b_n_m.value)),
            largest_turn_rad: recordings.iter().filter(|r| free(r)).map(turned_rad).fold(0.0, f64::max),
            clips: any(&|r| free(r) && digits_of_gyro(r, model).clips_at_rad_s.is_some()),
            sample_s: recordings.iter().map(sample_s).fold(f64::INFINITY, f64::min),
        }
    }

    /// What either holds.
    pub fn or(&self, other: &Self) -> Self {
        Self {
            body: self.body || other.body,
            jets: self.jets || other.jets,
            wheels: self.wheels || other.wheels,
            wheel_command: self.wheel_command || other.wheel_command,
            gimbals: self.gimbals || other.gimbals,
            accel: self.accel || other.accel,
            vector: self.vector || other.vector,
            temperature: self.temperature || other.temperature,
            voltage: self.voltage || other.voltage,
            ballast: self.ballast || other.ballast,
            largest_turn_rad: self.largest_turn_rad.max(other.largest_turn_rad),
            clips: self.clips || other.clips,
            sample_s: self.sample_s.min(other.sample_s),
        }
    }

    /// Whether these data could show the effect at all.
    pub fn can_test(&self, effect: &dyn Effect) -> bool {
        effect.evidence().iter().any(|needs| needs.iter().all(|need| self.has(*need)))
    }

    /// Whether they hold what an effect needs.
    pub fn has(&self, need: Need) -> bool {
        match need {
            Need::FreeBody => self.body,
            Need::Jets => self.jets,
            Need::Wheels => self.wheels,
            Need::WheelCommands => self.wheel_command,
            Need::Gimbals => self.gimbals,
            Need::Accelerometer => self.accel,
            Need::VectorSensor => self.vector,
            Need::Temperature => self.temperature,
            Need::BusVoltage => self.voltage,
            Need::Ballast => self.ballast,
            Need::HalfATurn => self.largest_turn_rad > PI,
            Need::UnclippedGyro => !self.clips,
        }
    }
}

/// Typical time between readings of the gyro, or of the wheels where it has none \[s\].
pub(crate) fn sample_s(recording: &Recording) -> f64 {
    let gyro = &recording.gyro_b_rad_s.time_s;
    typical_step_s(if gyro.len() > 1 { gyro } else { &recording.wheel_speed_rad_s.time_s })
}

fn moves(moments: &[Vector3<f64>]) -> bool {
    moments.first().is_some_and(|first| moments.iter().any(|moment| moment != first))
}

/// Angle between the two instants of a run that are furthest apart, by the gyro about one axis of the body \[rad\].
fn turned_rad(run: &Recording) -> f64 {
    let series = &run.gyro_b_rad_s;
    let (mut turned, mut least, mut most) = (Vector3::zeros(), Vector3::zeros(), Vector3::zeros());
    for (times, rates) in series.time_s.windows(2).zip(series.value.windows(2)) {
        if let ([from, to], [before, after]) = (times, rates) {
            turned += (before + after) * (0.5 * (to - from));
        }
        least = least.inf(&turned);
        most = most.sup(&turned);
    }
    (most - least).amax()
}
