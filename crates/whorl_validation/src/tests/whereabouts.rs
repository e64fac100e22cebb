//! Where models of simulated runs fail.

use std::collections::BTreeMap;

use nalgebra::Vector3;
use whorl_dynamics::PlatformModel;

use super::generator::{Manoeuvre, platform, record};
use crate::dependence::Parity;
use crate::explain_where;
use crate::residual::residual_torque;

fn with_effect(model: &PlatformModel, id: &str, parameters: &[(&str, f64)]) -> PlatformModel {
    let mut truth = model.clone();
    let parameters = parameters.iter().map(|(name, value)| ((*name).to_owned(), *value));
    truth.effects.insert(id.to_owned(), parameters.collect::<BTreeMap<_, _>>());
    truth
}

/// Both directions of yaw, several times.
fn turning() -> Manoeuvre {
    Manoeuvre {
        duration_s: 90.0,
        yaw_swing_n_m: 0.25,
        jet_period_s: 0.0,
        rate_rad_s: Vector3::new(0.01, -0.01, 0.0),
        ..Manoeuvre::default()
    }
}

#[test]
fn the_residual_torque_is_the_missing_one_within_its_deviation() {
    let model = platform();
    let truth = with_effect(&model, "air_current", &[("t_x_n_m", 0.02), ("t_z_n_m", -0.01)]);
    let recording = record(&truth, &turning());
    let residual = residual_torque(&recording, &model).unwrap();
    let expected = Vector3::new(0.02, 0.0, -0.01);
    let (mut inside, mut all) = (0, 0);
    let torque = &residual.torque;
    for ((g, stddev), q) in torque.torque_b_n_m.iter().zip(&torque.stddev_b_n_m).zip(&torque.q_world_body) {
        let error = g - q.inverse_transform_vector(&expected);
        inside += (0..3).filter(|i| error[*i].abs() < 2.0 * stddev[*i]).count();
        all += 3;
    }
    assert!(inside * 100 > all * 80, "{inside} of {all}");
    let mean: Vector3<f64> =
        torque.torque_b_n_m.iter().zip(&torque.q_world_body).map(|(g, q)| q * g).sum::<Vector3<f64>>()
            / torque.time_s.len() as f64;
    assert!((mean - expected).norm() < 3e-3, "{mean}");
}

#[test]
fn friction_is_found_in_yaw_rate() {
    let model = platform();
    let truth = with_effect(&model, "bearing_viscous_friction", &[("c_n_m_s", 0.3)]);
    let where_ = explain_where(&record(&truth, &turning()), &model).unwrap();
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
    let where_ = explain_where(&record(&model, &turning()), &model).unwrap();
    let answer = where_.answer();
    assert!(answer.len() == 1 && answer[0].contains("nothing to locate"), "{answer:?}");
}
