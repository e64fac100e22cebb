//! Quaternion / angular-velocity filter of section 4.5.2 (eqs. 4.54-4.60), kept to show why it is not enough.
//!
//! The quaternion is four free components and its update adds. Its length is then no longer one and its covariance has
//! a meaningless direction; both are repaired after each update (normalised; the covariance projected across the
//! quaternion), which no derivation justifies: that is the dissertation's argument for section 4.5.3. Components are
//! w, x, y, z (Hamilton).

use super::rate_state::RateState;
use nalgebra::{
    Matrix3, Matrix3x4, Matrix4, Matrix4x3, Quaternion, SMatrix, SVector, UnitQuaternion, Vector3,
};
use whorl_estimation::kernels::{
    DirectionMeasurement, FilterStep, Kernel, KernelStart, Solution, Update, correct_three_components,
};
use whorl_math::covariance::propagate;
use whorl_math::skew;

type Covariance = SMatrix<f64, 7, 7>;

/// The filter's state.
#[derive(Clone, Debug, PartialEq)]
pub struct QuaternionRateFilter {
    state: RateState,
    /// Quaternion w, x, y, z; rate.
    covariance: Covariance,
}

/// `q' = Xi(q) omega / 2`.
fn xi(q: &Quaternion<f64>) -> Matrix4x3<f64> {
    let (w, x, y, z) = (q.w, q.i, q.j, q.k);
    Matrix4x3::new(-x, -y, -z, w, -z, y, z, w, -x, -y, x, w)
}

/// `q' = Omega(omega) q / 2`.
fn omega_matrix(rate: &Vector3<f64>) -> Matrix4<f64> {
    let (x, y, z) = (rate.x, rate.y, rate.z);
    Matrix4::new(0.0, -x, -y, -z, x, 0.0, z, -y, y, -z, 0.0, x, z, y, -x, 0.0)
}

/// Derivative of `R(q)^T r` by the four components (eqs. 4.56-4.58 for any direction).
fn direction_sensitivity(q: &Quaternion<f64>, r: &Vector3<f64>) -> Matrix3x4<f64> {
    let v = Vector3::new(q.i, q.j, q.k);
    let by_scalar = r * (2.0 * q.w) - v.cross(r) * 2.0;
    let by_vector =
        (v * r.transpose() - r * v.transpose() + Matrix3::identity() * v.dot(r) + skew(r) * q.w) * 2.0;
    Matrix3x4::from_columns(&[
        by_scalar,
        by_vector.column(0).into(),
        by_vector.column(1).into(),
        by_vector.column(2).into(),
    ])
}

impl QuaternionRateFilter {
    /// A filter that goes on from an estimate; `None` without a body, or if its inertia is singular.
    #[must_use]
    pub fn new(start: &KernelStart<'_>) -> Option<Self> {
        let (state, rate) = RateState::new(start)?;
        let start = start.solution;
        let to_quaternion = xi(start.q_world_body.quaternion()) * 0.5;
        let attitude: Matrix3<f64> = start.covariance.fixed_view::<3, 3>(0, 0).into();
        let mut covariance = Covariance::zeros();
        let quaternion = to_quaternion * attitude * to_quaternion.transpose();
        covariance.fixed_view_mut::<4, 4>(0, 0).copy_from(&quaternion);
        covariance.fixed_view_mut::<3, 3>(4, 4).copy_from(&rate);
        Some(Self { state, covariance })
    }

    /// Adds a correction, then repairs length and covariance.
    fn apply(&mut self, correction: &SVector<f64, 7>) {
        let q = self.state.q_world_body.quaternion();
        let sum = Quaternion::new(
            q.w + correction[0],
            q.i + correction[1],
            q.j + correction[2],
            q.k + correction[3],
        );
        if let Some(unit) = UnitQuaternion::try_new(sum, 1e-9) {
            self.state.q_world_body = unit;
        }
        self.state.omega_rad_s += correction.fixed_rows::<3>(4);
        let q = self.state.q_world_body.quaternion();
        let along = nalgebra::Vector4::new(q.w, q.i, q.j, q.k);
        let mut across = Covariance::identity();
        across.fixed_view_mut::<4, 4>(0, 0).copy_from(&(Matrix4::identity() - along * along.transpose()));
        self.covariance = across * self.covariance * across;
    }
}

