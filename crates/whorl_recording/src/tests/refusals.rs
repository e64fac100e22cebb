//! Recordings that cannot be used are refused with a sentence that helps.

use nalgebra::Vector3;
use whorl_dynamics::PlatformModel;

use super::whorl_1;
use crate::{Mounting, Needs, Recording, Refusal, Series, Why, check};

const NEEDS: Needs = Needs { shortest_s: 5.0, free: false, accelerometer: false };

fn platform() -> PlatformModel {
    whorl_1().model
}

/// Eight seconds of a platform that stands upright and nods a little, with sensors that are never quite still.
fn good() -> Recording {
    let model = platform();
    let time_s: Vec<f64> = (0..800).map(|k| f64::from(k) * 0.01).collect();
    let of = |value: fn(f64) -> Vector3<f64>| Series {
        value: time_s.iter().map(|t| value(*t)).collect(),
        time_s: time_s.clone(),
    };
    let wheels =
        |x: f64| Series { value: vec![vec![x; model.wheels().len()]; time_s.len()], time_s: time_s.clone() };
    Recording {
        gyro_b_rad_s: of(|t| 0.05 * Vector3::new((3.0 * t).sin(), (2.0 * t).cos(), t.sin())),
        specific_force_b_m_s2: of(|t| Vector3::new(0.1 * (3.0 * t).cos(), 0.1 * t.sin(), 9.81)),
        wheel_speed_rad_s: wheels(10.0),
        wheel_torque_command_n_m: wheels(0.01),
        jet_pulses: vec![Vec::new(); model.jets().len()],
        ..Recording::default()
    }
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
