//! The shortcut for columns that add one torque, against the whole equations of motion.

use nalgebra::Vector3;
use whorl_dynamics::effects::catalogue;
use whorl_dynamics::{ModelPrior, PlatformModel};

use super::change::{Change, changes};
use super::moved::{Moved, Way};
use super::{LANES, Linearised, UnmodelledInput};
use crate::evidence::problem::Problem;
use crate::parameters::{Point, Reference};
use crate::tests::generator::record;

/// Largest difference of two series of numbers over the largest of the second.
fn differ(a: impl Iterator<Item = f64>, b: impl Iterator<Item = f64>) -> f64 {
    let (mut difference, mut size) = (0.0_f64, 1e-12_f64);
    for (a, b) in a.zip(b) {
        difference = difference.max((a - b).abs());
        size = size.max(b.abs());
    }
    difference / size
}

fn largest_difference(short: &Change, whole: &Change) -> f64 {
    let vectors = |list: &[Vector3<f64>]| list.iter().flat_map(|v| [v.x, v.y, v.z]).collect::<Vec<_>>();
    let wheels = |change: &Change| change.wheel_dot.iter().flatten().copied().collect::<Vec<_>>();
    assert_eq!(short.omega_dot.len(), whole.omega_dot.len());
    [
        differ(vectors(&short.omega_dot).into_iter(), vectors(&whole.omega_dot).into_iter()),
        differ(wheels(short).into_iter(), wheels(whole).into_iter()),
        differ(vectors(&short.accel).into_iter(), vectors(&whole.accel).into_iter()),
    ]
    .into_iter()
    .fold(0.0, f64::max)
}

/// Checks every column that takes the shortcut at a point, but of hidden states only those that the point holds:
/// where the base has none, the whole equations are solved in other steps than the base's. The effects checked.
fn check(problem: &Problem, point: &Point) -> Vec<&'static str> {
    let (run, motion, reference) = (&problem.runs[0], &problem.motions[0], &problem.reference);
    let base = Linearised::new(run, motion, reference, point, problem.settings(0)).unwrap();
    let carries = base.mechanics.gyrostat.effects().hidden_states() > 0;
    let mut short = Vec::new();
    for effect in catalogue() {
        let hidden = effect.hidden_states(&reference.model) > 0;
        if hidden && !point.effects.contains_key(effect.info().id) {
            continue;
        }
        for column in reference.columns_at(point, *effect) {
            let moved = Moved::new(&base.mechanics, reference, point, &column).unwrap();
            if matches!(moved.motion, Some(Way::Torque(_))) {
                // With hidden states in the base the whole takes the mean over steps also of what has none.
                short.push((effect.info().id, if carries && !hidden { 5e-2 } else { 1e-7 }, moved));
            }
        }
    }
    for group in short.chunks(LANES) {
        let shortcut: Vec<Moved> = group.iter().map(|(.., moved)| moved.clone()).collect();
        let whole: Vec<Moved> =
            shortcut.iter().map(|moved| Moved { motion: Some(Way::Whole), ..moved.clone() }).collect();
        let pairs =
            changes(run, motion, &base, &shortcut).into_iter().zip(changes(run, motion, &base, &whole));
        for ((id, most, _), (short, whole)) in group.iter().zip(pairs) {
            let difference = largest_difference(&short, &whole);
            assert!(difference < *most, "{id}: {difference:e}");
        }
    }
    let mut ids: Vec<&str> = short.into_iter().map(|(id, ..)| id).collect();
    ids.dedup();
    ids
}

#[test]
fn one_torque_is_worth_the_whole_mechanics() {
    let model = PlatformModel::whorl_1_reference();
    let run = record(&model, 4, 12.0, None);
    let reference = Reference::new(&model, &ModelPrior::typical(&model));
    let problem = Problem::new(std::slice::from_ref(&run), reference, run.duration_s(), 1).unwrap();
    // Added to the base model.
    let mut point = problem.reference.point();
    let added = check(&problem, &point);
    for id in ["bearing_viscous_friction", "air_current", "thruster_leak", "wheel_windage"] {
        assert!(added.contains(&id), "{id} takes another way: {added:?}");
    }
    // Changed from where the point has them: friction, a mass that swings and resists less, drag of the wheels.
    for (id, parameters) in [
        ("bearing_viscous_friction", &[("c_n_m_s", 0.03)][..]),
        ("slosh", &[("mass_ratio", 0.02)]),
        ("wheel_windage", &[]),
    ] {
        let effect = whorl_dynamics::effects::find(id).unwrap();
        let specs = effect.parameters(&problem.reference.model);
        let given = |name: &str| parameters.iter().find(|(known, _)| *known == name).map(|(_, x)| *x);
        let usual = if parameters.is_empty() { 1.0 } else { 0.0 };
        let values = specs
            .iter()
            .map(|s| given(&s.name).unwrap_or((s.neutral + usual * s.prior_stddev).min(s.max)))
            .collect();
        point.effects.insert(effect.info().id, values);
    }
    let changed = check(&problem, &point);
    assert!(changed.contains(&"slosh") && changed.contains(&"bearing_viscous_friction"), "{changed:?}");
}

#[test]
fn what_acts_inside_changes_no_momentum() {
    let model = PlatformModel::whorl_1_reference();
    let recording = record(&model, 1, 12.0, None);
    let reference = Reference::new(&model, &ModelPrior::typical(&model));
    let problem = Problem::new(std::slice::from_ref(&recording), reference, 12.0, 1).unwrap();
    let linear = problem.linearise(&problem.reference.point()).unwrap();
    let linear = &linear[0];
    // Body and wheels turn as one with the inertia of the whole; a wheel's own speed adds to it.
    let momentum = |change: &Change| {
        let wheels = model.wheels().iter().zip(change.wheel_dot[0]);
        let of_wheels: Vector3<f64> =
            wheels.map(|(w, rate)| w.spin_axis_b.into_inner() * (w.spin_inertia_kg_m2 * rate)).sum();
        model.mass_properties.inertia_b_kg_m2() * change.omega_dot[0] + of_wheels
    };
    for wheel in 0..model.wheels().len() {
        let inside = UnmodelledInput::Wheel(wheel, vec![0.01]).change(linear);
        assert!(inside.omega_dot[0].norm() > 1e-4 && momentum(&inside).norm() < 1e-9, "{inside:?}");
    }
    let torque = Vector3::new(0.003, -0.001, 0.002);
    let outside = UnmodelledInput::Torque(vec![torque]).change(linear);
    assert!((momentum(&outside) - torque).norm() < 1e-9, "{outside:?}");
}
