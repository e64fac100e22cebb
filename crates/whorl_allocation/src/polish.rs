//! From the interior point to the exact optimum.
//!
//! An interior point ends about 1e-8 inside its bounds, and a reward M for torque makes it stop
//! short where torque is dearer than M. Two things mend both. First, the share alpha that can be
//! met is known exactly ([`crate::zonotope`]), so the torque to be met is a constant t*. When it is
//! on a facet with normal n, every effector off the facet stands at the bound that n'a_k points to.
//!
//! Second, the cost is separable, so for a given price of torque y every other effector stands at
//! v_k(y) = (a_k'y - c_k) / H_k, clipped to 0..=1, and y minimises the convex dual function with
//! gradient sum a_k v_k(y) + o - t*. That is three unknowns: Newton's method with the generalised
//! Hessian S = sum a_k a_k' / H_k over the unclipped, and an exact line search over the breakpoints,
//! ends in finitely many steps (Qi and Sun, Math. Programming 58, 1993; Hager and Zhang, SIAM J. Optim.
//! 26, 2016), in one or two from the interior point's price. All conditions of optimality but the
//! torque equation hold by construction, so a small gradient is a certificate.

use nalgebra::{Matrix3, Vector3};

use crate::problem::Problem;
use crate::quadratic_program::InteriorPoint;

const ITERATIONS: usize = 60;
/// Gradient, in units of full torque, at which to stop.
const TARGET_ERROR: f64 = 1e-12;
/// Gradient that rounding may leave where torque is very dear; the last step removes it.
const ACCEPTED_ERROR: f64 = 1e-7;
/// Miss of the torque equation after that step.
const TORQUE_TOLERANCE: f64 = 1e-10;
/// Height over a facet, relative to a generator's length, that counts as none.
const ON_FACET: f64 = 1e-12;

/// An effector that is not held: index, column, linear cost and curvature.
struct Movable {
    index: usize,
    column: Vector3<f64>,
    linear: f64,
    softness: f64,
}

impl Movable {
    /// v before clipping.
    fn wish(&self, price: &Vector3<f64>) -> f64 {
        self.column.dot(price) - self.linear
    }
}

/// Moves `point` to the exact optimum for torque `torque`, which lies on the facet with normal
/// `facet_normal` if there is one. True on success; otherwise `point.v` is as it was.
pub(crate) fn to_vertex(
    problem: &Problem,
    torque: Vector3<f64>,
    facet_normal: Option<Vector3<f64>>,
    point: &mut InteriorPoint,
) -> bool {
    let mut v = vec![0.0; problem.len()];
    let mut goal = torque - problem.offset;
    let mut movable = Vec::with_capacity(problem.len());
    // Costs are divided by the smallest curvature, so that S is of order one.
    let unit = problem.curvature_unit;
    for (k, a) in problem.columns.iter().enumerate().filter(|&(k, _)| problem.free[k]) {
        let height = facet_normal.map_or(0.0, |normal| normal.dot(a));
        if height.abs() <= ON_FACET * a.norm() {
            movable.push(Movable {
                index: k,
                column: *a,
                linear: problem.linear[k] / unit,
                softness: unit / problem.curvature[k],
            });
        } else if height > 0.0 {
            v[k] = 1.0;
            goal -= a;
        }
    }
    let mut breakpoints = Vec::with_capacity(2 * movable.len());
    let mut price = point.price / unit;
    if !price.iter().all(|value| value.is_finite()) {
        price = Vector3::zeros();
    }
    if let Some(normal) = facet_normal {
        // Along the normal nothing moves any more; a large component would only bring rounding.
        price -= normal * normal.dot(&price);
    }
    let mut best = (f64::INFINITY, price);
    for _ in 0..ITERATIONS {
        let mut gradient = -goal;
        let mut hessian = Matrix3::zeros();
        for effector in &movable {
            let wish = effector.wish(&price) * effector.softness;
            gradient += effector.column * wish.clamp(0.0, 1.0);
            if (0.0..=1.0).contains(&wish) {
                hessian += effector.column * effector.column.transpose() * effector.softness;
            }
        }
        let error = gradient.norm();
        if error < best.0 {
            best = (error, price);
        }
        if error <= TARGET_ERROR {
            break;
        }
        let Some(direction) = newton_direction(hessian, gradient) else {
            break;
        };
        let Some(step) = exact_step(&movable, &goal, &price, &direction, &mut breakpoints) else {
            break;
        };
        price += direction * step;
    }
    let (error, price) = best;
    if error.is_nan() || error > ACCEPTED_ERROR {
        return false;
    }
    for effector in &movable {
        v[effector.index] = (effector.wish(&price) * effector.softness).clamp(0.0, 1.0);
    }
    onto_torque(problem, torque, &mut v);
    if (problem.torque_of(&v) - torque).norm() > TORQUE_TOLERANCE {
        return false;
    }
    point.v = v;
    point.price = price * unit;
    true
}

