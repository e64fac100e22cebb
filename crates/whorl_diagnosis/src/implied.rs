//! Wheel torques of a recording that has none: from the speeds.

use nalgebra::Vector3;
use whorl_dynamics::PlatformModel;
use whorl_recording::{Recording, Series};

use crate::bins::median_step_s;

/// Half of the stretch over which a speed's slope is taken \[s\]: shorter than the platform's motion, long
/// enough for a tachometer's noise.
const HALF_S: f64 = 0.03;

/// The torques that the wheels' motors must have given for the speeds that were measured:
/// u = J (dOmega/dt + a . domega/dt) + friction, with the model's friction \[N m\]. They stand in for the
/// commands where an acceleration is needed (an accelerometer off the centre of rotation feels it); what they
/// are worth as knowledge of the torque is left to the filter's process noise.
pub(crate) fn implied_wheel_torques(recording: &Recording, model: &PlatformModel) -> Series<Vec<f64>> {
    let speeds = &recording.wheel_speed_rad_s;
    let half_s = HALF_S.max(2.5 * median_step_s(&speeds.time_s));
    let body = slopes(&recording.gyro_b_rad_s, &speeds.time_s, half_s, 3, |w, i| w[i]);
    let wheels =
        slopes(speeds, &speeds.time_s, half_s, model.wheels().len(), |s, j| s.get(j).copied().unwrap_or(0.0));
    let value = speeds
        .value
        .iter()
        .zip(body.iter().zip(&wheels))
        .map(|(speed, (body, slope))| {
            let acceleration = Vector3::from_fn(|i, _| body.get(i).copied().unwrap_or(0.0));
            model
                .wheels()
                .iter()
                .zip(speed.iter().zip(slope))
                .map(|(wheel, (speed, slope))| {
                    let relative = slope + wheel.spin_axis_b.dot(&acceleration);
                    let friction = wheel.viscous_friction_n_m_s * speed
                        + wheel.coulomb_friction_n_m * speed.clamp(-1.0, 1.0);
                    wheel.spin_inertia_kg_m2 * relative + friction
                })
                .collect()
        })
        .collect();
    // A torque holds from its stamp on: half a step early, so that it is centred.
    let early_s = 0.5 * median_step_s(&speeds.time_s);
    Series { time_s: speeds.time_s.iter().map(|t| t - early_s).collect(), value }
}

/// Least-squares slopes of a series' components within `half_s` of each time; zero where there are fewer than
/// two samples.
fn slopes<T>(
    series: &Series<T>,
    times_s: &[f64],
    half_s: f64,
    size: usize,
    component: impl Fn(&T, usize) -> f64,
) -> Vec<Vec<f64>> {
    times_s
        .iter()
        .map(|t| {
            let from = series.time_s.partition_point(|s| *s < t - half_s);
            let to = series.time_s.partition_point(|s| *s <= t + half_s);
            let near = || {
                let times = series.time_s.get(from..to).unwrap_or_default();
                times.iter().zip(series.value.get(from..to).unwrap_or_default())
            };
            let count = near().count();
            let mean_s = near().map(|(s, _)| s).sum::<f64>() / count.max(1) as f64;
            let spread: f64 = near().map(|(s, _)| (s - mean_s).powi(2)).sum();
            (0..size)
                .map(|i| {
                    let moment: f64 = near().map(|(s, v)| (s - mean_s) * component(v, i)).sum();
                    if count > 1 && spread > 0.0 { moment / spread } else { 0.0 }
                })
                .collect()
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use nalgebra::Vector3;
    use whorl_dynamics::PlatformModel;
    use whorl_recording::{Recording, Series};

    use super::implied_wheel_torques;

    /// A wheel that speeds up by 2 rad/s2 on a body that turns faster by 0.1 rad/s2 about it.
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
        let torque = implied_wheel_torques(&recording, &model);
        let (t, u) = (torque.time_s[100], torque.value[100][0]);
        assert!((t - 0.995).abs() < 1e-9);
        assert!((u - (0.02 * 2.1 + 1e-4 * 52.0 + 1e-3)).abs() < 1e-9, "{u}");
    }
}
