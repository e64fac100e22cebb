//! Covariance of the attitude and gyro-bias error, in blocks.
//!
//! The attitude error is a rotation vector in *world* axes, `R_true = exp(delta) R_estimate`, and
//! the bias error is in body axes. In this frame the error does not turn with the body, and
//! directions known in the world have a constant sensitivity: the transition matrix is
//! `[1 B; 0 1]` with `B = -integral R dt`, whatever the motion.

use nalgebra::{Matrix1, Matrix2, Matrix3, Matrix3x2, Matrix6, SMatrix, Vector2, Vector3};
use whorl_math::covariance;

/// Blocks of the symmetric 6x6 covariance.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Covariance {
    /// Attitude error, world axes \[rad^2\].
    pub(crate) attitude: Matrix3<f64>,
    /// Attitude error (rows) against bias error (columns) \[rad^2/s\].
    pub(crate) cross: Matrix3<f64>,
    /// Bias error, body axes \[rad^2/s^2\].
    pub(crate) bias: Matrix3<f64>,
}

/// A linearised measurement of two components, `z = h_attitude^T delta + h_bias^T db + noise`.
pub(crate) struct Measurement {
    /// Innovation \[rad\].
    pub(crate) innovation: Vector2<f64>,
    /// Sensitivity to the attitude error, one column per component.
    pub(crate) attitude: Matrix3x2<f64>,
    /// Sensitivity to the bias error; `None` where it is zero.
    pub(crate) bias: Option<Matrix3x2<f64>>,
    /// Measurement noise \[rad^2\].
    pub(crate) noise: Matrix2<f64>,
    /// Variance by which the attitude error has grown since it was measured, on average
    /// \[rad^2\]: the measurement lacks that part of the error, `cov(delta, noise) = -lag h`.
    pub(crate) lag_variance: f64,
}

/// A linearised scalar measurement.
pub(crate) struct ScalarMeasurement {
    /// Innovation \[rad\].
    pub(crate) innovation: f64,
    /// Sensitivity to the attitude error.
    pub(crate) attitude: Vector3<f64>,
    /// Sensitivity to the bias error.
    pub(crate) bias: Vector3<f64>,
    /// Measurement noise \[rad^2\].
    pub(crate) noise: f64,
    /// As in [`Measurement`].
    pub(crate) lag_variance: f64,
    /// Which components of the attitude error it may correct (ones and zeros).
    pub(crate) corrects: Vector3<f64>,
}

/// The correction that an update makes.
pub(crate) struct Correction {
    /// Rotation, world axes \[rad\].
    pub(crate) attitude_rad: Vector3<f64>,
    /// Bias change, body axes \[rad/s\].
    pub(crate) bias_rad_s: Vector3<f64>,
    /// Normalised innovation squared.
    pub(crate) nis: f64,
}

/// The measurement lies outside the gate: its normalised innovation squared.
pub(crate) struct Outlier(pub(crate) f64);

impl Covariance {
    /// Independent attitude and bias errors.
    pub(crate) fn diagonal(attitude_variance: Vector3<f64>, bias_variance: f64) -> Self {
        Self {
            attitude: Matrix3::from_diagonal(&attitude_variance),
            cross: Matrix3::zeros(),
            bias: Matrix3::identity() * bias_variance,
        }
    }

    /// Time update with the mean rotation matrix of the interval; exact for constant bias and a
    /// rotation small within it. `noise` and `walk` are spectral densities \[rad^2/s\], \[rad^2/s^3\].
    pub(crate) fn propagate(&mut self, mean_rotation: &Matrix3<f64>, dt_s: f64, noise: f64, walk: f64) {
        let transition = mean_rotation * -dt_s;
        let moved = transition * self.bias;
        // B C^T + (B C^T)^T + B D B^T, written as X + X^T with half of the symmetric last term.
        let half = transition * (self.cross.transpose() + moved.transpose() * 0.5);
        self.attitude += half + half.transpose();
        let variance = noise * dt_s + walk * dt_s * dt_s * dt_s / 3.0;
        self.attitude[(0, 0)] += variance;
        self.attitude[(1, 1)] += variance;
        self.attitude[(2, 2)] += variance;
        self.cross += moved - mean_rotation * (0.5 * walk * dt_s * dt_s);
        self.bias[(0, 0)] += walk * dt_s;
        self.bias[(1, 1)] += walk * dt_s;
        self.bias[(2, 2)] += walk * dt_s;
    }

