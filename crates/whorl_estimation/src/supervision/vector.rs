//! The vector half: gates, the wait for the IMU, and the correction at the sample's own time.

use super::outcome::{FilterEvent, Rejection, SampleOutcome, UsedDirection};
use super::{AttitudeBiasEstimator, COARSE_HEADING_VARIANCE, UNKNOWN_HEADING_VARIANCE, seconds};
use crate::kernels::attitude_bias::covariance::{Correction, Measurement, Outlier, ScalarMeasurement};
use crate::parameters::{VectorParameters, VectorUse};
use crate::residual::{components, direction_residual, heading_residual};
use nalgebra::{Matrix2, Unit, Vector3};
use whorl_math::unit;

impl AttitudeBiasEstimator {
    /// Gates on a vector sample; true: it must wait for the IMU.
    pub(super) fn accept_vector(
        &mut self,
        stamp_ns: i64,
        direction_b: &Vector3<f64>,
    ) -> Result<(Unit<Vector3<f64>>, bool), Rejection> {
        let vector = self.parameters.vector.ok_or(Rejection::NotUsable)?;
        let direction = unit(*direction_b).map_err(|_| Rejection::NotFinite)?;
        let imu = self.previous.ok_or(Rejection::TooEarly)?;
        if let Some(newest_ns) = self.vector.samples.newest_ns {
            if stamp_ns == newest_ns {
                return Err(Rejection::DuplicateStamp);
            }
            if stamp_ns < newest_ns {
                return Err(Rejection::OutOfOrder);
            }
        }
        let age_s = seconds(imu.stamp_ns, stamp_ns);
        if age_s > vector.max_age_s {
            return Err(Rejection::Late);
        }
        if -age_s > vector.max_age_s {
            return Err(Rejection::TooEarly);
        }
        self.vector.samples.newest_ns = Some(stamp_ns);
        if self.vector.samples.is_frozen(direction_b, self.parameters.frozen_samples) {
            return Err(Rejection::Frozen);
        }
        Ok((direction, age_s < 0.0))
    }

    /// Corrects with a direction taken at `stamp_ns`, not after the newest IMU sample.
    pub(super) fn apply_vector(
        &mut self,
        stamp_ns: i64,
        direction_b: Unit<Vector3<f64>>,
        event: &mut Option<FilterEvent>,
    ) -> (SampleOutcome, Option<UsedDirection>) {
        let (Some(vector), Some(imu)) = (self.parameters.vector, self.previous) else {
            return (SampleOutcome::Rejected(Rejection::NotUsable), None);
        };
        let Some(q_inertial_then) = self.history.at(stamp_ns) else {
            self.vector.samples.reject(Rejection::Late);
            return (SampleOutcome::Rejected(Rejection::Late), None);
        };
        let now_b = self.state.q_inertial_body.inverse() * (q_inertial_then * direction_b.into_inner());
        self.compare_direction(&now_b, event);
        if self.contradicted.last().is_some_and(Option::is_some) {
            self.vector.samples.reject(Rejection::Contradicted);
            return (SampleOutcome::Rejected(Rejection::Contradicted), None);
        }
        let measured_w = self.state.q_world_inertial * (q_inertial_then * direction_b.into_inner());
        if let Some(start) = &mut self.start {
            start.add_vector(&self.parameters, stamp_ns, &measured_w, &direction_b);
            self.vector.samples.accept(stamp_ns);
            return (SampleOutcome::Collected, None);
        }
        // Rotation by the bias error since then: delta(then) = delta(now) + R age bias_error.
        let age_s = seconds(imu.stamp_ns, stamp_ns);
        let variance = vector.noise_rad * vector.noise_rad + self.constants.gyro_noise_density * age_s;
        let used = UsedDirection { direction_b: Unit::new_unchecked(now_b), variance };
        let (result, dof) = self.vector_update(&vector, &measured_w, age_s);
        let (outcome, lost) = self.vector.record(&result, dof, stamp_ns, vector.recovery_s);
        match result {
            Ok(correction) => self.apply(&correction, dof),
            Err(Outlier(nis)) => self.nis = Some((nis, dof)),
        }
        if lost {
            self.state.covariance.forget_heading(UNKNOWN_HEADING_VARIANCE);
            *event = Some(FilterEvent::HeadingForgotten);
        }
        (outcome, (outcome == SampleOutcome::Used).then_some(used))
    }

    fn vector_update(
        &mut self,
        vector: &VectorParameters,
        measured_w: &Vector3<f64>,
        age_s: f64,
    ) -> (Result<Correction, Outlier>, u8) {
        let since = self.state.rotation() * age_s;
        let lag_variance = self.constants.gyro_noise_density * age_s;
        let variance = vector.noise_rad * vector.noise_rad;
        let coarse = self.state.covariance.attitude.m33 > COARSE_HEADING_VARIANCE;
        if vector.usage == VectorUse::Heading || coarse {
            let (innovation, attitude) = heading_residual(measured_w, &vector.reference_w);
            let horizontal = vector.reference_w.x.powi(2) + vector.reference_w.y.powi(2);
            let heading_only = vector.usage == VectorUse::Heading;
            let measurement = ScalarMeasurement {
                innovation,
                attitude,
                bias: since.tr_mul(&attitude),
                noise: variance / horizontal + lag_variance * attitude.norm_squared(),
                lag_variance,
                corrects: if heading_only { Vector3::z() } else { Vector3::repeat(1.0) },
            };
            return (self.state.covariance.update_scalar(&measurement, self.constants.gate_one), 1);
        }
        let columns = &self.constants.vector_across;
        let residual = direction_residual(measured_w, &vector.reference_w);
        let measurement = Measurement {
            innovation: components(columns, &residual),
            attitude: *columns,
            bias: Some(since.tr_mul(columns)),
            // The columns are orthonormal.
            noise: Matrix2::identity() * (variance + lag_variance),
            lag_variance,
        };
        (self.state.covariance.update(&measurement, self.constants.gate_two), 2)
    }
}
