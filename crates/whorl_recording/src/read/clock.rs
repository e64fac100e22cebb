//! When the messages of a topic were measured: by their stamps, as far as these can be believed.
//!
//! A stamp is earlier than the time at which the message was recorded, by a delay that varies by milliseconds. Three things break
//! that, and are told by it:
//!
//! - a stamp that nobody set (zero): the message is taken for as late as the others were;
//! - a clock that was set: stamps go back, or jump ahead of what was possible, and the delay is another from there on. The stamps
//!   behind are moved on by the difference of the delays, so that the run goes on as it did;
//! - two publishers of one topic, whose stamps go back and forth.

use std::collections::{BTreeMap, VecDeque};

/// Clocks that differ by more are two clocks, and not one and a delay \[ns\].
const OTHER_CLOCK_NS: i64 = 10_000_000_000;
/// Delays that the usual one is the median of.
const DELAYS: usize = 15;
/// Fewer say nothing.
const FEWEST_DELAYS: usize = 5;
/// A clock was set when the delay changes by more than this \[ns\] ...
const STEP_NS: i64 = 20_000_000;
/// ... and, ahead, by more than so many intervals of messages.
const STEP_INTERVALS: i64 = 5;
/// More jumps than this, and than one in so many messages, are two publishers.
const MOST_STEPS: usize = 10;
const MESSAGES_PER_STEP: usize = 20;

/// How stamps and log times go together.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Clocks {
    One,
    /// Stamps of another clock than log times.
    Two,
    /// Stamps that nobody set.
    LogOnly,
}

/// The clock of one topic.
#[derive(Debug, Clone, Default)]
pub(super) struct TopicClock {
    clocks: Option<Clocks>,
    /// Log time less moved stamp of the latest messages \[ns\].
    delays: VecDeque<i64>,
    least_delay_ns: Option<i64>,
    /// Log time and stamp of the latest message that had one \[ns\].
    last: Option<[i64; 2]>,
    /// Usual interval of stamps \[ns\].
    interval_ns: i64,
    /// What is added to stamps \[ns\].
    moved_ns: i64,
    messages: usize,
    /// Messages whose stamp nobody set, among others that have one.
    unset: usize,
    /// When the clock was set, in moved stamps, and by how much \[ns\].
    steps: Vec<[i64; 2]>,
    step_count: usize,
    /// Stamps before the one of the message before.
    back_count: usize,
    /// Senders, by the frame that their messages name.
    frames: BTreeMap<String, usize>,
}

/// More frames than this are not counted.
const MOST_FRAMES: usize = 8;

impl TopicClock {
    /// When a message was measured \[ns\].
    pub fn measured_ns(&mut self, log_ns: i64, stamp_ns: i64) -> i64 {
        self.messages += 1;
        let unset = stamp_ns == 0 && log_ns > OTHER_CLOCK_NS;
        if unset {
            self.unset += 1;
            self.clocks.get_or_insert(Clocks::LogOnly);
            return log_ns - self.usual_delay().unwrap_or(0);
        }
        if matches!(self.clocks, None | Some(Clocks::LogOnly)) {
            let other = stamp_ns.abs_diff(log_ns) > OTHER_CLOCK_NS.unsigned_abs();
            self.clocks = Some(if other { Clocks::Two } else { Clocks::One });
        }
        self.back_count += usize::from(self.last.is_some_and(|[_, last_ns]| stamp_ns < last_ns));
        let delay_ns = log_ns.saturating_sub(stamp_ns.saturating_add(self.moved_ns));
        if let Some(step_ns) = self.step(log_ns, stamp_ns, delay_ns) {
            self.moved_ns = self.moved_ns.saturating_add(step_ns);
            self.step_count += 1;
            if self.steps.len() < MOST_STEPS {
                self.steps.push([stamp_ns.saturating_add(self.moved_ns), step_ns]);
            }
        } else if let Some([_, last_ns]) = self.last.filter(|[_, last_ns]| *last_ns < stamp_ns) {
            let interval_ns = stamp_ns.saturating_sub(last_ns);
            self.interval_ns = if self.interval_ns == 0 {
                interval_ns
            } else {
                self.interval_ns + (interval_ns - self.interval_ns) / 8
            };
        }
        let at_ns = stamp_ns.saturating_add(self.moved_ns);
        let delay_ns = log_ns.saturating_sub(at_ns);
        self.least_delay_ns = Some(self.least_delay_ns.map_or(delay_ns, |least| least.min(delay_ns)));
        self.delays.push_back(delay_ns);
        if self.delays.len() > DELAYS {
            self.delays.pop_front();
        }
        self.last = Some([log_ns, stamp_ns]);
        at_ns
    }

