//! Curves of runs of any length, for plots.

/// Below this number of points a [`GrowingCurve`] stays; a multiple of four.
const KEPT: usize = 4800;

/// A curve that is thinned while it grows: the smallest and the largest value of each stretch are kept, so that no peak
/// is lost. The stretches double whenever there are too many.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct GrowingCurve {
    points: Vec<(f64, f64)>,
    /// Samples per stretch; 0: every sample is kept.
    stretch: usize,
    /// Extremes of the stretch that is not full, and the samples in it.
    open: Option<[(f64, f64); 2]>,
    samples: usize,
}

impl GrowingCurve {
    /// Adds a point.
    pub fn push(&mut self, time_s: f64, value: f64) {
        let point = (time_s, value);
        if self.stretch == 0 {
            self.points.push(point);
        } else {
            self.open = Some(self.open.map_or([point; 2], |open| extremes([open[0], open[1], point])));
            self.samples += 1;
            if self.samples == self.stretch {
                self.points.extend(self.open.take().map(in_order).into_iter().flatten());
                self.samples = 0;
            }
        }
        if self.points.len() >= KEPT && self.samples == 0 {
            // Two points stand for a stretch, or for themselves: four become two.
            let half = self.points.chunks(4).flat_map(|four| in_order(extremes(four.iter().copied())));
            self.points = half.collect();
            self.stretch = if self.stretch == 0 { 4 } else { 2 * self.stretch };
        }
    }

    /// The points: times \[s\] and values.
    pub fn points(&self) -> impl Iterator<Item = (f64, f64)> {
        let open = self.open.map(in_order).into_iter().flatten();
        self.points.iter().copied().chain(open)
    }
}

/// The points with the smallest and with the largest value.
fn extremes(points: impl IntoIterator<Item = (f64, f64)>) -> [(f64, f64); 2] {
    let mut found: Option<[(f64, f64); 2]> = None;
    for point in points {
        let [low, high] = found.get_or_insert([point; 2]);
        if point.1.total_cmp(&low.1).is_lt() {
            *low = point;
        }
        if point.1.total_cmp(&high.1).is_gt() {
            *high = point;
        }
    }
    found.unwrap_or_default()
}

fn in_order([a, b]: [(f64, f64); 2]) -> [(f64, f64); 2] {
    if b.0 < a.0 { [b, a] } else { [a, b] }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_curve_that_grows_stays_short_and_keeps_its_peaks() {
        // A day at 100 Hz, with a spike up and one down.
        let value = |i: u32| match i {
            4_321_007 => 9.0,
            17 => -7.0,
            _ => (f64::from(i) * 0.01).sin(),
        };
        let mut growing = GrowingCurve::default();
        for i in 0..8_640_000 {
            growing.push(f64::from(i) * 0.01, value(i));
        }
        let curve: Vec<(f64, f64)> = growing.points().collect();
        assert!((KEPT / 2..=KEPT + 2).contains(&curve.len()), "{}", curve.len());
        let peaks = [(43_210.07, 9.0), (0.17, -7.0)];
        assert!(peaks.iter().all(|peak| curve.contains(peak)));
        assert!(curve.windows(2).all(|w| w[0].0 <= w[1].0));
        assert!(curve.last().is_some_and(|(t, _)| *t > 86_400.0 - 60.0), "to the end");
        // Evenly spaced: no stretch of time is shown more coarsely than another.
        let longest = curve.windows(2).map(|w| w[1].0 - w[0].0).fold(0.0, f64::max);
        assert!(longest < 4.0 * 86_400.0 / curve.len() as f64, "{longest}");
    }

    #[test]
    fn a_short_curve_is_kept_as_it_is() {
        let mut growing = GrowingCurve::default();
        (0..KEPT - 1).for_each(|i| growing.push(i as f64, -(i as f64)));
        assert!(growing.points().eq((0..KEPT - 1).map(|i| (i as f64, -(i as f64)))));
    }
}
