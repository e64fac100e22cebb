//! What is left of a run that touches its stop.

use nalgebra::Vector3;
use whorl_dynamics::PlatformModel;
use whorl_recording::Recording;

use crate::identification::contact::*;

/// Hanging still but for a touch from 40 s to 41 s.
#[test]
fn a_touch_is_left_out_with_its_margins() {
    let model = PlatformModel::whorl_1_reference();
    let mut run = Recording { name: "run".to_owned(), ..Recording::default() };
    for k in 0..10_000 {
        let t = f64::from(k) * 0.01;
        let tilt_rad: f64 = if (40.0..41.0).contains(&t) { 0.0875 } else { 0.02 };
        run.gyro_b_rad_s.time_s.push(t);
        run.gyro_b_rad_s.value.push(Vector3::zeros());
        run.specific_force_b_m_s2.time_s.push(t);
        run.specific_force_b_m_s2.value.push(Vector3::new(tilt_rad.sin(), 0.0, tilt_rad.cos()) * 9.81);
        run.wheel_torque_command_n_m.time_s.push(t);
        run.wheel_torque_command_n_m.value.push(vec![t, 0.0, 0.0]);
    }
    let (pieces, remark) = between_touches(&run, &model);
    let ends = |run: &Recording| {
        let times = &run.gyro_b_rad_s.time_s;
        (times[0], times[times.len() - 1])
    };
    let ends: Vec<(f64, f64)> = pieces.iter().map(ends).collect();
    assert_eq!(ends.len(), 2, "{ends:?}");
    assert!((ends[0].1 - 39.7).abs() < 0.02 && (ends[1].0 - 41.3).abs() < 0.02, "{ends:?}");
    assert!(remark.as_ref().unwrap().contains("1.6 s at the stop"), "{remark:?}");
    // The command that holds when the second piece begins is its first.
    let held = pieces[1].wheel_torque_command_n_m.value[0][0];
    assert!((held - 41.3).abs() < 0.02, "{held}");
    // A rig without a stop is not cut.
    let mut free = model.clone();
    free.tilt_limit = whorl_dynamics::platform::TiltLimit::NONE;
    assert_eq!(between_touches(&run, &free), (vec![run.clone()], None));
}
