//! Counts losses from sequence numbers.

/// Meaning of one sequence number.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Arrival {
    /// The first of this writer: what came before is not known and not counted.
    First,
    /// The next one.
    InOrder,
    /// After a hole of `missing` numbers.
    AfterGap {
        /// How many are missing, for now.
        missing: u64,
    },
    /// One that was missing arrived late.
    Late,
    /// One that was there already.
    Duplicate,
    /// The writer began again.
    Restart,
}

/// What was counted.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct SequenceCounts {
    /// Arrivals, duplicates included.
    pub received: u64,
    /// Numbers that never came.
    pub lost: u64,
    /// Arrivals after a larger number.
    pub late: u64,
    /// Arrivals of a number that was there already.
    pub duplicates: u64,
    /// How often the writer began again.
    pub restarts: u64,
}

impl SequenceCounts {
    /// Adds those of another writer.
    #[must_use]
    pub fn plus(self, other: Self) -> Self {
        Self {
            received: self.received + other.received,
            lost: self.lost + other.lost,
            late: self.late + other.late,
            duplicates: self.duplicates + other.duplicates,
            restarts: self.restarts + other.restarts,
        }
    }
}

/// Follows the sequence numbers of one writer of one topic.
///
/// Numbers may wrap (at 2^32 or 2^64), arrive late by up to [`Self::WINDOW`] numbers, or begin again: a
/// writer that restarts is told from duplicates by numbers behind the window, by a jump ahead of more than
/// [`Self::LARGEST_GAP`], or by [`Self::RESTART_RUN`] old numbers in ascending order.
#[derive(Debug, Clone)]
pub struct SequenceTracker {
    /// Numbers are counted modulo 2^bits.
    mask: u64,
    /// The largest number so far.
    newest: Option<u64>,
    /// Bit i: `newest - i` has arrived, or was before the first.
    seen: u64,
    /// Old numbers in ascending order: the last one, and how many.
    run: (u64, u64),
    counts: SequenceCounts,
}

impl SequenceTracker {
    /// How far back a late number is recognised.
    pub const WINDOW: u64 = 64;
    /// A jump ahead of more than this is another writer's numbering, not a loss.
    pub const LARGEST_GAP: u64 = 10_000_000;
    /// This many duplicates in ascending order are a restart.
    pub const RESTART_RUN: u64 = 3;

    /// For numbers of 64 bits: DDS writers and the `sequence` fields of messages.
    #[must_use]
    pub fn new() -> Self {
        Self { mask: u64::MAX, newest: None, seen: 0, run: (0, 0), counts: SequenceCounts::default() }
    }

    /// For numbers of 32 bits: the sequence numbers in a bag.
    #[must_use]
    pub fn with_32_bits() -> Self {
        Self { mask: u64::from(u32::MAX), ..Self::new() }
    }

    /// Counts so far.
    #[must_use]
    pub fn counts(&self) -> SequenceCounts {
        self.counts
    }

    /// Records an arrival.
    pub fn observe(&mut self, sequence: u64) -> Arrival {
        let sequence = sequence & self.mask;
        self.counts.received += 1;
        let Some(newest) = self.newest else {
            self.begin(sequence);
            return Arrival::First;
        };
        let ahead = sequence.wrapping_sub(newest) & self.mask;
        let behind = newest.wrapping_sub(sequence) & self.mask;
        if ahead == 0 {
            return self.old(sequence, 1);
        }
        if ahead <= behind {
            if ahead > Self::LARGEST_GAP {
                return self.restart(sequence);
            }
            self.run = (0, 0);
            self.newest = Some(sequence);
            self.seen = if ahead < Self::WINDOW { self.seen << ahead } else { 0 } | 1;
            let missing = ahead - 1;
            self.counts.lost += missing;
            return if missing == 0 { Arrival::InOrder } else { Arrival::AfterGap { missing } };
        }
        if behind >= Self::WINDOW {
            return self.restart(sequence);
        }
        self.old(sequence, 1 << behind)
    }

    /// A number within the window, at `bit`.
    fn old(&mut self, sequence: u64, bit: u64) -> Arrival {
        if self.seen & bit == 0 {
            self.seen |= bit;
            self.counts.lost -= 1;
            self.counts.late += 1;
            self.run = (0, 0);
            return Arrival::Late;
        }
        let (last, length) = self.run;
        self.run = if length > 0 && sequence == last.wrapping_add(1) & self.mask {
            (sequence, length + 1)
        } else {
            (sequence, 1)
        };
        if self.run.1 >= Self::RESTART_RUN {
            // The run so far was not duplicates after all.
            self.counts.duplicates -= Self::RESTART_RUN - 1;
            return self.restart(sequence);
        }
        self.counts.duplicates += 1;
        Arrival::Duplicate
    }

