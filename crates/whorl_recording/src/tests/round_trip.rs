//! Recordings survive the run directory and CSV.

use nalgebra::{Unit, UnitQuaternion, Vector3};
use proptest::prelude::*;
use whorl_bag::CsvMap;

use super::whorl_1;
use crate::{
    Mounting, OnInterval, ReadOptions, Recording, RunOrigin, Series, TrueMotion, VectorChannel, export_csv,
    platform_parts, read_csv, read_run, read_run_with, write_run,
};

/// Times to a nanosecond, values to rounding.
fn assert_same(a: &Recording, b: &Recording) {
    fn close(a: f64, b: f64) -> bool {
        (a - b).abs() <= 1e-12 * a.abs().max(1.0)
    }
    fn series<T>(what: &str, a: &Series<T>, b: &Series<T>, numbers: impl Fn(&T) -> Vec<f64>) {
        assert_eq!(a.len(), b.len(), "{what}");
        assert!(a.time_s.iter().zip(&b.time_s).all(|(a, b)| (a - b).abs() < 1e-9), "{what}");
        for (a, b) in a.value.iter().zip(&b.value) {
            let (a, b) = (numbers(a), numbers(b));
            assert!(
                a.len() == b.len() && a.iter().zip(&b).all(|(a, b)| close(*a, *b)),
                "{what}: {a:?} {b:?}"
            );
        }
    }
    let vector = |v: &Vector3<f64>| v.as_slice().to_vec();
    let list = |l: &Vec<f64>| l.clone();
    assert_eq!((&a.platform, a.mounting, a.closed_loop), (&b.platform, b.mounting, b.closed_loop));
    series("gyro", &a.gyro_b_rad_s, &b.gyro_b_rad_s, vector);
    series("force", &a.specific_force_b_m_s2, &b.specific_force_b_m_s2, vector);
    assert_eq!(a.vectors.len(), b.vectors.len());
    for (a, b) in a.vectors.iter().zip(&b.vectors) {
        assert!((a.reference_world.into_inner() - *b.reference_world).norm() < 1e-12);
        series("vector", &a.direction_b, &b.direction_b, vector);
    }
    series("wheel speed", &a.wheel_speed_rad_s, &b.wheel_speed_rad_s, list);
    series("wheel torque", &a.wheel_torque_command_n_m, &b.wheel_torque_command_n_m, list);
    series("wheel current", &a.wheel_current_a, &b.wheel_current_a, list);
    assert_eq!(a.jet_pulses.len(), b.jet_pulses.len());
    for (a, b) in a.jet_pulses.iter().zip(&b.jet_pulses) {
        assert_eq!(a.len(), b.len(), "{a:?} {b:?}");
        for (a, b) in a.iter().zip(b) {
            assert!((a.on_s - b.on_s).abs() < 2e-9 && (a.off_s - b.off_s).abs() < 2e-9, "{a:?} {b:?}");
        }
    }
    series("body torque", &a.body_torque_b_n_m, &b.body_torque_b_n_m, vector);
    series("ballast", &a.ballast_moment_b_n_m, &b.ballast_moment_b_n_m, vector);
    let one = |x: &f64| vec![*x];
    // A battery's message has 32 bits.
    series("voltage", &a.bus_voltage_v, &b.bus_voltage_v, |x| vec![f64::from(*x as f32)]);
    series("pressure", &a.tank_pressure_pa, &b.tank_pressure_pa, one);
    series("temperature", &a.temperature_k, &b.temperature_k, one);
    assert_eq!(a.truth.is_some(), b.truth.is_some());
    if let (Some(a), Some(b)) = (&a.truth, &b.truth) {
        series("attitude", &a.q_world_body, &b.q_world_body, |q| q.coords.as_slice().to_vec());
        series("true rate", &a.omega_wb_b_rad_s, &b.omega_wb_b_rad_s, vector);
    }
}

/// Out to a run directory and back, and out to CSV and back.
pub(super) fn survives(recording: &Recording) {
    let known = whorl_1();
    let directory = tempfile::tempdir().unwrap();
    let path = directory.path().join("run");
    write_run(recording, &known, &RunOrigin::default(), &path).unwrap();
    let read = read_run(&path, None).unwrap();
    assert_eq!(read.len(), 1);
    assert_same(recording, &read[0]);
    // Beside runs of another system, whose map names none of its topics.
    let map = directory.path().join("map.yaml");
    std::fs::write(&map, "bag:\n  ros__parameters:\n    gyro: {topic: /xsens/imu}\n").unwrap();
    let options = ReadOptions { channels: Some(&map), ..ReadOptions::default() };
    assert_same(recording, &read_run_with(&path, &options).unwrap()[0]);

    let parts = platform_parts(&known);
    let exported = export_csv(recording, &parts.wheels, &parts.jets, &directory.path().join("csv")).unwrap();
    let map = CsvMap::load_for(&exported.map, &parts).unwrap();
    let imported = read_csv(&exported.csv, &map, &known).unwrap();
    assert_eq!(imported.rows, exported.rows as u64);
    assert_same(recording, &imported.recording);
}

