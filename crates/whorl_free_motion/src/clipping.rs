//! A gyro at the end of its range.

use nalgebra::Vector3;

/// So many equal samples in a row, at the largest rate of the axis so far, are pinned.
const PINNED_SAMPLES: u32 = 3;
/// Slower than this no gyro's range ends [rad/s].
const LEAST_RANGE_RAD_S: f64 = 0.5;
/// Standard deviation of the rate beyond the end, relative to the end: the rate may be any, and was quick enough to get there \[1\].
const BEYOND: f64 = 1.0;

/// Finds samples that stand at the end of the gyro's range, and says how much the angle may be off.
///
/// Noise makes every sample of a turning gyro differ from the one before; one at its end repeats it exactly, while the other axes
/// go on. (Where all of them repeat themselves, the log holds its values, or nothing has noise.) The errors of
/// consecutive pinned samples have one sign: their angle's standard deviation grows with the time, not with its root.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Clipping {
    largest: [f64; 3],
    last: [f64; 3],
    equal: [u32; 3],
    /// For how long each axis has been pinned, and the variance that was told of it.
    pinned_s: [f64; 3],
    told_rad2: [f64; 3],
    /// Samples with a pinned axis.
    count: u64,
}

impl Clipping {
    /// Takes a sample over `dt_s`; gives the variance that it adds to the angle about each axis \[rad^2\].
    pub fn add(&mut self, dt_s: f64, gyro_rad_s: &Vector3<f64>) -> Option<Vector3<f64>> {
        let mut added = Vector3::zeros();
        let mut pinned = false;
        let is_held = (0..3).all(|axis| gyro_rad_s[axis] == self.last[axis]);
        for axis in 0..3 {
            let rate = gyro_rad_s[axis];
            let is_end = rate.abs() >= self.largest[axis] && rate.abs() > LEAST_RANGE_RAD_S;
            self.largest[axis] = self.largest[axis].max(rate.abs());
            if !is_end || is_held || rate != self.last[axis] {
                self.last[axis] = rate;
                self.equal[axis] = u32::from(is_end);
                // The first ones are seen to be pinned when the third is.
                (self.pinned_s[axis], self.told_rad2[axis]) = (dt_s, 0.0);
                continue;
            }
            self.equal[axis] += 1;
            self.pinned_s[axis] += dt_s;
            if self.equal[axis] >= PINNED_SAMPLES {
                let variance = (BEYOND * rate * self.pinned_s[axis]).powi(2);
                added[axis] = variance - self.told_rad2[axis];
                self.told_rad2[axis] = variance;
                self.count += if pinned {
                    0
                } else if self.equal[axis] == PINNED_SAMPLES {
                    u64::from(PINNED_SAMPLES)
                } else {
                    1
                };
                pinned = true;
            }
        }
        pinned.then_some(added)
    }

    /// Samples at the end of the range so far.
    #[must_use]
    pub fn count(&self) -> u64 {
        self.count
    }

    /// The largest rate so far: the end of the range, where there are samples at it [rad/s].
    #[must_use]
    pub fn range_rad_s(&self) -> f64 {
        self.largest.iter().copied().fold(0.0, f64::max)
    }
}

impl std::fmt::Display for Clipping {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(
            f,
            "{} samples of the gyro stand at the end of its range ({:.1} deg/s): the turns in them are uncertain by their whole \
             angle. A wider range of the gyro would measure them.",
            self.count,
            self.range_rad_s().to_degrees()
        )
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const END: f64 = 2.181_661_564_992_912;

    #[test]
    fn samples_at_the_end_of_the_range_are_found_and_their_uncertainty_adds_up() {
        let mut clipping = Clipping::default();
        let mut variance = 0.0;
        for i in 0..300_i32 {
            let t = f64::from(i) * 0.01;
            // A quick turn whose middle 24 samples are beyond the end.
            let rate =
                (5.0 * (-((t - 1.5) / 0.13).powi(2)).exp()).min(END) + if i % 2 == 0 { 0.0 } else { 1e-4 };
            let rate = rate.min(END);
            variance += clipping.add(0.01, &Vector3::new(0.01 * t, 0.0, rate)).map_or(0.0, |added| added.z);
        }
        assert_eq!((clipping.count(), clipping.range_rad_s()), (23, END));
        assert!((variance.sqrt() - END * 0.23).abs() < 1e-9, "{}", variance.sqrt());
    }

    #[test]
    fn rest_and_slow_steady_turns_are_no_end() {
        let mut clipping = Clipping::default();
        for i in 0..1000 {
            assert_eq!(clipping.add(0.01, &Vector3::new(0.0, 0.1, 1e-3 * f64::from(i % 3))), None);
        }
        assert_eq!(clipping.count(), 0);
        // A spin without noise.
        for i in 0..1000 {
            let rate = (0.01 * f64::from(i)).min(2.0);
            assert_eq!(clipping.add(0.01, &Vector3::new(0.0, 0.0, rate)), None);
        }
    }
}
