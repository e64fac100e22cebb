//! The numbers of one channel of a file, without an allocation for each line.

use crate::recording::is_whole;

/// Times and numbers, of the same number of numbers in every line.
#[derive(Debug, Clone, Default, PartialEq)]
pub(super) struct Columns {
    time_ns: Vec<i64>,
    width: usize,
    numbers: Vec<f64>,
}

impl Columns {
    /// Adds a line; the first says how many numbers a line has.
    pub fn push(&mut self, time_ns: i64, numbers: &[f64]) {
        if self.time_ns.is_empty() {
            self.width = numbers.len();
        }
        if numbers.len() == self.width {
            self.time_ns.push(time_ns);
            self.numbers.extend_from_slice(numbers);
        }
    }

    /// Lines.
    pub fn len(&self) -> usize {
        self.time_ns.len()
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

    /// The lines.
    pub fn lines(&self) -> impl Iterator<Item = (i64, &[f64])> {
        self.time_ns.iter().copied().zip(self.numbers.chunks(self.width.max(1)))
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
}
