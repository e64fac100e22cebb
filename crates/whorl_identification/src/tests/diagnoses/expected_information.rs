//! What further data are expected to bring, against what they bring.

use whorl_dynamics::PlatformModel;

use super::generator::{map, record, wrong_model};
use crate::{Options, expected_information};

#[test]
#[ignore = "slow: what further data bring against what they were expected to"]
fn expected_log_odds_come_true() {
    let mut truth = PlatformModel::whorl_1_reference();
    truth.effects = map(&[("bearing_viscous_friction", &[("c_n_m_s", 0.05)])]);
    let (model, prior) = wrong_model(&truth, 5);
    let first = record(&truth, 51, 30.0, None);
    let (short, long) = (record(&truth, 52, 15.0, None), record(&truth, 53, 60.0, None));
    let sets = [vec!["bearing_viscous_friction".to_owned()], vec!["harness_spring".to_owned()]];
    let options = Options::default();
    let given = std::slice::from_ref(&first);
    let (now, found) =
        expected_information(given, &[short, long.clone()], &model, &prior, &sets, &options).unwrap();
    let [of_short, of_long] = found.as_slice() else { panic!("{found:?}") };
    // More data of a kind tell more, and show no less.
    assert!(of_long.log_odds > of_short.log_odds, "{found:?}");
    assert!(of_long.shown.len() >= of_short.shown.len() && of_short.shown.len() >= now.shown.len());
    // The truth: the log odds when the data have come.
    let (both, _) = expected_information(&[first, long], &[], &model, &prior, &sets, &options).unwrap();
    let (expected, came) = (of_long.log_odds.unwrap(), both.log_odds.unwrap());
    // Log odds of two explanations of Gaussian data whose mean is L have the variance 2 L.
    let scatter = (2.0 * expected).sqrt();
    assert!(expected > 5.0 && (came - expected).abs() < 3.0 * scatter, "expected {expected}, came {came}");
}
