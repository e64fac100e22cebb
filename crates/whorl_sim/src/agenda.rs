//! What is to happen when, in order of time, then of entry.
//!
//! Most of what a simulation enters comes later than all that was entered for the same reason: a delay is constant, a timer
//! is periodic. Such entries stand in a few queues that are each in order already; only what fits into none is sorted.

use std::cmp::Ordering;
use std::collections::{BinaryHeap, VecDeque};

use whorl_node::Timestamp;

/// Queues in order: the delays between nodes and between computers, and the periods of timers.
const QUEUES: usize = 6;

/// What happens at a time.
struct Entry<T> {
    at: Timestamp,
    order: u64,
    what: T,
}

impl<T> Entry<T> {
    fn place(&self) -> (Timestamp, u64) {
        (self.at, self.order)
    }
}

// The heap's largest is what comes first; never by content.
impl<T> PartialEq for Entry<T> {
    fn eq(&self, other: &Self) -> bool {
        self.place() == other.place()
    }
}
impl<T> Eq for Entry<T> {}
impl<T> PartialOrd for Entry<T> {
    fn partial_cmp(&self, other: &Self) -> Option<Ordering> {
        Some(self.cmp(other))
    }
}
impl<T> Ord for Entry<T> {
    fn cmp(&self, other: &Self) -> Ordering {
        other.place().cmp(&self.place())
    }
}

/// The agenda.
pub(crate) struct Agenda<T> {
    queues: [VecDeque<Entry<T>>; QUEUES],
    /// What fits into no queue.
    rest: BinaryHeap<Entry<T>>,
    order: u64,
}

impl<T> Default for Agenda<T> {
    fn default() -> Self {
        Self { queues: Default::default(), rest: BinaryHeap::new(), order: 0 }
    }
}

impl<T> Agenda<T> {
    /// Enters what is to happen at a time, after all that has been entered for the same time.
    pub fn enter(&mut self, at: Timestamp, what: T) {
        let entry = Entry { at, order: self.order, what };
        self.order += 1;
        // The queue that ends nearest before it; an empty one, if there is none.
        let mut best: Option<(usize, Option<Timestamp>)> = None;
        for (k, queue) in self.queues.iter().enumerate() {
            let end = queue.back().map(|last| last.at);
            if end.is_none_or(|end| end <= at) && best.is_none_or(|(_, so_far)| end > so_far) {
                best = Some((k, end));
            }
        }
        match best.and_then(|(k, _)| self.queues.get_mut(k)) {
            Some(queue) => queue.push_back(entry),
            None => self.rest.push(entry),
        }
    }

    /// Takes out what comes first, if it comes until this time.
    pub fn next_until(&mut self, until: Timestamp) -> Option<(Timestamp, T)> {
        let mut first = self.rest.peek().map(Entry::place);
        let mut from = None;
        for queue in &mut self.queues {
            if let Some(place) = queue.front().map(Entry::place)
                && first.is_none_or(|first| place < first)
            {
                first = Some(place);
                from = Some(queue);
            }
        }
        first.filter(|(at, _)| *at <= until)?;
        let entry = match from {
            Some(queue) => queue.pop_front(),
            None => self.rest.pop(),
        };
        entry.map(|Entry { at, what, .. }| (at, what))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand_pcg::Pcg64Mcg;
    use rand_pcg::rand_core::{Rng, SeedableRng};

    /// Against a list that is sorted by time, stably, with delays of all kinds: equal, constant and random ones.
    #[test]
    fn everything_comes_in_order_of_time_then_of_entry() {
        let mut rng = Pcg64Mcg::seed_from_u64(5);
        let mut agenda = Agenda::default();
        let mut expected: Vec<(Timestamp, u64)> = Vec::new();
        let (mut now, mut entered, mut taken, mut sorted) = (Timestamp(0), 0, 0, 0);
        for _ in 0..20_000 {
            let delay = match rng.next_u64() % 4 {
                0 => 0,
                1 => 20,
                2 => 1_000,
                _ => (rng.next_u64() % 3_000) as i64,
            };
            agenda.enter(Timestamp(now.0 + delay), entered);
            expected.push((Timestamp(now.0 + delay), entered));
            entered += 1;
            sorted += usize::from(!agenda.rest.is_empty());
            let until = Timestamp(now.0 + (rng.next_u64() % 60) as i64);
            while let Some(found) = agenda.next_until(until) {
                let next = expected.iter().copied().min();
                assert_eq!(Some(found), next);
                expected.retain(|entry| *entry != found);
                now = found.0;
                taken += 1;
            }
            assert!(expected.iter().all(|(at, _)| *at > until));
            now = now.max(until);
        }
        assert!(taken > 15_000 && sorted > 100, "{taken}, {sorted}: queues and heap are used");
    }
}