fn times(most: usize) -> impl Strategy<Value = Vec<f64>> {
    proptest::collection::vec(1_000_000i64..50_000_000, 0..most).prop_map(|steps| {
        let mut now = -1_000_000;
        let mut times = Vec::new();
        for step in steps {
            now += step;
            times.push(now as f64 * 1e-9);
        }
        times
    })
}

fn values<T: std::fmt::Debug>(
    value: impl Strategy<Value = T> + Clone,
    most: usize,
) -> impl Strategy<Value = Series<T>> {
    times(most).prop_flat_map(move |time_s| {
        let count = time_s.len();
        proptest::collection::vec(value.clone(), count)
            .prop_map(move |value| Series { time_s: time_s.clone(), value })
    })
}

fn vector() -> impl Strategy<Value = Vector3<f64>> + Clone {
    [-1e3..1e3, -1e-3..1e-3, -9.0..9.0f64].prop_map(Vector3::from)
}

fn direction() -> impl Strategy<Value = Vector3<f64>> + Clone {
    [0.1..1.0, -1.0..1.0, -1.0..1.0f64].prop_map(|v| Unit::new_normalize(Vector3::from(v)).into_inner())
}

fn list(count: usize) -> impl Strategy<Value = Vec<f64>> + Clone {
    proptest::collection::vec(-300.0..300.0f64, count)
}

fn pulses() -> impl Strategy<Value = Vec<OnInterval>> {
    proptest::collection::vec((2_000i64..90_000_000, 2_000i64..90_000_000), 0..6).prop_map(|steps| {
        let mut now = 0;
        let mut pulses = Vec::new();
        for (pause, on) in steps {
            let (from, to) = (now + pause, now + pause + on);
            pulses.push(OnInterval { on_s: from as f64 * 1e-9, off_s: to as f64 * 1e-9 });
            now = to;
        }
        pulses
    })
}

fn recordings() -> impl Strategy<Value = Recording> {
    let attitude = (direction(), -3.0..3.0f64)
        .prop_map(|(axis, angle)| UnitQuaternion::from_axis_angle(&Unit::new_normalize(axis), angle));
    let channels = (
        values(vector(), 8),
        values(vector(), 8),
        proptest::collection::vec((direction(), values(direction(), 8)), 0..3),
        values(list(3), 8),
        values(list(3), 8),
        values(list(3), 8),
        prop_oneof![Just(Vec::new()), proptest::collection::vec(pulses(), 12)],
    );
    let rest = (
        values(vector(), 5),
        values(1.0..30.0f64, 5),
        values(1e5..2e7f64, 5),
        values(250.0..320.0f64, 5),
        values(vector(), 5),
        proptest::option::of((values(attitude, 5), values(vector(), 5))),
        any::<bool>(),
        any::<bool>(),
    );
    (channels, rest).prop_map(|((gyro, force, vectors, speed, torque, current, jets), rest)| {
        let (body_torque, bus, tank, temperature, ballast, truth, closed_loop, clamped) = rest;
        let vectors = vectors.into_iter().filter(|(_, samples)| !samples.is_empty());
        let truth = truth.filter(|(q, rate)| !q.is_empty() || !rate.is_empty());
        Recording {
            platform: "whorl_1".into(),
            mounting: if clamped { Mounting::Clamped } else { Mounting::OnBearing },
            gyro_b_rad_s: gyro,
            specific_force_b_m_s2: force,
            vectors: vectors
                .map(|(reference, direction_b)| VectorChannel {
                    reference_world: Unit::new_normalize(reference),
                    direction_b,
                })
                .collect(),
            wheel_speed_rad_s: speed,
            wheel_torque_command_n_m: torque,
            wheel_current_a: current,
            jet_pulses: jets,
            body_torque_b_n_m: body_torque,
            bus_voltage_v: bus,
            tank_pressure_pa: tank,
            temperature_k: temperature,
            ballast_moment_b_n_m: ballast,
            closed_loop,
            truth: truth
                .map(|(q_world_body, omega_wb_b_rad_s)| TrueMotion { q_world_body, omega_wb_b_rad_s }),
            ..Recording::default()
        }
    })
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(48))]
    /// Any channels, any of them missing.
    #[test]
    fn any_recording_survives(recording in recordings()) {
        // Without motion it is refused, and that is tested elsewhere.
        prop_assume!(
            !(recording.gyro_b_rad_s.is_empty()
                && recording.specific_force_b_m_s2.is_empty()
                && recording.wheel_speed_rad_s.is_empty())
        );
        survives(&recording);
    }
}
