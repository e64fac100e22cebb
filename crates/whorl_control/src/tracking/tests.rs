use super::*;
use nalgebra::{Unit, Vector3};
use whorl_dynamics::actuators::wheels::{Wheel, Wheels};
use whorl_math::{integrate_rate, quaternion_exp};

/// Table 4.1 of the dissertation.
fn total_b_kg_m2() -> Matrix3<f64> {
    Matrix3::new(6.2, -0.9, -0.2, -0.9, 7.5, 0.1, -0.2, 0.1, 12.1)
}

/// Three wheels of 0.05 kg m^2 about the body axes.
fn wheels() -> Actuators {
    let axes = [Vector3::x_axis(), Vector3::y_axis(), Vector3::z_axis()];
    Actuators { wheels: Wheels(axes.map(wheel).to_vec()), ..Actuators::default() }
}

fn resisting_b_kg_m2() -> Matrix3<f64> {
    total_b_kg_m2() - Matrix3::identity() * 0.05
}

fn wheel(spin_axis_b: Unit<Vector3<f64>>) -> Wheel {
    Wheel {
        name: String::new(),
        spin_axis_b,
        spin_inertia_kg_m2: 0.05,
        max_torque_n_m: 0.2,
        max_speed_rad_s: 300.0,
        viscous_friction_n_m_s: 0.0,
        coulomb_friction_n_m: 0.0,
    }
}

fn gains() -> TrackingGains {
    TrackingGains {
        bandwidth_rad_s: Vector3::new(0.8, 0.8, 0.6),
        damping: Vector3::repeat(0.9),
        integral: None,
        rate_error_time_constant_s: 0.0,
    }
}

/// A gyrostat whose wheels make the control torque: total momentum H in world axes, written here
/// independently of the law: H_dot = R g, with H_b = I omega + h_w and h_w_dot = -(tau) - I_s omega_dot
/// along the wheels. Integrated by RK4 over q, omega, h_w.
#[derive(Clone, Copy)]
struct Gyrostat {
    q: UnitQuaternion<f64>,
    omega: Vector3<f64>,
    wheels: Vector3<f64>,
}

impl Gyrostat {
    const WHEEL_KG_M2: f64 = 0.05;

    /// (omega_dot, h_w_dot) for torque `tau` made by the wheels and outer torque `outer`.
    fn derivative(&self, tau: &Vector3<f64>, outer: &Vector3<f64>) -> (Vector3<f64>, Vector3<f64>) {
        let total = total_b_kg_m2();
        let momentum = total * self.omega + self.wheels;
        let resisting = total - Matrix3::identity() * Self::WHEEL_KG_M2;
        let omega_dot = resisting.try_inverse().unwrap() * (tau + outer - self.omega.cross(&momentum));
        (omega_dot, -tau - omega_dot * Self::WHEEL_KG_M2)
    }

    fn step(&mut self, tau: &Vector3<f64>, outer: &Vector3<f64>, dt: f64) {
        let at = |k: (Vector3<f64>, Vector3<f64>), h: f64| Self {
            omega: self.omega + k.0 * h,
            wheels: self.wheels + k.1 * h,
            ..*self
        };
        let k1 = self.derivative(tau, outer);
        let k2 = at(k1, dt / 2.0).derivative(tau, outer);
        let k3 = at(k2, dt / 2.0).derivative(tau, outer);
        let k4 = at(k3, dt).derivative(tau, outer);
        let mean = |a, b, c, d| (a + (b + c) * 2.0 + d) * (dt / 6.0);
        let change: Vector3<f64> = mean(k1.0, k2.0, k3.0, k4.0);
        let middle = self.omega + change / 2.0;
        self.q = integrate_rate(&self.q, &middle, dt);
        self.omega += change;
        self.wheels += mean(k1.1, k2.1, k3.1, k4.1);
    }

