//! Whether computers keep up and messages arrive, by what nodes count of themselves once a second.

use std::collections::{BTreeMap, VecDeque};

use whorl_msgs::diagnostic_msgs::DiagnosticStatus;
use whorl_ros::{LATE_TIMERS, LOST_MESSAGES};

/// Counts are compared over this time \[s\]: ten reports of each node.
const WINDOW_S: f64 = 10.0;
/// A node that is silent for longer \[s\] has ended.
const STALE_S: f64 = 3.0;
/// Reports that are kept of each node: those of the window at ten times their rate.
const REPORTS: usize = 100;
/// Nodes that are followed: a formation of eight platforms has some forty.
const NODES: usize = 128;
/// Late timers per second above which the verdict on a run calls its computer overloaded.
const LATE_PER_S: f64 = 1.0;

/// How often the page looks at what has arrived \[Hz\], ...
const LOOKS_HZ: f64 = 30.0;
/// ... and the share of that below which it says so.
const KEEPS_UP: f64 = 0.5;
/// Looks that are kept: those of the window at ten times their rate.
const LOOKS: usize = 3000;

/// What nodes said of themselves.
#[derive(Debug, Default)]
pub struct Load {
    /// When the page itself looked at what had arrived.
    looks: VecDeque<f64>,
    nodes: BTreeMap<String, VecDeque<Report>>,
}

/// When \[s\], timers that were late, messages that were lost.
type Report = (f64, u64, u64);

impl Load {
    /// Takes a node's own status; others have none of the counts.
    pub fn take(&mut self, now_s: f64, status: &DiagnosticStatus) {
        let count = |key: &str| status.values.iter().find(|v| v.key == key)?.value.parse::<u64>().ok();
        let (Some(late), Some(lost)) = (count(LATE_TIMERS), count(LOST_MESSAGES)) else { return };
        if self.nodes.len() >= NODES && !self.nodes.contains_key(&status.name) {
            return;
        }
        let reports = self.nodes.entry(status.name.clone()).or_default();
        // One that was started again counts anew.
        if reports.back().is_some_and(|(_, before, gone)| late < *before || lost < *gone) {
            reports.clear();
        }
        reports.push_back((now_s, late, lost));
        while reports.len() > REPORTS || reports.front().is_some_and(|(t, ..)| now_s - t > WINDOW_S) {
            reports.pop_front();
        }
    }

    /// The page itself looks at what has arrived.
    pub fn look(&mut self, now_s: f64) {
        self.looks.push_back(now_s);
        while self.looks.len() > LOOKS || self.looks.front().is_some_and(|t| now_s - t > WINDOW_S) {
            self.looks.pop_front();
        }
    }

    /// How often a second the page looks, where that is too seldom; `None` where it keeps up.
    fn looks_hz(&self, now_s: f64) -> Option<f64> {
        let since_s = now_s - self.looks.front()?;
        let hz = self.looks.len().saturating_sub(1) as f64 / since_s;
        (since_s > STALE_S && hz < KEEPS_UP * LOOKS_HZ).then_some(hz)
    }

    /// What somebody who looks at the page should know: who, and what.
    pub fn faults(&self, now_s: f64) -> Vec<(String, String)> {
        let mut faults = Vec::new();
        if let Some(hz) = self.looks_hz(now_s) {
            let what = format!(
                "this page cannot keep up: it looks {hz:.0} times a second at what arrives in place of {LOOKS_HZ:.0}, and shows less than there is"
            );
            faults.push(("live page".to_owned(), what));
        }
        if let Some((sum, most)) = self.most(now_s, |(_, late, _)| *late)
            && sum as f64 > LATE_PER_S * WINDOW_S
        {
            let what = format!(
                "a computer is overloaded: {sum} deadlines missed in the last {WINDOW_S} s, most of them by {most}"
            );
            faults.push(("load".to_owned(), what));
        }
        if let Some((sum, most)) = self.most(now_s, |(_, _, lost)| *lost) {
            let what =
                format!("{sum} messages lost in the last {WINDOW_S} s, most of them on the way to {most}");
            faults.push(("network".to_owned(), what));
        }
        faults
    }

