//! Equal bins over a recording, and means of samples in them.

use nalgebra::{SVector, Vector3};
use whorl_recording::Series;

use crate::noise::typical_step_s;

/// Mean of a channel's samples in a bin.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Mean<const N: usize> {
    /// Mean in the channel's unit; zero without samples.
    pub value: SVector<f64, N>,
    /// Number of samples in the bin.
    pub count: f64,
    /// Their mean time less the node's \[s\].
    pub late_s: f64,
}

/// Mean of a three-axis channel.
pub type Mean3 = Mean<3>;

/// Times of the nodes and of their samples.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct SampleTimes {
    /// Nodes \[s\].
    pub node_s: Vec<f64>,
    /// Samples of each node \[s\].
    pub samples_s: Vec<Vec<f64>>,
}

/// Bins of equal width, each with a node at the mean time of its samples.
#[derive(Debug, Clone, PartialEq)]
pub struct Bins {
    origin_s: f64,
    width_s: f64,
    /// The nodes, and the stamps from which the bins were made.
    pub times: SampleTimes,
}

impl Bins {
    /// Bins spanning the first to the last of these stamps, at least two; `None` without stamps.
    #[must_use]
    pub fn new(stamps_s: &[f64], width_s: f64) -> Option<Self> {
        let (first_s, last_s) = (stamps_s.first()?, stamps_s.last()?);
        let count = (((last_s - first_s) / width_s).floor() as usize).max(2);
        // Offset by half a sample, so that jitter does not move samples across a bin's edge.
        let origin_s = first_s - 0.5 * typical_step_s(stamps_s).min(width_s);
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

    /// Means of a channel whose stamps are late by `latency_s`; `read` extracts the numbers from its values.
    pub fn means_of<T, const N: usize>(
        &self,
        series: &Series<T>,
        latency_s: f64,
        read: impl Fn(&T) -> SVector<f64, N>,
    ) -> Vec<Mean<N>> {
        let mut sums = vec![(SVector::<f64, N>::zeros(), 0.0, 0.0); self.times.node_s.len()];
        for (stamp, value) in series.time_s.iter().zip(&series.value) {
            let t = stamp - latency_s;
            if let Some(slot) = self.bin_of(t).and_then(|b| sums.get_mut(b)) {
                slot.0 += read(value);
                slot.1 += 1.0;
                slot.2 += t;
            }
        }
        sums.into_iter()
            .zip(&self.times.node_s)
            .map(|((sum, count, time), node_s)| {
                if count > 0.0 {
                    Mean { value: sum / count, count, late_s: time / count - node_s }
                } else {
                    Mean { value: SVector::zeros(), count: 0.0, late_s: 0.0 }
                }
            })
            .collect()
    }

    /// Means of a three-axis channel whose stamps are late by `latency_s`.
    #[must_use]
    pub fn means(&self, series: &Series<Vector3<f64>>, latency_s: f64) -> Vec<Mean3> {
        self.means_of(series, latency_s, |value| *value)
    }

    /// Discards means that contain a clipped sample: their count becomes zero.
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
        // The same channel, stamped 30 ms late, with one value per sample.
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
        // Uncorrected, they are late by the latency.
        assert!(bins.means(&series, 0.0).iter().all(|m| (m.late_s - 0.03).abs() < 1e-12));
        bins.drop_clipped(&mut means, &series, 0.03, 5.0);
        assert_eq!(means.iter().map(|m| m.count).collect::<Vec<_>>(), [2.0, 1.0, 0.0]);
    }
}
