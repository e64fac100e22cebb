//! Orbits against an independent propagator: scipy's DOP853 (reference/make_orbits.py made reference/orbits.csv).

#![allow(clippy::unwrap_used, reason = "a reference that cannot be read fails the test")]

use nalgebra::{Unit, Vector3};
use whorl_orbits::burn::Burn;
use whorl_orbits::co_observation::{self, Mounting, Target};
use whorl_orbits::flight::Flight;
use whorl_orbits::pass::{Pass, RelativeModel, Spacecraft, WantedDeltaV};
use whorl_orbits::{
    Elements, HillState, OrbitState, Propagator, clohessy_wiltshire, mean_elements, relative_motion,
    yamanaka_ankersen,
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

fn rows(file: &str) -> Vec<Vec<f64>> {
    let path = format!("{}/tests/reference/{file}", env!("CARGO_MANIFEST_DIR"));
    let mut reader = csv::Reader::from_path(path).unwrap();
    reader.records().map(|r| r.unwrap().iter().map(|x| x.parse().unwrap()).collect()).collect()
}

fn vector(row: &[f64], first: usize) -> Vector3<f64> {
    Vector3::new(row[first], row[first + 1], row[first + 2])
}

/// A deputy that thrusts where its attitude points it, against DOP853 (reference/make_burns.py made reference/burns.csv).
#[test]
fn thrust_moves_the_orbit_where_the_attitude_points_it() {
    let rows = rows("burns.csv");
    assert_eq!(rows.len(), 6);
    for row in &rows {
        let chief = OrbitState {
            position_m: Vector3::new(6_878_137.0, 0.0, 0.0),
            velocity_m_s: Vector3::new(0.0, 0.3_f64.cos(), 0.3_f64.sin()) * 7612.608,
        };
        let (sine, cosine) = row[1].to_radians().sin_cos();
        let thrust_body = Unit::new_normalize(Vector3::new(cosine, sine, 0.0));
        let mounting = Mounting { boresight_body: Vector3::x_axis(), thrust_body };
        let still = Spacecraft {
            formation: None,
            mounting,
            wanted: WantedDeltaV::None,
            burn: None,
            velocity_error_hill_m_s: Vector3::zeros(),
        };
        let pass = Pass {
            chief: Elements::of(&chief).unwrap(),
            model: if row[0] > 0.0 { RelativeModel::J2 } else { RelativeModel::TwoBody },
            spacecraft: vec![
                still,
                Spacecraft {
                    wanted: WantedDeltaV::Hill(vector(row, 3)),
                    burn: Some(Burn {
                        start_s: row[9],
                        thrust_n: 5.0,
                        mass_kg: 80.0,
                        specific_impulse_s: 70.0,
                    }),
                    velocity_error_hill_m_s: vector(row, 6),
                    ..still
                },
            ],
            target: Target::Point { latitude_rad: 10_f64.to_radians(), longitude_rad: 9_f64.to_radians() },
            thrust_weight: row[2],
        };
        let flight = Flight::new(&pass).unwrap();
        let end = flight.at(row[10]).unwrap()[1].state;
        let (position, velocity) = (end.position_m - vector(row, 11), end.velocity_m_s - vector(row, 14));
        // The propagators' own differences from DOP853 are a tenth of these.
        assert!(position.norm() < 5e-3 && velocity.norm() < 2e-5, "{row:?}: {position} {velocity}");
        let flown = flight.flown()[0];
        assert!((flown.given_hill_m_s - vector(row, 17)).norm() < 1e-6, "{:?}", flown.given_hill_m_s);
        assert!((flown.gas_kg - row[20]).abs() < 1e-12);
        // Without the burn it would be metres elsewhere.
        let mut without = pass.clone();
        without.spacecraft[1].burn = None;
        let apart = without.at(row[10]).unwrap()[1].state.position_m - end.position_m;
        assert!(apart.norm() > 50.0, "{apart}");
        // Its attitude does not jump where the burn begins and ends.
        for edge_s in [flown.span_s.0, flown.span_s.1] {
            let q = |t: f64| flight.at(t).unwrap()[1].pointing.q_eci_body;
            let jump = q(edge_s - 1e-3).angle_to(&q(edge_s + 1e-3));
            assert!(edge_s == 0.0 || jump < 1e-4, "{jump}");
        }
    }
}

/// Against Basilisk's map (reference/make_mean.py made reference/mean.csv).
#[test]
fn mean_elements_are_those_of_basilisk() {
    let elements = |x: &[f64]| Elements {
        semi_major_axis_m: x[0],
        eccentricity: x[1],
        inclination_rad: x[2],
        node_rad: x[3],
        perigee_rad: x[4],
        mean_anomaly_rad: x[5],
    };
    let rows = rows("mean.csv");
    assert_eq!(rows.len(), 12);
    for row in &rows {
        let map = if row[0] > 0.0 { mean_elements::osculating } else { mean_elements::mean };
        let [found, expected] = [map(&elements(&row[1..7])).unwrap(), elements(&row[7..13])];
        assert!((found.semi_major_axis_m - expected.semi_major_axis_m).abs() < 1e-3, "{row:?}");
        // As a place in space: perigee and anomaly alone mean little on near-circles.
        let apart = (found.state().position_m - expected.state().position_m).norm();
        assert!(apart < 0.01, "{row:?}: {apart} m");
        assert!((found.state().velocity_m_s - expected.state().velocity_m_s).norm() < 1e-5);
    }
}

/// Slopes over forty revolutions of DOP853 (reference/secular.csv), to second order in J2.
#[test]
fn mean_elements_drift_as_orbits_do() {
    for row in rows("secular.csv") {
        let start = OrbitState { position_m: vector(&row, 0), velocity_m_s: vector(&row, 3) };
        let osculating = Elements::of(&start).unwrap();
        let rates = mean_elements::secular_rates(&mean_elements::mean(&osculating).unwrap());
        let node = rates.node_rad_s / row[6] - 1.0;
        let latitude = (rates.perigee_rad_s + rates.mean_anomaly_rad_s) / row[7] - 1.0;
        assert!(node.abs() < 4e-3 && latitude.abs() < 2e-5, "{row:?}: {node} {latitude}");
        // Osculating elements in their place are off by more: a hundred times, near the equator three.
        let wrong = mean_elements::secular_rates(&osculating);
        let wrong = (wrong.perigee_rad_s + wrong.mean_anomaly_rad_s) / row[7] - 1.0;
        assert!(wrong.abs() > 3.0 * latitude.abs(), "{wrong} {latitude}");
    }
}

/// The numerical propagator, which follows DOP853, is the judge: forty revolutions of chief and deputy.
#[test]
fn j2_invariant_deputies_stay() {
    let chief = Elements {
        semi_major_axis_m: 7_153_000.0,
        eccentricity: 0.05,
        inclination_rad: 48_f64.to_radians(),
        node_rad: 0.0,
        perigee_rad: 30_f64.to_radians(),
        mean_anomaly_rad: 0.0,
    };
    let tilt = 0.006_f64.to_radians();
    let invariant = mean_elements::j2_invariant(&chief, tilt).unwrap();
    let plain = Elements { inclination_rad: chief.inclination_rad + tilt, ..chief };
    // Means over a revolution, within which the relative orbit goes to and fro by kilometres.
    let drift = |deputy: &Elements| {
        let mut states = [chief, *deputy].map(|mean| mean_elements::osculating(&mean).unwrap().state());
        let (samples, revolutions) = (90, 40);
        let mut means = Vec::new();
        for _ in 0..revolutions {
            let (mut along, mut node) = (0.0, 0.0);
            for _ in 0..samples {
                let [node_c, node_d] = states.map(|s| Elements::of(&s).unwrap().node_rad);
                along += HillState::of(&states[0], &states[1]).position_m.y / f64::from(samples);
                node += (node_d - node_c) / f64::from(samples);
                let step_s = chief.period_s() / f64::from(samples);
                states = states.map(|s| Propagator::J2.after(&s, step_s).unwrap());
            }
            means.push((along, node));
        }
        let (first, last) = (means[0], means[means.len() - 1]);
        let turns = f64::from(revolutions - 1);
        ((last.0 - first.0) / turns, (last.1 - first.1) / turns)
    };
    let ((along, node), (plain_along, plain_node)) = (drift(&invariant), drift(&plain));
    assert!(along.abs() < 0.05 * plain_along.abs(), "{along} {plain_along} m/rev");
    assert!(node.abs() < 0.05 * plain_node.abs(), "{node} {plain_node} rad/rev");
    // The plain deputy's drift is what `keeping` says.
    let keeping = mean_elements::keeping(&chief, &plain);
    assert!((keeping.along_m_rev / plain_along - 1.0).abs() < 0.05, "{keeping:?} {plain_along}");
    let across = chief.semi_major_axis_m * chief.inclination_rad.sin() * plain_node;
    assert!((keeping.across_m_rev / across - 1.0).abs() < 0.05, "{keeping:?} {across}");
    assert!(mean_elements::keeping(&chief, &invariant).along_m_rev.abs() < 0.02 * plain_along.abs());
}
