//! Sensors whose axes turn against the gyro: named, and used no more.

use super::outcome::FilterEvent;
use super::{AttitudeBiasEstimator, ImuSample, UNKNOWN_HEADING_VARIANCE};
use nalgebra::{Matrix3, Vector3};
use whorl_free_motion::Contradiction;

/// How wrong an inclination is, about, that a wrong accelerometer corrected until it was found \[rad\].
const WRONG_FORCE_RAD: f64 = 0.3;

impl AttitudeBiasEstimator {
    /// What turns against the gyro and is not used: accelerometer, vector sensor.
    #[must_use]
    pub fn contradictions(&self) -> &[Option<Contradiction>; 2] {
        &self.contradicted
    }

    /// Compares what the accelerometer saw with the turn to this sample.
    pub(super) fn compare_axes(&mut self, sample: &ImuSample, event: &mut Option<FilterEvent>) {
        // The gyro as it is: a bias that a wrong sensor taught must not judge that sensor.
        self.axes.on_imu(sample.stamp_ns, &sample.gyro_rad_s, Some(&sample.specific_force_m_s2));
        let [force, _] = self.axes.contradictions();
        let is_new = force.is_some() && self.contradicted.first().is_some_and(Option::is_none);
        if let Some(known) = self.contradicted.first_mut() {
            *known = force;
        }
        if is_new {
            self.state.covariance.forget_inclination(WRONG_FORCE_RAD.powi(2));
            self.gravity = None;
            self.forget_bias();
            *event = Some(FilterEvent::AccelerometerContradicted);
        }
    }

    /// What was learned of the bias may be wrong.
    fn forget_bias(&mut self) {
        self.state.covariance.bias += Matrix3::identity() * self.parameters.initial_bias_sigma_rad_s.powi(2);
    }

    /// Compares what the vector sensor saw, in the axes of the newest inertial sample.
    pub(super) fn compare_direction(&mut self, now_b: &Vector3<f64>, event: &mut Option<FilterEvent>) {
        self.axes.on_field(now_b);
        let [_, field] = self.axes.contradictions();
        let is_new = field.is_some() && self.contradicted.last().is_some_and(Option::is_none);
        if let Some(known) = self.contradicted.last_mut() {
            *known = field;
        }
        if is_new {
            self.state.covariance.forget_heading(UNKNOWN_HEADING_VARIANCE);
            self.forget_bias();
            *event = Some(FilterEvent::VectorContradicted);
        }
    }
}
