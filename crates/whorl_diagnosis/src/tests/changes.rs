//! Effects that begin, end or change: torques in closed form, added to a plant that knows nothing of them.

use nalgebra::{UnitQuaternion, Vector3};
use whorl_dynamics::PlatformModel;

use super::generator::{record, wrong_model};
use crate::{Diagnosis, Options, Verdict, diagnose};

/// Torque on the body as a function of the run, time, attitude and rate [N m].
type Torque<'a> = &'a dyn Fn(u64, f64, &UnitQuaternion<f64>, &Vector3<f64>) -> Vector3<f64>;

fn diagnosed(torque: Torque<'_>, seed: u64) -> Diagnosis {
    let truth = PlatformModel::whorl_1_reference();
    let run = |i: u64| record(&truth, seed * 10 + i, 60.0, Some(&|t, q, w| torque(i, t, q, w)));
    let runs: Vec<_> = (0..2).map(run).collect();
    let (model, prior) = wrong_model(&truth, seed);
    let found = diagnose(&runs, &[], &model, &prior, &Options::default(), &mut |_| {}).unwrap();
    println!("{:#?}", found.answer());
    found
}

#[test]
fn a_friction_that_begins_has_its_onset() {
    let began_s = 37.3;
    let friction =
        |run, t: f64, w: &Vector3<f64>| if run == 1 && t >= began_s { w * -0.08 } else { Vector3::zeros() };
    let found = diagnosed(&|run, t, _, w| friction(run, t, w), 3);
    assert_eq!(
        (found.verdict, found.effects.as_slice()),
        (Verdict::Named, &["bearing_viscous_friction".to_owned()][..])
    );
    let change = &found.changes[0];
    let onset = change.onset.unwrap();
    assert!(change.run.ends_with("31") && !change.in_later_runs, "{change:?}");
    assert!((onset.at_s - began_s).abs() < 4.0 * onset.stddev_s && onset.stddev_s < 1.5, "{onset:?}");
    assert!(onset.from_s < onset.at_s && onset.at_s < onset.to_s);
    let size = &change.parameters[0];
    assert!((size.after - 0.08).abs() < 4.0 * size.after_stddev && size.after_stddev < 0.01, "{size:?}");
    assert!(size.before.abs() <= 3.0 * size.before_stddev, "{size:?}");
}

#[test]
fn a_friction_that_one_run_has_is_said_to_be_there_only() {
    let found = diagnosed(&|run, _, _, w| if run == 1 { w * -0.08 } else { Vector3::zeros() }, 4);
    assert_eq!(found.effects, ["bearing_viscous_friction"]);
    let change = &found.changes[0];
    assert!(change.onset.is_none() && change.run.ends_with("41"), "{change:?}");
    assert!(change.sentence().contains("is there only in"), "{}", change.sentence());
}

#[test]
fn what_is_constant_does_not_change() {
    let found = diagnosed(&|_, _, _, w| w * -0.08, 5);
    assert_eq!(found.effects, ["bearing_viscous_friction"]);
    assert!(found.changes.is_empty(), "{:?}", found.changes);
}

#[test]
fn a_mass_that_slides_changes_the_gravity_offset() {
    let slid_s = 22.4;
    // m g r of 0.02 N m along body y.
    let shift = |t: f64, q: &UnitQuaternion<f64>| {
        let up = q.inverse_transform_vector(&Vector3::z());
        if t >= slid_s { -Vector3::new(0.0, 0.02, 0.0).cross(&up) } else { Vector3::zeros() }
    };
    let found = diagnosed(&|run, t, q, _| if run == 0 { shift(t, q) } else { shift(slid_s, q) }, 6);
    assert_eq!(found.effects, ["gravity_offset"]);
    let change = &found.changes[0];
    let onset = change.onset.unwrap();
    assert!((onset.at_s - slid_s).abs() < 4.0 * onset.stddev_s && onset.stddev_s < 1.0, "{onset:?}");
    assert!(change.in_later_runs, "{change:?}");
    let y = change.parameters.iter().find(|p| p.name.ends_with('y')).unwrap();
    assert!((y.after - y.before - 0.02).abs() < 5.0 * y.after_stddev.max(1e-4), "{y:?}");
}
