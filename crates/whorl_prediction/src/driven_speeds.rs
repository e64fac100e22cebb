//! Speeds of wheels as their tachometers show them, without the noise (METHOD.md, "What is known of it": Carroll et al., *Measurement Error in
//! Nonlinear Models*, 2nd ed., chapter 4), and the motor torques that explain them, for recordings without torques.

use nalgebra::Vector3;
use whorl_dynamics::PlatformModel;
use whorl_dynamics::effects::{Need, find};
use whorl_dynamics::platform::Wheel;
use whorl_math::line::local_line;
use whorl_math::noise::typical_step_s;
use whorl_math::random_walk::smoothed;
use whorl_recording::{Recording, Series};

/// Half of the stretch over which the slope of the body's rate is fitted \[s\]: short compared with the platform's motion.
const HALF_S: f64 = 0.03;
/// Factor to a motor's limit that no torque with a tachometer's noise reaches.
const FAR_BEYOND: f64 = 1e3;

#[derive(Debug, Clone, PartialEq)]
pub struct DrivenSpeeds {
    pub speed_rad_s: Series<Vec<f64>>,
    /// Root of the power density of the noise of each wheel's readings [rad/s per root of Hz]: that of the smoothed speed too, over times long enough.
    pub noise_root: Vec<f64>,
}

impl DrivenSpeeds {
    /// Of a recording's readings; those that are no numbers are passed over.
    pub fn of(recording: &Recording) -> Self {
        let Series { time_s, value: read } = &recording.wheel_speed_rad_s;
        let wheels = read.iter().map(Vec::len).max().unwrap_or(0);
        let mut value = vec![vec![0.0; wheels]; time_s.len()];
        let mut noise_root = Vec::new();
        for j in 0..wheels {
            let speeds = read.iter().map(|speeds| speeds.get(j).copied().unwrap_or(f64::NAN));
            let (found, variance) = smoothed(time_s, &speeds.collect::<Vec<f64>>());
            value.iter_mut().zip(found).for_each(|(row, speed)| row[j] = speed);
            noise_root.push((variance * typical_step_s(time_s).max(0.0)).sqrt());
        }
        Self { speed_rad_s: Series { time_s: time_s.clone(), value }, noise_root }
    }
}

/// Whether the wheels of a recording are driven along their measured speeds: their torques were not recorded.
pub fn go_along_speeds(recording: &Recording) -> bool {
    recording.wheel_torque_command_n_m.is_empty() && !recording.wheel_speed_rad_s.is_empty()
}

/// A model as its wheels go in a recording: by commands, or along their measured speeds, in which friction, limits and effects of motors show already.
pub fn as_driven(recording: &Recording, model: &PlatformModel) -> PlatformModel {
    let mut model = model.clone();
    if go_along_speeds(recording) {
        for wheel in model.wheels_mut() {
            (wheel.viscous_friction_n_m_s, wheel.coulomb_friction_n_m) = (0.0, 0.0);
            wheel.max_torque_n_m *= FAR_BEYOND;
        }
        let is_of_motors = |evidence: &[&[Need]]| {
            !evidence.is_empty() && evidence.iter().all(|needs| needs.contains(&Need::WheelCommands))
        };
        model.effects.retain(|id, _| !find(id).is_some_and(|effect| is_of_motors(effect.evidence())));
    }
    model
}

/// Motor torques of the wheels that explain their measured speeds \[N m\], u = J (dOmega/dt + a . domega/dt) + friction with the model's spin inertia J,
/// axis a and friction. Each turns the wheel from one speed to the next: over any time the momentum that it gives the body has the noise of two speeds.
pub fn from_speeds(recording: &Recording, speeds: &DrivenSpeeds, model: &PlatformModel) -> Series<Vec<f64>> {
    let (gyro, speeds) = (&recording.gyro_b_rad_s, &speeds.speed_rad_s);
    let rate = |k: usize| gyro.value.get(k).copied().unwrap_or_default();
    let stretches = speeds.time_s.windows(2).zip(speeds.value.windows(2));
    let torques = stretches.filter(|(ends, _)| ends[1] > ends[0]).map(|(ends, speeds)| {
        let (middle_s, length_s) = (0.5 * (ends[0] + ends[1]), ends[1] - ends[0]);
        let line = local_line(&gyro.time_s, rate, middle_s, HALF_S);
        let acceleration = line.map_or(Vector3::zeros(), |line| line.slope);
        let of_wheel = |(j, wheel): (usize, &Wheel)| {
            let [from, to] = [0, 1].map(|k| speeds[k].get(j).copied().unwrap_or(0.0));
            let speed = 0.5 * (from + to);
            let friction =
                wheel.viscous_friction_n_m_s * speed + wheel.coulomb_friction_n_m * speed.clamp(-1.0, 1.0);
            let relative = (to - from) / length_s + wheel.spin_axis_b.dot(&acceleration);
            wheel.spin_inertia_kg_m2 * relative + friction
        };
        (ends[0], model.wheels().iter().enumerate().map(of_wheel).collect())
    });
    let (time_s, value) = torques.unzip();
    Series { time_s, value }
}

#[cfg(test)]
mod tests;
