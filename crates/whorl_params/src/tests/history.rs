//! The group `model_history`.

use super::read_error;
use crate::{ModelStep, NodeParameters, ParameterTree, model_history, read_shared};

fn parameters(lines: &str) -> NodeParameters {
    let indented: String = lines.lines().map(|line| format!("      {line}\n")).collect();
    let text = format!("/whorl_1/**:\n  ros__parameters:\n    model_history:\n{indented}");
    ParameterTree::from_texts(&[("p.yaml", &text)], &[]).unwrap().for_node("/whorl_1/estimator")
}

#[test]
fn steps_are_read_in_the_order_of_their_numbers() {
    let lines = "step_10.source: whorl identify run
step_2: {effects: [a, b], date: \"2026-03-02T10:15:00Z\", prediction_error: [7.0, 1.25]}
";
    let steps = read_shared(&parameters(lines), model_history).unwrap();
    let second = ModelStep {
        number: 2,
        date: Some("2026-03-02T10:15:00Z".into()),
        effects: vec!["a".into(), "b".into()],
        prediction_error: Some([7.0, 1.25]),
        held_out_prediction_error: None,
        source: None,
    };
    assert_eq!(
        steps,
        [second, ModelStep { number: 10, ..ModelStep::of_source("whorl identify run".into()) }]
    );
}

#[test]
fn what_is_no_step_is_refused_with_its_line() {
    for (lines, message) in [
        ("first.source: x", "p.yaml:4: model_history.first: allowed: step_1, step_2, ..."),
        (
            "step_1.prediction_error: [1.0, 2.0, 3.0]",
            "p.yaml:4: model_history.step_1.prediction_error = [1.0, 2.0, 3.0]: allowed: two numbers, before and after",
        ),
        ("step_1.efects: [a]", "p.yaml:4: model_history.step_1.efects = [a]: unknown parameter"),
    ] {
        let error = read_error(&parameters(lines), model_history);
        assert!(error.starts_with(message), "{error}");
    }
}
