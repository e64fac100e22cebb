//! Recovers a missing torque from a simulated run.

use std::collections::BTreeMap;

use nalgebra::Vector3;

use super::generator::{platform, record, turning};
use crate::residual_torque;

#[test]
fn the_residual_torque_is_the_missing_one_within_its_deviation() {
    let model = platform();
    let mut truth = model.clone();
    let draught = BTreeMap::from([("t_x_n_m".to_owned(), 0.02), ("t_z_n_m".to_owned(), -0.01)]);
    truth.effects.insert("air_current".to_owned(), draught);
    let recording = record(&truth, &turning());
    let torque = residual_torque(&recording, &model).unwrap();
    let expected = Vector3::new(0.02, 0.0, -0.01);
    let (mut inside, mut all) = (0, 0);
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
