//! Fault row: the computer's clock is set while nodes run.

use std::time::Duration;

use whorl_msgs::topics::Topic;
use whorl_msgs::whorl::{ControlStatus, GateState};

use crate::support::clock::Settable;
use crate::support::formation::{Formation, LONG_HOLD_ALONE, STARTUP};
use crate::support::skipped;
use crate::support::watch::route;

#[test]
fn a_clock_that_is_set_by_a_minute_is_survived_and_told_and_the_gate_still_closes() {
    let mut formation = Formation::new(&["whorl_1"], &[LONG_HOLD_ALONE]);
    let (clock, variables) = match Settable::new(formation.folder()) {
        Ok(made) => made,
        Err(why) => {
            skipped("a clock that is set", &format!("no clock can be shifted here: {why}"));
            return;
        }
    };
    formation.set_environment_of_all(variables);
    let watch = formation.watch();
    formation.start_all();
    formation.wait_for_step(&watch, "hold");

    // Back, forth, and forth again.
    for ahead_s in [-60.0, 0.0, 60.0] {
        clock.set_ahead(ahead_s);
        // One second: what was under way has arrived.
        watch.during(Duration::from_secs(1));
        watch.wait_next::<ControlStatus>("tracking", route(0, Topic::ControlStatus), STARTUP, |m| {
            m.mode == ControlStatus::MODE_TRACK
        });
        formation.check_alive();
    }
    for node in ["/whorl_1/driver", "/whorl_1/estimator", "/whorl_1/local_control", "/coordinator"] {
        let log = formation.node(node).log();
        for step in ["-60.000 s", "+60.000 s"] {
            let said = format!("clock was set by {step}");
            assert!(log.contains(&said), "{node} did not say '{said}':\n{log}");
        }
    }

    // Set back at the moment at which commands end: everything is off all the same.
    formation.kill("/whorl_1/local_control");
    clock.set_ahead(0.0);
    let closed =
        watch.wait_next::<GateState>("the gate to close", route(0, Topic::GateState), STARTUP, |m| {
            m.state == GateState::STATE_OFF
        });
    // And stays so.
    let since = watch.during(Duration::from_secs(1));
    assert!(since > closed);
    let states: Vec<u8> =
        watch.log().after::<GateState>(route(0, Topic::GateState), since).map(|(_, m)| m.state).collect();
    assert!(states.iter().all(|state| *state == GateState::STATE_OFF), "{states:?}");
}