    /// Measurement update of two components; leaves the covariance alone when outside the gate.
    pub(crate) fn update(&mut self, measurement: &Measurement, gate: f64) -> Result<Correction, Outlier> {
        let h = &measurement.attitude;
        // A = P H^T + M and S = H P H^T + H M + M^T H^T + R, M the correlation of state and noise.
        let lag = h * self.possible_lag(measurement.lag_variance);
        let mut on_attitude = self.attitude * h - lag;
        let mut on_bias = self.cross.tr_mul(h);
        if let Some(h_bias) = &measurement.bias {
            on_attitude += self.cross * h_bias;
            on_bias += self.bias * h_bias;
        }
        let mut innovation_covariance = h.tr_mul(&(on_attitude - lag)) + measurement.noise;
        if let Some(h_bias) = &measurement.bias {
            innovation_covariance += h_bias.tr_mul(&on_bias);
        }
        let inverse = inverse_2x2(&innovation_covariance);
        let z = &measurement.innovation;
        let nis = z.dot(&(inverse * z));
        if nis.is_nan() || nis > gate {
            return Err(Outlier(nis));
        }
        let gain_attitude = on_attitude * inverse;
        let gain_bias = on_bias * inverse;
        self.correct(
            &stacked(&gain_attitude, &gain_bias),
            &stacked(&on_attitude, &on_bias),
            &innovation_covariance,
        );
        Ok(Correction { attitude_rad: gain_attitude * z, bias_rad_s: gain_bias * z, nis })
    }

    /// Scalar measurement update whose gain is masked: the covariance stays valid for the
    /// suboptimal gain.
    pub(crate) fn update_scalar(
        &mut self,
        measurement: &ScalarMeasurement,
        gate: f64,
    ) -> Result<Correction, Outlier> {
        let (h, h_bias) = (&measurement.attitude, &measurement.bias);
        let lag = h * self.possible_lag(measurement.lag_variance);
        let on_attitude = self.attitude * h + self.cross * h_bias - lag;
        let on_bias = self.cross.tr_mul(h) + self.bias * h_bias;
        let variance = h.dot(&(on_attitude - lag)) + h_bias.dot(&on_bias) + measurement.noise;
        let nis = measurement.innovation * measurement.innovation / variance;
        if nis.is_nan() || nis > gate {
            return Err(Outlier(nis));
        }
        let gain = on_attitude.component_mul(&measurement.corrects) / variance;
        let gain_bias = on_bias / variance;
        self.correct(&stacked(&gain, &gain_bias), &stacked(&on_attitude, &on_bias), &Matrix1::new(variance));
        Ok(Correction {
            attitude_rad: gain * measurement.innovation,
            bias_rad_s: gain_bias * measurement.innovation,
            nis,
        })
    }

    /// The 6x6 covariance with the attitude error in body axes.
    pub(crate) fn in_body_axes(&self, rotation: &Matrix3<f64>) -> Matrix6<f64> {
        let attitude = rotation.tr_mul(&(self.attitude * rotation));
        let attitude = (attitude + attitude.transpose()) * 0.5;
        self.full(&attitude, &rotation.tr_mul(&self.cross))
    }

    /// Forgets the heading and all correlations with it.
    pub(crate) fn forget_heading(&mut self, variance: f64) {
        for axis in 0..3 {
            self.attitude[(2, axis)] = 0.0;
            self.attitude[(axis, 2)] = 0.0;
            self.cross[(2, axis)] = 0.0;
        }
        self.attitude[(2, 2)] = variance;
    }

    /// Forgets how the inclination goes with everything else, and adds to its variance \[rad^2\].
    pub(crate) fn forget_inclination(&mut self, added: f64) {
        for axis in 0..2 {
            let variance = self.attitude[(axis, axis)];
            for other in 0..3 {
                self.attitude[(axis, other)] = 0.0;
                self.attitude[(other, axis)] = 0.0;
                self.cross[(axis, other)] = 0.0;
            }
            self.attitude[(axis, axis)] = variance + added;
        }
    }

    /// The growth since a measurement cannot exceed what is there now: another update in between
    /// may have taken some of it away.
    fn possible_lag(&self, lag_variance: f64) -> f64 {
        let p = &self.attitude;
        lag_variance.min(0.9 * p.m11.min(p.m22).min(p.m33))
    }

    /// Covariance after a correction with this gain: see [`covariance::correct`].
    fn correct<const M: usize>(
        &mut self,
        gain: &SMatrix<f64, 6, M>,
        a: &SMatrix<f64, 6, M>,
        s: &SMatrix<f64, M, M>,
    ) {
        let mut full = self.full(&self.attitude, &self.cross);
        covariance::correct(&mut full, gain, a, s);
        self.attitude = full.fixed_view::<3, 3>(0, 0).into();
        self.cross = full.fixed_view::<3, 3>(0, 3).into();
        self.bias = full.fixed_view::<3, 3>(3, 3).into();
    }