    fn input<'a>(&'a self, reference: &'a Reference, modelled: &'a Vector3<f64>) -> TrackingInput<'a> {
        TrackingInput {
            q_world_body: &self.q,
            omega_wb_b_rad_s: &self.omega,
            reference,
            wheel_momentum_b_n_m_s: &self.wheels,
            modelled_torque_b_n_m: modelled,
            dt_s: DT_S,
        }
    }
}

const DT_S: f64 = 0.01;

fn at_rest() -> Gyrostat {
    Gyrostat { q: UnitQuaternion::identity(), omega: Vector3::zeros(), wheels: Vector3::new(2.0, -1.0, 3.0) }
}

#[test]
fn gyroscopic_feed_forward_matches_the_torque_of_a_steady_turn() {
    // A body of diagonal inertia that turns steadily about (1,1,0)/sqrt 2 needs
    // omega x I omega = (0, 0, (I_yy - I_xx)/2 w^2), plus omega x h_w for h_w = h e_z:
    // w h (1, -1, 0)/sqrt 2.
    let total_b_kg_m2 = Matrix3::from_diagonal(&Vector3::new(6.0, 8.0, 12.0));
    let mut law = TrackingLaw::new(total_b_kg_m2, &Actuators::default(), gains()).unwrap();
    let (rate, stored) = (0.3, 4.0);
    let omega = Vector3::new(1.0, 1.0, 0.0) * (rate / 2.0_f64.sqrt());
    let q = UnitQuaternion::from_euler_angles(0.3, 0.2, 0.1);
    let reference =
        Reference { q_world_reference: q, omega_wr_r_rad_s: omega, omega_dot_wr_r_rad_s2: Vector3::zeros() };
    let output = law.torque(&TrackingInput {
        q_world_body: &q,
        omega_wb_b_rad_s: &omega,
        reference: &reference,
        wheel_momentum_b_n_m_s: &(Vector3::z() * stored),
        modelled_torque_b_n_m: &Vector3::zeros(),
        dt_s: DT_S,
    });
    let side = rate * stored / 2.0_f64.sqrt();
    let expected = Vector3::new(side, -side, (8.0 - 6.0) / 2.0 * rate * rate);
    assert!((output.torque_b_n_m - expected).norm() < 1e-12, "{}", output.torque_b_n_m);
}

#[test]
fn a_large_error_settles_the_short_way_and_as_fast_as_its_bandwidth_says() {
    let mut law = TrackingLaw::new(total_b_kg_m2(), &wheels(), gains()).unwrap();
    let mut body = at_rest();
    body.q = quaternion_exp(&Vector3::new(1.0, -2.0, 1.5));
    let reference = Reference::at_rest(UnitQuaternion::identity());
    let start = body.q.angle();
    for _ in 0..2500 {
        let torque = law.torque(&body.input(&reference, &Vector3::zeros())).torque_b_n_m;
        body.step(&torque, &Vector3::zeros(), DT_S);
        assert!(body.q.angle() <= start + 1e-9, "never turns the long way round");
    }
    assert!(body.q.angle() < 1e-4, "{}", body.q.angle());
}

#[test]
fn a_small_error_decays_as_the_second_order_model() {
    let mut law = TrackingLaw::new(total_b_kg_m2(), &wheels(), gains()).unwrap();
    let mut body = at_rest();
    let initial = Vector3::new(2e-3, -1e-3, 3e-3);
    body.q = quaternion_exp(&initial);
    let reference = Reference::at_rest(UnitQuaternion::identity());
    for k in 1..=600 {
        let torque = law.torque(&body.input(&reference, &Vector3::zeros())).torque_b_n_m;
        body.step(&torque, &Vector3::zeros(), DT_S);
        let t = f64::from(k) * DT_S;
        for axis in 0..3 {
            let (w, z) = (gains().bandwidth_rad_s[axis], 0.9);
            let damped = w * (1.0_f64 - z * z).sqrt();
            let expected = initial[axis]
                * (-z * w * t).exp()
                * ((damped * t).cos() + z * w / damped * (damped * t).sin());
            let actual = attitude_error(&reference.q_world_reference, &body.q)[axis];
            assert!((actual - expected).abs() < 0.02 * initial.norm(), "axis {axis} at {t}");
        }
    }
}

