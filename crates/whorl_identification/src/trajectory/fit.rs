//! Gauss-Newton over states and unknowns.

use nalgebra::{DMatrix, DVector, Matrix3, Vector3};
use whorl_dynamics::PlatformModel;

use super::dynamics::Physics;
use super::segment::{Node, Noise, SegmentFit, end_difference, fit_segment, perturbed};
use super::smoother::{CrossMatrix, Elimination, Link, StateMatrix, StateVector};
use super::start::first_guess;
use super::unknowns::Unknowns;
use crate::data::{AveragedSample, Chain, DataError, PreparedData};

/// Longest time between states \[s\].
const STATE_EVERY_S: f64 = 2.0;
/// Gauss-Newton steps at most.
const MAX_ITERATIONS: usize = 40;
/// The first of them move the states alone.
const STATES_FIRST: usize = 2;
/// The iteration ends when no unknown moves by more than this share of its uncertainty.
const CONVERGED: f64 = 1e-3;
/// An iteration that can no longer lower the cost still counts as converged when its step is below this.
const STALLED: f64 = 1.0;
/// Attitude information before a chain starts, about the guess [1/rad^2]: only keeps an unobserved
/// heading from drifting.
const LOOSE_ATTITUDE: f64 = 1e-2;
/// Error of the equations' numerical solution over one stretch: attitude \[rad\] and rate [rad/s].
const NUMERICAL: [f64; 2] = [3e-6, 3e-6];

/// A fit to be made.
pub(crate) struct Problem<'a> {
    /// The platform, its constants corrected by the effects of the model.
    pub model: &'a PlatformModel,
    pub data: &'a PreparedData,
    pub unknowns: Unknowns,
    pub noise: Noise,
    /// Unexplained torque, as white noise [N m sqrt(s)].
    pub torque_noise_n_m_sqrt_s: f64,
    stretches: Vec<Stretch<'a>>,
}

/// The points between two states.
struct Stretch<'a> {
    /// Index of its chain, and of its first point there.
    chain: usize,
    at: usize,
    points: &'a [AveragedSample],
    own: usize,
    /// First of its chain.
    first: bool,
    /// First of its run.
    first_of_run: bool,
    /// Time from the end of the chain before \[s\], when it starts a chain within a run.
    gap_s: f64,
}

/// Where the fit stands.
#[derive(Clone)]
pub(crate) struct Solution {
    pub values: DVector<f64>,
    pub nodes: Vec<Node>,
}

/// A finished fit.
pub(crate) struct Fitted {
    pub solution: Solution,
    /// Information about the unknowns, their prior included.
    pub information: DMatrix<f64>,
    /// Residuals squared over their variances, measurements only.
    pub cost: f64,
    /// Number of measurements used.
    pub residuals: f64,
    pub outliers: usize,
    /// Largest remaining step of an unknown, over its uncertainty.
    pub unsettled: f64,
    /// -2 log of the marginal likelihood, up to a constant.
    pub surprise: f64,
}

impl<'a> Problem<'a> {
    pub fn new(
        model: &'a PlatformModel,
        data: &'a PreparedData,
        unknowns: Unknowns,
        torque_noise: f64,
    ) -> Self {
        let mut stretches = Vec::new();
        let mut before: Option<&Chain> = None;
        for (index, chain) in data.chains.iter().enumerate() {
            let gap_s = match (before, chain.points.first()) {
                (Some(b), Some(p)) if b.run == chain.run => {
                    b.points.last().map_or(0.0, |last| p.time_s - last.time_s)
                }
                _ => 0.0,
            };
            let first_of_run = before.is_none_or(|b| b.run != chain.run);
            let steps = chain.points.len();
            let step_s = chain.duration_s() / (steps.max(2) - 1) as f64;
            let per = ((STATE_EVERY_S / step_s).round() as usize).max(1);
            let mut at = 0;
            while at < steps {
                // The last stretch includes a short remainder.
                let rest = steps - at;
                let own = if rest < 2 * per { rest } else { per };
                let end = (at + own + 1).min(steps);
                stretches.push(Stretch {
                    chain: index,
                    at,
                    points: chain.points.get(at..end).unwrap_or_default(),
                    own,
                    first: at == 0,
                    first_of_run: at == 0 && first_of_run,
                    gap_s,
                });
                at += own;
            }
            before = Some(chain);
        }
        Self {
            model,
            data,
            unknowns,
            noise: Noise::new(model),
            torque_noise_n_m_sqrt_s: torque_noise,
            stretches,
        }
    }

