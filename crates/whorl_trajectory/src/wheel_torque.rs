//! Wheel torques derived from the speeds, for recordings without torques.

use nalgebra::Vector3;
use whorl_dynamics::PlatformModel;
use whorl_recording::{Recording, Series};

use crate::line::local_line;
use crate::noise::typical_step_s;

/// Half of the stretch over which a speed's slope is fitted \[s\]: short compared with the platform's motion, long
/// enough to average the tachometer's noise.
const HALF_S: f64 = 0.03;

/// Motor torques of the wheels that explain their measured speeds \[N m\]:
///
/// ```text
/// u = J (dOmega/dt + a . domega/dt) + friction
/// ```
///
/// with the model's spin inertia J, axis a and friction, and the accelerations of wheel and body from straight lines
/// through neighbouring samples. They replace the commands where those were not recorded.
#[must_use]
pub fn from_speeds(recording: &Recording, model: &PlatformModel) -> Series<Vec<f64>> {
    let speeds = &recording.wheel_speed_rad_s;
    let gyro = &recording.gyro_b_rad_s;
    let step_s = typical_step_s(&speeds.time_s);
    let half_s = HALF_S.max(2.5 * step_s);
    let torque_at = |(t, speed): (&f64, &Vec<f64>)| -> Vec<f64> {
        let rate = |k: usize| gyro.value.get(k).copied().unwrap_or_default();
        let acceleration = local_line(&gyro.time_s, rate, *t, half_s).map_or(Vector3::zeros(), |l| l.slope);
        let of_wheel = |(j, wheel): (usize, &whorl_dynamics::platform::Wheel)| {
            let at = |k: usize| speeds.value.get(k).and_then(|s| s.get(j)).copied().unwrap_or(0.0);
            let slope = local_line(&speeds.time_s, at, *t, half_s).map_or(0.0, |l| l.slope);
            let speed = speed.get(j).copied().unwrap_or(0.0);
            let relative = slope + wheel.spin_axis_b.dot(&acceleration);
            let friction =
                wheel.viscous_friction_n_m_s * speed + wheel.coulomb_friction_n_m * speed.clamp(-1.0, 1.0);
            wheel.spin_inertia_kg_m2 * relative + friction
        };
        model.wheels().iter().enumerate().map(of_wheel).collect()
    };
    let value = speeds.time_s.iter().zip(&speeds.value).map(torque_at).collect();
    // A torque holds from its stamp on, so the stamp is half a step early to centre it.
    Series { time_s: speeds.time_s.iter().map(|t| t - 0.5 * step_s).collect(), value }
}

#[cfg(test)]
mod tests {
    use nalgebra::Vector3;
    use whorl_dynamics::PlatformModel;
    use whorl_recording::{Recording, Series};

    use super::from_speeds;

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
        let torque = from_speeds(&recording, &model);
        let (t, u) = (torque.time_s[100], torque.value[100][0]);
        assert!((t - 0.995).abs() < 1e-9);
        assert!((u - (0.02 * 2.1 + 1e-4 * 52.0 + 1e-3)).abs() < 1e-9, "{u}");
    }
}
