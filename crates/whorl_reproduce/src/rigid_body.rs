//! A rigid body under known torques, for the studies of section 4.6.4.

use nalgebra::{UnitQuaternion, Vector3};
use whorl_dynamics::MassProperties;
use whorl_dynamics::gyrostat::RateEquation;
use whorl_dynamics::gyrostat::equation::gravity_torque_n_m;
use whorl_math::{quaternion_rate, vertical_b};

use crate::regression::{StateSample, StateSeries};

/// Moves a rigid body (eqs. 4.8 and 4.74) from an attitude and rate, under a torque in body axes that is
/// held over each sample, and returns the exact motion at the samples. Each sample is integrated by
/// `substeps` classical Runge-Kutta steps.
#[must_use]
pub fn simulate_rigid_body(
    mass: &MassProperties,
    start: (UnitQuaternion<f64>, Vector3<f64>),
    torque_b_n_m: &dyn Fn(f64) -> Vector3<f64>,
    step_s: f64,
    samples: usize,
    substeps: usize,
) -> StateSeries {
    // Mass properties are positive definite.
    let Some(equation) = RateEquation::with_known_wheel_speeds(*mass.inertia_b_kg_m2()) else {
        return StateSeries::default();
    };
    let (mut q, mut omega) = start;
    let h_s = step_s / substeps.max(1) as f64;
    let mut series = StateSeries::default();
    for k in 0..samples {
        let time_s = k as f64 * step_s;
        let torque = torque_b_n_m(time_s + 0.5 * step_s);
        series.samples.push(StateSample {
            time_s,
            q_world_body: q,
            omega_wb_b_rad_s: omega,
            wheel_speed_rad_s: Vec::new(),
            external_torque_b_n_m: torque,
        });
        let derivative = |q: &UnitQuaternion<f64>, w: &Vector3<f64>| {
            let total = torque + gravity_torque_n_m(mass.gravity_offset_b_n_m(), &vertical_b(q));
            let momentum = equation.momentum_b_n_m_s(w, &Vector3::zeros());
            (quaternion_rate(q, w), equation.acceleration_b_rad_s2(w, &momentum, &total, &Vector3::zeros()))
        };
        for _ in 0..substeps.max(1) {
            let at = |dq: &nalgebra::Quaternion<f64>, h: f64| {
                UnitQuaternion::new_unchecked(q.into_inner() + dq * h)
            };
            let (q1, w1) = derivative(&q, &omega);
            let (q2, w2) = derivative(&at(&q1, 0.5 * h_s), &(omega + w1 * (0.5 * h_s)));
            let (q3, w3) = derivative(&at(&q2, 0.5 * h_s), &(omega + w2 * (0.5 * h_s)));
            let (q4, w4) = derivative(&at(&q3, h_s), &(omega + w3 * h_s));
            let dq = (q1 + (q2 + q3) * 2.0 + q4) * (h_s / 6.0);
            q = UnitQuaternion::new_normalize(q.into_inner() + dq);
            omega += (w1 + (w2 + w3) * 2.0 + w4) * (h_s / 6.0);
        }
    }
    series
}
