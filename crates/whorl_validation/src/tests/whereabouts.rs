//! Where models of simulated runs fail.

use std::collections::BTreeMap;

use whorl_dynamics::PlatformModel;

use super::generator::{platform, record, turning};
use crate::dependence::Parity;
use crate::explain_where;

fn with_effect(model: &PlatformModel, id: &str, parameters: &[(&str, f64)]) -> PlatformModel {
    let mut truth = model.clone();
    let parameters = parameters.iter().map(|(name, value)| ((*name).to_owned(), *value));
    truth.effects.insert(id.to_owned(), parameters.collect::<BTreeMap<_, _>>());
    truth
}

#[test]
fn friction_is_found_in_yaw_rate() {
    let model = platform();
    let truth = with_effect(&model, "bearing_viscous_friction", &[("c_n_m_s", 0.3)]);
    let where_ = explain_where(&[&record(&truth, &turning())], &model).unwrap();
    let answer = where_.answer();
    let first = &where_.dependences.ranked[0];
    assert_eq!(
        (first.variable.as_str(), first.axis, first.parity),
        ("yaw_rate", 2, Parity::Odd),
        "{answer:?}"
    );
    assert!(first.share > 0.8, "{answer:?}");
    assert!(answer[1].contains("yaw rate") && answer[1].contains("in proportion"), "{answer:?}");
}

#[test]
fn the_right_model_leaves_nothing_to_locate() {
    let model = platform();
    let where_ = explain_where(&[&record(&model, &turning())], &model).unwrap();
    let answer = where_.answer();
    assert!(answer.len() == 1 && answer[0].contains("nothing to locate"), "{answer:?}");
}
