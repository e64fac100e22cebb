//! Attitude over time, statistics, thinning for plots.

use nalgebra::UnitQuaternion;
pub use whorl_math::GrowingCurve;
use whorl_msgs::geometry_msgs::Quaternion;

/// Attitudes at increasing times.
#[derive(Debug, Clone, Default)]
pub struct AttitudeSeries {
    time_s: Vec<f64>,
    q_world_body: Vec<UnitQuaternion<f64>>,
}

impl AttitudeSeries {
    /// Adds a sample, which is returned as a rotation; an invalid rotation and a sample that does not advance in time
    /// are left out.
    pub fn push(&mut self, time_s: f64, q: Quaternion) -> Option<UnitQuaternion<f64>> {
        let q = q.to_unit().filter(|_| self.time_s.last().is_none_or(|last| time_s > *last))?;
        self.time_s.push(time_s);
        self.q_world_body.push(q);
        Some(q)
    }

    /// Drops the samples before a time, except the last of all.
    pub fn forget_before(&mut self, time_s: f64) {
        let old = self.time_s.partition_point(|t| *t < time_s).min(self.time_s.len().saturating_sub(1));
        self.time_s.drain(..old);
        self.q_world_body.drain(..old);
    }

    /// Whether there are no samples.
    pub fn is_empty(&self) -> bool {
        self.time_s.is_empty()
    }

    /// Interpolated along the shortest arc; `None` outside the samples or in a gap over `gap_s`.
    pub fn at(&self, time_s: f64, gap_s: f64) -> Option<UnitQuaternion<f64>> {
        let after = self.time_s.partition_point(|t| *t < time_s);
        let (t1, q1) = (self.time_s.get(after)?, self.q_world_body.get(after)?);
        if *t1 == time_s {
            return Some(*q1);
        }
        let before = after.checked_sub(1)?;
        let (t0, q0) = (self.time_s.get(before)?, self.q_world_body.get(before)?);
        if t1 - t0 > gap_s {
            return None;
        }
        let fraction = (time_s - t0) / (t1 - t0);
        Some(q0 * whorl_math::quaternion_exp(&(whorl_math::rotation_vector(&(q0.inverse() * q1)) * fraction)))
    }

    /// The samples after one time and before another \[s\].
    pub fn between(
        &self,
        after_s: Option<f64>,
        until_s: f64,
    ) -> impl Iterator<Item = (f64, UnitQuaternion<f64>)> + '_ {
        let begin = after_s.map_or(0, |after| self.time_s.partition_point(|t| *t <= after));
        let end = self.time_s.partition_point(|t| *t < until_s).max(begin);
        (begin..end).map(|i| (self.time_s[i], self.q_world_body[i]))
    }
}

/// Root mean square of values that come one after the other.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct Rms {
    sum: f64,
    count: u64,
}

impl Rms {
    /// Adds a value.
    pub fn add(&mut self, value: f64) {
        self.sum += value * value;
        self.count += 1;
    }

    /// Values so far.
    pub fn count(self) -> u64 {
        self.count
    }

    /// NaN without values.
    pub fn value(self) -> f64 {
        (self.sum / self.count as f64).sqrt()
    }
}

/// Root mean square; NaN without values.
pub fn rms(values: impl IntoIterator<Item = f64>) -> f64 {
    let (sum, count) = values.into_iter().fold((0.0, 0u64), |(s, n), x| (s + x * x, n + 1));
    (sum / count as f64).sqrt()
}

/// Largest value; NaN without values.
pub fn maximum(values: impl IntoIterator<Item = f64>) -> f64 {
    values.into_iter().fold(f64::NAN, f64::max)
}

/// A curve of a plot.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Curve {
    /// Legend.
    pub name: String,
    /// Times \[s\].
    pub time_s: Vec<f64>,
    /// Values in the plot's unit.
    pub value: Vec<f64>,
}

impl Curve {
    /// From points.
    pub fn new(name: impl Into<String>, points: impl IntoIterator<Item = (f64, f64)>) -> Self {
        let (time_s, value) = points.into_iter().unzip();
        Self { name: name.into(), time_s, value }
    }

    /// One that has grown.
    pub fn of(name: impl Into<String>, growing: &GrowingCurve) -> Self {
        Self::new(name, growing.points())
    }

    /// At most about `limit` points: the smallest and the largest of each stretch are kept, so that
    /// no peak is lost.
    #[must_use]
    pub fn thinned(self, limit: usize) -> Self {
        if self.time_s.len() <= limit {
            return self;
        }
        let stretch = self.time_s.len().div_ceil(limit / 2);
        let mut thin = Self { name: self.name, ..Self::default() };
        for (times, values) in self.time_s.chunks(stretch).zip(self.value.chunks(stretch)) {
            let by_value = |a: &usize, b: &usize| values[*a].total_cmp(&values[*b]);
            let (low, high) = ((0..values.len()).min_by(by_value), (0..values.len()).max_by(by_value));
            let (Some(low), Some(high)) = (low, high) else { continue };
            for index in [low.min(high), low.max(high)] {
                thin.time_s.push(times[index]);
                thin.value.push(values[index]);
            }
        }
        thin
    }
}

/// Three curves with names.
pub fn named(names: [&str; 3], curves: &[GrowingCurve; 3]) -> Vec<Curve> {
    names.into_iter().zip(curves).map(|(name, curve)| Curve::of(name, curve)).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::Vector3;

    #[test]
    fn attitudes_are_interpolated_at_constant_rate() {
        let about_z = |angle: f64| UnitQuaternion::from_axis_angle(&Vector3::z_axis(), angle);
        let mut series = AttitudeSeries::default();
        series.push(0.0, about_z(0.2).into());
        series.push(1.0, about_z(0.6).into());
        assert_eq!(series.push(1.0, about_z(0.7).into()), None, "not later");
        assert!(series.at(0.25, 2.0).unwrap().angle_to(&about_z(0.3)) < 1e-12);
        assert_eq!(series.at(0.25, 0.5), None, "a gap");
        assert_eq!(series.at(1.01, 2.0), None, "past the end");
    }

    #[test]
    fn statistics_of_known_numbers() {
        assert_eq!(rms([3.0, 4.0]), 12.5f64.sqrt());
        assert!(rms([]).is_nan());
        assert_eq!(maximum([1.0, f64::NAN, 3.0]), 3.0);
    }

    #[test]
    fn thinning_keeps_the_peaks() {
        let spike = |i: usize| if i == 12_345 { 9.0 } else { (i as f64 * 0.01).sin() };
        let curve = Curve::new("x", (0..100_000).map(|i| (i as f64, spike(i)))).thinned(2000);
        assert!(curve.time_s.len() <= 2000);
        assert_eq!(maximum(curve.value.iter().copied()), 9.0);
        assert!(curve.time_s.windows(2).all(|w| w[0] <= w[1]));
    }
}
