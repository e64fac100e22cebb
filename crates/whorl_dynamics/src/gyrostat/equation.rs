//! The equation of motion of a gyrostat, its linearisation, and the matrix that its mass parameters multiply.
//!
//! Total angular momentum about the centre of rotation and its balance in body axes (eqs. 4.9-4.14, see the page of
//! [`crate::gyrostat`]), k_b the vertical:
//!
//! ```text
//! h = I w + h_w         dh/dt = g - w x h         g = -(m g r_cg) x k_b + all other torque from outside
//! R dw/dt = g - w x h - u
//! ```
//!
//! R, the inertia that resists, and u depend on what is known of the wheels:
//!
//! | known | R | u |
//! |---|---|---|
//! | torque on each wheel about its axis | I - A J A^T, J of the wheels that turn freely | A times these torques |
//! | their speeds | I | d(h_w)/dt |
//!
//! Where the rig leaves fewer axes ([`Freedom`]), R^-1 becomes the mobility M: an ideal hinge adds a torque c with
//! a^T c = 0 and leaves dw/dt = a alpha, so a^T R a alpha = a^T (g - w x h - u) and M = a a^T / (a^T R a); of a clamped
//! body M = 0.
//!
//! This is the only implementation of the equation: the plant, the filters, the feed-forward, the identification and
//! the diagnosis call it. What their model has of further effects comes with g, u and R: see [`crate::Gyrostat`].

use nalgebra::{Matrix3, SMatrix, Vector3};
use whorl_math::skew;

use crate::actuators::Actuators;
use crate::platform::freedom::Freedom;

/// Torque of the gravity offset, -(m g r_cg) x k (eq. 4.74) [N m]: offset and upward vertical in the same axes.
#[must_use]
pub fn gravity_torque_n_m(offset_n_m: &Vector3<f64>, vertical: &Vector3<f64>) -> Vector3<f64> {
    -offset_n_m.cross(vertical)
}

/// dh/dt = g - w x h in body axes [N m]: rate [rad/s] and total momentum [N m s] of the body, torque from outside.
#[must_use]
pub fn momentum_rate_b_n_m(
    omega_wb_b_rad_s: &Vector3<f64>,
    momentum_b_n_m_s: &Vector3<f64>,
    torque_b_n_m: &Vector3<f64>,
) -> Vector3<f64> {
    torque_b_n_m - omega_wb_b_rad_s.cross(momentum_b_n_m_s)
}

/// The equation of motion for given inertias.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct RateEquation {
    freedom: Freedom,
    inertia_b_kg_m2: Matrix3<f64>,
    inverse_inertia: Matrix3<f64>,
    resisting_b_kg_m2: Matrix3<f64>,
    inverse_resisting: Matrix3<f64>,
}

/// Derivatives of the angular acceleration, body axes.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct LinearisedRate {
    /// By the rate [1/s].
    pub by_rate: Matrix3<f64>,
    /// By the vertical in body axes [rad/s^2].
    pub by_vertical: Matrix3<f64>,
    /// By a small rotation of the body about its own axes, R_true = R exp(a) [1/s^2].
    pub by_attitude: Matrix3<f64>,
    /// By the momentum of the wheels relative to the body [1/(kg m^2 s)].
    pub by_wheel_momentum: Matrix3<f64>,
    /// By a torque on the body [1/(kg m^2)].
    pub by_torque: Matrix3<f64>,
}

impl RateEquation {
    /// With the inertia of platform and locked wheels, and the inertia that resists, both about the centre of rotation
    /// in body axes [kg m^2], of a body on a bearing. `None` unless both are positive definite.
    #[must_use]
    pub fn new(inertia_b_kg_m2: Matrix3<f64>, resisting_b_kg_m2: Matrix3<f64>) -> Option<Self> {
        Self::with_freedom(Freedom::OnBearing, inertia_b_kg_m2, resisting_b_kg_m2)
    }

    /// As [`Self::new`], of a body that its rig leaves this freedom.
    #[must_use]
    pub fn with_freedom(
        freedom: Freedom,
        inertia_b_kg_m2: Matrix3<f64>,
        resisting_b_kg_m2: Matrix3<f64>,
    ) -> Option<Self> {
        inertia_b_kg_m2.cholesky()?;
        resisting_b_kg_m2.cholesky()?;
        Some(Self {
            inverse_inertia: freedom.mobility(&inertia_b_kg_m2)?,
            inverse_resisting: freedom.mobility(&resisting_b_kg_m2)?,
            freedom,
            inertia_b_kg_m2,
            resisting_b_kg_m2,
        })
    }

