//! The exact optimum from the dual problem: three prices of torque instead of one unknown per effector.
//!
//! The share alpha that can be met is known exactly ([`crate::zonotope`]), so the torque to be met is a constant t*. When
//! it is on a facet with normal n, every effector off the facet stands at the bound that n'a_k points to. For the others the
//! cost is separable, so at a given price of torque y each stands at
//!
//! v_k(y) = (a_k'y - c_k) / H_k, clipped to 0..=1,
//!
//! and y minimises the convex dual function with gradient sum a_k v_k(y) + o - t*. That is three unknowns: Newton's method with
//! the generalised Hessian S = sum a_k a_k' / H_k over the unclipped, and an exact line search over the breakpoints, ends in
//! finitely many steps (Qi and Sun, Math. Programming 58, 1993; Hager and Zhang, SIAM J. Optim. 26, 2016).
//!
//! Without a start, the curvatures H_k, tiny for jets, are first enlarged and then lowered to their true values, each optimum
//! being the start of the next: where all effectors are clipped S is zero and Newton's method is blind.
//!
//! # Proof
//!
//! The program is convex, so the conditions of Karush, Kuhn and Tucker are sufficient: v in its bounds, the torque equation,
//! and v_k = v_k(y) for every effector. [`Optimum::miss`] is the largest deviation from the last, measured on the numbers that
//! are returned; what deviates by more than [`PROVEN`], or misses the torque by more than [`TORQUE_TOLERANCE`], is rejected.

use nalgebra::{Matrix3, Vector3};

use crate::problem::Problem;

/// Newton steps at one curvature.
const STEPS: usize = 60;
/// Curvatures, relative to the effectors' own, when there is no start.
const CURVATURES: [f64; 3] = [3000.0, 50.0, 1.0];
/// Gradient, in units of full torque, at which to stop.
const TARGET_ERROR: f64 = 1e-12;
/// Gradient that is small enough at an enlarged curvature.
const START_ERROR: f64 = 1e-3;
/// Gradient that rounding may leave where torque is very expensive; the last step removes it.
const ACCEPTED_ERROR: f64 = 1e-7;
/// Miss of the torque equation after that step.
const TORQUE_TOLERANCE: f64 = 1e-10;
/// Deviation from the conditions of optimality, in v, that counts as zero.
const PROVEN: f64 = 1e-6;
/// Height over a facet, relative to a generator's length, that counts as zero.
const ON_FACET: f64 = 1e-12;

/// Effectors at the least cost.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Optimum {
    /// v, each in 0..=1.
    pub v: Vec<f64>,
    /// Number of Newton steps.
    pub steps: u32,
    /// Largest deviation of a v_k from the v_k(y) of its price: 0 at the optimum.
    pub miss: f64,
}

/// An effector that is not held: index, column, linear cost and inverse of its curvature.
struct Movable {
    index: usize,
    column: Vector3<f64>,
    linear: f64,
    softness: f64,
}

impl Movable {
    /// v before clipping, with curvatures `stiffer` times as large.
    fn wish(&self, price: &Vector3<f64>, stiffer: f64) -> f64 {
        (self.column.dot(price) - self.linear) * self.softness / stiffer
    }
}

/// The optimum for torque `torque`, which lies on the facet with normal `facet_normal` if there is one. `start` is a price of
/// torque near the optimum's, if one is known. `None` when no optimum was found and proven.
pub(crate) fn solve(
    problem: &Problem,
    torque: Vector3<f64>,
    facet_normal: Option<Vector3<f64>>,
    start: Option<Vector3<f64>>,
) -> Option<Optimum> {
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
    let start = start.map(|price| price / unit).filter(|price| price.iter().all(|value| value.is_finite()));
    let mut price = start.unwrap_or_else(Vector3::zeros);
    if let Some(normal) = facet_normal {
        // Nothing moves along the normal; a large component would only add rounding errors.
        price -= normal * normal.dot(&price);
    }
    let mut newton = Newton { movable: &movable, goal, breakpoints: Vec::new(), steps: 0 };
    let curvatures = if start.is_some() { &CURVATURES[CURVATURES.len() - 1..] } else { &CURVATURES[..] };
    let mut error = f64::INFINITY;
    for &stiffer in curvatures {
        let enough = if stiffer > 1.0 { START_ERROR } else { TARGET_ERROR };
        (price, error) = newton.minimise(price, stiffer, enough);
    }
    let steps = newton.steps;
    if error.is_nan() || error > ACCEPTED_ERROR {
        return None;
    }
    for effector in &movable {
        v[effector.index] = effector.wish(&price, 1.0).clamp(0.0, 1.0);
    }
    onto_torque(problem, torque, &mut v);
    let deviation =
        |effector: &Movable| (v[effector.index] - effector.wish(&price, 1.0).clamp(0.0, 1.0)).abs();
    let miss = movable.iter().map(deviation).fold(0.0, f64::max);
    let proven = miss <= PROVEN && (problem.torque_of(&v) - torque).norm() <= TORQUE_TOLERANCE;
    proven.then_some(Optimum { v, steps, miss })
}

/// Newton's method on the dual function.
struct Newton<'a> {
    movable: &'a [Movable],
    /// Torque that the movable effectors are to give.
    goal: Vector3<f64>,
    breakpoints: Vec<(f64, f64)>,
    steps: u32,
}

impl Newton<'_> {
    /// From `price` to the price at which the gradient is at most `enough`, or to the best one found; with its gradient.
    fn minimise(&mut self, start: Vector3<f64>, stiffer: f64, enough: f64) -> (Vector3<f64>, f64) {
        let mut price = start;
        let mut best = (price, f64::INFINITY);
        for _ in 0..STEPS {
            let mut gradient = -self.goal;
            let mut hessian = Matrix3::zeros();
            for effector in self.movable {
                let wish = effector.wish(&price, stiffer);
                gradient += effector.column * wish.clamp(0.0, 1.0);
                if (0.0..=1.0).contains(&wish) {
                    hessian += effector.column * effector.column.transpose() * (effector.softness / stiffer);
                }
            }
            let error = gradient.norm();
            if error < best.1 {
                best = (price, error);
            }
            if error <= enough {
                break;
            }
            let Some(direction) = newton_direction(hessian, gradient) else {
                break;
            };
            let Some(step) = self.exact_step(&price, stiffer, &direction) else {
                break;
            };
            price += direction * step;
            self.steps += 1;
        }
        best
    }

    /// The step to the minimum along `direction`: the slope is piecewise linear and never falls.
    /// `None` when it has no zero ahead.
    fn exact_step(&mut self, price: &Vector3<f64>, stiffer: f64, direction: &Vector3<f64>) -> Option<f64> {
        // Slope and its rate of change now; each breakpoint changes the rate.
        let mut slope = -self.goal.dot(direction);
        let mut rate = 0.0;
        self.breakpoints.clear();
        for effector in self.movable {
            let reach = effector.column.dot(direction);
            let speed = reach * effector.softness / stiffer;
            let wish = effector.wish(price, stiffer);
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
                self.breakpoints.push((enter, gain));
            } else {
                rate += gain;
            }
            self.breakpoints.push((leave, -gain));
        }
        if slope >= 0.0 {
            return None;
        }
        self.breakpoints.sort_unstable_by(|a, b| a.0.total_cmp(&b.0));
        let mut at = 0.0;
        for &(next, change) in &self.breakpoints {
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
