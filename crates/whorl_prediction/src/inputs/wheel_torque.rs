//! Wheel torques derived from the speeds, for recordings without torques.

use nalgebra::Vector3;
use whorl_dynamics::PlatformModel;
use whorl_dynamics::effects::{Need, find};
use whorl_recording::{Recording, Series};

use crate::inputs::driven_speeds::DrivenSpeeds;
use whorl_math::line::local_line;

/// Half of the stretch over which the slope of the body's rate is fitted \[s\]: short compared with the platform's motion.
const HALF_S: f64 = 0.03;
/// Factor to a motor's limit that no torque with a tachometer's noise reaches.
const FAR_BEYOND: f64 = 1e3;

/// Whether the wheels of a recording are driven along their measured speeds: their torques were not recorded.
#[must_use]
pub fn go_along_speeds(recording: &Recording) -> bool {
    recording.wheel_torque_command_n_m.is_empty() && !recording.wheel_speed_rad_s.is_empty()
}

/// A model whose wheels go as their speeds were measured: friction, motors and their limits show in the speeds already. Effects of motors are those
/// that need the commands of wheels to show.
#[must_use]
pub fn along_speeds(model: &PlatformModel) -> PlatformModel {
    let mut model = model.clone();
    for wheel in model.wheels_mut() {
        (wheel.viscous_friction_n_m_s, wheel.coulomb_friction_n_m) = (0.0, 0.0);
        wheel.max_torque_n_m *= FAR_BEYOND;
    }
    model.effects.retain(|id, _| !find(id).is_some_and(|effect| is_of_motors(effect.evidence())));
    model
}

/// Whether nothing but commands of wheels shows it.
fn is_of_motors(evidence: &[&[Need]]) -> bool {
    !evidence.is_empty() && evidence.iter().all(|needs| needs.contains(&Need::WheelCommands))
}

/// Motor torques of the wheels that explain their measured speeds \[N m\], u = J (dOmega/dt + a . domega/dt) + friction with the model's spin inertia J,
/// axis a and friction. Each holds from one speed to the next and turns the wheel from the one into the other, so that over any time the momentum
/// that the wheel gives the body has the noise of two speeds, and no more.
#[must_use]
pub fn from_speeds(recording: &Recording, speeds: &DrivenSpeeds, model: &PlatformModel) -> Series<Vec<f64>> {
    let (gyro, speeds) = (&recording.gyro_b_rad_s, &speeds.speed_rad_s);
    let rate = |k: usize| gyro.value.get(k).copied().unwrap_or_default();
    let stretches = speeds.time_s.windows(2).zip(speeds.value.windows(2));
    let stretches = stretches.filter(|(ends, _)| ends[1] > ends[0]);
    let torques = stretches.map(|(ends, speeds)| {
        let (middle_s, length_s) = (0.5 * (ends[0] + ends[1]), ends[1] - ends[0]);
        let acceleration =
            local_line(&gyro.time_s, rate, middle_s, HALF_S).map_or(Vector3::zeros(), |l| l.slope);
        let of_wheel = |(j, wheel): (usize, &whorl_dynamics::platform::Wheel)| {
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
mod tests {
    use nalgebra::Vector3;
    use whorl_dynamics::PlatformModel;
    use whorl_recording::{Recording, Series};

    use super::from_speeds;
    use crate::inputs::driven_speeds::DrivenSpeeds;

    /// A wheel that accelerates at 2 rad/s^2 on a body that accelerates at 0.1 rad/s^2 about its axis.
    #[test]
    fn torque_is_inertia_times_acceleration_in_space_and_friction() {
        let mut model = PlatformModel::whorl_1_reference();
        model.wheels_mut().truncate(1);
        let wheel = &mut model.wheels_mut()[0];
        (wheel.spin_inertia_kg_m2, wheel.viscous_friction_n_m_s, wheel.coulomb_friction_n_m) =
            (0.02, 1e-4, 1e-3);
        let axis = wheel.spin_axis_b.into_inner();
        let time_s: Vec<f64> = (0..200).map(|i| 0.01 * f64::from(i)).collect();
        let rates: Vec<Vector3<f64>> = time_s.iter().map(|t| axis * (0.1 * t)).collect();
        let speeds = time_s.iter().map(|t| vec![50.0 + 2.0 * t]).collect();
        let recording = Recording {
            gyro_b_rad_s: Series { time_s: time_s.clone(), value: rates },
            wheel_speed_rad_s: Series { time_s, value: speeds },
            ..Recording::default()
        };
        let torque = from_speeds(&recording, &DrivenSpeeds::of(&recording), &model);
        let (t, u) = (torque.time_s[100], torque.value[100][0]);
        assert!((t - 1.0).abs() < 1e-9);
        assert!((u - (0.02 * 2.1 + 1e-4 * 52.01 + 1e-3)).abs() < 1e-6, "{u}");
    }
}
