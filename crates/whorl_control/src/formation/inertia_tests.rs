//! The whole closed loop with rigid bodies: leader-follower, shaper, tracking law and nonlinear rotation, for random
//! inertias that the controllers know inaccurately, random gains in their allowed ranges, momentum in the wheels,
//! disturbing torques and delays.

use std::collections::VecDeque;

use nalgebra::{Matrix3, UnitQuaternion, Vector3};
use proptest::prelude::*;
use whorl_dynamics::actuators::Actuators;
use whorl_math::{attitude_error, quaternion_exp};

use super::shaper_tests::{DT_S, dumbbell};
use super::*;
use crate::reference::Reference;
use crate::tracking::{IntegralAction, TrackingGains, TrackingInput, TrackingLaw};

/// Steps of the rotation within a control period, whose torque is held.
const SUBSTEPS: usize = 4;

struct Body {
    inertia_b_kg_m2: Matrix3<f64>,
    wheel_momentum_b_n_m_s: Vector3<f64>,
    disturbance_b_n_m: Vector3<f64>,
    q: UnitQuaternion<f64>,
    omega: Vector3<f64>,
    law: TrackingLaw,
    shaper: ReferenceShaper,
}

impl Body {
    fn step(&mut self) {
        self.shaper.advance(DT_S);
        let reference = self.shaper.reference();
        let torque = self.law.torque(&TrackingInput {
            q_world_body: &self.q,
            omega_wb_b_rad_s: &self.omega,
            reference: &reference,
            wheel_momentum_b_n_m_s: &self.wheel_momentum_b_n_m_s,
            modelled_torque_b_n_m: &Vector3::zeros(),
            dt_s: DT_S,
        });
        self.law.integrate(DT_S, true);
        let dt_s = DT_S / SUBSTEPS as f64;
        for _ in 0..SUBSTEPS {
            let momentum = self.inertia_b_kg_m2 * self.omega + self.wheel_momentum_b_n_m_s;
            let net = torque.torque_b_n_m + self.disturbance_b_n_m - self.omega.cross(&momentum);
            self.omega += self.inertia_b_kg_m2.try_inverse().unwrap() * net * dt_s;
            self.q *= quaternion_exp(&(self.omega * dt_s));
        }
    }

    fn member(&self) -> Member {
        Member {
            q_world_body: self.q,
            omega_wb_b_rad_s: self.omega,
            age_s: 0.0,
            usable: true,
            tracking: true,
            reference: self.shaper.reference(),
        }
    }
}

/// Any realisable inertia: three pairs of equal masses on orthogonal axes, turned.
fn inertias() -> impl Strategy<Value = Matrix3<f64>> {
    let pairs = prop::array::uniform3(0.3..15.0_f64);
    (pairs, prop::array::uniform3(-3.0..3.0_f64)).prop_map(|([a, b, c], turn)| {
        let turn = quaternion_exp(&Vector3::from(turn)).to_rotation_matrix();
        turn.matrix() * Matrix3::from_diagonal(&Vector3::new(b + c, a + c, a + b)) * turn.matrix().transpose()
    })
}

#[derive(Debug, Clone)]
struct Drawn {
    inertia: Matrix3<f64>,
    /// Known inertia over the true one, per entry of its Cholesky factor.
    known: [f64; 3],
    bandwidth: [f64; 3],
    damping: [f64; 3],
    /// Integral time over its bound.
    integral: Option<f64>,
    wheels: [f64; 3],
    disturbance: [f64; 3],
    start: [f64; 3],
}

fn bodies() -> impl Strategy<Value = Drawn> {
    (
        inertias(),
        prop::array::uniform3(0.9..1.1_f64),
        prop::array::uniform3(0.4..2.0_f64),
        prop::array::uniform3(0.6..1.5_f64),
        prop::option::of(3.0..10.0_f64),
        prop::array::uniform3(-1.0..1.0_f64),
        prop::array::uniform3(-0.01..0.01_f64),
        prop::array::uniform3(-0.4..0.4_f64),
    )
        .prop_map(|(inertia, known, bandwidth, damping, integral, wheels, disturbance, start)| Drawn {
            inertia,
            known,
            bandwidth,
            damping,
            integral,
            wheels,
            disturbance,
            start,
        })
}