    /// The motion that the rig leaves the body.
    #[must_use]
    pub fn freedom(&self) -> &Freedom {
        &self.freedom
    }

    /// For moving parts with known torques, of whatever kind (wheels, gimbals): all of them turn freely.
    #[must_use]
    pub fn with_free_parts(inertia_b_kg_m2: Matrix3<f64>, actuators: &Actuators) -> Option<Self> {
        let mut left = inertia_b_kg_m2;
        actuators.take_out(None, &mut left);
        Self::new(inertia_b_kg_m2, left)
    }

    /// For a rigid body, or wheels with known speeds.
    #[must_use]
    pub fn with_known_wheel_speeds(inertia_b_kg_m2: Matrix3<f64>) -> Option<Self> {
        Self::new(inertia_b_kg_m2, inertia_b_kg_m2)
    }

    /// Platform and locked wheels [kg m^2].
    #[must_use]
    pub fn inertia_b_kg_m2(&self) -> &Matrix3<f64> {
        &self.inertia_b_kg_m2
    }

    /// What resists angular acceleration [kg m^2].
    #[must_use]
    pub fn resisting_b_kg_m2(&self) -> &Matrix3<f64> {
        &self.resisting_b_kg_m2
    }

    /// Angular acceleration for each torque: its inverse, on the axes that are free [1/(kg m^2)].
    #[must_use]
    pub fn inverse_resisting(&self) -> &Matrix3<f64> {
        &self.inverse_resisting
    }

    /// Total momentum h = I w + h_w, body axes [N m s].
    #[must_use]
    pub fn momentum_b_n_m_s(
        &self,
        omega_wb_b_rad_s: &Vector3<f64>,
        wheel_momentum_b_n_m_s: &Vector3<f64>,
    ) -> Vector3<f64> {
        self.inertia_b_kg_m2 * omega_wb_b_rad_s + wheel_momentum_b_n_m_s
    }

    /// The rate of a body with this total momentum, w = I^-1 (h - h_w) on the axes that are free [rad/s].
    #[must_use]
    pub fn rate_b_rad_s(
        &self,
        momentum_b_n_m_s: &Vector3<f64>,
        wheel_momentum_b_n_m_s: &Vector3<f64>,
    ) -> Vector3<f64> {
        self.inverse_inertia * (momentum_b_n_m_s - wheel_momentum_b_n_m_s)
    }

    /// Derivative of [`Self::rate_b_rad_s`] by the momentum, I^-1 [1/(kg m^2)].
    #[must_use]
    pub fn rate_by_momentum(&self) -> &Matrix3<f64> {
        &self.inverse_inertia
    }

    /// As [`gravity_torque_n_m`], and zero where weight has no moment [N m].
    #[must_use]
    #[inline]
    pub fn gravity_torque_n_m(&self, offset_n_m: &Vector3<f64>, vertical: &Vector3<f64>) -> Vector3<f64> {
        if self.freedom.has_weight() { gravity_torque_n_m(offset_n_m, vertical) } else { Vector3::zeros() }
    }

    /// Angular acceleration [rad/s^2]: g from outside and u on the wheels as in the table of this page, body axes [N m].
    #[must_use]
    #[inline]
    pub fn acceleration_b_rad_s2(
        &self,
        omega_wb_b_rad_s: &Vector3<f64>,
        momentum_b_n_m_s: &Vector3<f64>,
        torque_b_n_m: &Vector3<f64>,
        on_wheels_b_n_m: &Vector3<f64>,
    ) -> Vector3<f64> {
        self.inverse_resisting
            * (momentum_rate_b_n_m(omega_wb_b_rad_s, momentum_b_n_m_s, torque_b_n_m) - on_wheels_b_n_m)
    }

    /// What torque g - u gives this angular acceleration: the inverse dynamics, without what the constraint bears [N m].
    #[must_use]
    pub fn required_torque_b_n_m(
        &self,
        omega_wb_b_rad_s: &Vector3<f64>,
        momentum_b_n_m_s: &Vector3<f64>,
        omega_dot_wb_b_rad_s2: &Vector3<f64>,
    ) -> Vector3<f64> {
        let inertial = self.resisting_b_kg_m2 * omega_dot_wb_b_rad_s2;
        let free = inertial - momentum_rate_b_n_m(omega_wb_b_rad_s, momentum_b_n_m_s, &Vector3::zeros());
        self.freedom.share(&free)
    }

