//! Explanations that data cannot tell apart are both kept.

use whorl_dynamics::PlatformModel;

use super::generator::{map, record, wrong_model};
use crate::{Options, Verdict, diagnose};

#[test]
#[ignore = "slow: a tie from one run"]
fn torques_that_no_motion_tells_apart_are_both_kept() {
    // A steady torque about the vertical: from the bearing or from the air of the room.
    let mut truth = PlatformModel::whorl_1_reference();
    truth.effects = map(&[("bearing_turbine", &[("vertical_n_m", 0.01)])]);
    let run = record(&truth, 41, 50.0, None);
    let (model, prior) = wrong_model(&truth, 41);
    let diagnosis =
        diagnose(std::slice::from_ref(&run), &[], &model, &prior, &Options::default(), &mut |_| {}).unwrap();
    let (effects, others) = (&diagnosis.effects, &diagnosis.confounded_with);
    assert_eq!(diagnosis.verdict, Verdict::Confounded, "{effects:?} {others:?}");
    for id in ["air_current", "bearing_turbine"] {
        assert!(
            effects.iter().chain(others.iter().flatten()).any(|e| e == id),
            "{id}: {effects:?} {others:?}"
        );
    }
}