    fn full(&self, attitude: &Matrix3<f64>, cross: &Matrix3<f64>) -> Matrix6<f64> {
        let mut full = Matrix6::zeros();
        full.fixed_view_mut::<3, 3>(0, 0).copy_from(attitude);
        full.fixed_view_mut::<3, 3>(0, 3).copy_from(cross);
        full.fixed_view_mut::<3, 3>(3, 0).copy_from(&cross.transpose());
        full.fixed_view_mut::<3, 3>(3, 3).copy_from(&self.bias);
        full
    }
}

/// Attitude rows above bias rows.
fn stacked<const M: usize>(attitude: &SMatrix<f64, 3, M>, bias: &SMatrix<f64, 3, M>) -> SMatrix<f64, 6, M> {
    let mut both = SMatrix::<f64, 6, M>::zeros();
    both.fixed_view_mut::<3, M>(0, 0).copy_from(attitude);
    both.fixed_view_mut::<3, M>(3, 0).copy_from(bias);
    both
}

/// Inverse of a symmetric positive definite 2x2 matrix; NaN, which no gate accepts, if singular.
fn inverse_2x2(m: &Matrix2<f64>) -> Matrix2<f64> {
    let off = 0.5 * (m.m12 + m.m21);
    let scale = 1.0 / (m.m11 * m.m22 - off * off);
    Matrix2::new(m.m22 * scale, -off * scale, -off * scale, m.m11 * scale)
}

#[cfg(test)]
mod tests {
    use super::*;
    use whorl_math::quaternion_exp;

    fn full(p: &Covariance) -> Matrix6<f64> {
        p.in_body_axes(&Matrix3::identity())
    }

    fn example() -> Covariance {
        let seed = SMatrix::<f64, 6, 6>::from_fn(|i, j| ((i * 7 + j * 3) as f64).sin());
        let p = seed * seed.transpose() + Matrix6::identity() * 0.1;
        Covariance {
            attitude: p.fixed_view::<3, 3>(0, 0).into(),
            cross: p.fixed_view::<3, 3>(0, 3).into(),
            bias: p.fixed_view::<3, 3>(3, 3).into(),
        }
    }

    #[test]
    fn propagation_equals_the_dense_formula() {
        let mut p = example();
        let rotation = *quaternion_exp(&Vector3::new(0.3, -1.0, 0.4)).to_rotation_matrix().matrix();
        let (dt, noise, walk) = (0.2, 0.05, 0.03);
        let mut phi = Matrix6::identity();
        phi.fixed_view_mut::<3, 3>(0, 3).copy_from(&(rotation * -dt));
        let mut q = Matrix6::identity() * walk * dt;
        q.fixed_view_mut::<3, 3>(0, 0)
            .copy_from(&(Matrix3::identity() * (noise * dt + walk * dt.powi(3) / 3.0)));
        let cross = rotation * (-0.5 * walk * dt * dt);
        q.fixed_view_mut::<3, 3>(0, 3).copy_from(&cross);
        q.fixed_view_mut::<3, 3>(3, 0).copy_from(&cross.transpose());
        let expected = phi * full(&p) * phi.transpose() + q;
        p.propagate(&rotation, dt, noise, walk);
        assert!((full(&p) - expected).amax() < 1e-13);
    }

    #[test]
    fn update_equals_the_information_form() {
        let mut p = example();
        let h_attitude = Matrix3x2::new(1.0, 0.2, 0.0, 1.0, -0.3, 0.1);
        let h_bias = Matrix3x2::new(0.01, 0.0, 0.03, -0.02, 0.0, 0.05);
        let noise = Matrix2::new(0.02, 0.005, 0.005, 0.03);
        let mut h = SMatrix::<f64, 2, 6>::zeros();
        h.fixed_view_mut::<2, 3>(0, 0).copy_from(&h_attitude.transpose());
        h.fixed_view_mut::<2, 3>(0, 3).copy_from(&h_bias.transpose());
        let inverse = |m: Matrix6<f64>| m.try_inverse().expect("regular");
        let information = h.transpose() * noise.try_inverse().expect("regular") * h;
        let expected = inverse(inverse(full(&p)) + information);
        let innovation = Vector2::new(0.1, -0.2);
        let state = expected * h.transpose() * noise.try_inverse().expect("regular") * innovation;
        let measurement =
            Measurement { innovation, attitude: h_attitude, bias: Some(h_bias), noise, lag_variance: 0.0 };
        let correction = p.update(&measurement, f64::INFINITY).ok().expect("no gate");
        assert!((full(&p) - expected).amax() < 1e-12);
        assert!((correction.attitude_rad - state.fixed_rows::<3>(0)).norm() < 1e-12);
        assert!((correction.bias_rad_s - state.fixed_rows::<3>(3)).norm() < 1e-12);
    }