    /// By how much the clock was set back before this message, if it was.
    fn step(&self, log_ns: i64, stamp_ns: i64, delay_ns: i64) -> Option<i64> {
        let usual_ns = self.usual_delay()?;
        let [last_log_ns, last_ns] = self.last?;
        let change_ns = delay_ns.saturating_sub(usual_ns);
        let is_back = stamp_ns < last_ns && change_ns > STEP_NS;
        // A recorder that was held up logs late messages in a burst: their delays become as small as before, and not smaller.
        let passed_ns = log_ns.saturating_sub(last_log_ns);
        let ahead_ns = stamp_ns.saturating_sub(last_ns).saturating_sub(passed_ns);
        let is_ahead = delay_ns < self.least_delay_ns?.saturating_sub(STEP_NS)
            && ahead_ns > STEP_NS.max(STEP_INTERVALS.saturating_mul(self.interval_ns));
        (is_back || is_ahead).then_some(change_ns)
    }

    fn usual_delay(&self) -> Option<i64> {
        if self.delays.len() < FEWEST_DELAYS {
            return None;
        }
        let mut delays: Vec<i64> = self.delays.iter().copied().collect();
        delays.sort_unstable();
        delays.get(delays.len() / 2).copied()
    }

    /// Counts the sender of a message.
    pub fn sent_by(&mut self, frame_id: &str) {
        if let Some(count) = self.frames.get_mut(frame_id) {
            *count += 1;
        } else if self.frames.len() < MOST_FRAMES {
            self.frames.insert(frame_id.to_owned(), 1);
        }
    }

    pub fn clocks(&self) -> Option<Clocks> {
        self.clocks
    }

    /// What shows that several publishers sent the messages, and what helps.
    pub fn several_publishers(&self) -> Option<String> {
        if self.frames.len() > 1 {
            let name = |name: &String| if name.is_empty() { "(none)".to_owned() } else { name.clone() };
            let frames = self.frames.iter().map(|(frame, count)| format!("{} {count} times", name(frame)));
            let frames: Vec<String> = frames.collect();
            return Some(format!(
                "its messages name several frames: {}. Several sensors publish it: give frame_id beside the topic in the map",
                frames.join(", ")
            ));
        }
        let jumps = self.step_count.max(self.back_count);
        let many = jumps > MOST_STEPS && jumps * MESSAGES_PER_STEP > self.messages;
        many.then(|| {
            format!(
                "the stamps of its {} messages go back or jump ahead {jumps} times: several publishers with clocks of their own send \
                 it, or one whose stamps say nothing; record the topic of one",
                self.messages
            )
        })
    }

