//! Counts of the shell, reported in `/diagnostics`.

use std::collections::HashMap;
use std::time::Duration;

use whorl_msgs::diagnostic_msgs::{DiagnosticArray, DiagnosticStatus, KeyValue};
use whorl_msgs::std_msgs::Header;
use whorl_node::Timestamp;

use crate::raw::EndpointId;

/// Verdict on one sample.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Arrival {
    /// To be delivered.
    Fresh,
    /// Not newer than one that was already delivered from the same writer: a late one, or a
    /// repetition after a renewal.
    Old,
}

/// Counts of one subscription.
#[derive(Debug, Clone, Default)]
pub(crate) struct SubscriptionCounts {
    pub received: u64,
    pub lost: u64,
    pub old: u64,
    pub undecodable: u64,
    /// Refused because a field is outside its bounds.
    pub out_of_bounds: u64,
    /// Refused because another participant is the topic's publisher.
    pub second_publisher: u64,
    /// Accepted from the topic's publisher after such a one had been refused: both are alive.
    pub contested: u64,
    /// Monotonic time of the last sample that was delivered.
    pub last: Option<Duration>,
    writers: HashMap<EndpointId, Heard>,
}

/// What was heard of one writer.
#[derive(Debug, Clone, Copy)]
struct Heard {
    /// Number of the latest sample that was delivered.
    latest: i64,
    /// Number of the latest old one, and how many came since, each newer than the one before.
    old: (i64, u32),
}

/// So many old samples in a row, each newer than the one before, are no repetition, which is a writer's history of at most
/// ten: the writer is there, and a number that it never sent had been taken for its latest.
const STREAM_OF_OLD: u32 = 20;

impl SubscriptionCounts {
    /// Records a sample by its writer's count.
    pub(crate) fn arrival(&mut self, now: Duration, writer: EndpointId, number: i64) -> Arrival {
        let fresh = Heard { latest: number, old: (i64::MIN, 0) };
        match self.writers.get_mut(&writer) {
            Some(heard) if number <= heard.latest => {
                let (last, streak) = heard.old;
                heard.old = (number, if number > last { streak + 1 } else { 1 });
                if heard.old.1 < STREAM_OF_OLD {
                    self.old += 1;
                    return Arrival::Old;
                }
                *heard = fresh;
            }
            Some(heard) => {
                let missing = number.saturating_sub(heard.latest).saturating_sub(1);
                self.lost = self.lost.saturating_add(u64::try_from(missing).unwrap_or(0));
                *heard = fresh;
            }
            None => {
                self.writers.insert(writer, fresh);
            }
        }
        // Not before: who only repeats himself has said nothing.
        self.last = Some(now);
        self.received += 1;
        Arrival::Fresh
    }

    /// Writers heard so far.
    pub(crate) fn writers(&self) -> impl Iterator<Item = &EndpointId> {
        self.writers.keys()
    }

    fn forget(&mut self, writer: EndpointId) {
        self.writers.remove(&writer);
    }
}

/// Counts of a node.
#[derive(Debug, Default)]
pub(crate) struct Statistics {
    pub subscriptions: Vec<(String, SubscriptionCounts)>,
    pub publications: Vec<(String, u64)>,
    pub publish_failures: u64,
    pub undeclared: u64,
    pub late_timers: u64,
    pub parameter_sets_refused: u64,
    pub renewals: u64,
    pub reconnections: u64,
    /// How often the computer's clock was set.
    pub clock_steps: u64,
    pub missing_participants: usize,
    gone: Vec<(Duration, EndpointId)>,
    reported: Reported,
}

/// How `/diagnostics` reports that two participants write a topic of one; the monitor shows it at once.
pub const SECOND_PUBLISHER: &str = "a second publisher writes";

/// Key under which a node counts in `/diagnostics` how often it was late.
pub const LATE_TIMERS: &str = "timer firings more than a period late";
/// Likewise for messages to it that did not arrive.
pub const LOST_MESSAGES: &str = "messages lost on the way";

/// Longer than DDS's cache keeps a sample that everybody has read.
const REMEMBER_GONE_WRITERS: Duration = Duration::from_secs(60);

/// Totals at the time of the last report.
#[derive(Debug, Default)]
struct Reported {
    at: Timestamp,
    received: Vec<u64>,
    sent: Vec<u64>,
    undecodable: u64,
    out_of_bounds: u64,
    contested: u64,
    publish_failures: u64,
}

