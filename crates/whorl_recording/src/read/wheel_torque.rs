//! Motor torque in force over time.
//!
//! The driver's `wheels/state` carries the torque in force at its stamp; the commands say when, between two
//! such messages, it changed.

use crate::columns::Columns;

/// Two readings of one torque [N m].
const EQUAL_N_M: f64 = 1e-9;

/// Torques in force, each until the next: from the commands as the driver carries them out, checked with what
/// it says was in force. Both are in order of time; either may be empty.
pub(super) fn in_force(commanded: Columns, stated: &Columns) -> Columns {
    let steps = match (commanded.is_empty(), stated.is_empty()) {
        (_, true) => commanded,
        (true, false) => halfway(stated),
        (false, false) if agree(&commanded, stated) => reconciled(&commanded, stated),
        // What the drives state is measured, or of something else.
        (false, false) => commanded,
    };
    let mut changes = Columns::default();
    for (at, torque) in steps.lines() {
        let before = changes.len().checked_sub(1).and_then(|last| changes.line(last));
        if before.is_none_or(|(earlier, old)| earlier != at && old != torque) {
            changes.push(at, torque);
        }
    }
    changes
}

fn equal(a: &[f64], b: &[f64]) -> bool {
    a.len() == b.len() && a.iter().zip(b).all(|(a, b)| (a - b).abs() <= EQUAL_N_M)
}

/// Whether most of what is stated was commanded before.
fn agree(commanded: &Columns, stated: &Columns) -> bool {
    let mut next = 0;
    let mut same = 0;
    for (at, torque) in stated.lines() {
        while commanded.line(next).is_some_and(|(sent, _)| sent <= at) {
            next += 1;
        }
        // The last two: the newest may have arrived after the stamp.
        let mut recent = (next.saturating_sub(2)..=next).filter_map(|k| commanded.line(k));
        let none_yet = next == 0 && torque.iter().all(|u| *u == 0.0);
        same += usize::from(none_yet || recent.any(|(_, sent)| equal(sent, torque)));
    }
    2 * same > stated.len()
}

/// Without commands a change lies anywhere between two messages: halfway has no bias.
fn halfway(stated: &Columns) -> Columns {
    let mut steps = Columns::default();
    steps.extend(stated.lines().take(1));
    let changes = stated.pairs().filter(|((_, old), (_, new))| old != new);
    steps.extend(changes.map(|((before, _), (now, new))| (before + (now - before) / 2, new)));
    steps
}

fn reconciled(commanded: &Columns, stated: &Columns) -> Columns {
    let mut steps = Columns::default();
    steps.extend(stated.lines().take(1));
    let mut next = 0;
    let from = |k: usize| (k..commanded.len()).filter_map(|k| commanded.line(k));
    for ((before, old), (now, new)) in stated.pairs() {
        // Two commands may arrive between messages; one that was recorded a little before or after the
        // driver had it belongs here all the same when its torque is the one in force now.
        let slack = (now - before).min(20_000_000);
        while commanded.line(next).is_some_and(|(sent, _)| sent <= before - slack) {
            next += 1;
        }
        let reach = from(next).take_while(|(sent, _)| *sent <= now + slack);
        let in_force = reach
            .filter(|(_, torque)| equal(torque, new))
            .min_by_key(|(sent, _)| (*sent - (*sent).clamp(before + 1, now)).abs());
        if equal(old, new) {
            continue;
        }
        let changed = in_force.map_or(before + (now - before) / 2, |(sent, _)| sent.clamp(before + 1, now));
        let until = from(next).take_while(|(sent, _)| *sent < changed);
        let earlier = until.filter(|(sent, _)| *sent > before);
        // A command that came and went between two messages.
        steps.extend(earlier.take(4));
        steps.push(changed, new);
    }
    steps
}

#[cfg(test)]
mod tests {
    use super::*;

    /// An hour at 100 Hz: what the drives state half a period later is what was commanded, when it was. (With a search of
    /// all commands for each message this takes minutes.)
    #[test]
    fn an_hour_of_commands_comes_back() {
        let (mut commanded, mut stated) = (Columns::default(), Columns::default());
        for k in 0..360_000 {
            let (at, torque) = (k * 10_000_000 + 3_000, [1e-3 * (k % 1000) as f64, 0.5]);
            commanded.push(at, &torque);
            stated.push(at + 5_000_000, &torque);
        }
        let steps = in_force(commanded.clone(), &stated);
        // The first is known by its statement only.
        assert_eq!(steps.line(0), stated.line(0));
        assert!(steps.lines().skip(1).eq(commanded.lines().skip(1)));
    }
}
