//! What effects tell the searches for them is consistent with their parameters.

use std::f64::consts::TAU;

use nalgebra::Vector3;

use super::super::{
    BasePrior, Clues, Contribution, Direction, Effect, Grouping, ParameterSpec, Part, Periodicity, Resonance,
    Role, Signature, catalogue,
};
use super::{neutral, platform, rich_run, specs, with_effect};
use crate::ModelPrior;

const CLUES: Clues<'static> = Clues {
    bin_s: 0.04,
    largest_rate_rad_s: 0.5,
    largest_tilt_rad: 0.08,
    torque_lines_hz: &[0.7],
    sensor_lines_hz: &[3.1],
    resonances: &[Resonance { hz: 2.5, damping_ratio: 0.01, axis_b: Vector3::new(0.6, 0.0, 0.8) }],
};

fn starts(effect: &dyn Effect) -> Vec<Direction> {
    effect.starts(&platform(), &CLUES).into_iter().flatten().flatten().collect()
}

#[test]
fn roles_of_parameters_are_consistent() {
    for effect in catalogue() {
        let specs = specs(*effect);
        let fitted = || specs.iter().filter(|spec| !spec.known);
        assert!(fitted().any(|spec| spec.role == Role::Amplitude), "{:?} has an amplitude", effect);
        for spec in &specs {
            let label = format!("{} {}", effect.info().id, spec.name);
            if let Some(period) = spec.period {
                assert_eq!(spec.role, Role::FloatingShape, "{label}");
                assert!((spec.max - spec.min - period).abs() < 1e-12, "{label}: its range is one period");
                assert!((spec.limited(spec.min + 1.1 * period) - (spec.min + 0.1 * period)).abs() < 1e-12);
            } else {
                assert_eq!(spec.limited(spec.max + 1.0), spec.max, "{label}");
            }
            assert!(!spec.essential || spec.role == Role::Amplitude, "{label}");
            assert!(spec.base.is_none() || (spec.role == Role::Amplitude && !spec.known), "{label}");
        }
    }
}

/// Whatever the platform's prior says of its constants, exactly the base effects' parameters have it.
#[test]
fn base_effects_have_a_place_in_the_prior_of_the_platform() {
    let model = platform();
    let typical = ModelPrior::typical(&model);
    let mut places = Vec::new();
    for effect in catalogue() {
        let specs = specs(*effect);
        assert_eq!(effect.is_base(), specs.iter().any(|spec| spec.base.is_some()), "{}", effect.info().id);
        for spec in specs {
            let before = typical.of_parameter(&model, *effect, &spec);
            let Some(base) = spec.base else {
                assert_eq!(before, 0.0);
                continue;
            };
            let is_as_stated = matches!(
                base,
                BasePrior::WheelViscousFriction
                    | BasePrior::WheelCoulombFriction
                    | BasePrior::OpeningDelay
                    | BasePrior::ClosingDelay
            );
            assert_eq!(before > 0.0, !is_as_stated, "{} {}", effect.info().id, spec.name);
            let mut prior = typical.clone();
            base.set_stddev(&mut prior, spec.part, 0.123);
            assert_eq!(
                prior.of_parameter(&model, *effect, &spec),
                0.123,
                "{} {}",
                effect.info().id,
                spec.name
            );
            assert_eq!(prior.inertia_b_kg_m2, prior.inertia_b_kg_m2.transpose());
            // A constant that can be read is the one that the parameter moves.
            if let Some(constant) = base.constant(&model, spec.part) {
                let mut moved = model.clone();
                let moves = 0.05_f64.min(spec.max);
                let at: Vec<f64> = super::specs(*effect)
                    .iter()
                    .map(|s| if s.name == spec.name { s.neutral + moves } else { s.neutral })
                    .collect();
                effect.adjust(&at, &mut moved).unwrap();
                assert!((base.constant(&moved, spec.part).unwrap() - constant - moves).abs() < 1e-12);
            }
            places.push((base, spec.part));
        }
    }
    // Two angles share the place of their wheel, jet or gyro; nothing else shares one.
    places.retain(|(base, _)| {
        !matches!(base, BasePrior::WheelAxis | BasePrior::JetDirection | BasePrior::GimbalAxis)
    });
    let count = places.len();
    places.sort();
    places.dedup();
    assert_eq!(places.len(), count);
    assert_eq!(count, 3 + 3 + 2 + 3 * model.wheels().len() + model.jets().len() + model.gyros().len());
}

