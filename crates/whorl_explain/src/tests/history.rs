//! The history of a model.

use std::collections::BTreeMap;
use std::path::Path;

use whorl_params::{ModelStep, PriorEntry};
use whorl_recording::read_model;

use crate::changes::of_step;
use crate::history;

const FRICTION: &str = "bearing_viscous_friction";
const SPRING: &str = "harness_spring";

#[test]
fn effects_are_listed_with_the_steps_that_adopted_them() {
    let file = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../params/whorl_1.yaml");
    let mut known = read_model(&file, None).unwrap();
    let step = |number, effects: &[&str]| ModelStep {
        number,
        effects: effects.iter().map(|id| (*id).to_owned()).collect(),
        ..ModelStep::of_source("whorl adopt".to_owned())
    };
    known.history = vec![step(1, &[FRICTION]), step(2, &[]), step(3, &[FRICTION])];
    known.model.effects = BTreeMap::from([
        (FRICTION.to_owned(), BTreeMap::from([("c_n_m_s".to_owned(), 0.02)])),
        (SPRING.to_owned(), BTreeMap::from([("k_n_m_rad".to_owned(), 0.3)])),
    ]);
    known.prior.effects =
        BTreeMap::from([(FRICTION.to_owned(), BTreeMap::from([("c_n_m_s".to_owned(), 0.001)]))]);
    let history = history(&known);
    let [friction, spring] = history.effects.as_slice() else { panic!("{:?}", history.effects) };
    assert_eq!((friction.effect.as_str(), friction.adopted_in.as_slice()), (FRICTION, &[1, 3][..]));
    let c = &friction.parameters[0];
    assert_eq!((c.name.as_str(), c.unit, c.value, c.stddev), ("c_n_m_s", "N m s", 0.02, Some(0.001)));
    assert!(spring.adopted_in.is_empty() && spring.parameters[0].stddev.is_none());
    let cad = |entries: &[PriorEntry]| entries.iter().filter(|e| e.key.starts_with("inertia_kg_m2")).count();
    let (source, keys) = &history.sources[0];
    assert!(source.starts_with("CAD") && keys.len() == cad(&known.prior_entries), "{source} {keys:?}");
}

/// What a step writes is what the reader of parameter files reads.
#[test]
fn a_step_is_read_back_from_its_entries() {
    let step = ModelStep {
        number: 4,
        date: Some("2026-03-02T10:15:00Z".to_owned()),
        effects: vec![FRICTION.to_owned()],
        prediction_error: Some([9.793_81, 1.084]),
        held_out_prediction_error: None,
        source: Some("run (sha256 12); whorl adopt run x".to_owned()),
    };
    let mut text = String::from("/whorl_1/**:\n  ros__parameters:\n    use_sim_time: false\n");
    for change in of_step(&step) {
        text =
            whorl_params::set_in_text("f", &text, "/whorl_1/**", &change.key, &change.value, None).unwrap();
    }
    let tree = whorl_params::ParameterTree::from_texts(&[("f", &text)], &[]).unwrap();
    let again =
        whorl_params::read_shared(&tree.for_node("/whorl_1/estimator"), whorl_params::model_history).unwrap();
    assert_eq!(again, [ModelStep { prediction_error: Some([9.794, 1.084]), ..step }]);
}
