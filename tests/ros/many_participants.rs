//! More participants on one machine than RustDDS announces itself to: four platforms have twelve nodes, and coordinator,
//! recorder and monitor come to that.

use whorl_ros::Participant;

use crate::support::formation::{Formation, LONG_HOLD_ALONE};

/// RustDDS does not announce itself to participants beyond this number.
pub(super) const TOLD_BY_RUSTDDS: u16 = 12;

#[test]
fn nodes_beyond_the_twelfth_participant_meet() {
    let mut formation = Formation::new(&["whorl_1"], &[LONG_HOLD_ALONE]);
    let watch = formation.watch();
    // With the watch they take all of these numbers but the last, which carries announcements to those after it.
    let crowd: Vec<Participant> = (1..TOLD_BY_RUSTDDS - 1).map(|_| formation.participant()).collect();
    assert!(crowd.iter().all(|one| one.participant_number() < TOLD_BY_RUSTDDS));
    formation.start_all();
    formation.wait_for_step(&watch, "hold");
    formation.stop();
}
