//! Attitude error and gyro bias: the algorithm of section 4.5.4 (eqs. 4.69-4.72), without gates or windows.
//!
//! The gyro turns an undisturbed inertial frame and corrections turn that frame in the world, so that a late
//! measurement meets the attitude of its own time. The attitude error is a rotation vector in world axes,
//! `R_true = exp(delta) R`: see [`covariance`].

pub(crate) mod covariance;

use covariance::{Correction, Covariance};
use nalgebra::{Matrix3, Matrix6, UnitQuaternion, Vector3};
use whorl_math::quaternion_exp;

/// Mean and covariance.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct AttitudeBias {
    pub(crate) q_world_inertial: UnitQuaternion<f64>,
    pub(crate) q_inertial_body: UnitQuaternion<f64>,
    /// Rotation matrix of `q_world_inertial * q_inertial_body`.
    rotation: Matrix3<f64>,
    pub(crate) bias_rad_s: Vector3<f64>,
    pub(crate) covariance: Covariance,
}

impl AttitudeBias {
    /// Nothing is known except how large a bias may be \[rad^2/s^2\].
    pub(crate) fn unknown(bias_variance: f64) -> Self {
        Self {
            q_world_inertial: UnitQuaternion::identity(),
            q_inertial_body: UnitQuaternion::identity(),
            rotation: Matrix3::identity(),
            bias_rad_s: Vector3::zeros(),
            covariance: Covariance::diagonal(Vector3::repeat(10.0), bias_variance),
        }
    }

    /// A known attitude and bias; `covariance` is that of [`crate::Estimate::covariance`].
    pub(crate) fn known(
        q_world_body: UnitQuaternion<f64>,
        bias_rad_s: Vector3<f64>,
        covariance: &Matrix6<f64>,
    ) -> Self {
        let rotation = *q_world_body.to_rotation_matrix().matrix();
        Self {
            q_world_inertial: UnitQuaternion::identity(),
            q_inertial_body: q_world_body,
            rotation,
            bias_rad_s,
            covariance: Covariance {
                attitude: rotation * covariance.fixed_view::<3, 3>(0, 0) * rotation.transpose(),
                cross: rotation * covariance.fixed_view::<3, 3>(0, 3),
                bias: covariance.fixed_view::<3, 3>(3, 3).into(),
            },
        }
    }

    pub(crate) fn q_world_body(&self) -> UnitQuaternion<f64> {
        self.q_world_inertial * self.q_inertial_body
    }

    /// World from body.
    pub(crate) fn rotation(&self) -> &Matrix3<f64> {
        &self.rotation
    }

    /// Turns the body by a rotation vector in body axes \[rad\]; the mean of the rotation matrices before and after.
    pub(crate) fn turn(&mut self, turn_b_rad: &Vector3<f64>) -> Matrix3<f64> {
        self.q_inertial_body *= quaternion_exp(turn_b_rad);
        self.q_inertial_body.renormalize_fast();
        let before = self.rotation;
        self.update_rotation();
        (before + self.rotation) * 0.5
    }

    /// Turns the inertial frame in the world and moves the bias. The error is then zero again; kept in world axes,
    /// where the reset leaves the unobserved heading direction in place, it needs no transport.
    pub(crate) fn apply(&mut self, correction: &Correction) {
        self.q_world_inertial = quaternion_exp(&correction.attitude_rad) * self.q_world_inertial;
        self.q_world_inertial.renormalize_fast();
        self.bias_rad_s += correction.bias_rad_s;
        self.update_rotation();
    }

    /// The first attitude: rotation of the world relative to the frame carried as the world so far.
    pub(crate) fn begin(
        &mut self,
        q_world_carried: &UnitQuaternion<f64>,
        bias_change_rad_s: &Vector3<f64>,
        covariance: Covariance,
    ) {
        self.q_world_inertial = q_world_carried * self.q_world_inertial;
        self.bias_rad_s += bias_change_rad_s;
        self.covariance = covariance;
        self.update_rotation();
    }

    pub(crate) fn is_finite(&self) -> bool {
        let covariance = &self.covariance;
        (self.rotation.sum()
            + self.bias_rad_s.sum()
            + covariance.attitude.trace()
            + covariance.bias.trace()
            + covariance.cross.sum())
        .is_finite()
    }

    fn update_rotation(&mut self) {
        self.rotation = *self.q_world_body().to_rotation_matrix().matrix();
    }
}