    /// A start from the prior and the measurements.
    pub fn start(&self) -> Solution {
        let sensors = &self.model.sensors;
        let guesses: Vec<_> = self.data.chains.iter().map(first_guess).collect();
        let motion = |s: &Stretch<'_>| guesses.get(s.chain).and_then(|g| g.get(s.at)).copied();
        let nodes = self.stretches.iter().filter_map(motion).map(|motion| Node {
            motion,
            gyro_bias_rad_s: sensors.gyro.errors.bias,
            accelerometer_bias_m_s2: sensors.accelerometer.errors.bias,
        });
        let nodes = nodes.collect();
        Solution { values: self.unknowns.mean.clone(), nodes }
    }

    /// Iterates to the optimum from `start`: first with all samples, then without the outliers.
    pub fn solve(&self, start: Solution) -> Result<Fitted, DataError> {
        let refused = |why: &str| DataError::NotConverged(why.to_owned());
        let mut solution = start;
        let mut reject = false;
        let mut last_moved = f64::INFINITY;
        for iteration in 1..=MAX_ITERATIONS {
            let (elimination, parts) = self.linearise(&solution, reject)?;
            let (mut step, mut states, factor) = elimination.solve().map_err(refused)?;
            if iteration <= STATES_FIRST {
                // A poor initial guess of the motion must not disturb the unknowns.
                step.fill(0.0);
                states = elimination.states(&step);
            }
            let stddev = factor.inverse().diagonal().map(f64::sqrt);
            let moved = step.iter().zip(&stddev).map(|(d, s)| (d / s).abs()).fold(0.0, f64::max);
            let total = parts.total();
            let next = self.improved(&solution, &step, &states, total, reject);
            let settled = iteration > STATES_FIRST && (moved < CONVERGED || next.is_none());
            last_moved = moved;
            let settled = settled || (iteration == MAX_ITERATIONS && moved < STALLED);
            if settled && (reject || iteration == MAX_ITERATIONS || parts.cost < 1.1 * parts.residuals) {
                if moved > STALLED {
                    break;
                }
                let log_unknowns = 2.0 * factor.l().diagonal().map(f64::ln).sum();
                return Ok(Fitted {
                    // The remaining step counts as uncertainty.
                    unsettled: if moved < CONVERGED { 0.0 } else { moved },
                    information: 0.5 * (&elimination.unknowns + elimination.unknowns.transpose()),
                    cost: parts.cost,
                    residuals: parts.residuals,
                    outliers: parts.outliers,
                    surprise: total + elimination.log_determinant + log_unknowns - parts.log_weights,
                    solution,
                });
            }
            // Outliers can be recognised only once the fit is near.
            reject |= settled || (moved < 1.0 && iteration > 3);
            if let Some(next) = next {
                solution = next;
            }
        }
        Err(refused(&format!(
            "after many steps the estimate still moves by {last_moved:.1} of its uncertainty; the model does not fit the data"
        )))
    }

    /// The solution after the longest share of the step that lowers the cost.
    fn improved(
        &self,
        solution: &Solution,
        step: &DVector<f64>,
        states: &[StateVector],
        total: f64,
        reject: bool,
    ) -> Option<Solution> {
        let mut share = 1.0;
        while share > 0.01 {
            let candidate = moved_by(solution, step, states, share);
            if self.cost(&candidate, reject) <= total {
                return Some(candidate);
            }
            share *= 0.5;
        }
        None
    }

    /// Total cost: measurements, links and priors.
    fn cost(&self, solution: &Solution, reject: bool) -> f64 {
        let Some(physics) = Physics::new(&self.unknowns, &solution.values) else {
            return f64::INFINITY;
        };
        let mut parts = Parts::default();
        let known = (&self.unknowns, &self.noise);
        self.add_prior_cost(solution, &mut parts);
        for (n, (stretch, node)) in self.stretches.iter().zip(&solution.nodes).enumerate() {
            let fit = fit_segment(known, &physics, &[], node, stretch.points, stretch.own, (false, reject));
            parts.cost += fit.cost;
            self.add_state_prior_cost(stretch, node, &mut parts);
            if let Some((_, gap, weight)) = self.link(n, solution, &fit, &physics) {
                parts.links += (gap.transpose() * weight * gap)[(0, 0)];
            }
        }
        parts.total()
    }

