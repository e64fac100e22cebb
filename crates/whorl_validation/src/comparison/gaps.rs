//! Samples that are left out.

use std::ops::Range;

/// Positions of samples that were left out, in their order: mostly none, or long stretches.
#[derive(Debug, Clone, Default, PartialEq)]
pub(super) struct Gaps(Vec<Range<usize>>);

impl Gaps {
    /// Leaves out a sample behind those that are left out.
    pub fn add(&mut self, k: usize) {
        match self.0.last_mut() {
            Some(last) if last.end == k => last.end += 1,
            _ => self.0.push(k..k + 1),
        }
    }

    /// The other ones of so many samples.
    pub fn others(&self, samples: usize) -> impl Iterator<Item = usize> {
        let starts = std::iter::once(0).chain(self.0.iter().map(|gap| gap.end));
        let ends = self.0.iter().map(|gap| gap.start).chain([samples]);
        starts.zip(ends).flat_map(|(start, end)| start..end)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_others_are_those_that_were_not_left_out() {
        let mut gaps = Gaps::default();
        [0, 3, 4, 9].into_iter().for_each(|k| gaps.add(k));
        assert_eq!(gaps.others(11).collect::<Vec<_>>(), [1, 2, 5, 6, 7, 8, 10]);
        assert_eq!(gaps.0.len(), 3);
        assert_eq!(Gaps::default().others(3).collect::<Vec<_>>(), [0, 1, 2]);
    }
}