    /// Change of the rate by an impulse on the body [N m s].
    #[must_use]
    pub fn rate_change_b_rad_s(&self, impulse_b_n_m_s: &Vector3<f64>) -> Vector3<f64> {
        self.inverse_resisting * impulse_b_n_m_s
    }

    /// Derivatives about a state, gravity being the torque that depends on it: its offset [N m] and the vertical are
    /// those of the state.
    #[must_use]
    pub fn linearised(
        &self,
        omega_wb_b_rad_s: &Vector3<f64>,
        momentum_b_n_m_s: &Vector3<f64>,
        gravity_offset_b_n_m: &Vector3<f64>,
        vertical_b: &Vector3<f64>,
    ) -> LinearisedRate {
        let inverse = &self.inverse_resisting;
        let omega = skew(omega_wb_b_rad_s);
        let weight = if self.freedom.has_weight() { skew(gravity_offset_b_n_m) } else { Matrix3::zeros() };
        let by_vertical = inverse * -weight;
        LinearisedRate {
            by_rate: inverse * (skew(momentum_b_n_m_s) - omega * self.inertia_b_kg_m2),
            // exp(-a) k = k + k x a.
            by_attitude: by_vertical * skew(vertical_b),
            by_vertical,
            by_wheel_momentum: inverse * -omega,
            by_torque: *inverse,
        }
    }
}

/// The matrix that turns the six inertia elements (xx, xy, xz, yy, yz, zz, matrix elements with their sign) into I v:
/// `[v] {I} = I v` (eq. 4.75).
#[must_use]
pub fn inertia_regressor(v: &Vector3<f64>) -> SMatrix<f64, 3, 6> {
    SMatrix::<f64, 3, 6>::from_row_slice(&[
        v.x, v.y, v.z, 0.0, 0.0, 0.0, //
        0.0, v.x, 0.0, v.y, v.z, 0.0, //
        0.0, 0.0, v.x, 0.0, v.y, v.z,
    ])
}