#[test]
fn names_that_effects_give_are_those_of_their_parameters() {
    for effect in catalogue() {
        let (id, specs) = (effect.info().id, specs(*effect));
        let has = |name: &str| specs.iter().any(|spec| spec.name == name);
        for needs in effect.evidence() {
            assert!(!needs.is_empty(), "{id}");
        }
        match effect.grouping() {
            Grouping::AllPartsEach(also) => assert!(also.iter().flat_map(|set| *set).all(|n| has(n)), "{id}"),
            Grouping::CommonEachParts => {
                assert!(specs.iter().any(|s| s.part == Part::Platform), "{id}");
                assert!(specs.iter().any(|s| s.part != Part::Platform), "{id}");
            }
            Grouping::All | Grouping::EachAndPairs => {}
        }
        match effect.signature() {
            Some(Signature::GyroDigits { range, step }) => assert!(has(range) && has(step), "{id}"),
            Some(Signature::WheelTurn) => {
                assert!(specs.iter().enumerate().all(|(j, spec)| spec.part == Part::Wheel(j)), "{id}");
            }
            Some(Signature::SensorLine { gyro, accelerometer, frequency, background }) => {
                assert!(gyro.iter().chain(&accelerometer).all(|name| has(name)), "{id}");
                assert!(has(frequency) && has(background), "{id}");
            }
            None => {}
        }
        let values: Vec<f64> = specs.iter().map(|spec| spec.neutral).collect();
        assert_eq!(
            effect.imposed_hz(&values).is_some(),
            effect.periodicity() == Some(Periodicity::Torque),
            "{id}"
        );
    }
}

/// A start is a place where the effect is still absent, and something moves from there.
#[test]
fn effects_are_absent_where_they_start() {
    let base = rich_run(&platform());
    let mut seen = 0;
    for effect in catalogue() {
        for direction in starts(*effect) {
            let label = format!("{}: {}", effect.info().id, direction.name);
            let at: Vec<(ParameterSpec, f64)> = specs(*effect).into_iter().zip(direction.origin).collect();
            assert_eq!(at.len(), neutral(*effect).len(), "{label}");
            assert!(at.iter().all(|(spec, x)| (spec.min..=spec.max).contains(x)), "{label}");
            assert!(!direction.moves.is_empty(), "{label}");
            let is_place = direction.moves.iter().all(|(_, by)| *by == 0.0);
            assert!(is_place || direction.moves.iter().all(|(_, by)| *by != 0.0), "{label}");
            assert_eq!(rich_run(&with_effect(*effect, &at)) == base, !is_place, "{label}");
            seen += 1;
        }
    }
    assert!(seen > 100, "{seen}");
}

/// Sine and cosine that are fitted about each axis come together in one phase.
#[test]
fn a_sine_and_a_cosine_are_one_periodic_torque() {
    let effect = catalogue().iter().find(|effect| effect.periodicity() == Some(Periodicity::Torque)).unwrap();
    let (amplitude, phase_rad): ([f64; 3], f64) = ([0.02, -0.05, 0.01], 0.4);
    let start = effect.starts(&platform(), &CLUES).unwrap().remove(0);
    // a sin(x + phase) = a cos(phase) sin(x) + a sin(phase) cos(x): the starts come as pairs.
    let contributions: Vec<Contribution<'_>> = start
        .iter()
        .enumerate()
        .map(|(n, direction)| Contribution {
            name: &direction.name,
            origin: &direction.origin,
            amount: amplitude[n / 2] * if n % 2 == 0 { phase_rad.cos() } else { phase_rad.sin() },
        })
        .collect();
    let joined = effect.joined(&contributions).unwrap();
    for (value, expected) in joined.iter().zip([0.02, -0.05, 0.01, 0.7, 0.4]) {
        assert!((value - expected).abs() < 1e-12, "{joined:?}");
    }
    assert!(TAU > phase_rad && effect.joined(&[]).is_none());
}

/// Effects that control compensates can be computed from its inputs: no states of the effect's own, and not the time.
#[test]
fn effects_with_states_of_their_own_are_not_fed_forward() {
    let model = platform();
    for effect in catalogue() {
        if effect.is_fed_forward(&model) {
            assert_eq!(effect.hidden_states(&model), 0, "{}", effect.info().id);
            assert_ne!(effect.periodicity(), Some(Periodicity::Torque), "{}", effect.info().id);
        }
    }
}
