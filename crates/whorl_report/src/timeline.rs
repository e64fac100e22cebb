//! What all figures over time share: the time they show, shaded stretches and marked events.

use serde_json::{Value, json};
use whorl_msgs::whorl::ControlStatus;

use crate::data::RunData;
use crate::events::Happening;
use crate::metrics::phase_name;
use crate::times::Interval;

/// Who a mark concerns when it concerns all.
const ALL: &str = "formation";

/// Time, shaded stretches and events of a run.
#[derive(Debug, Clone, Default)]
pub struct Timeline {
    /// First and last time shown \[s\].
    pub span_s: Interval,
    shades: Vec<Value>,
    events: Vec<Value>,
}

impl Timeline {
    /// A time without marks.
    pub fn plain(span_s: Interval) -> Self {
        Self { span_s, ..Self::default() }
    }

    /// Of a run: hold phases, safe modes and clipped references shaded, steps and faults marked.
    pub fn new(run: &RunData, happenings: &[Happening]) -> Self {
        let mut shades: Vec<Value> =
            run.holds.intervals().map(|interval| shade(interval, "hold", ALL)).collect();
        for (name, data) in &run.platforms {
            let safe =
                |mode| matches!(mode, ControlStatus::MODE_SAFE_DAMPING | ControlStatus::MODE_SAFE_COAST);
            let last = data.modes.last().map(|(_, (mode, _))| (data.last_status_s, safe(*mode)));
            let states = data.modes.iter().map(|(time_s, (mode, _))| (*time_s, safe(*mode))).chain(last);
            shades.extend(stretches(states).into_iter().map(|s| shade(s, "safe", name)));
            let clipped = run.formation.iter().filter_map(|s| {
                let index = s.message.platforms.iter().position(|p| p == name)?;
                Some((s.stamp_s, *s.message.reference_clipped.get(index)?))
            });
            shades.extend(stretches(clipped).into_iter().map(|s| shade(s, "clipped", name)));
        }
        let mut events: Vec<Value> = steps(run)
            .into_iter()
            .map(|(time_s, label)| json!({"t": time_s, "who": ALL, "label": label, "fault": false}))
            .collect();
        events.extend(happenings.iter().filter(|h| h.fault).map(|h| {
            let who = run.platforms.keys().find(|name| h.who.starts_with(name.as_str()));
            json!({"t": h.time_s, "who": who.map_or(ALL, String::as_str), "label": "", "fault": true})
        }));
        Self { span_s: (0.0, run.duration_s), shades, events }
    }

    /// As the page's script reads it.
    pub fn stored(&self) -> [(&'static str, Value); 3] {
        [("span", json!(self.span_s)), ("shades", json!(self.shades)), ("events", json!(self.events))]
    }
}

/// When each step of the sequence began \[s\], and its name; the phase before and after the sequence.
pub(crate) fn steps(run: &RunData) -> Vec<(f64, String)> {
    let mut list: Vec<(f64, String)> = Vec::new();
    for state in &run.formation {
        let name =
            if state.message.step.is_empty() { phase_name(state.message.phase) } else { &state.message.step };
        if list.last().is_none_or(|(_, last)| last != name) {
            list.push((state.stamp_s, name.to_owned()));
        }
    }
    list
}

fn shade((from, to): Interval, kind: &str, who: &str) -> Value {
    json!({"from": from, "to": to, "kind": kind, "who": who})
}

/// Stretches of time over which a state holds, each to the first sample in which it does not.
fn stretches(states: impl Iterator<Item = (f64, bool)>) -> Vec<Interval> {
    let mut list = Vec::new();
    let (mut since, mut last) = (None, 0.0);
    for (time_s, holds) in states {
        last = time_s;
        match (since, holds) {
            (None, true) => since = Some(time_s),
            (Some(start), false) => {
                list.push((start, time_s));
                since = None;
            }
            _ => {}
        }
    }
    list.extend(since.map(|start| (start, last)));
    list
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn stretches_end_where_the_state_does() {
        let states = [(0.0, false), (1.0, true), (2.0, true), (3.0, false), (4.0, true), (5.0, true)];
        assert_eq!(stretches(states.into_iter()), [(1.0, 3.0), (4.0, 5.0)]);
        assert_eq!(stretches([(1.0, false)].into_iter()), []);
    }
}
