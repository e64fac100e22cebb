//! The inertial half: gates, propagation, and the accelerometer's correction.

use super::gravity_window::{GravityWindow, vertical_of_sample};
use super::outcome::{FilterEvent, Rejection, SampleOutcome, UsedDirection};
use super::{AttitudeBiasEstimator, CLOCK_STEP_SAMPLES, ImuSample, Interval, PreviousImu, seconds};
use crate::kernels::attitude_bias::covariance::{Measurement, Outlier};
use crate::parameters::{GyroSampling, Parameters};
use nalgebra::{Matrix2, Matrix3, Unit, Vector3};
use whorl_math::quaternion_exp;

impl AttitudeBiasEstimator {
    /// Gates on the gyro half; a step back of the clock restarts the filter.
    pub(super) fn accept_gyro(
        &mut self,
        sample: &ImuSample,
        event: &mut Option<FilterEvent>,
    ) -> Result<(), Rejection> {
        let gyro = &sample.gyro_rad_s;
        if !gyro.iter().all(|c| c.is_finite()) {
            return Err(Rejection::NotFinite);
        }
        if let Some(previous) = self.previous
            && sample.stamp_ns <= previous.stamp_ns
        {
            if sample.stamp_ns == previous.stamp_ns {
                return Err(Rejection::DuplicateStamp);
            }
            self.backward_stamps += 1;
            if self.backward_stamps < CLOCK_STEP_SAMPLES {
                return Err(Rejection::OutOfOrder);
            }
            self.previous = None;
            self.vector.samples.accepted_ns = None;
            self.vector.samples.newest_ns = None;
            self.accelerometer.samples.accepted_ns = None;
            self.restart(sample.stamp_ns);
            *event = Some(FilterEvent::RestartedAfterClockStep);
        }
        self.backward_stamps = 0;
        if gyro.amax() > self.parameters.gyro_range_rad_s {
            return Err(Rejection::OutOfRange);
        }
        if self.gyro.is_frozen(gyro, self.parameters.frozen_samples) {
            return Err(Rejection::Frozen);
        }
        let step = self.parameters.gyro_step_rad_s;
        if let Some(previous) = &mut self.previous
            && (gyro - previous.gyro_rad_s).amax() > step
        {
            // Twice in a row near the same value is a motion, not a spike.
            let confirmed = previous.suspect_rad_s.is_some_and(|suspect| (gyro - suspect).amax() <= step);
            previous.suspect_rad_s = Some(*gyro);
            if !confirmed {
                return Err(Rejection::Spike);
            }
        }
        Ok(())
    }

    /// Carries attitude and covariance to the sample's stamp.
    pub(super) fn propagate(&mut self, sample: &ImuSample, event: &mut Option<FilterEvent>) {
        let gyro = sample.gyro_rad_s;
        let now = PreviousImu { stamp_ns: sample.stamp_ns, gyro_rad_s: gyro, suspect_rad_s: None };
        let Some(previous) = self.previous.replace(now) else {
            self.restart(sample.stamp_ns);
            return;
        };
        let dt_s = seconds(sample.stamp_ns, previous.stamp_ns);
        let walk = self.constants.bias_walk_density;
        let mut noise = self.constants.gyro_noise_density;
        if dt_s > self.parameters.imu_timeout_s {
            self.state.covariance.bias += Matrix3::identity() * (walk * dt_s);
            self.restart(sample.stamp_ns);
            *event = Some(FilterEvent::RestartedAfterGap);
            return;
        } else if dt_s > self.parameters.imu_gap_s {
            // Rotation by a rate that may have wandered between the samples.
            let lost = 0.25 * self.parameters.gap_acceleration_rad_s2 * dt_s * dt_s;
            noise += lost * lost / dt_s;
        }
        let clipped = self.clipping.add(dt_s, &gyro);
        self.is_clipped = clipped.is_some();
        // One number for all axes, which must not be less than the worst.
        noise += clipped.map_or(0.0, |variance| variance.amax()) / dt_s;
        let omega = gyro - self.state.bias_rad_s;
        let turn = match self.parameters.gyro_sampling {
            GyroSampling::IntervalMean => omega * dt_s,
            GyroSampling::Instantaneous => {
                let before = previous.gyro_rad_s - self.state.bias_rad_s;
                // Linear rate: the mean, and the first term of the Magnus series (coning).
                (before + omega) * (0.5 * dt_s) + before.cross(&omega) * (dt_s * dt_s / 12.0)
            }
        };
        let mean_rotation = self.state.turn(&turn);
        self.interval = Interval { dt_s, mean_rotation };
        self.history.push(sample.stamp_ns, self.state.q_inertial_body);
        if let Some(start) = &mut self.start {
            start.add_rate(&omega);
            self.state.covariance.bias += Matrix3::identity() * (walk * dt_s);
        } else {
            self.state.covariance.propagate(&mean_rotation, dt_s, noise, walk);
        }
    }

