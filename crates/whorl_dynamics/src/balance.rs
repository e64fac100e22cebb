//! Which actuator to move, and by how much, to balance a platform.

use nalgebra::{Unit, Vector3};

/// Rounds of moving one ballast after the other; far more than ballasts along different axes need.
const ROUNDS: usize = 10_000;

/// Something that moves a known weight along a line: a linear actuator, a battery in its slots.
#[derive(Debug, Clone, PartialEq)]
pub struct Ballast {
    /// For people.
    pub name: String,
    /// Direction of travel, body axes.
    pub axis_b: Unit<Vector3<f64>>,
    /// Weight that moves \[N\], > 0.
    pub weight_n: f64,
    /// How far it can be moved from where it is, both ways \[m\].
    pub travel_m: f64,
}

/// The moves \[m\] that bring an offset (m g r, body axes [N m]) as near to a target as travel allows, and the offset after them: least
/// squares within bounds, by moving one ballast after the other.
pub fn plan_balance(
    offset_b_n_m: &Vector3<f64>,
    target_b_n_m: &Vector3<f64>,
    ballasts: &[Ballast],
) -> (Vec<f64>, Vector3<f64>) {
    let mut moves_m = vec![0.0; ballasts.len()];
    let mut after = *offset_b_n_m;
    for _ in 0..ROUNDS {
        for (moved, ballast) in moves_m.iter_mut().zip(ballasts) {
            let to = *moved + ballast.axis_b.dot(&(target_b_n_m - after)) / ballast.weight_n;
            let to = to.clamp(-ballast.travel_m, ballast.travel_m);
            after += ballast.axis_b.into_inner() * ballast.weight_n * (to - *moved);
            *moved = to;
        }
    }
    (moves_m, after)
}

#[cfg(test)]
mod tests;
