//! Several lines of one time as one line.

use std::collections::BTreeMap;

use nalgebra::Vector3;

use super::rows::{CsvRow, direction};
use crate::channels::Channel;

/// More lines of one time are an error in the time column.
pub(super) const MOST_LINES: usize = 10_000;

impl CsvRow {
    /// Whether no sensor has numbers in both lines.
    pub(super) fn is_apart_from(&self, other: &Self) -> bool {
        let both =
            |a: &[Option<f64>], b: &[Option<f64>]| a.iter().zip(b).any(|(a, b)| a.is_some() && b.is_some());
        !(self.numbers.keys().any(|channel| other.numbers.contains_key(channel))
            || both(&self.vector_lengths, &other.vector_lengths)
            || self.jets.is_some() && other.jets.is_some()
            || self.q_world_body.is_some() && other.q_world_body.is_some())
    }

    /// Takes what the other line has and this one has not.
    pub(super) fn take(&mut self, other: Self) {
        for (channel, numbers) in other.numbers {
            self.numbers.entry(channel).or_insert(numbers);
        }
        fill(&mut self.vectors_b, &other.vectors_b);
        fill(&mut self.references_w, &other.references_w);
        fill(&mut self.vector_lengths, &other.vector_lengths);
        self.jets = self.jets.take().or(other.jets);
        if self.q_world_body.is_none() {
            self.q_world_body = other.q_world_body;
            self.scored = other.scored;
        }
    }
}

fn fill<T: Copy>(mine: &mut [Option<T>], others: &[Option<T>]) {
    for (mine, other) in mine.iter_mut().zip(others) {
        *mine = mine.or(*other);
    }
}

/// Gives lines of one time, in the order that they came, times of their own: evenly since the time before, the last at its own. Of a
/// first burst, whose time before is not known, they are as far apart as those of the next.
pub(super) fn spread(rows: &mut [CsvRow], before_ns: Option<i64>, next_ns: Option<i64>) {
    let Some(at_ns) = rows.first().map(|row| row.time_ns) else { return };
    let count = rows.len() as i64;
    let long_ns = match (before_ns, next_ns) {
        (Some(before_ns), _) => at_ns.saturating_sub(before_ns),
        (None, Some(next_ns)) => next_ns.saturating_sub(at_ns),
        // All lines have one time: nothing says how far they are apart.
        (None, None) => count,
    };
    for (place, row) in (1..).zip(rows) {
        // In 128 bits: times of years and thousands of lines.
        let back_ns = i128::from(long_ns) * i128::from(count - place) / i128::from(count);
        row.time_ns = at_ns.saturating_sub(back_ns as i64);
    }
}

/// The mean of lines of one time: of every channel and vector over the lines that have it. Of commands, attitudes and references
/// the first counts.
pub(super) fn mean(rows: Vec<CsvRow>) -> Option<CsvRow> {
    let mut sums: BTreeMap<Channel, (Vec<f64>, f64)> = BTreeMap::new();
    let mut vectors: Vec<(Vector3<f64>, f64)> = Vec::new();
    let mut all: Option<CsvRow> = None;
    for row in rows {
        for (channel, numbers) in &row.numbers {
            let (sum, count) = sums.entry(*channel).or_insert_with(|| (vec![0.0; numbers.len()], 0.0));
            sum.iter_mut().zip(numbers).for_each(|(sum, x)| *sum += x);
            *count += 1.0;
        }
        vectors.resize(row.vectors_b.len(), (Vector3::zeros(), 0.0));
        for (sum, (seen, length)) in vectors.iter_mut().zip(row.vectors_b.iter().zip(&row.vector_lengths)) {
            if let (Some(seen), Some(length)) = (seen, length) {
                sum.0 += seen.into_inner() * *length;
                sum.1 += 1.0;
            }
        }
        match &mut all {
            None => all = Some(row),
            Some(all) => all.take(row),
        }
    }
    let mut all = all?;
    for (channel, (sum, count)) in sums {
        all.numbers.insert(channel, sum.into_iter().map(|sum| sum / count).collect());
    }
    let seen = all.vectors_b.iter_mut().zip(&mut all.vector_lengths).zip(vectors);
    // The only sample of a sensor stays as it is, to the bit.
    for ((body, length), (sum, count)) in seen.filter(|(_, (_, count))| *count > 1.0) {
        *body = direction(sum / count);
        *length = Some((sum / count).norm());
    }
    Some(all)
}