    #[test]
    fn a_late_measurement_is_one_of_an_earlier_state() {
        // The attitude error was measured, then grew by white noise of variance q: the late
        // update must give what update-then-growth gives.
        let growth = 0.3;
        let h = Matrix3x2::new(1.0, 0.2, 0.0, 1.0, -0.3, 0.1);
        let noise = Matrix2::new(0.02, 0.005, 0.005, 0.03);
        let innovation = Vector2::new(0.1, -0.2);
        let mut expected = example();
        let in_time = Measurement { innovation, attitude: h, bias: None, noise, lag_variance: 0.0 };
        let first = expected.update(&in_time, f64::INFINITY).ok().expect("no gate");
        expected.attitude += Matrix3::identity() * growth;

        let mut late = example();
        late.attitude += Matrix3::identity() * growth;
        let measurement = Measurement {
            innovation,
            attitude: h,
            bias: None,
            noise: noise + h.tr_mul(&h) * growth,
            lag_variance: growth,
        };
        let second = late.update(&measurement, f64::INFINITY).ok().expect("no gate");
        assert!((full(&late) - full(&expected)).amax() < 1e-12);
        assert!((second.attitude_rad - first.attitude_rad).norm() < 1e-12);
        assert!((second.bias_rad_s - first.bias_rad_s).norm() < 1e-12);
        assert!((second.nis - first.nis).abs() < 1e-12);
    }

    #[test]
    fn masked_scalar_update_equals_josephs_form() {
        let mut p = example();
        let before = full(&p);
        let measurement = ScalarMeasurement {
            innovation: 0.1,
            attitude: Vector3::new(-0.4, 0.1, 1.0),
            bias: Vector3::new(0.02, 0.0, 0.01),
            noise: 0.02,
            lag_variance: 0.0,
            corrects: Vector3::z(),
        };
        let h = SMatrix::<f64, 1, 6>::new(-0.4, 0.1, 1.0, 0.02, 0.0, 0.01);
        let variance = (h * before * h.transpose())[0] + 0.02;
        let mut gain = before * h.transpose() / variance;
        (gain[0], gain[1]) = (0.0, 0.0);
        let keep = Matrix6::identity() - gain * h;
        let expected = keep * before * keep.transpose() + gain * gain.transpose() * 0.02;
        let correction = p.update_scalar(&measurement, f64::INFINITY).ok().expect("no gate");
        assert!((full(&p) - expected).amax() < 1e-12);
        assert_eq!((correction.attitude_rad.x, correction.attitude_rad.y), (0.0, 0.0));
    }

    #[test]
    fn stays_positive_definite_with_extreme_measurements() {
        let mut p = Covariance::diagonal(Vector3::repeat(10.0), 1.0);
        let rotation = Matrix3::identity();
        for step in 0..20_000 {
            p.propagate(&rotation, 0.01, 1e-12, 1e-16);
            let mut attitude = Matrix3x2::zeros();
            (attitude[(step % 3, 0)], attitude[((step + 1) % 3, 1)]) = (1.0, 1.0);
            let measurement = Measurement {
                innovation: Vector2::zeros(),
                attitude,
                bias: None,
                noise: Matrix2::identity() * 1e-12,
                lag_variance: 0.0,
            };
            assert!(p.update(&measurement, 1.0).is_ok());
            let smallest = full(&p).symmetric_eigenvalues().min();
            assert!(smallest > 0.0, "step {step}: eigenvalue {smallest:e}");
        }
    }

    #[test]
    fn outliers_leave_the_covariance_alone() {
        let mut p = example();
        let before = p.clone();
        let measurement = Measurement {
            innovation: Vector2::new(100.0, 0.0),
            attitude: Matrix3x2::new(1.0, 0.0, 0.0, 1.0, 0.0, 0.0),
            bias: None,
            noise: Matrix2::identity(),
            lag_variance: 0.0,
        };
        assert!(p.update(&measurement, 30.0).is_err());
        assert_eq!(p, before);
    }
}
