//! Steps of a model's history.

use whorl_params::ModelStep;

use crate::changes::of_step;

const FRICTION: &str = "bearing_viscous_friction";

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
