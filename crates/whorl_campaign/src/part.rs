//! Tasks: parts of a campaign that an engine distributes.

use std::fmt;

/// Part `number` of `of`: every run whose number leaves this rest. Together, the parts have each run once.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Part {
    number: u64,
    of: u64,
}

impl Part {
    /// Everything.
    pub const WHOLE: Self = Self { number: 0, of: 1 };

    /// Part `number` (from 0) of `of`; `None` where there is no such part.
    #[must_use]
    pub fn new(number: u64, of: u64) -> Option<Self> {
        (number < of).then_some(Self { number, of })
    }

    /// All parts.
    pub fn all(of: u64) -> impl Iterator<Item = Self> {
        (0..of).map(move |number| Self { number, of })
    }

    /// From `3/16`.
    ///
    /// # Errors
    /// What is allowed.
    pub fn parse(text: &str) -> Result<Self, String> {
        let numbers = text.split_once('/').and_then(|(a, b)| Some((a.parse().ok()?, b.parse().ok()?)));
        numbers
            .and_then(|(number, of)| Self::new(number, of))
            .ok_or_else(|| format!("{text}: allowed: NUMBER/OF, NUMBER from 0 to OF - 1, e.g. 3/16"))
    }

    /// Its number, from 0.
    #[must_use]
    pub fn number(self) -> u64 {
        self.number
    }

    /// Its runs, of so many.
    pub fn runs(self, len: u64) -> impl Iterator<Item = u64> {
        (self.number..len).step_by(usize::try_from(self.of).unwrap_or(usize::MAX))
    }
}

impl fmt::Display for Part {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}/{}", self.number, self.of)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn parts_have_every_run_once() {
        for of in [1, 3, 7, 20] {
            let mut all: Vec<u64> = Part::all(of).flat_map(|part| part.runs(11)).collect();
            all.sort_unstable();
            assert_eq!(all, (0..11).collect::<Vec<_>>());
        }
        assert_eq!(Part::parse("3/16").unwrap(), Part::new(3, 16).unwrap());
        assert_eq!(Part::parse("3/16").unwrap().to_string(), "3/16");
        for wrong in ["3", "3/3", "-1/4", "a/b", "3/16/2", ""] {
            assert!(Part::parse(wrong).unwrap_err().contains("allowed: NUMBER/OF"), "{wrong}");
        }
    }
}