fn body(drawn: &Drawn) -> Body {
    let (bandwidth_rad_s, damping) = (Vector3::from(drawn.bandwidth), Vector3::from(drawn.damping));
    let slowest = bandwidth_rad_s.component_mul(&damping).min();
    // Errors of up to a fifth along each axis of the factor, and the axes mixed with it.
    let factor = drawn.inertia.cholesky().unwrap().l();
    let scaled = factor * Matrix3::from_diagonal(&Vector3::from(drawn.known));
    let gains = TrackingGains {
        bandwidth_rad_s,
        damping,
        integral: drawn.integral.map(|over| IntegralAction {
            time_s: over / (2.0 * slowest),
            limit_n_m: Vector3::repeat(0.05),
            zone_rad: 0.05,
        }),
        rate_error_time_constant_s: 0.0,
    };
    let q = quaternion_exp(&Vector3::from(drawn.start));
    Body {
        inertia_b_kg_m2: drawn.inertia,
        wheel_momentum_b_n_m_s: Vector3::from(drawn.wheels),
        disturbance_b_n_m: Vector3::from(drawn.disturbance),
        law: TrackingLaw::new(scaled * scaled.transpose(), &Actuators::default(), gains).unwrap(),
        shaper: ReferenceShaper::new(dumbbell(), 2.0, &q).unwrap(),
        omega: Vector3::zeros(),
        q,
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(24))]

    #[test]
    fn bodies_of_any_inertia_that_is_known_within_a_fifth_stay_bounded_and_converge(
        drawn in prop::collection::vec(bodies(), 2..4),
        delay_steps in 0..15_usize,
        goal in prop::array::uniform3(-0.3..0.3_f64),
    ) {
        let mut bodies: Vec<Body> = drawn.iter().map(body).collect();
        let leaders = (0..bodies.len()).map(|i| i.checked_sub(1)).collect();
        let mut law = LeaderFollower::new(LeaderGraph::new(leaders).unwrap());
        let offsets = vec![Offset::constant(UnitQuaternion::identity()); bodies.len()];
        let goals =
            Goals { formation: Reference::at_rest(quaternion_exp(&Vector3::from(goal))), individual: vec![] };
        let mut past: VecDeque<Vec<Member>> = VecDeque::new();
        let mut demands = vec![];
        for step in 0..4000 {
            bodies.iter_mut().for_each(Body::step);
            past.push_front(bodies.iter().map(Body::member).collect());
            past.truncate(delay_steps + 1);
            let members = past.back().unwrap();
            let input = LawInput { dt_s: DT_S, members, goals: &goals, offsets: &offsets };
            if step == 0 {
                law.restart(&input);
            }
            law.demands(&input, &mut demands);
            for (body, demand) in bodies.iter_mut().zip(&demands) {
                body.shaper.plan(demand, DT_S);
                // References move with at most 0.06 rad/s; a body leads or lags them while it settles.
                prop_assert!(body.omega.norm() < 0.3, "{} rad/s", body.omega.norm());
                let error = attitude_error(&body.shaper.reference().q_world_reference, &body.q).norm();
                prop_assert!(error < 0.35, "{error} rad off its reference");
            }
        }
        // Each stands off its reference by what its feedback needs against the disturbance, without integral
        // action, and a follower by what its leader is off as well.
        let mut allowed_rad = 0.0;
        for (body, drawn) in bodies.iter().zip(&drawn) {
            let stiffness = drawn.bandwidth.iter().fold(f64::INFINITY, |w, b| w.min(b * b));
            let least = drawn.inertia.symmetric_eigenvalues().min();
            allowed_rad += 1e-3 + 1.3 * Vector3::from(drawn.disturbance).norm() / (stiffness * least);
            let error = attitude_error(&goals.formation.q_world_reference, &body.q).norm();
            prop_assert!(error < allowed_rad, "{error} rad, at most {allowed_rad}");
        }
    }
}