impl Kernel for QuaternionRateFilter {
    fn step(&mut self, step: &FilterStep) -> Update {
        let dt_s = step.dt_s;
        let rate_noise = self.state.model.rate_noise(step);
        let q = *self.state.q_world_body.quaternion();
        let up_b = self.state.q_world_body.inverse() * Vector3::z();
        let half = self.state.omega_rad_s
            + self.state.model.acceleration(&self.state.omega_rad_s, &up_b) * (0.5 * dt_s);
        let acceleration = self.state.model.acceleration(&half, &up_b);
        let rate = self.state.model.linearised(&half, &up_b);
        let (_, mean_rate) = self.state.advance(step, &acceleration);
        let mut f = Covariance::identity();
        // exp(Omega dt / 2) to second order: Omega^2 = -|omega|^2.
        let turn = omega_matrix(&mean_rate) * (0.5 * dt_s);
        let quaternion = Matrix4::identity() * (1.0 - 0.125 * mean_rate.norm_squared() * dt_s * dt_s) + turn;
        f.fixed_view_mut::<4, 4>(0, 0).copy_from(&quaternion);
        f.fixed_view_mut::<4, 3>(0, 4).copy_from(&(xi(&q) * (0.5 * dt_s)));
        let to_vertical = direction_sensitivity(&q, &Vector3::z());
        f.fixed_view_mut::<3, 4>(4, 0).copy_from(&(rate.by_vertical * to_vertical * dt_s));
        f.fixed_view_mut::<3, 3>(4, 4).copy_from(&(Matrix3::identity() + rate.by_rate * dt_s));
        let mut noise = Covariance::zeros();
        noise.fixed_view_mut::<3, 3>(4, 4).copy_from(&rate_noise);
        propagate(&mut self.covariance, &f, &noise);
        let (correction, update) = self.state.use_gyro(&mut self.covariance, 4, step);
        self.apply(&correction);
        update
    }

    fn correct_direction(&mut self, measured: &DirectionMeasurement) -> Update {
        let mut h = SMatrix::<f64, 3, 7>::zeros();
        let sensitivity = direction_sensitivity(self.state.q_world_body.quaternion(), &measured.reference_w);
        h.fixed_view_mut::<3, 4>(0, 0).copy_from(&sensitivity);
        let innovation = measured.direction_b.into_inner()
            - self.state.q_world_body.inverse() * measured.reference_w.into_inner();
        let (correction, update) =
            correct_three_components(&mut self.covariance, &h, measured.variance, &innovation, 2);
        self.apply(&correction);
        update
    }

    fn solution(&self) -> Solution {
        // Rotation vector from quaternion components: 2 Xi^T.
        let back = xi(self.state.q_world_body.quaternion()).transpose() * 2.0;
        let attitude = back * self.covariance.fixed_view::<4, 4>(0, 0) * back.transpose();
        self.state.solution(&((attitude + attitude.transpose()) * 0.5))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sensitivities_are_the_derivatives() {
        let q = Quaternion::new(0.5, -0.3, 0.7, 0.4);
        let r = Vector3::new(0.2, -0.9, 0.4);
        // R(q)^T r of a quaternion of any length, by the Hamilton product.
        let output = |q: &Quaternion<f64>| {
            let turned = q.conjugate() * Quaternion::from_parts(0.0, r) * q;
            turned.vector().into_owned()
        };
        let sensitivity = direction_sensitivity(&q, &r);
        for (column, step) in [
            Quaternion::new(1e-6, 0.0, 0.0, 0.0),
            Quaternion::new(0.0, 1e-6, 0.0, 0.0),
            Quaternion::new(0.0, 0.0, 1e-6, 0.0),
            Quaternion::new(0.0, 0.0, 0.0, 1e-6),
        ]
        .into_iter()
        .enumerate()
        {
            let numeric = (output(&(q + step)) - output(&(q - step))) / 2e-6;
            assert!((numeric - sensitivity.column(column)).norm() < 1e-8, "{column}");
        }
    }

    #[test]
    fn kinematic_matrices_are_the_hamilton_product() {
        let q = Quaternion::new(0.5, -0.3, 0.7, 0.4);
        let rate = Vector3::new(0.1, -0.2, 0.3);
        let product = q * Quaternion::from_parts(0.0, rate);
        let expected = nalgebra::Vector4::new(product.w, product.i, product.j, product.k);
        assert!((xi(&q) * rate - expected).norm() < 1e-15);
        let components = nalgebra::Vector4::new(q.w, q.i, q.j, q.k);
        assert!((omega_matrix(&rate) * components - expected).norm() < 1e-15);
    }
}
