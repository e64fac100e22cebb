//! What a run's supplies did, as it was measured: a plant that has it does not ask its model.

/// Temperature and bus voltage over a run, and with how much gas it began.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct MeasuredSupplies {
    /// Pressure of the tank at the start \[Pa\]; `None`: not measured.
    pub first_tank_pressure_pa: Option<f64>,
    /// Of the platform \[K\]; `None`: not measured.
    pub temperature_k: Option<Course>,
    /// Of the bus, with the load that it had \[V\]; `None`: not measured.
    pub bus_voltage_v: Option<Course>,
}

/// A number over time: linear between means of what was measured, the first and the last held before and after.
#[derive(Debug, Clone, PartialEq)]
pub struct Course {
    start_s: f64,
    step_s: f64,
    /// At the start and at every step: two at least.
    values: Vec<f64>,
}

/// Values that are kept at most: of a day at ten a second. Longer runs have longer steps.
const MOST: usize = 864_000;

impl Course {
    /// Through means over steps of this length \[s\], > 0, of samples sorted by time; steps without samples are bridged. `None` where nothing finite
    /// was measured.
    #[must_use]
    pub fn through(samples: impl IntoIterator<Item = (f64, f64)>, step_s: f64) -> Option<Self> {
        let samples: Vec<(f64, f64)> =
            samples.into_iter().filter(|(t, x)| t.is_finite() && x.is_finite()).collect();
        let (start_s, end_s) = (samples.first()?.0, samples.last()?.0);
        let step_s = step_s.max((end_s - start_s) / MOST as f64);
        let of_step = |t: f64| ((t - start_s) / step_s) as usize;
        // Time and value, each the mean of a step.
        let means: Vec<(f64, f64)> = samples
            .chunk_by(|a, b| of_step(a.0) == of_step(b.0))
            .map(|of| {
                let sum = of.iter().fold((0.0, 0.0), |sum, (t, x)| (sum.0 + t, sum.1 + x));
                (sum.0 / of.len() as f64, sum.1 / of.len() as f64)
            })
            .collect();
        let mut next = 0;
        let values = (0..=of_step(end_s) + 1).map(|k| {
            let t = start_s + k as f64 * step_s;
            next += means[next..].iter().take_while(|(at_s, _)| *at_s <= t).count();
            match (next.checked_sub(1).map(|before| means[before]), means.get(next)) {
                (Some((from_s, from)), Some((to_s, to))) => {
                    from + (to - from) * (t - from_s) / (to_s - from_s)
                }
                (Some((_, only)), None) => only,
                (None, first) => first.map_or(f64::NAN, |(_, first)| *first),
            }
        });
        Some(Self { values: values.collect(), start_s, step_s })
    }

    /// At a time \[s\].
    #[must_use]
    #[inline]
    pub fn at(&self, time_s: f64) -> f64 {
        let last = self.values.len() - 1;
        let place = ((time_s - self.start_s) / self.step_s).clamp(0.0, last as f64);
        let before = (place as usize).min(last - 1);
        self.values[before] + (self.values[before + 1] - self.values[before]) * (place - before as f64)
    }
}

#[cfg(test)]
mod tests {
    use super::Course;

    #[test]
    fn means_of_steps_are_joined_by_lines() {
        let ramp = (0..1000).map(|k| f64::from(k) * 0.01).map(|t| (t, 3.0 + 2.0 * t));
        let course = Course::through(ramp, 0.1).unwrap();
        for t in [0.2, 1.234, 5.0, 9.7] {
            assert!((course.at(t) - (3.0 + 2.0 * t)).abs() < 1e-9, "{t} s: {}", course.at(t));
        }
        // Before and after, and half a step at the ends: held.
        assert!((course.at(-5.0) - 3.09).abs() < 1e-9 && (course.at(20.0) - 22.89).abs() < 1e-9);
    }

    #[test]
    fn gaps_are_bridged_and_nothing_finite_is_nothing() {
        let sparse =
            Course::through([(0.0, 1.0), (f64::NAN, 7.0), (5.0, f64::INFINITY), (10.0, 2.0)], 0.1).unwrap();
        assert!((sparse.at(2.5) - 1.25).abs() < 1e-9, "{}", sparse.at(2.5));
        let one = Course::through([(4.0, 9.0)], 0.1).unwrap();
        assert_eq!([one.at(0.0), one.at(4.0), one.at(8.0)], [9.0; 3]);
        assert_eq!(Course::through([(1.0, f64::NAN)], 0.1), None);
        assert_eq!(Course::through([], 0.1), None);
        // As long as a clock that jumped may have it.
        assert!(Course::through([(0.0, 1.0), (1e12, 2.0)], 0.1).unwrap().values.len() < 900_000);
    }
}
