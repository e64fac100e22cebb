//! Gradients by levels against differences of log p.

use nalgebra::Vector3;
use whorl_dynamics::platform::TiltLimit;
use whorl_dynamics::{InitialState, Plant, PlatformModel};
use whorl_recording::Recording;

use super::scores::Level;
use super::*;
use crate::settings::Settings;

/// A platform whose wheels work, at 50 Hz.
fn recording(model: &PlatformModel) -> Recording {
    let start = InitialState { omega_wb_b_rad_s: Vector3::new(0.02, -0.03, 0.1), ..InitialState::default() };
    let mut plant = Plant::new(model, &start, 1).unwrap();
    let mut r = Recording { name: "at work".to_owned(), ..Recording::default() };
    for k in 0..300 {
        let (t, now_ns) = (f64::from(k) * 0.02, i64::from(k) * 20_000_000);
        plant.advance_to(now_ns).unwrap();
        let imu = plant.sample_imu();
        r.gyro_b_rad_s.time_s.push(t);
        r.gyro_b_rad_s.value.push(imu.angular_velocity_rad_s);
        r.specific_force_b_m_s2.time_s.push(t);
        r.specific_force_b_m_s2.value.push(imu.specific_force_m_s2);
        if k % 3 == 0 {
            r.wheel_speed_rad_s.time_s.push(t);
            r.wheel_speed_rad_s
                .value
                .push(plant.sample_wheels().iter().map(|wheel| wheel.speed_rad_s).collect());
        }
        let torque: Vec<f64> = (0..3).map(|j| 0.1 * ((0.3 + 0.2 * f64::from(j)) * t).sin()).collect();
        plant.command_wheels(&torque).unwrap();
        r.wheel_torque_command_n_m.time_s.push(t);
        r.wheel_torque_command_n_m.value.push(torque);
    }
    r
}

fn log_p(case: &Prepared<'_>, noise: &Noise, start: &Start) -> f64 {
    Filter::new(case, noise, start).about_known_biases(start).run(usize::MAX, &mut |_| {}).log
}

#[test]
fn gradients_by_levels_are_differences_of_log_p() {
    // It swings freely: a stop is no small change.
    let model = PlatformModel { tilt_limit: TiltLimit::NONE, ..PlatformModel::whorl_1_reference() };
    let recording = recording(&model);
    let case = Prepared::new(&recording, &model, Settings::default()).unwrap();
    let body = [(0.3, 2e-3), (30.0, 5e-3)]
        .map(|(correlation_s, x)| RandomTorque { stddev_b_n_m: [x, 2.0 * x, 0.5 * x], correlation_s });
    let disturbance =
        Disturbance { body: body.to_vec(), motors_n_m: vec![1e-3, 2e-3, 0.0], motors_correlation_s: 1.0 };
    let noise = Noise { disturbance, ..Noise::stated(&case).unwrap() };
    let start = fitted_start_within(&case, &noise, usize::MAX).start.with_levels(&case, &noise);
    let levels = Level::all(&case, &noise);
    let (scores, log) =
        climb::scored(&case, &noise, &start, &levels, usize::MAX, f64::NEG_INFINITY, false).unwrap();
    assert_eq!(levels.len(), 6 + 2 + 7);
    assert!((log - log_p(&case, &noise, &start)).abs() < 1e-9);
    for (i, level) in levels.iter().enumerate() {
        let log_with = |by: f64| {
            let mut other = noise.clone();
            level.set(&mut other, level.stddev(&noise) * (0.5 * by).exp());
            log_p(&case, &other, &start.with_levels(&case, &other))
        };
        let step = 1e-2;
        let difference = (log_with(step) - log_with(-step)) / (2.0 * step);
        let gradient = scores.squares[i] - scores.expected[i];
        let size = scores.squares[i].max(scores.expected[i]);
        assert!((gradient - difference).abs() < 1e-2 * size, "{level:?}: {gradient} {difference} {size}");
        assert!(size > 1e-3, "{level:?} shows");
    }
    // Information is that of squares that follow from the same series.
    let information = &scores.information;
    assert!((information - information.transpose()).amax() < 1e-12 * information.amax());
    assert!(nalgebra::Cholesky::new(information.clone()).is_some());
}

/// Tables of the distribution: 99.9 % quantiles of chi-squared.
#[test]
fn what_chance_brings_is_half_the_quantile_of_the_table() {
    for (degrees, quantile) in [(1, 10.828), (2, 13.816), (6, 22.458), (12, 32.909)] {
        let found = by_chance_nats(degrees, 3.0902);
        assert!((found - 0.5 * quantile).abs() < 0.02 * quantile, "{degrees}: {found}");
    }
}
