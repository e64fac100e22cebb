//! Logs that are faster than their sensors repeat each value until the next one comes.

/// Runs that are looked at.
const MOST_RUNS: usize = 4_000;
/// Fewer runs tell nothing.
const FEWEST_RUNS: usize = 20;
/// Share of the runs that are about as long as the usual one \[1\].
const REGULAR: f64 = 0.9;
/// Largest share of single values: a coarse sensor at rest repeats itself by chance, and as often does not \[1\].
const SINGLES: f64 = 0.1;
/// A value that stands for so many times the usual number of lines is a constant, and measured again.
const CONSTANT: u32 = 3;

/// Lengths of the runs of equal values of one sensor.
#[derive(Debug, Clone, Default)]
pub struct Runs {
    last: Vec<u64>,
    length: u32,
    lengths: Vec<u32>,
}

impl Runs {
    /// Takes the next value.
    pub fn add(&mut self, numbers: &[f64]) {
        if self.lengths.len() >= MOST_RUNS {
            return;
        }
        if self.is_again(numbers) {
            self.length += 1;
            return;
        }
        if self.length > 0 {
            self.lengths.push(self.length);
        }
        self.last = numbers.iter().map(|x| x.to_bits()).collect();
        self.length = 1;
    }

    fn is_again(&self, numbers: &[f64]) -> bool {
        self.last.len() == numbers.len()
            && self.last.iter().zip(numbers).all(|(last, x)| *last == x.to_bits())
            && self.length > 0
    }

    /// Number of lines in which most values stand.
    #[must_use]
    pub fn usual(&self) -> Option<u32> {
        let mut lengths = self.lengths.clone();
        lengths.sort_unstable();
        lengths.get(lengths.len() / 2).copied()
    }

    /// In how many lines each value stands, of a sensor whose values are held; `None` where values are equal by chance, or not.
    #[must_use]
    pub fn held(&self) -> Option<u32> {
        // The first run may have begun before the file.
        let mut lengths = self.lengths.get(1..)?.to_vec();
        if lengths.len() < FEWEST_RUNS {
            return None;
        }
        lengths.sort_unstable();
        let usual = lengths.get(lengths.len() / 2).copied()?;
        let share = |of: &dyn Fn(u32) -> bool| {
            lengths.iter().filter(|length| of(**length)).count() as f64 / lengths.len() as f64
        };
        let about = (usual / 4).max(1);
        let regular = share(&|length| length.abs_diff(usual) <= about) >= REGULAR;
        (usual >= 2 && regular && share(&|length| length == 1) <= SINGLES).then_some(usual)
    }
}

/// Leaves out the repetitions of held values.
#[derive(Debug, Clone)]
pub struct Thinning {
    held: u32,
    last: Runs,
    /// Values left out.
    pub left_out: u64,
}

impl Thinning {
    /// Of a sensor whose values stand in so many lines each.
    #[must_use]
    pub fn new(held: u32) -> Self {
        Self { held, last: Runs::default(), left_out: 0 }
    }

    /// Whether this is a measurement of its own.
    pub fn is_new(&mut self, numbers: &[f64]) -> bool {
        if self.last.is_again(numbers) && self.last.length < CONSTANT.saturating_mul(self.held) {
            self.last.length += 1;
            self.left_out += 1;
            return false;
        }
        self.last.last = numbers.iter().map(|x| x.to_bits()).collect();
        self.last.length = 1;
        true
    }
}

/// What is said of held values.
#[must_use]
pub fn said(sensor: &str, held: u32, left_out: u64) -> String {
    format!(
        "Each value of {sensor} stands in {held} samples in a row: the log is faster than the sensor. {left_out} repetitions were \
         not counted as measurements."
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    fn runs(values: impl IntoIterator<Item = f64>) -> Runs {
        let mut runs = Runs::default();
        values.into_iter().for_each(|x| runs.add(&[x, 1.0]));
        runs
    }

    #[test]
    fn held_values_are_told_from_equal_ones() {
        assert_eq!(runs((0..1000).map(|i| f64::from(i / 10))).held(), Some(10));
        // A log of 286 Hz of a sensor of 100 Hz.
        assert_eq!(runs((0..1000).map(|i| (f64::from(i) / 2.86).floor())).held(), Some(3));
        assert_eq!(runs((0..1000).map(f64::from)).held(), None);
        assert_eq!(runs((0..1000).map(|_| 7.0)).held(), None);
        // Coarse steps at rest: each value is equal to the one before by chance, half of the time.
        let mut seed = 1_u32;
        let mut chance = move || {
            seed = seed.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
            f64::from(seed >> 31)
        };
        assert_eq!(runs((0..4000).map(|_| chance())).held(), None);
        // Exact constants at rest, then motion.
        assert_eq!(runs((0..1000).map(|i| f64::from((i - 500).max(0)))).held(), None);
    }

    #[test]
    fn repetitions_are_left_out_and_constants_are_not_forgotten() {
        let mut thinning = Thinning::new(5);
        let new = (0..50).filter(|i| thinning.is_new(&[f64::from(i / 5)])).count();
        assert_eq!((new, thinning.left_out), (10, 40));
        let mut constant = Thinning::new(5);
        assert_eq!((0..60).filter(|_| constant.is_new(&[1.0])).count(), 4);
    }
}
