//! The numbers of one channel, without an allocation for each sample: an hour at 100 Hz has 360,000.

use std::borrow::Cow;

use whorl_bag::held::{Runs, Thinning};

use crate::recording::is_whole;

/// Fewer lines do not show that two sensors send them.
const FEWEST_TOLD: usize = 50;
/// A line is of the other sensor when it is so many times farther from the line before than from one before that, ...
const FARTHER: f64 = 4.0;
/// ... and two sensors send them when so many lines are: three of four where their order varies, all where it does not.
const MOST_JUMP: f64 = 0.6;

/// A time and its numbers.
type Line<'a> = (i64, &'a [f64]);

/// Times and numbers, of the same number of numbers in every line.
#[derive(Debug, Clone, Default, PartialEq)]
pub(crate) struct Columns {
    time_ns: Vec<i64>,
    width: usize,
    numbers: Vec<f64>,
}

impl Columns {
    /// Adds a line; the first says how many numbers a line has. One with another number of them is left out, and
    /// `false` says so.
    pub fn push(&mut self, time_ns: i64, numbers: &[f64]) -> bool {
        if self.time_ns.is_empty() {
            self.width = numbers.len();
        }
        let fits = numbers.len() == self.width;
        if fits {
            self.time_ns.push(time_ns);
            self.numbers.extend_from_slice(numbers);
        }
        fits
    }

    /// As [`Self::push`], of a line of finite numbers only.
    pub fn push_finite(&mut self, time_ns: i64, numbers: &[f64]) -> bool {
        numbers.iter().all(|x| x.is_finite()) && self.push(time_ns, numbers)
    }

