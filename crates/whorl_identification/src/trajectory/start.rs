//! A first guess of the motion: gyro, slowly pulled to gravity and the vector sensor.

use nalgebra::{Unit, UnitQuaternion, Vector3};
use whorl_math::{integrate_rate, unit_or};
use whorl_trajectory::rough_attitude::{pull, start_attitude};

use super::dynamics::Motion;
use crate::data::{AveragedSample, Chain};

/// Points averaged for the first attitude.
const FIRST_POINTS: usize = 20;
/// Time constant of the pull to gravity and the vector \[s\].
const PULL_S: f64 = 4.0;

/// Motion at every point of a chain, good to a few degrees.
pub(crate) fn first_guess(chain: &Chain) -> Vec<Motion> {
    let mut q = first_attitude(&chain.points);
    let mut motions = Vec::with_capacity(chain.points.len());
    for (i, point) in chain.points.iter().enumerate() {
        motions.push(Motion { q_world_body: q, omega_wb_b_rad_s: point.gyro_b_rad_s });
        let Some(next) = chain.points.get(i + 1) else { break };
        let step_s = next.time_s - point.time_s;
        let mut total = Vector3::zeros();
        let gain = (step_s / PULL_S).min(1.0);
        if let Some((force, _)) = &point.specific_force_b_m_s2 {
            let seen = unit_or(*force, Vector3::z_axis());
            total += pull(&q, &seen, &Vector3::z()) * gain;
        }
        for d in &point.directions {
            total += pull(&q, &d.direction_b, &d.reference_world) * (10.0 * gain).min(0.5);
        }
        let rate = 0.5 * (point.gyro_b_rad_s + next.gyro_b_rad_s);
        q = integrate_rate(&q, &(rate + total / step_s), step_s);
    }
    motions
}

fn first_attitude(points: &[AveragedSample]) -> UnitQuaternion<f64> {
    let first = points.iter().take(FIRST_POINTS);
    let force: Vector3<f64> = first.clone().filter_map(|p| p.specific_force_b_m_s2).map(|(f, _)| f).sum();
    let vertical: Unit<Vector3<f64>> = unit_or(force, Vector3::z_axis());
    let direction = first.clone().flat_map(|p| &p.directions).next();
    start_attitude(vertical, direction.map(|d| (d.direction_b, d.reference_world)))
}