#[test]
fn a_moving_reference_is_tracked_without_lag_thanks_to_the_feed_forward() {
    let worst_with = |feed_forward: f64| {
        let mut law = TrackingLaw::new(total_b_kg_m2(), &wheels(), gains()).unwrap();
        let mut reference = Reference {
            q_world_reference: UnitQuaternion::from_euler_angles(0.02, 0.05, 1.0),
            omega_wr_r_rad_s: Vector3::new(0.05, -0.03, 0.2),
            omega_dot_wr_r_rad_s2: Vector3::new(-0.005, 0.003, 0.002),
        };
        let mut body = at_rest();
        body.q = reference.q_world_reference;
        body.omega = reference.omega_wr_r_rad_s;
        let mut worst = 0.0_f64;
        for _ in 0..2000 {
            let given = Reference {
                omega_dot_wr_r_rad_s2: reference.omega_dot_wr_r_rad_s2 * feed_forward,
                ..reference
            };
            let output = law.torque(&body.input(&given, &Vector3::zeros()));
            worst = worst.max(output.attitude_error_b_rad.norm());
            body.step(&output.torque_b_n_m, &Vector3::zeros(), DT_S);
            reference = reference.extrapolated(DT_S);
        }
        worst
    };
    // The torque is held for a sample and so is late by half of one: some 0.3 N m/s * 5 ms / (J w^2).
    assert!(worst_with(1.0) < 2e-4);
    assert!(worst_with(0.0) > 5e-3, "the acceleration itself would cost a/w^2");
}

fn with_integral(limit_n_m: f64) -> TrackingGains {
    let integral = IntegralAction { time_s: 6.0, limit_n_m: Vector3::repeat(limit_n_m), zone_rad: 0.1 };
    TrackingGains { integral: Some(integral), ..gains() }
}

#[test]
fn integral_action_removes_the_offset_of_an_unknown_constant_torque() {
    let unknown = Vector3::new(0.01, -0.02, 0.015);
    let reference = Reference::at_rest(UnitQuaternion::identity());
    let run = |gains: TrackingGains| {
        let mut law = TrackingLaw::new(total_b_kg_m2(), &wheels(), gains).unwrap();
        let mut body = at_rest();
        for _ in 0..12_000 {
            let torque = law.torque(&body.input(&reference, &Vector3::zeros())).torque_b_n_m;
            body.step(&torque, &unknown, DT_S);
            law.integrate(DT_S, true);
        }
        body.q.angle().to_degrees()
    };
    // Without: error = torque / (J w^2), 0.2 deg or so.
    let offset = run(gains());
    let expected = resisting_b_kg_m2().try_inverse().unwrap() * unknown;
    let expected = expected.component_div(&gains().bandwidth_rad_s.component_mul(&gains().bandwidth_rad_s));
    assert!((offset - expected.norm().to_degrees()).abs() < 0.01, "{offset}");
    assert!(offset > 0.15);
    let residual = run(with_integral(0.1));
    assert!(residual < 1e-3, "{residual}");
}

#[test]
fn the_integral_is_frozen_by_saturation_and_large_errors_and_is_clamped() {
    let mut law = TrackingLaw::new(total_b_kg_m2(), &wheels(), with_integral(0.02)).unwrap();
    let reference = Reference::at_rest(UnitQuaternion::identity());
    let mut body = at_rest();
    body.q = quaternion_exp(&(Vector3::x() * 0.05));
    law.torque(&body.input(&reference, &Vector3::zeros()));
    law.integrate(1.0, false);
    assert_eq!(law.integral_b_n_m(), Vector3::zeros(), "saturated");
    for _ in 0..100 {
        law.integrate(1.0, true);
    }
    assert_eq!(law.integral_b_n_m().x, -0.02, "clamped, against the error");
    law.reset();
    body.q = quaternion_exp(&(Vector3::x() * 0.2));
    law.torque(&body.input(&reference, &Vector3::zeros()));
    law.integrate(1.0, true);
    assert_eq!(law.integral_b_n_m(), Vector3::zeros(), "outside the zone");
}

