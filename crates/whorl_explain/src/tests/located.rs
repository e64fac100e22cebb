//! Where models of simulated runs fail.

use std::collections::BTreeMap;

use whorl_dynamics::{MassProperties, ModelPrior};
use whorl_identification::Options;

use super::generator::{Manoeuvre, platform, record, turning};
use crate::{Case, locate};

/// A wrong centre of mass causes a constant torque. After the refit nothing is left to locate; the model as given
/// leaves that torque.
#[test]
fn a_wrong_centre_of_mass_is_no_missing_torque() {
    let truth = platform();
    let mut model = truth.clone();
    let offset = truth.mass_properties.gravity_offset_b_n_m() + nalgebra::Vector3::new(0.02, -0.015, 0.0);
    let inertia = *truth.mass_properties.inertia_b_kg_m2();
    model.mass_properties = MassProperties::new(inertia, offset, truth.mass_properties.mass_kg()).unwrap();
    let training = [record(&truth, &turning())];
    let mut prior = ModelPrior::typical(&model);
    prior.gravity_offset_b_n_m.fill(0.05);
    let case = Case { training: &training, held_out: &[], model: &model, prior: &prior };
    let found = locate(&case, &Options::default(), &mut |_, _| {}).unwrap();
    assert_eq!(found.not_refitted, None);
    assert!(found.runs.is_empty(), "one run is its own pool");
    let as_given = whorl_validation::unexplained_torques(&training[0], &model, None).unwrap();
    let as_given = whorl_validation::explain_where(&[(&training[0], &as_given)], &model);
    assert!(as_given.is_anything_left(), "{:?}", as_given.answer());
    assert!(!found.pooled.is_anything_left(), "{:?}", found.pooled.answer());
}

#[test]
fn runs_are_pooled_and_told_one_by_one() {
    let model = platform();
    let mut truth = model.clone();
    let friction = BTreeMap::from([("c_n_m_s".to_owned(), 0.3)]);
    truth.effects.insert("bearing_viscous_friction".to_owned(), friction);
    let run = |seed| record(&truth, &Manoeuvre { seed, duration_s: 60.0, ..turning() });
    let (training, held_out) = ([run(1)], [run(2)]);
    let prior = ModelPrior::typical(&model);
    let case = Case { training: &training, held_out: &held_out, model: &model, prior: &prior };
    let found = locate(&case, &Options::default(), &mut |_, _| {}).unwrap();
    // What is missing counts as noise in the refit, and does not bend the constants.
    assert_eq!(found.not_refitted, None);
    assert_eq!(found.pooled.run, "run_1, run_2");
    assert_eq!(found.runs.iter().map(|r| r.run.as_str()).collect::<Vec<_>>(), ["run_1", "run_2"]);
    assert_eq!(found.torques.len(), 2);
    let first = &found.pooled.dependences.as_ref().unwrap().ranked[0];
    assert_eq!(first.variable, "rate_about_the_same_axis", "{:?}", found.pooled.answer());
    assert!(first.share > 0.9, "{:?}", found.pooled.answer());
}
