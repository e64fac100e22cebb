//! Readings that are taken in together, as their means (METHOD.md, "Means of readings").

use whorl_recording::Recording;

use crate::inputs::commands::ns;
use crate::readings::{Cursor, Track};

/// Behind a command of a valve each reading is taken in by itself for so long \[s\]: most valves open and close within it, and nothing of a step in
/// which one does can be told from its beginning.
const VALVE_S: f64 = 0.02;

/// Of the time within which a random torque comes and goes: its mean over a cell is known from its end to a hundredth of its variance.
pub(crate) const SHARE_OF_TIME: f64 = 1.0 / 6.0;
/// Radians of the fastest motion: of exp(-A t) the terms that are left out are a twentieth of a hundredth.
pub(crate) const SHARE_OF_MOTION_RAD: f64 = 0.25;

/// The last instant of each cell \[ns\]; none: every instant is one.
///
/// Cells are the recording's own, whatever the model is, so that all models are asked for the same numbers.
pub(crate) fn cell_ends_ns(tracks: &[Track<'_>], recording: &Recording, cell_s: f64) -> Vec<i64> {
    let (mut ends, cell_ns) = (Vec::new(), ns(cell_s));
    if cell_ns <= 0 {
        return ends;
    }
    let (edges_ns, commands_ns) = (edges_ns(recording), commands_ns(recording));
    let comes = |all: &[i64], from_ns: i64, to_ns: i64| {
        let next = all.partition_point(|time_ns| *time_ns < from_ns);
        all.get(next).is_some_and(|time_ns| *time_ns < to_ns)
    };
    let (mut cursor, mut first_ns, mut before_ns) = (Cursor::new(tracks), i64::MIN, i64::MIN);
    let (mut is_open, mut was_alone) = (false, false);
    while let Some(instant_ns) = cursor.instant_ns(tracks) {
        while cursor.take(tracks, instant_ns).is_some() {}
        let is_alone = is_open && comes(&edges_ns, before_ns - ns(VALVE_S), instant_ns + 1);
        let is_told = is_open && comes(&commands_ns, before_ns, instant_ns);
        if is_open && !was_alone && !is_alone && !is_told && instant_ns - first_ns < cell_ns {
            ends.pop();
        } else {
            first_ns = instant_ns;
        }
        ends.push(instant_ns);
        (is_open, was_alone, before_ns) = (true, is_alone, instant_ns);
    }
    ends
}

/// When wheels are told something else \[ns\]. A controller may have answered to what was read just before: what is read behind its command follows from
/// that, and is taken in later.
fn commands_ns(recording: &Recording) -> Vec<i64> {
    let wheels = &recording.wheel_torque_command_n_m;
    let told = wheels.time_s.iter().zip(&wheels.value);
    let changed = told.zip(std::iter::once(None).chain(wheels.value.iter().map(Some)));
    changed
        .filter(|((_, now), before)| before.is_none_or(|before| before != *now))
        .map(|((t, _), _)| ns(*t))
        .collect()
}

/// When anything is told to the platform that moves it at once and wholly, or moves its valves \[ns\], in order.
fn edges_ns(recording: &Recording) -> Vec<i64> {
    let pulses = recording.jet_pulses.iter().flatten().flat_map(|pulse| [pulse.on_s, pulse.off_s]);
    let others = [
        &recording.ballast_moment_b_n_m.time_s,
        &recording.body_torque_b_n_m.time_s,
        &recording.gimbal_angle_rad.time_s,
    ];
    let mut edges: Vec<i64> = pulses.chain(others.into_iter().flatten().copied()).map(ns).collect();
    edges.sort_unstable();
    edges
}
