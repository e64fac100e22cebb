//! Smoothed speeds against the truth.

use super::*;

fn noise(k: usize) -> f64 {
    // Uniform of variance 1: fractions of multiples of the golden ratio, shuffled by a square.
    let u = ((k * k) as f64 * 0.618_033_988_75 + k as f64 * 0.414_213_562).fract();
    12f64.sqrt() * (u - 0.5)
}

fn recorded(step_s: f64, speed: &dyn Fn(f64) -> f64, stddev: f64) -> Recording {
    let time_s: Vec<f64> = (0..4000).map(|k| step_s * f64::from(k)).collect();
    let value = time_s.iter().enumerate().map(|(k, t)| vec![speed(*t) + stddev * noise(k)]).collect();
    Recording { wheel_speed_rad_s: Series { time_s, value }, ..Recording::default() }
}

/// A slow swing far below the digits of its reading, jumps of the torque, and a ramp.
#[test]
fn what_is_smoothed_is_closer_to_the_truth_than_readings_are() {
    let swing = |t: f64| 0.4 * t.sin();
    let jumps = |t: f64| 5.0 * ((t + 2.5).rem_euclid(10.0) - 5.0).abs();
    let ramp = |t: f64| 50.0 + 2.0 * t;
    for (speed, better) in [(&swing as &dyn Fn(f64) -> f64, 4.0), (&jumps, 1.5), (&ramp, 10.0)] {
        let run = recorded(0.01, speed, 0.05);
        let found = DrivenSpeeds::of(&run);
        let squares: f64 = run
            .wheel_speed_rad_s
            .time_s
            .iter()
            .zip(&found.speed_rad_s.value)
            .map(|(t, found)| (found[0] - speed(*t)).powi(2))
            .sum();
        let error = (squares / 4000.0).sqrt();
        assert!(error < 0.05 / better, "{error} {better}");
        assert!((found.noise_root[0] / (0.05 * 0.1) - 1.0).abs() < 0.1, "{}", found.noise_root[0]);
    }
}

#[test]
fn numbers_that_are_none_and_constants_do_no_harm() {
    let mut run = recorded(0.01, &|t| 0.4 * t.sin(), 0.05);
    for k in 100..200 {
        run.wheel_speed_rad_s.value[k][0] = f64::NAN;
    }
    let found = DrivenSpeeds::of(&run);
    for (t, speed) in run.wheel_speed_rad_s.time_s.iter().zip(&found.speed_rad_s.value) {
        assert!((speed[0] - 0.4 * t.sin()).abs() < 0.06, "{t} {}", speed[0]);
    }
    let still = DrivenSpeeds::of(&recorded(0.01, &|_| 3.0, 0.0));
    assert!(still.speed_rad_s.value.iter().all(|speed| (speed[0] - 3.0).abs() < 1e-6));
    assert!(still.noise_root[0] < 1e-6);
    assert_eq!(DrivenSpeeds::of(&Recording::default()).noise_root.len(), 0);
}

/// A wheel that accelerates at 2 rad/s^2 on a body that accelerates at 0.1 rad/s^2 about its axis.
#[test]
fn torque_is_inertia_times_acceleration_in_space_and_friction() {
    let mut model = PlatformModel::whorl_1_reference();
    model.wheels_mut().truncate(1);
    let wheel = &mut model.wheels_mut()[0];
    (wheel.spin_inertia_kg_m2, wheel.viscous_friction_n_m_s, wheel.coulomb_friction_n_m) = (0.02, 1e-4, 1e-3);
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