impl Statistics {
    pub(crate) fn new(subscriptions: Vec<String>, publications: Vec<String>) -> Self {
        Self {
            subscriptions: subscriptions.into_iter().map(|t| (t, SubscriptionCounts::default())).collect(),
            publications: publications.into_iter().map(|t| (t, 0)).collect(),
            ..Self::default()
        }
    }

    /// Records departed writers, and forgets those that left some time ago: a peer
    /// that restarts often must not fill memory, but a new reader may be served from DDS's cache
    /// the last messages of a departed writer.
    pub(crate) fn writers_gone(&mut self, now: Duration, writers: impl IntoIterator<Item = EndpointId>) {
        self.gone.extend(writers.into_iter().map(|writer| (now, writer)));
        let Self { gone, subscriptions, .. } = self;
        gone.retain(|(since, writer)| {
            let keep = now.saturating_sub(*since) < REMEMBER_GONE_WRITERS;
            if !keep {
                subscriptions.iter_mut().for_each(|(_, counts)| counts.forget(*writer));
            }
            keep
        });
    }

    fn total(&self, count: impl Fn(&SubscriptionCounts) -> u64) -> u64 {
        self.subscriptions.iter().map(|(_, counts)| count(counts)).sum()
    }

    fn topics_with(&self, count: impl Fn(&SubscriptionCounts) -> u64) -> String {
        let topics = self.subscriptions.iter().filter(|(_, counts)| count(counts) > 0);
        topics.map(|(topic, _)| topic.as_str()).collect::<Vec<_>>().join(", ")
    }

