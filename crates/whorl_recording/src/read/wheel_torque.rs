//! Motor torque in force over time.
//!
//! The driver's `wheels/state` carries the torque in force at its stamp; the commands say when, between two
//! such messages, it changed.

/// Torques and since when.
type Steps = Vec<(i64, Vec<f64>)>;

/// Two readings of one torque [N m].
const EQUAL_N_M: f64 = 1e-9;

/// Torques in force, each until the next: from the commands as the driver carries them out, checked with what
/// it says was in force. Both are in order of time; either may be empty.
pub(super) fn in_force(commanded: &Steps, stated: &Steps) -> Steps {
    let mut steps = match (commanded.is_empty(), stated.is_empty()) {
        (_, true) => commanded.clone(),
        (true, false) => halfway(stated),
        (false, false) if agree(commanded, stated) => reconciled(commanded, stated),
        // What the drives state is measured, or of something else.
        (false, false) => commanded.clone(),
    };
    steps.dedup_by(|later, earlier| later.1 == earlier.1 || later.0 == earlier.0);
    steps
}

fn equal(a: &[f64], b: &[f64]) -> bool {
    a.len() == b.len() && a.iter().zip(b).all(|(a, b)| (a - b).abs() <= EQUAL_N_M)
}

/// Whether most of what is stated was commanded before.
fn agree(commanded: &Steps, stated: &Steps) -> bool {
    let mut next = 0;
    let mut same = 0;
    for (at, torque) in stated {
        while commanded.get(next).is_some_and(|(sent, _)| sent <= at) {
            next += 1;
        }
        // The last two: the newest may have arrived after the stamp.
        let recent = commanded.iter().take(next + 1).skip(next.saturating_sub(2));
        let none_yet = next == 0 && torque.iter().all(|u| *u == 0.0);
        same += usize::from(none_yet || recent.clone().any(|(_, sent)| equal(sent, torque)));
    }
    2 * same > stated.len()
}

/// Without commands a change lies anywhere between two messages: halfway has no bias.
fn halfway(stated: &Steps) -> Steps {
    let first = stated.iter().take(1).cloned();
    let changes = stated.windows(2).filter_map(|pair| match pair {
        [(before, old), (now, new)] if old != new => Some((before + (now - before) / 2, new.clone())),
        _ => None,
    });
    first.chain(changes).collect()
}

fn reconciled(commanded: &Steps, stated: &Steps) -> Steps {
    let mut steps: Steps = stated.iter().take(1).cloned().collect();
    let mut next = 0;
    for pair in stated.windows(2) {
        let [(before, old), (now, new)] = pair else { continue };
        // Two commands may arrive between messages; one that was recorded a little before or after the
        // driver had it belongs here all the same when its torque is the one in force now.
        let slack = (now - before).min(20_000_000);
        while commanded.get(next).is_some_and(|(sent, _)| *sent <= before - slack) {
            next += 1;
        }
        let reach = commanded.iter().skip(next).take_while(|(sent, _)| *sent <= now + slack);
        let in_force = reach
            .filter(|(_, torque)| equal(torque, new))
            .min_by_key(|(sent, _)| (*sent - (*sent).clamp(before + 1, *now)).abs());
        if equal(old, new) {
            continue;
        }
        let changed =
            in_force.map_or(before + (now - before) / 2, |(sent, _)| (*sent).clamp(before + 1, *now));
        let until = commanded.iter().skip(next).take_while(|(sent, _)| *sent < changed);
        let earlier = until.filter(|(sent, _)| sent > before);
        // A command that came and went between two messages.
        steps.extend(earlier.take(4).cloned());
        steps.push((changed, new.clone()));
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
        let commanded: Steps =
            (0..360_000).map(|k| (k * 10_000_000 + 3_000, vec![1e-3 * (k % 1000) as f64, 0.5])).collect();
        let stated: Steps = commanded.iter().map(|(at, torque)| (at + 5_000_000, torque.clone())).collect();
        let steps = in_force(&commanded, &stated);
        // The first is known by its statement only.
        assert_eq!(steps[0], stated[0]);
        assert_eq!(steps[1..], commanded[1..]);
    }
}
