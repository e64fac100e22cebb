//! Recordings that cannot be used are refused with a sentence that helps.

use nalgebra::Vector3;
use whorl_recording::{Mounting, Recording};

use super::generator::{Manoeuvre, platform, record};
use crate::{Needs, Refusal, Why, check};

const NEEDS: Needs = Needs { shortest_s: 5.0, free: false, accelerometer: false };

fn good() -> Recording {
    record(&platform(), &Manoeuvre { duration_s: 8.0, ..Manoeuvre::default() })
}

fn refused(change: impl Fn(&mut Recording)) -> Refusal {
    let mut recording = good();
    change(&mut recording);
    check(&recording, &platform(), &NEEDS).unwrap_err()
}

#[test]
fn a_good_recording_is_accepted_and_needs_are_kept() {
    let (recording, model) = (good(), platform());
    assert_eq!(check(&recording, &model, &NEEDS), Ok(()));
    let long = Needs { shortest_s: 10.0, ..NEEDS };
    let refusal = check(&recording, &model, &long).unwrap_err();
    assert!(matches!(refusal, Refusal { why: Why::TooShort(_, 10.0), .. }), "{refusal}");
    let blind = Recording { specific_force_b_m_s2: Default::default(), ..recording.clone() };
    assert_eq!(check(&blind, &model, &NEEDS), Ok(()));
    let refusal = check(&blind, &model, &Needs { accelerometer: true, ..NEEDS }).unwrap_err();
    assert!(matches!(refusal, Refusal { why: Why::Missing("accelerometer", _), .. }), "{refusal}");
    let bench = Recording { mounting: Mounting::Clamped, ..recording };
    assert_eq!(check(&bench, &model, &NEEDS), Ok(()));
    let refusal = check(&bench, &model, &Needs { free: true, ..NEEDS }).unwrap_err();
    assert!(matches!(refusal, Refusal { why: Why::Clamped, .. }), "{refusal}");
}

#[test]
fn what_is_wrong_is_said() {
    let text = |change: fn(&mut Recording)| refused(change).to_string();
    assert!(text(|r| r.gyro_b_rad_s = Default::default()).contains("gyro"));
    assert!(text(|r| r.gyro_b_rad_s.value.iter_mut().for_each(|w| *w *= 1146.0)).contains("deg/s"));
    assert!(
        text(|r| r.gyro_b_rad_s.value.iter_mut().for_each(|w| w.y = 0.1)).contains("y axis never changes")
    );
    let force: fn(&mut Recording, fn(&mut Vector3<f64>)) =
        |r, change| r.specific_force_b_m_s2.value.iter_mut().for_each(change);
    assert!(refused(|r| force(r, |f| *f /= 9.81)).to_string().contains("(g or m/s^2)"));
    assert!(refused(|r| force(r, |f| *f = -*f)).to_string().contains("points up at rest"));
    assert!(refused(|r| force(r, |f| *f = Vector3::z() * 9.81)).to_string().contains("frozen"));
    assert!(text(|r| r.wheel_speed_rad_s.value.iter_mut().for_each(|w| w.truncate(2))).contains("2 wheels"));
    assert!(text(|r| r.jet_pulses.truncate(1)).contains("1 jets in the data, 12 in the model"));
    let bench = |r: &mut Recording| {
        r.mounting = Mounting::Clamped;
        r.wheel_torque_command_n_m = Default::default();
    };
    assert!(matches!(refused(bench), Refusal { why: Why::Missing("wheel torque command", _), .. }));
}
