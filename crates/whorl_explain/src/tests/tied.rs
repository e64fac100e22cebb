//! What a run does not tell apart is adopted as what is known of it.

use std::collections::BTreeMap;

use nalgebra::Vector3;
use whorl_diagnosis::Options;
use whorl_dynamics::ModelPrior;

use super::generator::{Manoeuvre, platform, record, turning};
use crate::{Case, adopt};

const EFFECT: &str = "bearing_turbine";
const TORQUE_N_M: f64 = 0.03;

/// A platform that stands upright turns about the vertical and about its own axis alike.
#[test]
fn torques_about_one_axis_are_adopted_as_their_sum() {
    let model = platform();
    let mut truth = model.clone();
    truth.effects.insert(EFFECT.to_owned(), BTreeMap::from([("vertical_n_m".to_owned(), TORQUE_N_M)]));
    // At balance, and nothing that tilts it.
    let offset = model.mass_properties.gravity_offset_b_n_m();
    let tilt_rad = [offset.y, -offset.x].map(|torque| torque / offset.z);
    let still = Manoeuvre { wheel_torque_n_m: 0.0, rate_rad_s: Vector3::zeros(), tilt_rad, ..turning() };
    let training = [record(&truth, &Manoeuvre { duration_s: 30.0, ..still })];
    let prior = ModelPrior::typical(&model);
    let case = Case { training: &training, held_out: &[], model: &model, prior: &prior };
    let adoption = adopt(&case, &[vec![EFFECT.to_owned()]], &Options::default(), &mut |_, _| {}).unwrap();

    let fit = adoption.versions.last().and_then(|version| version.fit.as_ref()).unwrap();
    let [tie] = fit.ties.as_slice() else { panic!("{:?}: {:?}", fit.ties, fit.estimates) };
    let off = (tie.value - TORQUE_N_M) / tie.stddev;
    println!(
        "measured: {} = {} +- {}, {off:.2} off; alone {:?}",
        tie.combination(),
        tie.value,
        tie.stddev,
        tie.stddevs
    );
    assert_eq!(tie.combination(), "body_z_n_m + vertical_n_m");
    assert!(off.abs() < 4.0 && tie.stddev < 0.02 * TORQUE_N_M, "{tie:?}");
    assert!(tie.stddevs.iter().all(|alone| *alone > TORQUE_N_M / 10.0), "{tie:?}");

    // The row says what is known, and the file leaves open which of the two it is.
    let row = fit.estimates.iter().find(|p| p.name == tie.combination()).unwrap();
    assert_eq!((row.estimate, row.stddev), (tie.value, tie.stddev));
    let written: f64 = fit.model.effects[EFFECT].values().sum();
    assert!((written - tie.value).abs() < tie.stddev, "{:?}", fit.model.effects);
    for name in ["body_z_n_m", "vertical_n_m"] {
        assert!(fit.prior.effects[EFFECT][name] > TORQUE_N_M / 10.0, "{:?}", fit.prior.effects);
    }
    let said = adoption.answer().join("\n");
    assert!(said.contains("do not tell body_z_n_m and vertical_n_m") && said.contains("tilted"), "{said}");
    let changes = adoption.changes(&case, "run");
    let comment =
        &changes.iter().find(|c| c.key == "model.effects.bearing_turbine.vertical_n_m").unwrap().comment;
    assert!(comment.contains("body_z_n_m + vertical_n_m +- "), "{comment}");
}
