//! Counts, rates, gaps and losses of one topic.

use std::collections::BTreeMap;

use whorl_msgs::Topic;
use whorl_node::Timestamp;

use crate::{SequenceCounts, SequenceTracker};

/// Which writer a message came from: a DDS GUID, or 0 where there is only one.
pub type WriterId = u128;

/// Statistics of one topic of a recording.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct TopicSummary {
    /// Full topic name.
    pub name: String,
    /// ROS type.
    pub type_name: String,
    /// Messages recorded.
    pub count: u64,
    /// Bytes of CDR recorded.
    pub bytes: u64,
    /// Mean rate between the first and the last message \[Hz\]; 0 with fewer than two.
    pub rate_hz: f64,
    /// Messages per second that the topic should have \[Hz\]; `None` when that is not known.
    pub expected_rate_hz: Option<f64>,
    /// Longest interval between two messages \[s\]; 0 with fewer than two.
    pub largest_gap_s: f64,
    /// Log time at which that interval began [s since the first message of the recording's topic].
    pub largest_gap_at_s: f64,
    /// Intervals of more than [`GAP_PERIODS`] expected periods.
    pub gaps: u64,
    /// Number of writers that were heard.
    pub writers: u64,
    /// Losses, from the sequence numbers of DDS writers or of messages. `None`: the messages carry none.
    pub sequence: Option<SequenceCounts>,
}

/// An interval of more than this many expected periods is a gap.
pub const GAP_PERIODS: f64 = 3.0;

/// Writers of one topic that are followed at once: each start of a node is one, and whoever forges messages may be any number.
const WRITERS: usize = 64;

/// Gathers a [`TopicSummary`]. Pure: times are arguments.
#[derive(Debug, Clone, Default)]
pub struct TopicStatistics {
    expected_rate_hz: Option<f64>,
    count: u64,
    bytes: u64,
    first: Option<Timestamp>,
    last: Timestamp,
    largest_gap_ns: i64,
    largest_gap_at: Timestamp,
    gaps: u64,
    trackers: BTreeMap<WriterId, SequenceTracker>,
    /// Counts of writers that are followed no more.
    past: SequenceCounts,
    counted: bool,
}

impl TopicStatistics {
    /// For a topic with this usual rate.
    #[must_use]
    pub fn new(expected_rate_hz: Option<f64>) -> Self {
        Self { expected_rate_hz, ..Self::default() }
    }

    /// Takes note of a message.
    pub fn observe(&mut self, log_time: Timestamp, bytes: usize) {
        self.count += 1;
        self.bytes += bytes as u64;
        if self.first.is_none() {
            self.first = Some(log_time);
        } else {
            let gap_ns = log_time.0.saturating_sub(self.last.0);
            if gap_ns > self.largest_gap_ns {
                self.largest_gap_ns = gap_ns;
                self.largest_gap_at = self.last;
            }
            if self.expected_rate_hz.is_some_and(|rate| gap_ns as f64 * 1e-9 * rate > GAP_PERIODS) {
                self.gaps += 1;
            }
        }
        self.last = self.last.max(log_time);
    }

    /// Takes note of the message's sequence number.
    pub fn observe_sequence(&mut self, writer: WriterId, sequence: u64) {
        self.counted = true;
        self.make_room_for(writer);
        self.trackers.entry(writer).or_default().observe(sequence);
    }

    /// As [`Self::observe_sequence`], for a number of which only 32 bits are known.
    pub fn observe_sequence_32(&mut self, writer: WriterId, sequence: u32) {
        self.counted = true;
        self.make_room_for(writer);
        self.trackers.entry(writer).or_insert_with(SequenceTracker::with_32_bits).observe(sequence.into());
    }