#[test]
fn a_modelled_torque_is_cancelled_at_once() {
    let known = Vector3::new(0.05, 0.1, -0.02);
    let mut law = TrackingLaw::new(total_b_kg_m2(), &wheels(), gains()).unwrap();
    let reference = Reference::at_rest(UnitQuaternion::identity());
    let mut body = at_rest();
    for _ in 0..1000 {
        let torque = law.torque(&body.input(&reference, &known)).torque_b_n_m;
        body.step(&torque, &known, DT_S);
    }
    assert!(body.q.angle() < 1e-9);
}

#[test]
fn noise_at_half_a_turn_does_not_make_the_law_chatter() {
    let mut law = TrackingLaw::new(total_b_kg_m2(), &wheels(), gains()).unwrap();
    let reference = Reference::at_rest(UnitQuaternion::identity());
    let mut signs = Vec::new();
    for k in 0..20 {
        let mut body = at_rest();
        body.wheels = Vector3::zeros();
        let noise = if k % 2 == 0 { 0.02 } else { -0.02 };
        body.q = quaternion_exp(&(Vector3::z() * (std::f64::consts::PI + noise)));
        signs.push(law.torque(&body.input(&reference, &Vector3::zeros())).torque_b_n_m.z.signum());
    }
    assert!(signs.windows(2).all(|pair| pair[0] == pair[1]), "{signs:?}");
}

#[test]
fn the_low_pass_passes_steady_rates_and_stops_noise() {
    let mut law = TrackingLaw::new(
        total_b_kg_m2(),
        &wheels(),
        TrackingGains { rate_error_time_constant_s: 0.2, ..gains() },
    )
    .unwrap();
    let reference = Reference::at_rest(UnitQuaternion::identity());
    let mut body = Gyrostat { wheels: Vector3::zeros(), ..at_rest() };
    let mut torque_at = |omega_z: f64| {
        body.omega = Vector3::z() * omega_z;
        law.torque(&body.input(&reference, &Vector3::zeros())).torque_b_n_m.z
    };
    let steady = (0..200).map(|_| torque_at(0.1)).last().unwrap();
    let unfiltered = -2.0 * 0.9 * 0.6 * 0.1 * resisting_b_kg_m2()[(2, 2)];
    assert!((steady - unfiltered).abs() < 1e-4);
    let swing: Vec<f64> = (0..200).map(|k| torque_at(if k % 2 == 0 { 0.1 } else { -0.1 })).collect();
    assert!(swing[150..].iter().all(|t| t.abs() < 0.03 * unfiltered.abs()));
}

#[test]
fn gains_that_cannot_work_are_refused() {
    let refused = |gains: TrackingGains| TrackingLaw::new(total_b_kg_m2(), &wheels(), gains).unwrap_err();
    assert!(matches!(
        refused(TrackingGains { bandwidth_rad_s: Vector3::new(1.0, 0.0, 1.0), ..gains() }),
        TrackingError::Gain { field: "bandwidth_rad_s", .. }
    ));
    let mut fast = with_integral(0.1);
    fast.integral.as_mut().unwrap().time_s = 0.9;
    // 1/(2 * 0.9 * 0.6) = 0.926 s on the z axis.
    assert!(matches!(refused(fast), TrackingError::IntegralTime { .. }));
    let light_body = Matrix3::identity() * 0.02;
    assert_eq!(TrackingLaw::new(light_body, &wheels(), gains()).unwrap_err(), TrackingError::Inertia);
}
