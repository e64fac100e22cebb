//! Whether a controller was running.

use whorl_dynamics::PlatformModel;
use whorl_recording::Recording;

/// Fewest samples that are worth a correlation.
const LEAST: usize = 500;

/// Whether changes of the wheels' commands follow changes of the gyro's readings sample by sample: these are mostly
/// noise, to which only a controller responds.
pub(crate) fn answers_gyro(recording: &Recording, model: &PlatformModel, least_correlation: f64) -> bool {
    let (gyro, commands) = (&recording.gyro_b_rad_s, &recording.wheel_torque_command_n_m);
    // The reading that a command may have known.
    let latest = |time_s: f64| gyro.time_s.partition_point(|t| *t <= time_s + 1e-6).checked_sub(1);
    model.wheels().iter().enumerate().any(|(j, wheel)| {
        let (mut product, mut of_command, mut of_gyro, mut count) = (0.0, 0.0, 0.0, 0);
        for (times, values) in commands.time_s.windows(2).zip(commands.value.windows(2)) {
            let ([t0, t1], [u0, u1]) = (times, values) else { continue };
            let (Some(a), Some(b)) = (latest(*t0), latest(*t1)) else { continue };
            let (Some(g0), Some(g1), Some(u0), Some(u1)) =
                (gyro.value.get(a), gyro.value.get(b), u0.get(j), u1.get(j))
            else {
                continue;
            };
            let (du, dg) = (u1 - u0, wheel.spin_axis_b.dot(&(g1 - g0)));
            product += du * dg;
            of_command += du * du;
            of_gyro += dg * dg;
            count += 1;
        }
        count >= LEAST
            && product.abs() > least_correlation * (of_command * of_gyro).sqrt().max(f64::MIN_POSITIVE)
    })
}

#[cfg(test)]
mod tests {
    use nalgebra::Vector3;
    use rand_distr::{Distribution, StandardNormal};
    use rand_pcg::Pcg64;
    use whorl_dynamics::PlatformModel;
    use whorl_recording::{Recording, Series};

    use super::answers_gyro;

    /// Noise on the gyro, and a torque that answers a share of it.
    fn recording(share: f64) -> Recording {
        let mut random = Pcg64::new(3, 0);
        let mut noise = || -> f64 { StandardNormal.sample(&mut random) };
        let time_s: Vec<f64> = (0..4000).map(|i| 0.01 * f64::from(i)).collect();
        let rates: Vec<Vector3<f64>> =
            time_s.iter().map(|_| Vector3::new(noise(), noise(), noise())).collect();
        let torques = rates.iter().map(|w| vec![share * w.x + (1.0 - share) * noise(), 0.0, 0.0]).collect();
        Recording {
            gyro_b_rad_s: Series { time_s: time_s.clone(), value: rates },
            wheel_torque_command_n_m: Series { time_s, value: torques },
            ..Recording::default()
        }
    }

    #[test]
    fn a_controller_shows_by_its_answers_to_noise() {
        let model = PlatformModel::whorl_1_reference();
        assert!(answers_gyro(&recording(0.3), &model, 0.1));
        assert!(answers_gyro(&recording(-0.3), &model, 0.1));
        assert!(!answers_gyro(&recording(0.0), &model, 0.1));
        assert!(!answers_gyro(&Recording::default(), &model, 0.1));
    }
}
