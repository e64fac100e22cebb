//! `whorl start`, `hold` and `abort` reach the coordinator every time: a person's way to stop an experiment. More participants
//! are there than RustDDS announces itself to, as with two platforms, their monitors, coordinator, recorder and status line.

use std::net::UdpSocket;
use std::process::Output;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

use whorl_msgs::topics::Topic;
use whorl_msgs::whorl::FormationState;

use crate::support::binaries;
use crate::support::formation::{Formation, LONG_HOLD_ALONE, STARTUP};
use crate::support::watch::route;

use super::many_participants::TOLD_BY_RUSTDDS;

/// Does not start by itself, and can be started again after an abort.
const BY_HAND: &str = r#"
/coordinator:
  ros__parameters:
    experiment: {auto_start: false, exit_when_finished: false}
"#;

/// A loop that computes until it is dropped.
struct Busy(Arc<AtomicBool>);

impl Busy {
    fn start() -> Self {
        let end = Arc::new(AtomicBool::new(false));
        let ended = Arc::clone(&end);
        std::thread::spawn(move || {
            while !ended.load(Ordering::Relaxed) {
                std::hint::spin_loop();
            }
        });
        Self(end)
    }
}

impl Drop for Busy {
    fn drop(&mut self) {
        self.0.store(true, Ordering::Relaxed);
    }
}

/// Whether the coordinator does as it is told; it is an error when it does not answer.
fn say(formation: &Formation, words: &[&str]) -> bool {
    let Output { status, stderr, .. } =
        formation.command(None, &binaries::path("whorl")).args(words).output().unwrap();
    let stderr = String::from_utf8_lossy(&stderr);
    assert!(!stderr.contains("nobody was found") && !stderr.contains("no answer"), "{words:?}: {stderr}");
    status.success()
}

fn is_heard(mut formation: Formation, times: usize) {
    let watch = formation.watch();
    // The numbers of participants below the twelfth are taken, without anybody who exchanges messages or keys.
    let taken: Vec<UdpSocket> = (0..TOLD_BY_RUSTDDS - 1)
        .filter_map(|number| {
            UdpSocket::bind(("0.0.0.0", 7400 + 250 * formation.domain() + 10 + 2 * number)).ok()
        })
        .collect();
    assert!(taken.len() + 2 >= usize::from(TOLD_BY_RUSTDDS), "only the watch is below the twelfth");
    formation.start_all();
    watch.wait_next::<FormationState>(
        "the platform to be ready",
        route(0, Topic::FormationState),
        STARTUP,
        |m| m.phase == FormationState::PHASE_READY,
    );
    for time in 0..times {
        // Half of them on a busy computer.
        let _busy = (time % 2 == 1).then(Busy::start);
        let begin = std::time::Instant::now();
        // Refused until the platform is ready.
        while !say(&formation, &["start"]) {
            formation.check_alive();
            assert!(begin.elapsed() < STARTUP, "it does not start\n{}", watch.summary());
        }
        assert!(say(&formation, &["hold", "a cable hangs"]), "hold {time} of {times} is refused");
        assert!(say(&formation, &["abort", "the cable is torn"]), "abort {time} of {times} is refused");
        watch.wait_next::<FormationState>("the abort", route(0, Topic::FormationState), STARTUP, |m| {
            m.phase == FormationState::PHASE_ABORTED
        });
    }
    println!("measured: {times} of {times} starts, holds and aborts were heard");
    formation.stop();
}

fn platform() -> Formation {
    Formation::new(&["whorl_1"], &[LONG_HOLD_ALONE, BY_HAND])
}

/// Each command is a participant that comes and goes: more of them, within seconds, than samples of a topic are kept for a reader.
#[test]
fn an_operator_is_heard_every_time() {
    is_heard(platform(), 25);
}

#[test]
#[ignore = "slow: fifty starts, holds and aborts"]
fn an_operator_is_heard_fifty_times() {
    is_heard(platform(), 50);
}

#[test]
fn an_operator_is_heard_every_time_where_traffic_is_secured() {
    if super::secure::is_built("an operator on a secured network") {
        is_heard(platform().secured(), 3);
    }
}

#[test]
#[ignore = "slow: fifty starts, holds and aborts, secured"]
fn an_operator_is_heard_fifty_times_where_traffic_is_secured() {
    if super::secure::is_built("an operator on a secured network") {
        is_heard(platform().secured(), 50);
    }
}