    /// How much a count grew over the window in all nodes, and the node in which it did most; `None` where it did not.
    fn most(&self, now_s: f64, count: impl Fn(&Report) -> u64) -> Option<(u64, &str)> {
        let grown = |reports: &VecDeque<Report>| {
            let (first, last) = (reports.front()?, reports.back()?);
            (now_s - last.0 <= STALE_S).then(|| count(last).saturating_sub(count(first)))
        };
        let of_nodes: Vec<(u64, &str)> =
            self.nodes.iter().filter_map(|(name, reports)| Some((grown(reports)?, name.as_str()))).collect();
        let (_, most) = of_nodes.iter().max_by_key(|(grown, _)| *grown).filter(|(grown, _)| *grown > 0)?;
        let sum = of_nodes.iter().fold(0, |sum: u64, (grown, _)| sum.saturating_add(*grown));
        Some((sum, most.trim_end_matches(": transport")))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use whorl_msgs::diagnostic_msgs::KeyValue;

    fn status(name: &str, late: u64, lost: u64) -> DiagnosticStatus {
        let value = |key: &str, count: u64| KeyValue { key: key.to_owned(), value: count.to_string() };
        let values = vec![value(LATE_TIMERS, late), value(LOST_MESSAGES, lost)];
        DiagnosticStatus { name: format!("{name}: transport"), values, ..DiagnosticStatus::default() }
    }

    #[test]
    fn overload_and_losses_are_told_while_they_last() {
        let mut load = Load::default();
        load.take(0.0, &status("driver", 500, 7));
        assert_eq!(load.faults(0.0), [], "what was before the page was opened is not told");
        load.take(1.0, &status("driver", 540, 7));
        load.take(1.0, &status("estimator", 2, 0));
        load.take(2.0, &status("estimator", 3, 5));
        let faults = load.faults(2.0);
        assert_eq!(faults.len(), 2, "{faults:?}");
        assert!(faults[0].1.contains("41 deadlines") && faults[0].1.ends_with("by driver"), "{faults:?}");
        assert!(faults[1].1.starts_with("5 messages") && faults[1].1.ends_with("to estimator"), "{faults:?}");
        // Neither a deadline now and then, nor a node that was started again.
        for k in 0..12 {
            load.take(f64::from(k) + 3.0, &status("driver", 540 + u64::from(k > 5), 7));
            load.take(f64::from(k) + 3.0, &status("estimator", 0, 0));
        }
        assert_eq!(load.faults(14.0), []);
        assert_eq!(load.faults(100.0), [], "all have ended");
    }

    #[test]
    fn a_page_that_does_not_keep_up_says_so_until_it_does() {
        let mut load = Load::default();
        let mut now_s = 0.0;
        let mut looked = |seconds: f64, hz: f64| {
            for _ in 0..(seconds * hz) as usize {
                now_s += 1.0 / hz;
                load.look(now_s);
            }
            load.faults(now_s)
        };
        assert_eq!(looked(20.0, 28.0), []);
        let faults = looked(20.0, 7.0);
        assert!(
            faults.len() == 1 && faults[0].0 == "live page" && faults[0].1.contains("7 times"),
            "{faults:?}"
        );
        assert_eq!(looked(20.0, 30.0), []);
        assert!(load.looks.len() <= LOOKS);
    }

    #[test]
    fn nodes_without_end_take_no_memory() {
        let mut load = Load::default();
        for k in 0..100_000_u32 {
            load.take(0.0, &status(&format!("node_{k}"), 0, 0));
            load.take(0.0, &status("node_0", 0, 0));
        }
        assert!(load.nodes.len() <= NODES && load.nodes.values().all(|reports| reports.len() <= REPORTS));
    }
}
