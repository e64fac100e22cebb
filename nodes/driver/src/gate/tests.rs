//! Tests of the gate alone.

use super::*;
use whorl_dynamics::PlatformModel;
use whorl_msgs::std_msgs::Header;

fn at(ms: i64) -> Timestamp {
    Timestamp(ms * 1_000_000)
}

fn command(sequence: u64, stamp_ms: i64, valid_ms: i64, slot: u64) -> ActuatorCommand {
    ActuatorCommand {
        header: Header { stamp: at(stamp_ms).into(), frame_id: String::new() },
        sequence,
        valid_until: at(valid_ms).into(),
        wheel_torque_n_m: vec![0.1, -9.0],
        jet_slot: slot,
        jet_slot_length_s: 0.1,
        jet_on_time_s: vec![0.02, 0.5],
        gimbal_rate_rad_s: Vec::new(),
    }
}

fn gate() -> Gate {
    let mut model = PlatformModel::whorl_1_reference();
    model.wheels_mut().truncate(2);
    model.jets_mut().truncate(2);
    Gate::new(&model.actuators)
}

#[test]
fn wheels_follow_every_command_and_a_slot_fires_once() {
    let mut gate = gate();
    let wheels = Action::Motors(Kind::Wheels, vec![0.1, -0.5]);
    let pulses = Action::Pulses(vec![0.02, 0.1]);
    assert_eq!(gate.command(at(1), &command(0, 0, 60, 4)), Ok(vec![wheels.clone(), pulses.clone()]));
    assert_eq!(gate.command(at(11), &command(1, 10, 70, 4)), Ok(vec![wheels.clone()]));
    // The first command of slot 5 was lost: the second one fires it.
    assert_eq!(gate.command(at(31), &command(3, 30, 90, 5)), Ok(vec![wheels, pulses]));
}

#[test]
fn silence_switches_everything_off_once_at_the_end_of_validity() {
    let mut gate = gate();
    gate.command(at(1), &command(0, 0, 60, 0)).unwrap();
    assert_eq!(gate.deadline(), Some(at(60)));
    assert_eq!(gate.watch(at(59)), None);
    assert_eq!(gate.watch(at(60)), Some(Action::AllOff));
    assert_eq!(gate.watch(at(61)), None);
    assert_eq!(gate.counts().timeouts, 1);
}

#[test]
fn no_command_holds_longer_than_a_tenth_of_a_second() {
    let mut gate = gate();
    gate.command(at(1), &command(0, 0, 3_600_000, 0)).unwrap();
    assert_eq!(gate.watch(at(80)), None);
    assert_eq!(gate.watch(at(81)), Some(Action::AllOff));
}

/// For one stall of the DDS library longer, and still less than what devices take for silence, 200 ms.
#[test]
fn secured_a_command_holds_for_a_stall_longer() {
    let mut gate = gate().secured();
    gate.command(at(1), &command(0, 0, 3_600_000, 0)).unwrap();
    assert_eq!(gate.watch(at(180)), None);
    assert_eq!(gate.watch(at(181)), Some(Action::AllOff));
    // What the sender says ends it earlier, as ever.
    gate.command(at(200), &command(1, 199, 259, 1)).unwrap();
    assert_eq!(gate.watch(at(259)), Some(Action::AllOff));
}

#[test]
fn bad_commands_are_refused_and_change_nothing() {
    let mut gate = gate();
    gate.command(at(1), &command(5, 0, 60, 0)).unwrap();
    let mut nan = command(6, 10, 70, 1);
    nan.wheel_torque_n_m[0] = f64::NAN;
    let mut short = command(6, 10, 70, 1);
    short.jet_on_time_s.pop();
    let mut negative = command(6, 10, 70, 1);
    negative.jet_on_time_s[0] = -0.01;
    assert_eq!(gate.command(at(11), &nan), Err(Refusal::NotFinite));
    assert_eq!(gate.command(at(11), &short), Err(Refusal::WrongSize));
    assert_eq!(gate.command(at(11), &negative), Err(Refusal::OutOfRange));
    assert_eq!(gate.command(at(11), &command(5, 0, 70, 1)), Err(Refusal::OutOfOrder));
    assert_eq!(gate.command(at(80), &command(6, 10, 70, 1)), Err(Refusal::Expired));
    assert_eq!(gate.deadline(), Some(at(60)));
    assert_eq!(gate.counts(), GateCounts { accepted: 1, refused: 5, timeouts: 0 });
}

#[test]
fn no_single_command_locks_later_ones_out() {
    let honest = |gate: &mut Gate, k: i64| {
        let number = u64::try_from(k).unwrap();
        gate.command(at(10 * k + 1), &command(number, 10 * k, 10 * k + 60, number / 3))
    };
    let mut gate = gate();
    honest(&mut gate, 0).unwrap();
    // An hour ahead; more than the tolerance ahead; the largest numbers; a slot that would not end.
    assert_eq!(gate.command(at(2), &command(1, 3_600_000, 3_600_060, 0)), Err(Refusal::Ahead));
    assert_eq!(gate.command(at(2), &command(1, 110, 170, 0)), Err(Refusal::Ahead));
    let mut long = command(1, 2, 60, 0);
    long.jet_slot_length_s = 1e20;
    long.jet_on_time_s[0] = 1e20;
    assert_eq!(gate.command(at(2), &long), Err(Refusal::OutOfRange));
    gate.command(at(2), &command(u64::MAX, 1, 61, u64::MAX)).unwrap();
    let mut fired = 0;
    for k in 1..10 {
        let actions = honest(&mut gate, k).unwrap();
        fired += usize::from(actions.iter().any(|a| matches!(a, Action::Pulses(_))));
    }
    // Slots 0 (again: the forged one had replaced it), 1, 2 and 3.
    assert_eq!(fired, 4);
}

#[test]
fn the_state_tells_what_was_applied_when_and_how_late_it_ended() {
    let mut gate = gate();
    assert_eq!(gate.state(), GateState::default());
    gate.command(at(11), &command(3, 10, 70, 0)).unwrap();
    let _ = gate.command(at(12), &command(4, 5000, 5060, 0));
    let state = gate.state();
    assert_eq!((state.state, state.command_sequence), (GateState::STATE_OBEYING, 3));
    assert_eq!(
        [state.command_stamp, state.applied_at, state.closes_at].map(Timestamp::from),
        [at(10), at(11), at(70)]
    );
    assert_eq!((state.refused, state.refusal), (1, GateState::REFUSAL_AHEAD));
    // The process was stopped for a second.
    gate.watch(at(1070)).unwrap();
    let state = gate.state();
    assert_eq!((state.state, state.timeouts, state.switched_off_late_s), (GateState::STATE_OFF, 1, 1.0));
    assert_eq!(Timestamp::from(state.closes_at), at(0));
}

#[test]
fn a_restarted_sender_is_obeyed_at_once() {
    let mut gate = gate();
    gate.command(at(1), &command(500, 0, 60, 50)).unwrap();
    let actions = gate.command(at(211), &command(0, 210, 270, 0)).unwrap();
    assert_eq!(actions.len(), 2, "its first slot fires although its counter is smaller");
}