    /// Adds lines.
    pub fn extend<'a>(&mut self, lines: impl Iterator<Item = Line<'a>>) {
        for (at, numbers) in lines {
            self.push(at, numbers);
        }
    }

    /// Lines.
    pub fn len(&self) -> usize {
        self.time_ns.len()
    }

    pub fn is_empty(&self) -> bool {
        self.time_ns.is_empty()
    }

    /// Time of each line \[ns\].
    pub fn times_ns(&self) -> &[i64] {
        &self.time_ns
    }

    /// A line.
    pub fn line(&self, line: usize) -> Option<Line<'_>> {
        let numbers = self.numbers.get(line * self.width..(line + 1) * self.width)?;
        Some((*self.time_ns.get(line)?, numbers))
    }

    /// The lines.
    pub fn lines(&self) -> impl ExactSizeIterator<Item = Line<'_>> + Clone {
        let numbers = |line: usize| self.numbers.get(line * self.width..(line + 1) * self.width);
        self.time_ns.iter().enumerate().map(move |(line, at)| (*at, numbers(line).unwrap_or_default()))
    }

    /// Each line with the one before it.
    pub fn pairs(&self) -> impl Iterator<Item = (Line<'_>, Line<'_>)> {
        self.lines().zip(self.lines().skip(1))
    }

    /// In order of time, each time once, the first of those that share one; returns how many were left out.
    pub fn in_order(&mut self) -> usize {
        if self.time_ns.is_sorted_by(|a, b| a < b) {
            return 0;
        }
        let mut order: Vec<usize> = (0..self.len()).collect();
        order.sort_by_key(|line| self.time_ns.get(*line));
        order.dedup_by_key(|line| self.time_ns.get(*line));
        let left_out = self.len() - order.len();
        let mut sorted = Self { width: self.width, ..Self::default() };
        sorted.extend(order.into_iter().filter_map(|line| self.line(line)));
        *self = sorted;
        left_out
    }

    /// In order of time. Where most times have several lines that differ, a sensor with a buffer was read now and then: all are kept, in
    /// the order that they came, spread evenly over the time since the one before. Else each time counts once, the first of those
    /// that share one. Returns how many were left out, and how many were spread.
    pub fn in_order_or_spread(&mut self) -> (usize, usize) {
        if self.time_ns.is_sorted_by(|a, b| a < b) {
            return (0, 0);
        }
        let mut sorted = self.sorted().into_owned();
        let differ = sorted.pairs().filter(|((a, x), (b, y))| a == b && x != y).count();
        let times = sorted.time_ns.chunk_by(|a, b| a == b).count();
        if 2 * differ < times {
            return (self.in_order(), 0);
        }
        sorted.spread();
        *self = sorted;
        (0, self.len() - times)
    }

    /// By time; lines of one time stay in the order that they came.
    fn sorted(&self) -> Cow<'_, Self> {
        if self.time_ns.is_sorted() {
            return Cow::Borrowed(self);
        }
        let mut order: Vec<usize> = (0..self.len()).collect();
        order.sort_by_key(|line| self.time_ns.get(*line));
        let mut sorted = Self { width: self.width, ..Self::default() };
        sorted.extend(order.into_iter().filter_map(|line| self.line(line)));
        Cow::Owned(sorted)
    }

    /// Times of their own for lines of one time: evenly since the time before, of the first as far apart as those of the next.
    fn spread(&mut self) {
        let bursts: Vec<(i64, usize)> =
            self.time_ns.chunk_by(|a, b| a == b).map(|burst| (burst[0], burst.len())).collect();
        let mut times = Vec::with_capacity(self.time_ns.len());
        for (k, (at, count)) in bursts.iter().enumerate() {
            let before =
                k.checked_sub(1).and_then(|k| bursts.get(k)).map(|(before, _)| at.saturating_sub(*before));
            let after = bursts.get(k + 1).map(|(next, _)| next.saturating_sub(*at));
            let long = i128::from(before.or(after).unwrap_or(*count as i64));
            let count = *count as i128;
            times.extend((1..=count).map(|place| at.saturating_sub((long * (count - place) / count) as i64)));
        }
        self.time_ns = times;
    }

    /// Two readings, where two sensors send these lines: most lines are far from the one before and close to one of the two before
    /// that. Noise does that in a third of the lines at most.
    pub fn two_senders(&self) -> Option<[Vec<f64>; 2]> {
        let sorted = self.sorted();
        if sorted.len() < FEWEST_TOLD {
            return None;
        }
        let apart = |a: Option<Line<'_>>, b: Option<Line<'_>>| -> f64 {
            let (Some((_, a)), Some((_, b))) = (a, b) else { return f64::NAN };
            a.iter()
                .zip(b)
                .filter(|(a, b)| a.is_finite() && b.is_finite())
                .map(|(a, b)| (a - b).powi(2))
                .sum::<f64>()
                .sqrt()
        };
        let jumps = (3..sorted.len()).filter(|k| {
            let here = sorted.line(*k);
            let from = |back: usize| apart(here, sorted.line(k - back));
            from(1) > FARTHER * from(2).min(from(3))
        });
        let jumps: Vec<usize> = jumps.collect();
        if (jumps.len() as f64) < MOST_JUMP * (sorted.len() - 3) as f64 {
            return None;
        }
        let middle = *jumps.get(jumps.len() / 2)?;
        let numbers = |line: usize| sorted.line(line).map(|(_, numbers)| numbers.to_vec());
        Some([numbers(middle - 1)?, numbers(middle)?])
    }

    /// Without the repetitions of values that a faster log holds: in how many lines each stands, and how many were left out.
    pub fn leave_out_held(&mut self) -> Option<(u32, u64)> {
        let mut runs = Runs::default();
        self.lines().for_each(|(_, numbers)| runs.add(numbers));
        let held = runs.held()?;
        let mut thinning = Thinning::new(held);
        let mut kept = Self { width: self.width, ..Self::default() };
        kept.extend(self.lines().filter(|(_, numbers)| thinning.is_new(numbers)));
        *self = kept;
        Some((held, thinning.left_out))
    }

    /// These numbers of every line, in this order; nothing is left where a line does not have them all.
    pub fn pick(&mut self, order: &[usize]) {
        if order.iter().any(|place| *place >= self.width) {
            *self = Self::default();
            return;
        }
        let mut picked = Self { width: order.len(), ..Self::default() };
        for (at, numbers) in self.lines() {
            picked.time_ns.push(at);
            picked.numbers.extend(order.iter().filter_map(|place| numbers.get(*place)));
        }
        *self = picked;
    }

    /// Without the lines that lack an axis that is not `missing` everywhere. Returns the missing ones, of a sensor that
    /// has any.
    pub fn take_out_missing_axes(&mut self, missing: [bool; 3]) -> [bool; 3] {
        let width = self.width.max(1);
        let mut kept = 0;
        for line in 0..self.time_ns.len() {
            let here = line * width..(line + 1) * width;
            if self.numbers.get_mut(here.clone()).is_some_and(|sample| is_whole(sample, missing)) {
                self.time_ns[kept] = self.time_ns[line];
                self.numbers.copy_within(here, kept * width);
                kept += 1;
            }
        }
        self.time_ns.truncate(kept);
        self.numbers.truncate(kept * width);
        if missing == [true; 3] { [false; 3] } else { missing }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lines_that_lack_a_measured_axis_are_left_out() {
        let mut columns = Columns::default();
        columns.push(1, &[1.0, f64::NAN, 3.0]);
        columns.push(2, &[f64::NAN, f64::NAN, 4.0]);
        columns.push(3, &[5.0, f64::NAN, 6.0]);
        assert_eq!(columns.take_out_missing_axes([false, true, false]), [false, true, false]);
        let lines: Vec<(i64, &[f64])> = columns.lines().collect();
        assert_eq!(lines, [(1, [1.0, 0.0, 3.0].as_slice()), (3, &[5.0, 0.0, 6.0])]);

        let mut none = Columns::default();
        none.push(1, &[f64::NAN; 3]);
        assert_eq!((none.take_out_missing_axes([true; 3]), none.len()), ([false; 3], 0));
    }

    #[test]
    fn lines_come_into_the_order_of_time_and_each_time_once() {
        let mut columns = Columns::default();
        for (at, x) in [(5, 1.0), (2, 2.0), (5, 3.0), (9, 4.0), (2, 5.0)] {
            columns.push(at, &[x, -x]);
        }
        assert_eq!(columns.in_order(), 2);
        let lines: Vec<(i64, &[f64])> = columns.lines().collect();
        assert_eq!(lines, [(2, [2.0, -2.0].as_slice()), (5, &[1.0, -1.0]), (9, &[4.0, -4.0])]);
        assert_eq!(columns.in_order(), 0);
        columns.pick(&[1]);
        assert_eq!(columns.line(1), Some((5, [-1.0].as_slice())));
        assert_eq!(columns.pairs().count(), 2);
        columns.pick(&[1]);
        assert!(columns.is_empty());
    }

    #[test]
    fn lines_of_another_width_or_without_numbers_are_refused() {
        let mut columns = Columns::default();
        assert!(columns.push_finite(1, &[1.0, 2.0]));
        assert!(!columns.push_finite(2, &[1.0]));
        assert!(!columns.push_finite(3, &[1.0, f64::NAN]));
        assert_eq!(columns.len(), 1);
    }
}
