//! Equal bins over a recording, and means of samples in them.

use nalgebra::Vector3;
use whorl_dynamics::gyrostat::MAX_WHEELS;
use whorl_math::statistics::median;
use whorl_recording::{Mounting, Recording, Series};

use crate::inputs::SampleTimes;
use crate::run::Wheels;

/// Mean of a vector channel's samples in a bin.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Mean3 {
    pub value: Vector3<f64>,
    /// Samples in it; 0 = none.
    pub count: f64,
    /// Their mean time less the node's \[s\].
    pub late_s: f64,
}

/// Bins of equal width, each with a node at the mean time of its samples.
pub(crate) struct Bins {
    origin_s: f64,
    width_s: f64,
    pub times: SampleTimes,
}

impl Bins {
    /// Bins from the first to the last of these stamps, at least two; `None` without stamps.
    pub fn new(stamps_s: &[f64], width_s: f64) -> Option<Self> {
        let (first_s, last_s) = (stamps_s.first()?, stamps_s.last()?);
        let count = (((last_s - first_s) / width_s).floor() as usize).max(2);
        // Half a sample off, so that jitter does not move samples over a bin's edge.
        let origin_s = first_s - 0.5 * median_step_s(stamps_s).min(width_s);
        let samples_s = vec![Vec::new(); count];
        let mut bins = Self { origin_s, width_s, times: SampleTimes { node_s: vec![0.0; count], samples_s } };
        for t in stamps_s {
            if let Some(samples) = bins.bin_of(*t).and_then(|b| bins.times.samples_s.get_mut(b)) {
                samples.push(*t);
            }
        }
        for (b, (node, samples)) in bins.times.node_s.iter_mut().zip(&bins.times.samples_s).enumerate() {
            *node = if samples.is_empty() {
                origin_s + (b as f64 + 0.5) * width_s
            } else {
                samples.iter().sum::<f64>() / samples.len() as f64
            };
        }
        Some(bins)
    }

    fn bin_of(&self, time_s: f64) -> Option<usize> {
        let index = (time_s - self.origin_s) / self.width_s;
        (index >= 0.0 && index < self.times.samples_s.len() as f64).then_some(index as usize)
    }

    /// Means of a channel whose stamps are late by `latency_s`.
    pub fn means(&self, series: &Series<Vector3<f64>>, latency_s: f64) -> Vec<Mean3> {
        let mut sums = vec![(Vector3::zeros(), 0.0, 0.0); self.times.node_s.len()];
        for (stamp, value) in series.time_s.iter().zip(&series.value) {
            let t = stamp - latency_s;
            if let Some(slot) = self.bin_of(t).and_then(|b| sums.get_mut(b)) {
                slot.0 += value;
                slot.1 += 1.0;
                slot.2 += t;
            }
        }
        sums.into_iter()
            .zip(&self.times.node_s)
            .map(|((sum, count, time), node_s)| {
                if count > 0.0 {
                    Mean3 { value: sum / count, count, late_s: time / count - node_s }
                } else {
                    Mean3 { value: Vector3::zeros(), count: 0.0, late_s: 0.0 }
                }
            })
            .collect()
    }

    /// Means that hold a clipped sample say nothing.
    pub fn drop_clipped(
        &self,
        means: &mut [Mean3],
        series: &Series<Vector3<f64>>,
        latency_s: f64,
        limit: f64,
    ) {
        for (stamp, value) in series.time_s.iter().zip(&series.value) {
            if value.amax() >= limit * (1.0 - 1e-9)
                && let Some(mean) = self.bin_of(stamp - latency_s).and_then(|b| means.get_mut(b))
            {
                mean.count = 0.0;
            }
        }
    }

    /// Means of the wheels' speeds, how many samples each is of, and their mean time less the node's \[s\].
    pub fn wheel_means(&self, series: &Series<Vec<f64>>) -> Vec<(Wheels, f64, f64)> {
        let mut sums = vec![([0.0; MAX_WHEELS], 0.0, 0.0); self.times.node_s.len()];
        for (t, value) in series.time_s.iter().zip(&series.value) {
            if let Some(slot) = self.bin_of(*t).and_then(|b| sums.get_mut(b)) {
                for (sum, speed) in slot.0.iter_mut().zip(value) {
                    *sum += speed;
                }
                slot.1 += 1.0;
                slot.2 += t;
            }
        }
        for (slot, node_s) in sums.iter_mut().zip(&self.times.node_s) {
            if slot.1 > 0.0 {
                slot.0.iter_mut().for_each(|x| *x /= slot.1);
                slot.2 = slot.2 / slot.1 - node_s;
            }
        }
        sums
    }
}

/// Typical time between stamps \[s\].
pub(crate) fn median_step_s(times: &[f64]) -> f64 {
    let typical = median(times.windows(2).map(|w| w[1] - w[0]));
    if typical.is_nan() { 0.01 } else { typical }
}

/// Typical time between samples of the channel that sets the nodes \[s\].
pub(crate) fn sample_step_s(recording: &Recording) -> f64 {
    if recording.mounting == Mounting::Clamped {
        median_step_s(&recording.wheel_speed_rad_s.time_s)
    } else {
        median_step_s(&recording.gyro_b_rad_s.time_s)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_bin_holds_the_mean_of_what_fell_into_it() {
        // 8 Hz, one sample lost, in bins of a quarter of a second that begin half a sample before the first.
        let stamps_s = [0.0, 0.125, 0.25, 0.5, 0.625, 0.75];
        let bins = Bins::new(&stamps_s, 0.25).unwrap();
        let expected = [0.0625, 0.25, 0.5625];
        assert_eq!(bins.times.node_s.len(), expected.len());
        assert!(bins.times.node_s.iter().zip(expected).all(|(t, e)| (t - e).abs() < 1e-12));
        // The same channel, stamped 30 ms late, of one value a sample.
        let series = Series {
            time_s: stamps_s.map(|t| t + 0.03).to_vec(),
            value: (1..7).map(|x| Vector3::repeat(f64::from(x))).collect(),
        };
        let mut means = bins.means(&series, 0.03);
        assert_eq!(
            means.iter().map(|m| (m.value.x, m.count)).collect::<Vec<_>>(),
            [(1.5, 2.0), (3.0, 1.0), (4.5, 2.0)]
        );
        assert!(means.iter().all(|m| m.late_s.abs() < 1e-12));
        // Not corrected, they are late by what they are late.
        assert!(bins.means(&series, 0.0).iter().all(|m| (m.late_s - 0.03).abs() < 1e-12));
        bins.drop_clipped(&mut means, &series, 0.03, 5.0);
        assert_eq!(means.iter().map(|m| m.count).collect::<Vec<_>>(), [2.0, 1.0, 0.0]);
    }
}