    /// The accelerometer half of a sample, at the attitude just propagated.
    pub(super) fn use_specific_force(
        &mut self,
        sample: &ImuSample,
        event: &mut Option<FilterEvent>,
    ) -> (SampleOutcome, Option<UsedDirection>) {
        let force_b = &sample.specific_force_m_s2;
        let rejection = self.refuse_force(force_b);
        if let Some(rejection) = rejection {
            self.accelerometer.samples.reject(rejection);
        }
        let omega = sample.gyro_rad_s - self.state.bias_rad_s;
        if rejection.is_none() {
            self.follow_deviation(force_b, self.interval.dt_s);
        }
        if let Some(start) = &mut self.start {
            if rejection.is_none() {
                start.add_force(&self.parameters, sample.stamp_ns, force_b);
            }
            extend(
                start.gravity_mut(),
                &self.parameters,
                self.state.rotation(),
                (force_b, rejection),
                &omega,
                self.interval,
            );
        } else if !self.constants.every_sample {
            extend(
                &mut self.gravity,
                &self.parameters,
                self.state.rotation(),
                (force_b, rejection),
                &omega,
                self.interval,
            );
        }
        if let Some(rejection) = rejection {
            return (SampleOutcome::Rejected(rejection), None);
        }
        let Some(mut vertical) = self.vertical(force_b, &omega) else {
            self.accelerometer.samples.accept(sample.stamp_ns);
            return (SampleOutcome::Collected, None);
        };
        vertical.noise += Matrix2::identity() * self.acceleration_variance();
        let up_w =
            quaternion_exp(&-Vector3::new(vertical.innovation.x, vertical.innovation.y, 0.0)) * Vector3::z();
        let up_b = Unit::new_unchecked(self.state.rotation().tr_mul(&up_w));
        // One number for both axes, which must not be less than the worse: with a lever arm the gyro's noise falls on one axis
        // alone.
        let variance = vertical.noise.symmetric_eigenvalues().max();
        let used = UsedDirection { direction_b: up_b, variance };
        let result = self.state.covariance.update(&vertical, self.constants.gate_two);
        let (outcome, lost) =
            self.accelerometer.record(&result, 2, sample.stamp_ns, self.parameters.recovery_s);
        match result {
            Ok(correction) => self.apply(&correction, 2),
            Err(Outlier(nis)) => self.nis = Some((nis, 2)),
        }
        if lost {
            let bias_variance = self.parameters.initial_bias_sigma_rad_s.powi(2);
            self.state.covariance.bias = Matrix3::identity() * bias_variance;
            self.restart(sample.stamp_ns);
            *event = Some(FilterEvent::RestartedAfterOutliers);
        }
        (outcome, (outcome == SampleOutcome::Used).then_some(used))
    }

    /// Holds the peak of the deviation from gravity's length while it decays.
    fn follow_deviation(&mut self, force_b: &Vector3<f64>, dt_s: f64) {
        if let Some(rejection) = &self.parameters.acceleration_rejection {
            let decayed = self.deviation_m_s2 * rejection.decay_s / (rejection.decay_s + dt_s);
            self.deviation_m_s2 = decayed.max((force_b.norm() - self.parameters.gravity_m_s2).abs());
        }
    }

    /// Extra variance of the vertical while the sensor itself accelerates \[rad^2\].
    fn acceleration_variance(&self) -> f64 {
        self.parameters.acceleration_rejection.map_or(0.0, |rejection| {
            (rejection.gain * self.deviation_m_s2 / self.parameters.gravity_m_s2).powi(2)
        })
    }

    /// The vertical, if this sample completes a measurement of it.
    fn vertical(&mut self, force_b: &Vector3<f64>, omega: &Vector3<f64>) -> Option<Measurement> {
        if self.start.is_some() {
            return None;
        }
        if self.constants.every_sample {
            return Some(vertical_of_sample(self.state.rotation(), force_b, &self.parameters));
        }
        let window = self.gravity.as_ref()?;
        // A rounding error of the stamps must not lengthen the window by a sample.
        let full = window.elapsed_s() + 0.1 * self.interval.dt_s >= self.parameters.accelerometer_window_s;
        if !full || window.intervals() == 0 {
            return None;
        }
        let vertical = window.vertical(self.state.rotation(), omega, &self.parameters);
        self.gravity = Some(GravityWindow::new(self.state.rotation(), force_b, omega, &self.parameters));
        Some(vertical)
    }

    /// Gates on the accelerometer half.
    fn refuse_force(&mut self, force_b: &Vector3<f64>) -> Option<Rejection> {
        let parameters = &self.parameters;
        if !force_b.iter().all(|c| c.is_finite()) {
            return Some(Rejection::NotFinite);
        }
        if force_b.amax() > parameters.accelerometer_range_m_s2 {
            return Some(Rejection::OutOfRange);
        }
        if self.accelerometer.samples.is_frozen(force_b, parameters.frozen_samples) {
            return Some(Rejection::Frozen);
        }
        if self.contradicted.first().is_some_and(Option::is_some) {
            return Some(Rejection::Contradicted);
        }
        let deviation = (force_b.norm() - parameters.gravity_m_s2).abs();
        (deviation > parameters.gravity_tolerance_m_s2).then_some(Rejection::NotGravity)
    }
}

/// Adds a sample to a window, or starts one.
fn extend(
    window: &mut Option<GravityWindow>,
    parameters: &Parameters,
    rotation: &Matrix3<f64>,
    (force_b, rejection): (&Vector3<f64>, Option<Rejection>),
    omega: &Vector3<f64>,
    interval: Interval,
) {
    let Interval { dt_s, mean_rotation } = interval;
    match (window, rejection) {
        (Some(window), None) => window.add(rotation, &mean_rotation, force_b, dt_s),
        (Some(window), Some(_)) => window.hold(&mean_rotation, dt_s),
        (window, None) => *window = Some(GravityWindow::new(rotation, force_b, omega, parameters)),
        (None, Some(_)) => {}
    }
}
