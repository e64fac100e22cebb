//! What recordings hold, as far as it decides which effects can be tested.

use std::f64::consts::PI;

use nalgebra::Vector3;
use whorl_dynamics::effects::Need;
use whorl_dynamics::{Effect, PlatformModel};
use whorl_math::noise::typical_step_s;
use whorl_recording::{Recording, digits_of_gyro};

pub(crate) struct Available {
    held: Vec<Need>,
    /// Typical time between the readings of what is read fastest \[s\].
    pub sample_s: f64,
}

impl Available {
    pub fn of<'r>(recordings: impl IntoIterator<Item = &'r Recording>, model: &PlatformModel) -> Self {
        let all: Vec<&Recording> = recordings.into_iter().collect();
        let free: Vec<&&Recording> = all.iter().filter(|run| !run.is_clamped(model)).collect();
        let any = |test: fn(&Recording) -> bool| all.iter().any(|run| test(run));
        let any_free = |test: fn(&Recording) -> bool| free.iter().any(|run| test(run));
        let has_wheels = !model.wheels().is_empty();
        let is_commanded = has_wheels && any(|run| !run.wheel_torque_command_n_m.is_empty());
        let of_needs = [
            (Need::FreeBody, !free.is_empty()),
            (Need::Jets, any_free(|run| run.jet_pulses.iter().any(|pulses| !pulses.is_empty()))),
            (Need::Wheels, is_commanded || has_wheels && any(|run| !run.wheel_speed_rad_s.is_empty())),
            (Need::WheelCommands, is_commanded),
            (Need::Gimbals, any_free(|run| run.gimbal_rate_rad_s.value.iter().flatten().any(|u| *u != 0.0))),
            (Need::Accelerometer, any_free(|run| !run.specific_force_b_m_s2.is_empty())),
            (Need::VectorSensor, any_free(|run| run.vectors.iter().any(|v| !v.direction_b.is_empty()))),
            (Need::Temperature, any(|run| run.temperature_k.len() > 1)),
            (Need::BusVoltage, any(|run| run.bus_voltage_v.len() > 1)),
            (Need::Ballast, any(|run| run.ballast_moment_b_n_m.value.windows(2).any(|w| w[0] != w[1]))),
            (Need::HalfATurn, any_free(|run| turned_rad(run) > PI)),
            (Need::UnclippedGyro, free.iter().all(|run| digits_of_gyro(run, model).clips_at_rad_s.is_none())),
        ];
        Self {
            held: of_needs.into_iter().filter(|(_, is_held)| *is_held).map(|(need, _)| need).collect(),
            sample_s: all.iter().map(|run| sample_s(run)).fold(f64::INFINITY, f64::min),
        }
    }

    /// Whether these data could show the effect at all.
    pub fn can_test(&self, effect: &dyn Effect) -> bool {
        effect.evidence().iter().any(|needs| needs.iter().all(|need| self.has(*need)))
    }

    pub fn has(&self, need: Need) -> bool {
        self.held.contains(&need)
    }
}

/// Typical time between readings of the gyro, or of the wheels where it has none \[s\].
pub(crate) fn sample_s(recording: &Recording) -> f64 {
    let gyro = &recording.gyro_b_rad_s.time_s;
    typical_step_s(if gyro.len() > 1 { gyro } else { &recording.wheel_speed_rad_s.time_s })
}

/// Angle between the two instants of a run that are furthest apart, by the gyro about one axis of the body \[rad\].
fn turned_rad(run: &Recording) -> f64 {
    let series = &run.gyro_b_rad_s;
    let (mut turned, mut least, mut most) = (Vector3::zeros(), Vector3::zeros(), Vector3::zeros());
    for (times, rates) in series.time_s.windows(2).zip(series.value.windows(2)) {
        turned += (rates[0] + rates[1]) * (0.5 * (times[1] - times[0]));
        (least, most) = (least.inf(&turned), most.sup(&turned));
    }
    (most - least).amax()
}
