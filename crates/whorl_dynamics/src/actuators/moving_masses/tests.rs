//! Masses against closed forms: travel, speed, play, and the torque on a clamped-free body.

use nalgebra::{Unit, Vector3};

use super::{MovingMass, MovingMasses};
use crate::actuators::{ActuatorError, ActuatorKind as _};
use crate::{InitialState, Plant, PlatformModel};

const WEIGHT_N: f64 = 5.0 * 9.81;

fn mass(name: &str, axis: Vector3<f64>) -> MovingMass {
    MovingMass {
        name: name.to_owned(),
        axis_b: Unit::new_normalize(axis),
        mass_kg: 5.0,
        travel_m: 0.1,
        max_speed_m_s: 0.02,
        backlash_m: 0.0,
    }
}

fn along_the_axes() -> MovingMasses {
    MovingMasses(vec![mass("x", Vector3::x()), mass("y", Vector3::y()), mass("z", Vector3::z())])
}

fn plant(masses: MovingMasses) -> Plant {
    let mut model = PlatformModel::whorl_1_reference();
    model.actuators.moving_masses = masses;
    let mut plant = Plant::new(&model, &InitialState::default(), 1).unwrap();
    plant.set_clamped(true);
    plant
}

fn at(plant: &mut Plant, time_s: f64) -> Vector3<f64> {
    plant.advance_to((time_s * 1e9) as i64).unwrap();
    plant.ballast_moment_b_n_m()
}

#[test]
fn a_mass_travels_at_its_largest_speed_and_stops_where_it_is_told() {
    let mut plant = plant(along_the_axes());
    // 0.05 m and -0.01 m: 2.5 s and 0.5 s.
    plant.move_ballast(Vector3::new(0.05 * WEIGHT_N, -0.01 * WEIGHT_N, 0.0));
    for (time_s, x_m, y_m) in [(0.25, 0.005, -0.005), (0.5, 0.01, -0.01), (2.0, 0.04, -0.01), (3.0, 0.05, -0.01)] {
        let found = at(&mut plant, time_s) / WEIGHT_N;
        assert!((found - Vector3::new(x_m, y_m, 0.0)).amax() < 1e-9, "{time_s}: {found}");
    }
}

#[test]
fn repeating_a_command_changes_nothing_and_a_new_one_turns_round_at_once() {
    let mut plant = plant(along_the_axes());
    let to = Vector3::new(0.05 * WEIGHT_N, 0.0, 0.0);
    for k in 0..10 {
        at(&mut plant, 0.1 * f64::from(k));
        plant.move_ballast(to);
    }
    assert!((at(&mut plant, 1.0).x / WEIGHT_N - 0.02).abs() < 1e-9);
    plant.move_ballast(Vector3::zeros());
    assert!((at(&mut plant, 1.5).x / WEIGHT_N - 0.01).abs() < 1e-9);
    assert!(at(&mut plant, 5.0).norm() < 1e-12);
}

#[test]
fn end_stops_hold_a_mass_that_is_sent_too_far() {
    let mut plant = plant(along_the_axes());
    plant.move_ballast(Vector3::new(7.0, -30.0, 0.0));
    let found = at(&mut plant, 20.0) / WEIGHT_N;
    assert!((found - Vector3::new(0.1, -0.1, 0.0)).amax() < 1e-12, "{found}");
}

/// A mass on a spindle with 4 mm of play, drawn as a hysteresis loop: flanks 2 mm behind the spindle.
#[test]
fn the_mass_lags_behind_its_spindle_by_half_the_play() {
    let mut masses = along_the_axes();
    masses.0[0].backlash_m = 0.004;
    let mut plant = plant(masses);
    let mut go = |to_m: f64, time_s: f64| {
        plant.move_ballast(Vector3::new(to_m * WEIGHT_N, 0.0, 0.0));
        at(&mut plant, time_s).x / WEIGHT_N
    };
    for (to_m, time_s, expected_m) in [
        (0.001, 1.0, 0.0),     // within the play: nothing moves
        (0.010, 2.0, 0.008),   // pushed from behind
        (0.0065, 3.0, 0.008),  // turned round: the play is crossed first
        (0.002, 4.0, 0.004),   // pushed from the other side
        (-0.01, 5.0, -0.008),
    ] {
        let found_m = go(to_m, time_s);
        assert!((found_m - expected_m).abs() < 1e-9, "to {to_m}: {found_m}, not {expected_m}");
    }
}

