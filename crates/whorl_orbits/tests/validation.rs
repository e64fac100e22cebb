//! Orbits against an independent propagator: scipy's DOP853 (reference/make_orbits.py made reference/orbits.csv).

#![allow(clippy::unwrap_used, reason = "a reference that cannot be read fails the test")]

use nalgebra::Vector3;
use whorl_orbits::co_observation::{self, Target};
use whorl_orbits::{
    Elements, HillState, OrbitState, Propagator, clohessy_wiltshire, relative_motion, yamanaka_ankersen,
};

struct Case {
    name: String,
    j2: bool,
    time_s: f64,
    chief: [OrbitState; 2],
    deputy: [OrbitState; 2],
    relative: [HillState; 2],
}

fn cases() -> Vec<Case> {
    let mut reader =
        csv::Reader::from_path(concat!(env!("CARGO_MANIFEST_DIR"), "/tests/reference/orbits.csv")).unwrap();
    reader
        .records()
        .map(|record| {
            let record = record.unwrap();
            let v = |i: usize| -> Vector3<f64> {
                Vector3::from_fn(|k, _| record[3 + 3 * i + k].parse().unwrap())
            };
            let state = |i| OrbitState { position_m: v(i), velocity_m_s: v(i + 1) };
            let hill = |i| HillState { position_m: v(i), velocity_m_s: v(i + 1) };
            Case {
                name: record[0].to_owned(),
                j2: &record[1] == "1",
                time_s: record[2].parse().unwrap(),
                chief: [state(0), state(4)],
                deputy: [state(2), state(6)],
                relative: [hill(8), hill(10)],
            }
        })
        .collect()
}

#[test]
fn both_propagators_follow_the_reference() {
    let cases = cases();
    assert_eq!(cases.len(), 24);
    for case in &cases {
        let propagator = if case.j2 { Propagator::J2 } else { Propagator::TwoBody };
        for [start, end] in [case.chief, case.deputy] {
            let after = propagator.after(&start, case.time_s).unwrap();
            // Fourth order at 5 s: a centimetre after three revolutions; closed form: rounding.
            let allowed_m = if case.j2 { 0.02 } else { 2e-4 };
            let error = (after.position_m - end.position_m).norm();
            assert!(error < allowed_m, "{} {} {}: {error}", case.name, case.j2, case.time_s);
        }
    }
}

#[test]
fn hill_states_and_the_nonlinear_relative_motion_follow_the_reference() {
    for case in cases() {
        let start = HillState::of(&case.chief[0], &case.deputy[0]);
        assert!((start.position_m - case.relative[0].position_m).norm() < 1e-6);
        assert!((start.velocity_m_s - case.relative[0].velocity_m_s).norm() < 1e-9);
        let back = start.deputy(&case.chief[0]);
        assert!((back.position_m - case.deputy[0].position_m).norm() < 1e-6);
        assert!((back.velocity_m_s - case.deputy[0].velocity_m_s).norm() < 1e-9);
        if !case.j2 {
            let after = relative_motion::after(&case.chief[0], &start, case.time_s);
            let error = (after.position_m - case.relative[1].position_m).norm();
            assert!(error < 5e-3, "{} {}: {error}", case.name, case.time_s);
        }
    }
}

#[test]
fn linear_models_follow_the_reference_to_second_order() {
    for case in cases().iter().filter(|c| !c.j2) {
        let chief = Elements::of(&case.chief[0]).unwrap();
        let truth = case.relative[1].position_m;
        let size = truth.norm().max(case.relative[0].position_m.norm());
        // (size / radius) of the size itself, times the revolutions over which it adds up.
        let allowed = 20.0 * size * size / chief.semi_major_axis_m * (1.0 + case.time_s / chief.period_s());
        let linear = yamanaka_ankersen::after(&chief, &case.relative[0], case.time_s).position_m;
        assert!(
            (linear - truth).norm() < allowed,
            "{} {}: {} {allowed}",
            case.name,
            case.time_s,
            (linear - truth).norm()
        );
        if chief.eccentricity < 1e-4 {
            let circle =
                clohessy_wiltshire::closed_form(&case.relative[0], chief.mean_motion_rad_s(), case.time_s);
            let error = (circle.position_m - truth).norm();
            assert!(error < allowed + 3e-3 * size, "{}: {error}", case.name);
        }
    }
}

/// Against pymap3d (reference/make_targets.py made reference/targets.csv).
#[test]
fn targets_stand_on_the_ellipsoid_of_wgs_84() {
    let path = concat!(env!("CARGO_MANIFEST_DIR"), "/tests/reference/targets.csv");
    let mut reader = csv::Reader::from_path(path).unwrap();
    let mut count = 0;
    for record in reader.records() {
        let record = record.unwrap();
        let number = |i: usize| -> f64 { record[i].parse().unwrap() };
        let vector = |i: usize| Vector3::new(number(i), number(i + 1), number(i + 2));
        let [geodetic, geocentric, longitude] = [0, 1, 2].map(|i| number(i).to_radians());
        let point = Target::geodetic(geodetic, longitude).position_m(&[], 0.0).unwrap();
        assert!((point - vector(3)).norm() < 1e-6, "{point}");
        let same = Target::Point { latitude_rad: geocentric, longitude_rad: longitude };
        assert!((same.position_m(&[], 0.0).unwrap() - vector(3)).norm() < 1e-6);
        let below = co_observation::ground_track_m(&vector(6), 0.0);
        assert!((below - vector(9)).norm() < 1e-5, "{below}");
        let elevation = co_observation::elevation_rad(&point, &vector(6)).to_degrees();
        assert!((elevation - number(12)).abs() < 1e-8, "{elevation}");
        count += 1;
    }
    assert_eq!(count, 5);
}