    /// Where too many writers are followed, the one that was heard least is so no more.
    fn make_room_for(&mut self, writer: WriterId) {
        if self.trackers.len() < WRITERS || self.trackers.contains_key(&writer) {
            return;
        }
        let least = self.trackers.iter().min_by_key(|(_, tracker)| tracker.counts().received);
        if let Some(gone) = least.map(|(writer, _)| *writer).and_then(|least| self.trackers.remove(&least)) {
            self.past = self.past.plus(gone.counts());
        }
    }

    /// Messages so far.
    #[must_use]
    pub fn count(&self) -> u64 {
        self.count
    }

    /// Losses so far, all writers together.
    #[must_use]
    pub fn sequence_counts(&self) -> SequenceCounts {
        self.trackers.values().fold(self.past, |sum, t| sum.plus(t.counts()))
    }

    /// The result.
    #[must_use]
    pub fn summary(&self, name: &str, type_name: &str) -> TopicSummary {
        let first = self.first.unwrap_or_default();
        let span_s = self.last.seconds_since(first);
        TopicSummary {
            name: name.to_owned(),
            type_name: type_name.to_owned(),
            count: self.count,
            bytes: self.bytes,
            rate_hz: if self.count > 1 && span_s > 0.0 { (self.count - 1) as f64 / span_s } else { 0.0 },
            expected_rate_hz: self.expected_rate_hz,
            largest_gap_s: self.largest_gap_ns as f64 * 1e-9,
            largest_gap_at_s: if self.largest_gap_ns > 0 {
                self.largest_gap_at.seconds_since(first)
            } else {
                0.0
            },
            gaps: self.gaps,
            writers: self.trackers.len() as u64,
            sequence: self.counted.then(|| self.sequence_counts()),
        }
    }
}

/// The rate at which a topic is sent periodically; `None` for those that are sent when something happens.
pub(crate) fn expected_rate_hz(topic: Topic) -> Option<f64> {
    // Diagnostics come from every node, and /tf from every estimator: no single period. Excitations are called for
    // in some steps only.
    (!matches!(topic, Topic::Diagnostics | Topic::Tf | Topic::Excitation)).then(|| topic.info().rate_hz)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_pause_of_a_second_in_ten_hertz_is_one_gap() {
        let mut statistics = TopicStatistics::new(Some(10.0));
        for i in 0..=20 {
            // 0.0 .. 1.0 s, then 2.0 .. 3.0 s.
            let tenths = if i <= 10 { i } else { i + 9 };
            statistics.observe(Timestamp(5_000_000_000 + tenths * 100_000_000), 100);
            // Two writers that count separately; the second one loses number 2.
            statistics.observe_sequence(1, i as u64);
            statistics.observe_sequence(2, if i < 2 { i as u64 } else { i as u64 + 1 });
        }
        let summary = statistics.summary("/a", "b/msg/C");
        assert_eq!((summary.count, summary.bytes, summary.gaps, summary.writers), (21, 2100, 1, 2));
        assert!(
            (summary.largest_gap_s - 1.0).abs() < 1e-12 && (summary.largest_gap_at_s - 1.0).abs() < 1e-12
        );
        assert!((summary.rate_hz - 20.0 / 2.9).abs() < 1e-12);
        assert_eq!(summary.sequence.unwrap().lost, 1);
        assert_eq!(TopicStatistics::new(None).summary("/a", "b").sequence, None);
    }

    /// A thousand writers of three messages each, beside one that goes on: what is kept has a bound, and no count is lost.
    #[test]
    fn writers_without_end_take_no_memory() {
        let mut statistics = TopicStatistics::new(None);
        for writer in 0..1000_u64 {
            for k in 0..3 {
                statistics.observe_sequence((writer + 10).into(), k);
                statistics.observe_sequence(1, writer * 3 + k);
            }
        }
        assert!(statistics.trackers.len() <= WRITERS, "{}", statistics.trackers.len());
        let counts = statistics.sequence_counts();
        assert_eq!((counts.received, counts.lost), (6000, 0));
        assert_eq!(statistics.trackers[&1].counts().received, 3000, "the one that goes on is followed");
    }
}
