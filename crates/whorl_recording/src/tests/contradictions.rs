//! Channels that contradict each other, from a motion in closed form.

use nalgebra::{Unit, Vector3};

use super::whorl_1;
use crate::{Recording, Series, VectorChannel};

/// Half a minute of yaw swings at 0.05 rad/s, a vector sensor that looks east, a wheel that drives the swing.
fn swinging() -> Recording {
    let spin_inertia = whorl_1().model.wheels()[2].spin_inertia_kg_m2;
    let (amplitude, omega) = (0.2_f64, 0.25_f64);
    let mut recording = Recording::default();
    let mut vector = Series::default();
    for k in 0..3000 {
        let t = f64::from(k) * 0.01;
        // A noise that is never twice the same.
        let noise = 1e-3 * (f64::from(k) * 12.9898).sin();
        let yaw = amplitude * (omega * t).sin();
        let rate = amplitude * omega * (omega * t).cos();
        recording.gyro_b_rad_s.time_s.push(t);
        recording.gyro_b_rad_s.value.push(Vector3::new(noise, -noise, rate + noise));
        recording.specific_force_b_m_s2.time_s.push(t);
        recording.specific_force_b_m_s2.value.push(Vector3::new(noise, noise, 9.81 + noise));
        if k % 10 == 0 {
            vector.time_s.push(t);
            vector.value.push(Vector3::new(yaw.cos(), -yaw.sin(), noise));
        }
        // J dOmega/dt = u; the body's moment of inertia sets how fast the wheel turns, here 10 kg m^2.
        let speed = -10.0 * rate / spin_inertia;
        let torque = 10.0 * amplitude * omega * omega * (omega * t).sin();
        recording.wheel_speed_rad_s.time_s.push(t);
        recording.wheel_speed_rad_s.value.push(vec![0.0, 0.0, speed]);
        recording.wheel_torque_command_n_m.time_s.push(t);
        recording.wheel_torque_command_n_m.value.push(vec![0.0, 0.0, torque]);
    }
    let reference_world = Unit::new_unchecked(Vector3::x());
    recording.vectors = vec![VectorChannel { reference_world, direction_b: vector }];
    recording
}

fn said(change: impl Fn(&mut Recording)) -> String {
    let mut recording = swinging();
    change(&mut recording);
    recording.contradictions(Some(&whorl_1().model)).join(" ")
}

fn scaled(series: &mut Series<Vector3<f64>>, factor: f64) {
    series.value.iter_mut().for_each(|v| *v *= factor);
}

#[test]
fn a_sound_recording_does_not_contradict_itself() {
    assert_eq!(said(|_| {}), "");
    // Nor does a poor one: a scale error of half, a hundredfold noise, no vector sensor.
    assert_eq!(said(|r| scaled(&mut r.gyro_b_rad_s, 1.5)), "");
    assert_eq!(said(|r| r.vectors.clear()), "");
    let noisy = |r: &mut Recording| {
        for (k, v) in r.gyro_b_rad_s.value.iter_mut().enumerate() {
            *v += Vector3::repeat(0.1 * (k as f64 * 78.233).sin());
        }
    };
    assert_eq!(said(noisy), "");
}

#[test]
fn a_gyro_in_the_wrong_unit_is_told_by_the_vector_sensor() {
    let degree = std::f64::consts::PI / 180.0;
    let text = said(|r| scaled(&mut r.gyro_b_rad_s, degree));
    assert!(text.contains("turns 57 times as far as the gyro says"), "{text}");
    let text = said(|r| scaled(&mut r.gyro_b_rad_s, 1.0 / degree));
    assert!(text.starts_with("The gyro says that the platform turns"), "{text}");
    let text = said(|r| scaled(&mut r.gyro_b_rad_s, -1.0));
    assert!(text.contains("opposite senses"), "{text}");
}

#[test]
fn gaps_are_told() {
    assert_eq!(swinging().gaps(), None);
    let mut recording = swinging();
    for times in [500..520, 2000..2031] {
        let gyro = &mut recording.gyro_b_rad_s;
        gyro.time_s.drain(times.clone());
        gyro.value.drain(times);
    }
    let text = recording.gaps().unwrap();
    assert!(text.contains("2 gaps in its readings, the longest of 0.32 s"), "{text}");
}

#[test]
fn a_frozen_sensor_and_a_wrong_time_are_told() {
    let text = said(|r| r.gyro_b_rad_s.value.iter_mut().for_each(|v| v.z = 0.01));
    assert!(text.contains("all 3000 samples (z)"), "{text}");
    let faster = |series: &mut Series<Vector3<f64>>| series.time_s.iter_mut().for_each(|t| *t *= 1e-3);
    let text = said(|r| faster(&mut r.gyro_b_rad_s));
    assert!(text.contains("3000 readings within 0.030 s are 100 kHz"), "{text}");
    let slower = |series: &mut Series<Vector3<f64>>| series.time_s.iter_mut().for_each(|t| *t *= 1e3);
    let text = said(|r| slower(&mut r.gyro_b_rad_s));
    assert!(text.contains("Readings come every 10 s: is the time's unit right?"), "{text}");
}

#[test]
fn wheel_speeds_in_turns_a_minute_are_told_by_the_torque() {
    let text =
        said(|r| r.wheel_speed_rad_s.value.iter_mut().for_each(|v| v[2] *= 30.0 / std::f64::consts::PI));
    assert!(text.starts_with("wheel_z changes its speed 9.5"), "{text}");
    let text = said(|r| r.wheel_torque_command_n_m.value.iter_mut().for_each(|v| v[2] *= 1e3));
    assert!(text.starts_with("wheel_z changes its speed 0.00 times"), "{text}");
}