    /// What was made of stamps, in words; `start_ns` is the recording's zero.
    pub fn notes(&self, topic: &str, start_ns: i64) -> Vec<String> {
        let mut notes = Vec::new();
        if self.unset > 0 && self.clocks == Some(Clocks::LogOnly) {
            notes.push(format!("Nobody stamped the messages of {topic}: they are timed by their arrival."));
        } else if self.unset > 0 {
            notes.push(format!(
                "{} of {} messages of {topic} have no stamp and are timed by their arrival.",
                self.unset, self.messages
            ));
        }
        for [at_ns, by_ns] in &self.steps {
            let way = if *by_ns > 0 { "back" } else { "ahead" };
            notes.push(format!(
                "The clock of {topic} was set {way} by {:.3} s at {:.3} s: the stamps behind were moved by that, by their arrival.",
                by_ns.unsigned_abs() as f64 * 1e-9,
                crate::series::seconds(at_ns - start_ns)
            ));
        }
        if self.step_count > self.steps.len() {
            notes.push(format!("The clock of {topic} was set {} times in all.", self.step_count));
        }
        notes
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const EPOCH: i64 = 1_700_000_000_000_000_000;
    const MS: i64 = 1_000_000;

    /// Delays of 1 to 4 ms.
    fn delay(i: i64) -> i64 {
        MS + (i * 7 % 4) * MS
    }

    /// Times of messages of 100 Hz whose stamps are `stamp` of the true time, and the clock.
    fn run(count: i64, stamp: impl Fn(i64, i64) -> i64) -> (Vec<i64>, TopicClock) {
        let mut clock = TopicClock::default();
        let one = |i: i64| {
            let true_ns = EPOCH + i * 10 * MS;
            clock.measured_ns(true_ns + delay(i), stamp(i, true_ns))
        };
        ((0..count).map(one).collect(), clock)
    }

    fn worst_ms(times: &[i64]) -> i64 {
        let off = times.iter().enumerate().map(|(i, at)| (at - EPOCH - i as i64 * 10 * MS).abs() / MS);
        off.max().unwrap()
    }

    #[test]
    fn stamps_that_nobody_set_now_and_then_are_bridged() {
        let (times, clock) = run(300, |i, at| if i % 37 == 20 { 0 } else { at });
        assert!(worst_ms(&times) <= 3, "{}", worst_ms(&times));
        assert!(clock.notes("/imu", EPOCH)[0].contains("8 of 300 messages of /imu have no stamp"));
        // The first one, too.
        assert!(worst_ms(&run(300, |i, at| if i == 0 { 0 } else { at }).0) <= 4);
        let (times, clock) = run(300, |_, _| 0);
        assert_eq!((worst_ms(&times), clock.clocks()), (4, Some(Clocks::LogOnly)));
    }

    #[test]
    fn a_clock_that_was_set_is_noticed_and_bridged() {
        for by_ms in [192, -350, 3_600_000, -86_400_000, 45] {
            let (times, clock) = run(600, |i, at| if i < 200 { at } else { at - by_ms * MS });
            assert!(worst_ms(&times) <= 4, "{by_ms}: {}", worst_ms(&times));
            assert_eq!((clock.steps.len(), clock.several_publishers()), (1, None), "{by_ms}");
            assert!((clock.steps[0][1] - by_ms * MS).abs() <= 3 * MS, "{by_ms}: {:?}", clock.steps);
        }
        let (_, clock) = run(600, |i, at| if i < 200 { at } else { at - 192 * MS });
        assert!(clock.notes("/imu", EPOCH)[0].starts_with("The clock of /imu was set back by 0.19"));
    }

    #[test]
    fn neither_late_logging_nor_lost_messages_are_a_set_clock() {
        // The recorder stands still for 0.4 s and then logs what it was sent.
        let mut clock = TopicClock::default();
        for i in 0..600 {
            let at = EPOCH + i * 10 * MS;
            let logged =
                if (200..240).contains(&i) { EPOCH + 2_400 * MS + i * MS / 10 } else { at + delay(i) };
            assert_eq!(clock.measured_ns(logged, at), at);
        }
        // Two seconds are missing.
        let mut lossy = TopicClock::default();
        for i in (0..200).chain(400..600) {
            let at = EPOCH + i * 10 * MS;
            assert_eq!(lossy.measured_ns(at + delay(i), at), at);
        }
        assert_eq!((clock.step_count, lossy.step_count), (0, 0));
    }

    #[test]
    fn two_publishers_are_told_by_their_frames_or_their_clocks() {
        let (_, mut clock) = run(100, |i, at| if i % 2 == 0 { at } else { at - 300 * MS });
        assert!(clock.several_publishers().unwrap().contains("several publishers with clocks of their own"));
        clock = run(100, |_, at| at).1;
        clock.sent_by("imu_left");
        assert_eq!(clock.several_publishers(), None);
        clock.sent_by("");
        let said = clock.several_publishers().unwrap();
        assert!(said.contains("(none) 1 times, imu_left 1 times") && said.contains("frame_id"), "{said}");
    }
}