/// w x I w + (m g r_cg) x k_b as a matrix times the six inertia elements and the gravity offset: [w^2] and [q^2] of
/// eq. 4.75. The equation of motion is linear in these nine parameters,
///
/// ```text
/// ([dw/dt, 0] + this) p = g_other - u - w x h_w
/// ```
#[must_use]
pub fn mass_regressor(omega_wb_b_rad_s: &Vector3<f64>, vertical_b: &Vector3<f64>) -> SMatrix<f64, 3, 9> {
    let mut row = SMatrix::<f64, 3, 9>::zeros();
    let gyroscopic = skew(omega_wb_b_rad_s) * inertia_regressor(omega_wb_b_rad_s);
    row.fixed_view_mut::<3, 6>(0, 0).copy_from(&gyroscopic);
    row.fixed_view_mut::<3, 3>(0, 6).copy_from(&-skew(vertical_b));
    row
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::{SVector, Unit, UnitQuaternion};

    const STEP: f64 = 1e-6;

    fn inertia() -> Matrix3<f64> {
        Matrix3::new(6.2, -0.9, -0.2, -0.9, 7.5, 0.1, -0.2, 0.1, 12.1)
    }

    fn equation() -> RateEquation {
        equation_with(Freedom::OnBearing)
    }

    fn equation_with(freedom: Freedom) -> RateEquation {
        let wheel = Matrix3::from_diagonal(&Vector3::new(0.02, 0.05, 0.3));
        RateEquation::with_freedom(freedom, inertia(), inertia() - wheel).expect("positive definite")
    }

    fn oblique() -> Unit<Vector3<f64>> {
        Unit::new_normalize(Vector3::new(0.3, -0.5, 0.8))
    }

    struct Example {
        omega: Vector3<f64>,
        wheels: Vector3<f64>,
        offset: Vector3<f64>,
        q_world_body: UnitQuaternion<f64>,
        torque: Vector3<f64>,
    }

    fn example() -> Example {
        Example {
            omega: Vector3::new(0.1, -0.4, 0.6),
            wheels: Vector3::new(0.3, -1.0, 2.0),
            offset: Vector3::new(-0.4, 0.7, -2.0),
            q_world_body: UnitQuaternion::from_euler_angles(0.2, -0.3, 1.0),
            torque: Vector3::new(0.05, -0.02, 0.01),
        }
    }

    fn acceleration(equation: &RateEquation, at: &Example) -> Vector3<f64> {
        let vertical = at.q_world_body.inverse() * Vector3::z();
        let momentum = equation.momentum_b_n_m_s(&at.omega, &at.wheels);
        let torque = at.torque + equation.gravity_torque_n_m(&at.offset, &vertical);
        equation.acceleration_b_rad_s2(&at.omega, &momentum, &torque, &Vector3::zeros())
    }

    /// Every derivative against central differences of the nonlinear equation, whatever the rig.
    #[test]
    fn linearisation_is_the_derivative() {
        for freedom in
            [Freedom::OnBearing, Freedom::Free, Freedom::Hinge { axis_b: oblique() }, Freedom::Clamped]
        {
            compare_with_differences(&equation_with(freedom));
        }
    }

    fn compare_with_differences(equation: &RateEquation) {
        let freedom = *equation.freedom();
        let at = example();
        let vertical = at.q_world_body.inverse() * Vector3::z();
        let momentum = equation.momentum_b_n_m_s(&at.omega, &at.wheels);
        let linear = equation.linearised(&at.omega, &momentum, &at.offset, &vertical);
        let numeric = |moved: &dyn Fn(&mut Example, Vector3<f64>)| {
            Matrix3::from_columns(&[0, 1, 2].map(|axis| {
                let [mut plus, mut minus] = [example(), example()];
                moved(&mut plus, Vector3::ith(axis, STEP));
                moved(&mut minus, Vector3::ith(axis, -STEP));
                (acceleration(equation, &plus) - acceleration(equation, &minus)) / (2.0 * STEP)
            }))
        };
        let attitude = |e: &mut Example, a| e.q_world_body *= UnitQuaternion::from_scaled_axis(a);
        for (what, expected, analytic) in [
            ("rate", numeric(&|e, d| e.omega += d), linear.by_rate),
            ("attitude", numeric(&attitude), linear.by_attitude),
            ("wheel momentum", numeric(&|e, d| e.wheels += d), linear.by_wheel_momentum),
            ("torque", numeric(&|e, d| e.torque += d), linear.by_torque),
        ] {
            assert!((expected - analytic).amax() < 1e-8, "{freedom:?}, {what}: {expected} {analytic}");
            let acts = freedom.turns() && (freedom.has_weight() || what != "attitude");
            assert_eq!(expected.amax() > 1e-3, acts, "{freedom:?}: {what} acts");
        }
        let tilted = |d: Vector3<f64>| {
            let torque = at.torque + equation.gravity_torque_n_m(&at.offset, &(vertical + d));
            equation.acceleration_b_rad_s2(&at.omega, &momentum, &torque, &Vector3::zeros())
        };
        for axis in 0..3 {
            let d = Vector3::ith(axis, STEP);
            let expected = (tilted(d) - tilted(-d)) / (2.0 * STEP);
            assert!((expected - linear.by_vertical.column(axis)).norm() < 1e-8, "vertical, axis {axis}");
        }
    }

    /// Newton's law with the shaft's torque written out: R dw/dt = g - w x h - u + c, a^T c = 0 and dw/dt along a. Five
    /// equations for five unknowns, solved as they stand.
    #[test]
    fn a_hinge_bears_all_torque_across_its_axis() {
        let (at, axis_b) = (example(), oblique());
        let equation = equation_with(Freedom::Hinge { axis_b });
        let momentum = equation.momentum_b_n_m_s(&at.omega, &at.wheels);
        let on_wheels = Vector3::new(0.02, 0.1, -0.3);
        let found = equation.acceleration_b_rad_s2(&at.omega, &momentum, &at.torque, &on_wheels);
        let across = [Vector3::x(), Vector3::y()].map(|v| Unit::new_normalize(v.cross(&axis_b)).into_inner());
        // Unknowns: dw/dt along a, c along the two directions across it.
        let columns = [equation.resisting_b_kg_m2() * axis_b.into_inner(), -across[0], -across[1]];
        let right = momentum_rate_b_n_m(&at.omega, &momentum, &at.torque) - on_wheels;
        let solution = Matrix3::from_columns(&columns).lu().solve(&right).expect("regular");
        assert!((found - axis_b.into_inner() * solution.x).norm() < 1e-14);
        assert!(solution.yz().norm() > 0.01, "the shaft bears something");
        let required = equation.required_torque_b_n_m(&at.omega, &momentum, &found);
        assert!((required - axis_b.into_inner() * axis_b.dot(&(at.torque - on_wheels))).norm() < 1e-14);
    }

    /// Torque-free axisymmetric body: dw1/dt = (It - Ia)/It w3 w2, dw2/dt = -(It - Ia)/It w3 w1, dw3/dt = 0.
    #[test]
    fn a_free_axisymmetric_body_precesses() {
        let (transverse, axial) = (6.0, 10.0);
        let inertia = Matrix3::from_diagonal(&Vector3::new(transverse, transverse, axial));
        let equation = RateEquation::with_known_wheel_speeds(inertia).expect("positive definite");
        let omega = Vector3::new(0.2, -0.3, 0.5);
        let momentum = equation.momentum_b_n_m_s(&omega, &Vector3::zeros());
        let zero = Vector3::zeros();
        let acceleration = equation.acceleration_b_rad_s2(&omega, &momentum, &zero, &zero);
        let rate = (transverse - axial) / transverse * omega.z;
        assert!((acceleration - Vector3::new(rate * omega.y, -rate * omega.x, 0.0)).norm() < 1e-15);
    }

    /// With nothing from outside, the momentum keeps its length and a rigid body its energy.
    #[test]
    fn a_free_body_keeps_momentum_and_energy() {
        let equation = RateEquation::with_known_wheel_speeds(inertia()).expect("positive definite");
        let omega = Vector3::new(0.3, 0.5, -0.2);
        let momentum = equation.momentum_b_n_m_s(&omega, &Vector3::zeros());
        let zero = Vector3::zeros();
        let acceleration = equation.acceleration_b_rad_s2(&omega, &momentum, &zero, &zero);
        assert!(acceleration.norm() > 0.01);
        assert!(omega.dot(&(inertia() * acceleration)).abs() < 1e-14);
        assert!(momentum.dot(&(inertia() * acceleration)).abs() < 1e-13);
    }

    /// A body at rest under a torque about a principal axis, with a free wheel of spin inertia J along it:
    /// (I - J) dw/dt = g - u.
    #[test]
    fn a_free_wheel_does_not_resist() {
        let mut actuators = crate::PlatformModel::whorl_1_reference().actuators;
        let wheel = &mut actuators.wheels.0[2];
        wheel.spin_axis_b = Vector3::z_axis();
        wheel.spin_inertia_kg_m2 = 0.3;
        actuators.wheels.0.drain(..2);
        let inertia = Matrix3::from_diagonal(&Vector3::new(6.0, 7.0, 12.0));
        let equation = RateEquation::with_free_parts(inertia, &actuators).expect("positive definite");
        let (zero, torque, on_wheel) = (Vector3::zeros(), Vector3::z() * 0.5, Vector3::z() * 0.2);
        let acceleration = equation.acceleration_b_rad_s2(&zero, &zero, &torque, &on_wheel);
        assert!((acceleration - Vector3::z() * (0.3 / 11.7)).norm() < 1e-16);
        assert_eq!(RateEquation::with_free_parts(Matrix3::identity() * 0.2, &actuators), None);
    }

    #[test]
    fn inverse_dynamics_and_rate_undo_acceleration_and_momentum() {
        let (at, equation) = (example(), equation());
        let momentum = equation.momentum_b_n_m_s(&at.omega, &at.wheels);
        assert!((equation.rate_b_rad_s(&momentum, &at.wheels) - at.omega).norm() < 1e-15);
        let acceleration =
            equation.acceleration_b_rad_s2(&at.omega, &momentum, &at.torque, &Vector3::zeros());
        let torque = equation.required_torque_b_n_m(&at.omega, &momentum, &acceleration);
        assert!((torque - at.torque).norm() < 1e-14);
    }

    /// The regressor times the parameters is the equation with everything on one side.
    #[test]
    fn the_equation_is_linear_in_the_mass_parameters() {
        let at = example();
        let vertical = at.q_world_body.inverse() * Vector3::z();
        let i = inertia();
        let o = at.offset;
        let parameters = SVector::<f64, 9>::from([i.m11, i.m12, i.m13, i.m22, i.m23, i.m33, o.x, o.y, o.z]);
        let by_hand = at.omega.cross(&(i * at.omega)) + o.cross(&vertical);
        assert!((mass_regressor(&at.omega, &vertical) * parameters - by_hand).norm() < 1e-14);
        let product = inertia_regressor(&at.omega) * parameters.fixed_rows::<6>(0);
        assert!((product - i * at.omega).norm() < 1e-15);
    }
}