    /// The node's entry in `/diagnostics`; rates are since the last call.
    pub(crate) fn report(&mut self, node: &str, now: Timestamp) -> DiagnosticArray {
        let seconds = now.seconds_since(self.reported.at).max(1e-3);
        let first = self.reported.at == Timestamp(0);
        let rate = |count: u64, before: Option<&u64>| {
            if first { 0.0 } else { (count - before.copied().unwrap_or(0)) as f64 / seconds }
        };
        let mut values = Vec::new();
        let mut value = |key: String, value: String| values.push(KeyValue { key, value });
        for (index, (topic, counts)) in self.subscriptions.iter().enumerate() {
            value(
                format!("in {topic}"),
                format!(
                    "{:.1} Hz, {} received, {} lost, {} old, {} undecodable, {} out of bounds, {} from a second publisher",
                    rate(counts.received, self.reported.received.get(index)),
                    counts.received,
                    counts.lost,
                    counts.old,
                    counts.undecodable,
                    counts.out_of_bounds,
                    counts.second_publisher
                ),
            );
        }
        for (index, (topic, sent)) in self.publications.iter().enumerate() {
            value(
                format!("out {topic}"),
                format!("{:.1} Hz, {sent} sent", rate(*sent, self.reported.sent.get(index))),
            );
        }
        for (key, count) in [
            ("messages that could not be sent", self.publish_failures),
            ("messages on topics not declared", self.undeclared),
            (LATE_TIMERS, self.late_timers),
            (LOST_MESSAGES, self.total(|counts| counts.lost)),
            ("parameter sets refused", self.parameter_sets_refused),
            ("renewals of the endpoints", self.renewals),
            ("reconnections", self.reconnections),
            ("steps of the computer's clock", self.clock_steps),
            ("missing participants", self.missing_participants as u64),
        ] {
            value(key.to_owned(), count.to_string());
        }
        let undecodable = self.total(|counts| counts.undecodable);
        let out_of_bounds = self.total(|counts| counts.out_of_bounds);
        let mut problems = Vec::new();
        if undecodable > self.reported.undecodable {
            problems
                .push(format!("undecodable messages on {}", self.topics_with(|counts| counts.undecodable)));
        }
        if out_of_bounds > self.reported.out_of_bounds {
            let topics = self.topics_with(|counts| counts.out_of_bounds);
            problems.push(format!("messages out of bounds on {topics}"));
        }
        let contested = self.total(|counts| counts.contested);
        let is_contested = contested > self.reported.contested;
        if is_contested {
            let topics = self.topics_with(|counts| counts.contested);
            problems.push(format!("{SECOND_PUBLISHER} {topics}: refused"));
        }
        if self.publish_failures > self.reported.publish_failures {
            problems.push("messages could not be sent".to_owned());
        }
        if self.missing_participants > 0 {
            problems.push(format!("{} participant(s) missing", self.missing_participants));
        }
        self.reported = Reported {
            at: now,
            received: self.subscriptions.iter().map(|(_, counts)| counts.received).collect(),
            sent: self.publications.iter().map(|(_, sent)| *sent).collect(),
            undecodable,
            out_of_bounds,
            contested,
            publish_failures: self.publish_failures,
        };
        DiagnosticArray {
            header: Header { stamp: now.into(), frame_id: String::new() },
            status: vec![DiagnosticStatus {
                level: match (is_contested, problems.is_empty()) {
                    (true, _) => DiagnosticStatus::ERROR,
                    (false, true) => DiagnosticStatus::OK,
                    (false, false) => DiagnosticStatus::WARN,
                },
                name: format!("{}: transport", node.trim_start_matches('/')),
                message: if problems.is_empty() { "ok".to_owned() } else { problems.join("; ") },
                hardware_id: String::new(),
                values,
            }],
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const W: EndpointId = EndpointId([1; 16]);

    #[test]
    fn gaps_are_losses_and_repetitions_are_not_delivered() {
        let mut counts = SubscriptionCounts::default();
        let mut arrive = |n| counts.arrival(Duration::ZERO, W, n);
        let fresh: Vec<i64> =
            [5, 6, 9, 8, 9, 10].into_iter().filter(|n| arrive(*n) == Arrival::Fresh).collect();
        assert_eq!(fresh, [5, 6, 9, 10]);
        assert_eq!((counts.received, counts.lost, counts.old), (4, 2, 2));
        // Another writer counts for itself.
        assert_eq!(counts.arrival(Duration::ZERO, EndpointId([2; 16]), 1), Arrival::Fresh);
    }

    #[test]
    fn a_forged_number_does_not_deafen() {
        let mut counts = SubscriptionCounts::default();
        let second = |n: i64| Duration::from_millis(u64::try_from(n).unwrap() * 10);
        (1..=100).for_each(|n| assert_eq!(counts.arrival(second(n), W, n), Arrival::Fresh));
        // In the writer's name, with its number and 2^33, and with the largest one.
        for forged in [101 + (1 << 33), i64::MAX] {
            assert_eq!(counts.arrival(second(101), W, forged), Arrival::Fresh);
        }
        let heard_of: Vec<i64> =
            (101..=200).filter(|n| counts.arrival(second(*n), W, *n) == Arrival::Fresh).collect();
        assert_eq!(heard_of, (120..=200).collect::<Vec<_>>());
        assert_eq!(counts.last, Some(second(200)));
        // Silence is told from old samples alone: the endpoints are renewed when nothing new comes.
        assert_eq!(counts.arrival(second(999), W, 150), Arrival::Old);
        assert_eq!(counts.last, Some(second(200)));
        // A history that is repeated, even twice, is not delivered again.
        let repeated = (191..=200).chain(191..=200);
        assert_eq!(repeated.filter(|n| counts.arrival(second(999), W, *n) == Arrival::Fresh).count(), 0);
    }

    #[test]
    fn what_a_writer_said_at_its_end_is_not_heard_twice() {
        let seconds = Duration::from_secs;
        let mut statistics = Statistics::new(vec!["/tf".into()], vec![]);
        assert_eq!(statistics.subscriptions[0].1.arrival(seconds(1), W, 7), Arrival::Fresh);
        statistics.writers_gone(seconds(2), [W]);
        assert_eq!(statistics.subscriptions[0].1.arrival(seconds(3), W, 7), Arrival::Old);
        statistics.writers_gone(seconds(63), []);
        assert_eq!(statistics.subscriptions[0].1.writers().count(), 0);
    }

    #[test]
    fn the_report_warns_only_of_what_is_new() {
        let mut statistics = Statistics::new(vec!["/whorl_1/imu/data_raw".into()], vec!["/tf".into()]);
        assert_eq!(statistics.report("/whorl_1/estimator", Timestamp(1_000_000_000)).status[0].level, 0);
        statistics.subscriptions[0].1.undecodable = 1;
        statistics.publications[0].1 = 20;
        let report = statistics.report("/whorl_1/estimator", Timestamp(2_000_000_000));
        let status = &report.status[0];
        assert_eq!((status.level, status.name.as_str()), (1, "whorl_1/estimator: transport"));
        assert!(status.message.contains("/whorl_1/imu/data_raw"), "{}", status.message);
        assert!(status.values.iter().any(|v| v.key == "out /tf" && v.value.starts_with("20.0 Hz")));
        assert_eq!(statistics.report("/whorl_1/estimator", Timestamp(3_000_000_000)).status[0].level, 0);
    }
}
