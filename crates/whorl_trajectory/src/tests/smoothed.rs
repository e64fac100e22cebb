//! The smoothed motion against the truth.

use whorl_dynamics::Gyrostat;

use super::generator::{Manoeuvre, platform, record};
use crate::commands::Commands;
use crate::smoothing::smooth;

#[test]
fn the_smoothed_motion_is_the_true_one_to_a_tenth_of_the_noise() {
    let model = platform();
    let recording = record(&model, &Manoeuvre::default());
    let gyrostat = Gyrostat::new(&model).unwrap();
    let commands = Commands::of(&recording, &gyrostat);
    let motion = smooth(&recording, &gyrostat, &commands);
    let truth = recording.truth.as_ref().unwrap();
    let (mut turn, mut tilt, mut rate, mut count) = (0.0, 0.0, 0.0, 0.0);
    for k in (0..truth.q_world_body.len()).step_by(37) {
        let t = truth.q_world_body.time_s[k];
        let found = motion.at(t);
        turn += found.q_world_body.angle_to(&truth.q_world_body.value[k]).powi(2);
        let up = whorl_math::vertical_b(&found.q_world_body)
            - whorl_math::vertical_b(&truth.q_world_body.value[k]);
        tilt += up.norm_squared();
        rate += (found.omega_wb_b_rad_s - truth.omega_wb_b_rad_s.value[k]).norm_squared() / 3.0;
        count += 1.0;
    }
    let (turn, tilt, rate) = (f64::sqrt(turn / count), f64::sqrt(tilt / count), f64::sqrt(rate / count));
    // The accelerometer's bias of 0.01 m/s^2 (1 mrad) limits the accuracy of tilt.
    assert!(tilt < 1.5e-3, "{tilt}");
    assert!(turn < 3e-3, "{turn}");
    // 1.7e-3 rad/s a sample, a hundred averaged.
    assert!(rate < 0.15 * 1.7e-3, "{rate}");
    assert!(
        motion.attitude.tilt_stddev_rad > 0.3 * tilt / f64::sqrt(2.0),
        "{}",
        motion.attitude.tilt_stddev_rad
    );
    assert!(motion.attitude.heading_measured);
}

#[test]
fn without_vector_sensor_heading_starts_at_zero_and_that_is_known() {
    let model = platform();
    let mut recording = record(&model, &Manoeuvre { duration_s: 20.0, ..Manoeuvre::default() });
    recording.vectors.clear();
    let gyrostat = Gyrostat::new(&model).unwrap();
    let commands = Commands::of(&recording, &gyrostat);
    let motion = smooth(&recording, &gyrostat, &commands);
    assert!(!motion.attitude.heading_measured);
    assert!(whorl_math::azimuth_rad(&motion.at(0.0).q_world_body).abs() < 5e-3);
}

/// A gyro bias of 0.2 deg/s turns by 12 deg in a minute: beyond the bearing's limit of 5 deg.
#[test]
fn without_an_accelerometer_the_platform_is_taken_to_stay_about_balance() {
    let mut model = platform();
    model.tilt_limit = whorl_dynamics::platform::TiltLimit::Cone { max_rad: 0.0873 };
    let manoeuvre = Manoeuvre { rate_rad_s: nalgebra::Vector3::zeros(), ..Manoeuvre::default() };
    let mut recording = record(&platform(), &manoeuvre);
    recording.gyro_b_rad_s.value.iter_mut().for_each(|w| w.x += 3.5e-3);
    let gyrostat = Gyrostat::new(&model).unwrap();
    let smoothed = |r: &whorl_recording::Recording| smooth(r, &gyrostat, &Commands::of(r, &gyrostat));
    let full = smoothed(&recording).attitude.gyro_bias_rad_s;
    recording.specific_force_b_m_s2 = whorl_recording::Series::default();
    recording.vectors.clear();
    let motion = smoothed(&recording);
    assert!(!motion.attitude.tilt_measured);
    for t in [0.0, 30.0, 59.0] {
        let tilt = whorl_math::vertical_b(&motion.at(t).q_world_body).z.acos();
        assert!(tilt < 0.12, "{t} s: {tilt}");
    }
    // Most of the bias across the vertical is estimated: twice the tilt limit over a minute.
    let error = (motion.attitude.gyro_bias_rad_s - full).xy().norm();
    assert!(error < 2.0 * 0.0873 / 60.0 && full.x > 5e-3, "{error} {full:?}");
}
