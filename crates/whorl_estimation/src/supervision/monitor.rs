//! Bookkeeping per sensor: frozen values, counts, average NIS, consecutive outliers.

use super::outcome::{Rejection, RejectionCounts, SampleOutcome};
use crate::kernels::attitude_bias::covariance::{Correction, Outlier};
use nalgebra::Vector3;

/// Weight of a new sample in the average NIS: a memory of about 100 samples, whose average
/// then scatters by 7 % (two degrees of freedom).
const NIS_WEIGHT: f64 = 0.01;

/// An outlier counts in the average with no more than this NIS per degree of freedom: one wild sample
/// must not raise the flag for long.
const NIS_CLIP: f64 = 15.0;

/// Stamps, frozen values and counts of one sensor.
#[derive(Clone, Debug, Default, PartialEq)]
pub(crate) struct SampleMonitor {
    /// Stamp of the last accepted sample.
    pub(crate) accepted_ns: Option<i64>,
    /// Newest stamp seen.
    pub(crate) newest_ns: Option<i64>,
    pub(crate) latest_rejected: bool,
    pub(crate) counts: RejectionCounts,
    value: Option<Vector3<f64>>,
    repeats: u32,
}

impl SampleMonitor {
    /// Whether this value completes a run of `limit` identical ones; 0: never.
    pub(crate) fn is_frozen(&mut self, value: &Vector3<f64>, limit: u32) -> bool {
        if self.value.as_ref() == Some(value) {
            self.repeats = self.repeats.saturating_add(1);
        } else {
            self.value = Some(*value);
            self.repeats = 1;
        }
        limit > 0 && self.repeats >= limit
    }

    pub(crate) fn accept(&mut self, stamp_ns: i64) {
        self.accepted_ns = Some(stamp_ns);
        self.latest_rejected = false;
    }

    pub(crate) fn reject(&mut self, rejection: Rejection) {
        self.latest_rejected = true;
        self.counts.add(rejection);
    }
}

/// A sensor that corrects the estimate.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct SensorMonitor {
    pub(crate) samples: SampleMonitor,
    /// Average NIS per degree of freedom; one when consistent.
    pub(crate) average_nis: f64,
    /// Stamp of the first outlier of the present run.
    outliers_since_ns: Option<i64>,
}

impl Default for SensorMonitor {
    fn default() -> Self {
        Self { samples: SampleMonitor::default(), average_nis: 1.0, outliers_since_ns: None }
    }
}

impl SensorMonitor {
    /// Books an update; true: outliers lasted for `recovery_s`, so the estimate must be reset.
    pub(crate) fn record(
        &mut self,
        result: &Result<Correction, Outlier>,
        dof: u8,
        stamp_ns: i64,
        recovery_s: f64,
    ) -> (SampleOutcome, bool) {
        let nis = match result {
            Ok(correction) => correction.nis,
            Err(Outlier(nis)) => *nis,
        };
        let ratio = (nis / f64::from(dof)).clamp(0.0, NIS_CLIP);
        self.average_nis += NIS_WEIGHT * (ratio - self.average_nis);
        if result.is_ok() {
            self.outliers_since_ns = None;
            self.samples.accept(stamp_ns);
            return (SampleOutcome::Used, false);
        }
        let rejection = Rejection::Outlier { nis };
        self.samples.reject(rejection);
        let since_ns = *self.outliers_since_ns.get_or_insert(stamp_ns);
        let lost = stamp_ns.saturating_sub(since_ns) as f64 * 1e-9 >= recovery_s;
        if lost {
            self.forget_outliers();
        }
        (SampleOutcome::Rejected(rejection), lost)
    }

    pub(crate) fn forget_outliers(&mut self) {
        self.outliers_since_ns = None;
        self.average_nis = 1.0;
    }
}