    fn restart(&mut self, sequence: u64) -> Arrival {
        self.counts.restarts += 1;
        self.begin(sequence);
        Arrival::Restart
    }

    fn begin(&mut self, sequence: u64) {
        self.newest = Some(sequence);
        // What came before the first is not missing.
        self.seen = u64::MAX;
        self.run = (0, 0);
    }
}

impl Default for SequenceTracker {
    fn default() -> Self {
        Self::new()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn counts(sequences: impl IntoIterator<Item = u64>) -> SequenceCounts {
        let mut tracker = SequenceTracker::new();
        sequences.into_iter().for_each(|s| {
            tracker.observe(s);
        });
        tracker.counts()
    }

    #[test]
    fn gaps_are_lost_and_late_ones_are_found_again() {
        assert_eq!(counts([5, 6, 9, 10]), SequenceCounts { received: 4, lost: 2, ..Default::default() });
        assert_eq!(
            counts([5, 6, 9, 8, 10]),
            SequenceCounts { received: 5, lost: 1, late: 1, ..Default::default() }
        );
        assert_eq!(counts([5, 6, 6, 7]), SequenceCounts { received: 4, duplicates: 1, ..Default::default() });
    }

    #[test]
    fn late_beyond_the_window_is_a_restart_and_not_a_negative_loss() {
        let far = 1 + SequenceTracker::WINDOW;
        assert_eq!(counts([0, far, 0]).restarts, 1);
        assert_eq!(counts([0, far - 1, 1]).late, 1);
    }

    #[test]
    fn a_restart_is_recognised_after_few_and_after_many_messages() {
        // 20 messages, then again from 0: within the window, so by the ascending run.
        let few = counts((0..20).chain(0..20));
        assert_eq!((few.restarts, few.lost, few.duplicates, few.received), (1, 0, 0, 40));
        let many = counts((0..1000).chain(0..1000));
        assert_eq!((many.restarts, many.lost, many.duplicates), (1, 0, 0));
        let ahead = counts([7, 1 << 40, (1 << 40) + 1]);
        assert_eq!((ahead.restarts, ahead.lost), (1, 0));
    }

    #[test]
    fn numbers_may_wrap() {
        assert_eq!(counts([u64::MAX - 1, u64::MAX, 0, 2]).lost, 1);
        let mut tracker = SequenceTracker::with_32_bits();
        for s in [u32::MAX - 1, u32::MAX, 0, 1] {
            tracker.observe(s.into());
        }
        assert_eq!(tracker.counts(), SequenceCounts { received: 4, ..Default::default() });
    }

    proptest::proptest! {
        /// Whatever is dropped, doubled or shuffled within the window, the losses are those that were
        /// dropped: counted by construction, not by the tracker.
        #[test]
        fn losses_equal_what_was_dropped(
            start in 0u64..u64::MAX,
            fate in proptest::collection::vec((0u8..10, 0u64..20), 100..400),
        ) {
            let mut arrivals = Vec::new();
            let mut dropped = 0;
            let mut doubled = 0;
            for (i, &(what, delay)) in fate.iter().enumerate() {
                let (i, last) = (i as u64, i + 1 == fate.len());
                // The first and the last frame the count.
                if what == 0 && i > 0 && !last {
                    dropped += 1;
                    continue;
                }
                let delay = if i == 0 || last { 0 } else { delay };
                let place = if last { u64::MAX } else { i + delay };
                arrivals.push((place, start.wrapping_add(i)));
                // Alone, so that it cannot look like a restart.
                if what == 1 && i % 8 == 0 && !last {
                    doubled += 1;
                    arrivals.push((place, start.wrapping_add(i)));
                }
            }
            arrivals.sort_by_key(|&(place, _)| place);
            let counts = counts(arrivals.iter().map(|&(_, s)| s));
            proptest::prop_assert_eq!(counts.lost, dropped);
            proptest::prop_assert_eq!(counts.duplicates, doubled);
            proptest::prop_assert_eq!(counts.restarts, 0);
            proptest::prop_assert_eq!(counts.received, arrivals.len() as u64);
        }
    }
}