    /// Normal equations at a solution, all states eliminated.
    pub fn linearise(&self, solution: &Solution, reject: bool) -> Result<(Elimination, Parts), DataError> {
        let impossible = || DataError::NotConverged("the inertia left the realm of the possible".to_owned());
        let physics = Physics::new(&self.unknowns, &solution.values).ok_or_else(impossible)?;
        let perturbed = perturbed(&self.unknowns, &solution.values).ok_or_else(impossible)?;
        let mut parts = Parts::default();
        let known = (&self.unknowns, &self.noise);
        let mut elimination = Elimination::new(self.unknowns.len());
        for n in 0..self.unknowns.len() {
            let information = self.unknowns.stddev[n].powi(-2);
            elimination.unknowns[(n, n)] += information;
            elimination.unknowns_right[n] += information * (self.unknowns.mean[n] - solution.values[n]);
        }
        self.add_prior_cost(solution, &mut parts);
        for (n, (stretch, node)) in self.stretches.iter().zip(&solution.nodes).enumerate() {
            let (information, right) = self.state_prior(stretch, node);
            elimination.add_state(&information, &right);
            self.add_state_prior_cost(stretch, node, &mut parts);
            let fit =
                fit_segment(known, &physics, &perturbed, node, stretch.points, stretch.own, (true, reject));
            parts.cost += fit.cost;
            parts.residuals += fit.residuals;
            parts.outliers += fit.outliers;
            elimination.add_measurements(&fit.normal, &fit.right);
            let link = self.link(n, solution, &fit, &physics).map(|(carried, gap, weight)| {
                parts.links += (gap.transpose() * weight * gap)[(0, 0)];
                let mut transition = StateMatrix::zeros();
                transition.fixed_view_mut::<6, 6>(6, 6).fill_with_identity();
                let mut unknowns = CrossMatrix::zeros(self.unknowns.len());
                if carried {
                    transition = fit.transition;
                    unknowns.copy_from(&fit.by_unknowns);
                    parts.log_weights += weight.determinant().max(f64::MIN_POSITIVE).ln();
                }
                Link { transition, unknowns, gap, weight }
            });
            elimination.advance(link.as_ref()).map_err(|why| DataError::NotConverged(why.to_owned()))?;
        }
        Ok((elimination, parts))
    }

    fn add_prior_cost(&self, solution: &Solution, parts: &mut Parts) {
        let misses = solution.values.iter().zip(&self.unknowns.mean).zip(&self.unknowns.stddev);
        parts.links += misses.map(|((v, m), s)| ((v - m) / s).powi(2)).sum::<f64>();
    }

    /// The prior of a state, only at starts.
    fn state_prior(&self, stretch: &Stretch<'_>, node: &Node) -> (StateMatrix, StateVector) {
        let mut information = StateMatrix::zeros();
        let mut right = StateVector::zeros();
        if stretch.first {
            for n in 0..3 {
                information[(n, n)] = LOOSE_ATTITUDE;
            }
        }
        if stretch.first_of_run {
            let sensors = &self.model.sensors;
            let biases = [
                (6, sensors.gyro.errors, node.gyro_bias_rad_s),
                (9, sensors.accelerometer.errors, node.accelerometer_bias_m_s2),
            ];
            for (at, errors, value) in biases {
                for axis in 0..3 {
                    let weight = bias_stddev(errors.bias_turn_on_stddev[axis]).powi(-2);
                    information[(at + axis, at + axis)] = weight;
                    right[at + axis] = weight * (errors.bias[axis] - value[axis]);
                }
            }
        }
        (information, right)
    }

    fn add_state_prior_cost(&self, stretch: &Stretch<'_>, node: &Node, parts: &mut Parts) {
        let (information, right) = self.state_prior(stretch, node);
        for n in 6..12 {
            if information[(n, n)] > 0.0 {
                parts.links += right[n].powi(2) / information[(n, n)];
            }
        }
    }