/// Newton's direction; where the Hessian is flat, nearly steepest descent.
fn newton_direction(mut hessian: Matrix3<f64>, gradient: Vector3<f64>) -> Option<Vector3<f64>> {
    let ridge = 1e-11 * hessian.trace().max(1e-3);
    for i in 0..3 {
        hessian[(i, i)] += ridge;
    }
    let direction = -hessian.cholesky()?.solve(&gradient);
    direction.iter().all(|value| value.is_finite()).then_some(direction)
}

/// The step to the minimum along `direction`: the slope is piecewise linear and never falls.
/// `None` when it has no zero ahead.
fn exact_step(
    movable: &[Movable],
    goal: &Vector3<f64>,
    price: &Vector3<f64>,
    direction: &Vector3<f64>,
    breakpoints: &mut Vec<(f64, f64)>,
) -> Option<f64> {
    // Slope and its rate of change now; each breakpoint changes the rate.
    let mut slope = -goal.dot(direction);
    let mut rate = 0.0;
    breakpoints.clear();
    for effector in movable {
        let reach = effector.column.dot(direction);
        let speed = reach * effector.softness;
        let wish = effector.wish(price) * effector.softness;
        slope += reach * wish.clamp(0.0, 1.0);
        if speed == 0.0 {
            continue;
        }
        let (enter, leave) = if speed > 0.0 { (0.0, 1.0) } else { (1.0, 0.0) };
        let (enter, leave) = ((enter - wish) / speed, (leave - wish) / speed);
        let gain = reach * speed;
        if leave <= 0.0 {
            continue;
        }
        if enter > 0.0 {
            breakpoints.push((enter, gain));
        } else {
            rate += gain;
        }
        breakpoints.push((leave, -gain));
    }
    if slope >= 0.0 {
        return None;
    }
    breakpoints.sort_unstable_by(|a, b| a.0.total_cmp(&b.0));
    let mut at = 0.0;
    for &(next, change) in breakpoints.iter() {
        let ahead = slope + rate * (next - at);
        if ahead >= 0.0 && rate > 0.0 {
            return Some(at - slope / rate);
        }
        slope = ahead;
        at = next;
        rate += change;
    }
    // No zero ahead but for rounding: the last breakpoint is the flattest place.
    (at > 0.0).then_some(at)
}

/// Corrects `v` onto the torque equation without leaving the bounds: a weighted least-change step
/// in which a variable moves the less the nearer it is to a bound.
pub(crate) fn onto_torque(problem: &Problem, torque: Vector3<f64>, v: &mut [f64]) {
    for _ in 0..4 {
        let error = torque - problem.torque_of(v);
        if error.norm() < 1e-14 {
            return;
        }
        let room = |v: f64| v.min(1.0 - v);
        let mut system = Matrix3::zeros();
        for (a, &v) in problem.columns.iter().zip(v.iter()) {
            system += a * a.transpose() * room(v);
        }
        let Some(step) = newton_direction(system, error) else {
            return;
        };
        for (a, v) in problem.columns.iter().zip(v.iter_mut()) {
            *v = (*v - room(*v) * a.dot(&step)).clamp(0.0, 1.0);
        }
    }
}