/// Two oblique masses give what lies in their plane; what does not is left, in no mass's direction.
#[test]
fn oblique_masses_share_a_moment() {
    let masses = MovingMasses(vec![mass("a", Vector3::new(1.0, 1.0, 0.0)), mass("b", Vector3::new(1.0, -1.0, 0.0))]);
    let found = masses.within_travel(&Vector3::new(1.0, 0.5, 0.7));
    assert!((found - Vector3::new(1.0, 0.5, 0.0)).amax() < 1e-12, "{found}");
    // 1 = W (p + q) / sqrt 2, 0.5 = W (p - q) / sqrt 2.
    let [p, q, none] = masses.positions_m(&Vector3::new(1.0, 0.5, 0.7));
    let root = 2.0_f64.sqrt();
    assert!((p - 0.75 * root / WEIGHT_N).abs() < 1e-12 && (q - 0.25 * root / WEIGHT_N).abs() < 1e-12);
    assert_eq!(none, 0.0);
}

/// A body that starts level and whose mass goes out along x with constant speed turns about y by the third integral of
/// the torque: theta = -W v t^3 / (6 I), as the gravity torque is -(m g r) x k = W v t along y and the step is small.
#[test]
fn a_travelling_mass_turns_the_body_as_the_closed_form_says() {
    let mut model = PlatformModel::whorl_1_reference();
    let inertia = nalgebra::Matrix3::from_diagonal(&Vector3::new(6.0, 8.0, 12.0));
    model.mass_properties = crate::MassProperties::new(inertia, Vector3::zeros(), 80.0).unwrap();
    model.wheels_mut().clear();
    model.actuators.moving_masses = along_the_axes();
    let mut plant = Plant::new(&model, &InitialState::default(), 1).unwrap();
    plant.move_ballast(Vector3::new(0.05 * WEIGHT_N, 0.0, 0.0));
    plant.advance_to(500_000_000).unwrap();
    let torque_rate = WEIGHT_N * 0.02;
    let expected_rad_s = torque_rate * 0.25 / (2.0 * 8.0);
    let found = plant.truth().omega_wb_b_rad_s;
    assert!((found.y.abs() - expected_rad_s).abs() < 2e-5 * expected_rad_s, "{found}");
    assert!(found.x.abs() < 1e-9 && found.z.abs() < 1e-9);
}

#[test]
fn a_plant_without_listed_masses_has_ideal_ones() {
    let mut plant = plant(MovingMasses::default());
    plant.move_ballast(Vector3::new(0.3, -40.0, 0.1));
    assert_eq!(plant.ballast_moment_b_n_m(), Vector3::new(0.3, -40.0, 0.1));
}

#[test]
fn too_many_and_dependent_masses_are_refused() {
    let mut masses = along_the_axes();
    assert_eq!(masses.check(), Ok(()));
    masses.0.push(mass("fourth", Vector3::x()));
    assert!(matches!(masses.check(), Err(ActuatorError::TooMany { .. })));
    let twice = MovingMasses(vec![mass("a", Vector3::x()), mass("b", -Vector3::x())]);
    let said = twice.check().unwrap_err().to_string();
    assert!(said.contains("moving_masses") && said.contains("axis"), "{said}");
}

/// Play of the masses is what the effect `moving_ballast_backlash` says of ideal ones: fits can find what the plant has.
#[test]
fn play_is_the_effect_of_the_catalogue() {
    let backlash_m = 0.004;
    let run = |masses: MovingMasses, effects: &[(&str, f64)]| {
        let mut model = PlatformModel::whorl_1_reference();
        let gap: std::collections::BTreeMap<String, f64> =
            effects.iter().map(|(key, value)| ((*key).to_owned(), *value)).collect();
        if !gap.is_empty() {
            model.effects.insert("moving_ballast_backlash".to_owned(), gap);
        }
        model.actuators.moving_masses = masses;
        let mut plant = Plant::new(&model, &InitialState::default(), 1).unwrap();
        for (k, x_m) in [0.01, 0.002, 0.012, -0.01].into_iter().enumerate() {
            plant.set_ballast_moment(Vector3::new(x_m * WEIGHT_N, 0.0, 0.0));
            plant.advance_to(500_000_000 * (k as i64 + 1)).unwrap();
        }
        plant.truth().omega_wb_b_rad_s
    };
    let mut with_play = along_the_axes();
    with_play.0[0].backlash_m = backlash_m;
    let by_masses = run(with_play, &[]);
    let by_effect = run(along_the_axes(), &[("gap_x_n_m", backlash_m * WEIGHT_N)]);
    let without = run(along_the_axes(), &[]);
    assert!((by_masses - by_effect).norm() < 1e-9, "{by_masses} {by_effect}");
    assert!((by_masses - without).norm() > 1e-4, "{by_masses} {without}");
}