    /// How a state is joined to the next: whether the motion is carried over, the gap and its weight.
    fn link(
        &self,
        n: usize,
        solution: &Solution,
        fit: &SegmentFit,
        physics: &Physics,
    ) -> Option<(bool, StateVector, StateMatrix)> {
        let (node, next) = (solution.nodes.get(n)?, solution.nodes.get(n + 1)?);
        let (stretch, following) = (self.stretches.get(n)?, self.stretches.get(n + 1)?);
        if following.first_of_run {
            return None;
        }
        let carried = !following.first;
        let first_s = stretch.points.first().map_or(0.0, |p| p.time_s);
        let last_s = stretch.points.last().map_or(0.0, |p| p.time_s);
        let length_s = if carried { last_s - first_s } else { last_s - first_s + following.gap_s };
        let mut gap = StateVector::zeros();
        gap.fixed_rows_mut::<6>(0).copy_from(&end_difference(&fit.end, &next.motion));
        gap.fixed_rows_mut::<3>(6).copy_from(&(next.gyro_bias_rad_s - node.gyro_bias_rad_s));
        gap.fixed_rows_mut::<3>(9).copy_from(&(next.accelerometer_bias_m_s2 - node.accelerometer_bias_m_s2));
        let mut weight = StateMatrix::zeros();
        let errors = [self.model.sensors.gyro.errors, self.model.sensors.accelerometer.errors];
        for (at, errors) in [(6, errors[0]), (9, errors[1])] {
            for axis in 0..3 {
                let walk = errors.bias_walk[axis].powi(2) * length_s;
                weight[(at + axis, at + axis)] = 1.0 / (walk + 1e-14);
            }
        }
        if carried {
            let inverse = physics.inverse_inertia();
            let spread = inverse * inverse.transpose() * (self.torque_noise_n_m_sqrt_s.powi(2) * length_s);
            let unit = Matrix3::identity();
            let mut covariance = nalgebra::Matrix6::zeros();
            let attitude = spread * (length_s.powi(2) / 3.0) + unit * NUMERICAL[0].powi(2);
            covariance.fixed_view_mut::<3, 3>(0, 0).copy_from(&attitude);
            covariance.fixed_view_mut::<3, 3>(0, 3).copy_from(&(spread * (0.5 * length_s)));
            covariance.fixed_view_mut::<3, 3>(3, 0).copy_from(&(spread * (0.5 * length_s)));
            covariance.fixed_view_mut::<3, 3>(3, 3).copy_from(&(spread + unit * NUMERICAL[1].powi(2)));
            // Positive definite: a covariance plus a positive diagonal.
            if let Some(factor) = covariance.cholesky() {
                weight.fixed_view_mut::<6, 6>(0, 0).copy_from(&factor.inverse());
            }
        } else {
            gap.fixed_rows_mut::<6>(0).fill(0.0);
        }
        Some((carried, gap, weight))
    }
}

/// Standard deviation of a turn-on bias, never zero.
fn bias_stddev(model: f64) -> f64 {
    model.max(1e-6)
}

/// Parts of the cost.
#[derive(Default)]
pub(crate) struct Parts {
    cost: f64,
    residuals: f64,
    outliers: usize,
    links: f64,
    log_weights: f64,
}

impl Parts {
    fn total(&self) -> f64 {
        self.cost + self.links
    }
}

fn moved_by(solution: &Solution, step: &DVector<f64>, states: &[StateVector], share: f64) -> Solution {
    Solution {
        values: &solution.values + step * share,
        nodes: solution.nodes.iter().zip(states).map(|(n, s)| n.moved(s, share)).collect(),
    }
}

/// Mean of the biases over all states, for reports.
pub(crate) fn mean_biases(nodes: &[Node]) -> (Vector3<f64>, Vector3<f64>) {
    let count = nodes.len().max(1) as f64;
    let gyro: Vector3<f64> = nodes.iter().map(|n| n.gyro_bias_rad_s).sum();
    let accelerometer: Vector3<f64> = nodes.iter().map(|n| n.accelerometer_bias_m_s2).sum();
    (gyro / count, accelerometer / count)
}
