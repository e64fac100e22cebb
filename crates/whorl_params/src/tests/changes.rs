//! Changes as entries of a file.

use crate::ModelStep;
use crate::changes::{of_step, rounded};

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
        text = crate::set_in_text("f", &text, "/whorl_1/**", &change.key, &change.value, None).unwrap();
    }
    let tree = crate::ParameterTree::from_texts(&[("f", &text)], &[]).unwrap();
    let again = crate::read_shared(&tree.for_node("/whorl_1/estimator"), crate::model_history).unwrap();
    assert_eq!(again, [ModelStep { prediction_error: Some([9.794, 1.084]), ..step }]);
}

#[test]
fn numbers_are_rounded_to_a_hundredth_of_their_deviation() {
    assert_eq!(rounded(0.020_123_456, 4e-4), 0.020_123);
    assert_eq!(rounded(-2.098_765, 0.03), -2.0988);
    for unknown in [0.0, f64::INFINITY, f64::NAN] {
        assert_eq!(rounded(1234.5678, unknown), 1234.5678);
    }
}
