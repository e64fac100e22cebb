//! Topics that one node alone may write: whoever was heard first keeps the topic until it is gone or silent; a second
//! publisher is refused, and reported once both are known to be alive. Pure: time and writers come in.
//!
//! A node that was killed and started again writes under a new name on the network while the old one is not yet known to
//! be gone. It takes over when the old one has been silent for some periods, and nothing is reported.

use std::time::Duration;

use crate::peers::ParticipantPrefix;

/// Silence after which another may take over: this long, and at least so many periods of the topic.
const SHORTEST_SILENCE: Duration = Duration::from_millis(500);
const PERIODS: f64 = 3.0;

/// Verdict on one sample.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Verdict {
    /// From the topic's publisher.
    Accepted,
    /// From its publisher, while this other participant writes it as well: to be reported.
    Contested(ParticipantPrefix),
    /// From another one.
    Refused,
}

/// The publisher of one topic.
#[derive(Debug, Clone)]
pub(crate) struct SolePublisher {
    silence: Duration,
    holder: Option<(ParticipantPrefix, Duration)>,
    challenger: Option<ParticipantPrefix>,
}

impl SolePublisher {
    /// Of a topic that is usually written at this rate.
    pub(crate) fn new(rate_hz: f64) -> Self {
        let periods = Duration::try_from_secs_f64(PERIODS / rate_hz).unwrap_or(SHORTEST_SILENCE);
        Self { silence: periods.max(SHORTEST_SILENCE), holder: None, challenger: None }
    }

    /// Judges a sample of this participant at monotonic time `now`.
    pub(crate) fn admit(&mut self, now: Duration, from: ParticipantPrefix) -> Verdict {
        match &mut self.holder {
            Some((holder, last)) if *holder == from => {
                *last = now;
                self.challenger.take().map_or(Verdict::Accepted, Verdict::Contested)
            }
            Some((_, last)) if now.saturating_sub(*last) < self.silence => {
                self.challenger = Some(from);
                Verdict::Refused
            }
            _ => {
                self.holder = Some((from, now));
                self.challenger = None;
                Verdict::Accepted
            }
        }
    }

    /// This participant has said goodbye, or was dropped.
    pub(crate) fn gone(&mut self, who: ParticipantPrefix) {
        self.holder = self.holder.filter(|(holder, _)| *holder != who);
        self.challenger = self.challenger.filter(|challenger| *challenger != who);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const A: ParticipantPrefix = [1; 12];
    const B: ParticipantPrefix = [2; 12];

    fn ms(n: u64) -> Duration {
        Duration::from_millis(n)
    }

    #[test]
    fn the_second_publisher_is_refused_and_told_of_as_long_as_both_write() {
        let mut topic = SolePublisher::new(100.0);
        assert_eq!(topic.admit(ms(0), A), Verdict::Accepted);
        for t in (10..5000).step_by(10) {
            assert_eq!(topic.admit(ms(t), B), Verdict::Refused);
            assert_eq!(topic.admit(ms(t + 5), A), Verdict::Contested(B));
        }
        assert_eq!(topic.admit(ms(5010), A), Verdict::Accepted);
    }

    #[test]
    fn a_node_that_was_started_again_takes_over_without_a_word() {
        let mut topic = SolePublisher::new(100.0);
        topic.admit(ms(0), A);
        let verdicts: Vec<Verdict> = (1..100).map(|k| topic.admit(ms(k * 10), B)).collect();
        let refused = verdicts.iter().take_while(|v| **v == Verdict::Refused).count();
        assert_eq!(refused, 49, "0.5 s of silence");
        assert!(verdicts[refused..].iter().all(|v| *v == Verdict::Accepted));
    }

    #[test]
    fn who_says_goodbye_leaves_at_once_and_rare_topics_wait_for_periods() {
        let mut topic = SolePublisher::new(1.0);
        topic.admit(ms(0), A);
        assert_eq!(topic.admit(ms(2900), B), Verdict::Refused);
        topic.gone(A);
        assert_eq!(topic.admit(ms(2910), B), Verdict::Accepted);
        assert_eq!(topic.admit(ms(5900), A), Verdict::Refused);
        assert_eq!(topic.admit(ms(5920), A), Verdict::Accepted);
    }
}
