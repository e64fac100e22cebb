//! The alpha-form quadratic program in Clarabel.
//!
//! Variables v_1..v_n in 0..=1 and beta in 0..=beta_max (beta_max of order one; alpha in other
//! units, so that the demand enters as a column of order one whatever its size):
//!
//! minimise  1/2 v'Hv + c'v - M beta   subject to   sum a_k v_k - d beta = -o
//!
//! and, with net force priced, three more rows f = F v and its square in the cost. The sparsity
//! pattern never changes: every entry is kept, zero or not, so one solver object serves all demands.

use clarabel::algebra::CscMatrix;
use clarabel::solver::SupportedConeT::{NonnegativeConeT, ZeroConeT};
use clarabel::solver::{DefaultSettings, DefaultSolver, IPSolver, SolverStatus};
use nalgebra::Vector3;

use crate::allocation::SolverOutcome;
use crate::problem::Problem;

const MAX_ITERATIONS: u32 = 40;

/// Why no allocator could be built.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum AllocatorError {
    /// The solver could not be set up.
    #[error("the quadratic program cannot be set up: {0}")]
    Solver(String),
}

/// The demand as a column d and a bound on beta.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Target {
    /// d
    pub column: Vector3<f64>,
    /// Upper bound of beta.
    pub beta_max: f64,
    /// alpha = alpha_per_beta * beta
    pub alpha_per_beta: f64,
    /// M
    pub reward: f64,
}

impl Target {
    pub fn new(problem: &Problem, reward: f64) -> Self {
        let norm = problem.torque.norm();
        // Beyond the sum of all effectors nothing is attainable: a huge demand is shortened there.
        let reach: f64 = problem.columns.iter().map(|a| a.norm()).sum();
        let reach = 2.0 * (reach + problem.offset.norm()) + 1.0;
        let shortened = norm.min(reach);
        let beta_max = shortened.max(1e-3);
        let (column, alpha_per_beta) = if norm > 0.0 {
            (problem.torque * (shortened / norm / beta_max), shortened / norm / beta_max)
        } else {
            (Vector3::zeros(), 1.0 / beta_max)
        };
        Self { column, beta_max, alpha_per_beta, reward }
    }
}

/// The result of the interior point method.
#[derive(Debug, Clone, Default)]
pub(crate) struct InteriorPoint {
    /// v, clamped to 0..=1.
    pub v: Vec<f64>,
    /// beta, clamped.
    pub beta: f64,
    /// Multiplier of the torque equation: the marginal cost of torque.
    pub price: Vector3<f64>,
    pub iterations: u32,
    /// `None` when solved.
    pub outcome: Option<SolverOutcome>,
}

/// The program's numbers, in the order of the sparsity pattern.
struct Data {
    /// Torque rows, and force rows when net force is priced.
    equalities: usize,
    /// Number of effectors; beta comes after them.
    count: usize,
    curvature: Vec<f64>,
    linear: Vec<f64>,
    entries: Vec<f64>,
    right_side: Vec<f64>,
}

pub(crate) struct QuadraticProgram {
    solver: DefaultSolver<f64>,
    data: Data,
}

impl QuadraticProgram {
    /// Sets the solver up with the sparsity pattern of `problem`; scaling is fixed from its data.
    pub fn new(problem: &Problem, with_force: bool) -> Result<Self, AllocatorError> {
        let count = problem.len();
        let boxed = count + 1;
        let forces = if with_force { 3 } else { 0 };
        let equalities = 3 + forces;
        let rows = equalities + 2 * boxed;
        let columns = boxed + forces;

        let mut column_start = vec![0];
        let mut row_index = Vec::new();
        for k in 0..columns {
            if k < boxed {
                row_index.extend(0..3);
                if with_force && k < problem.jets {
                    row_index.extend(3..6);
                }
                row_index.extend([equalities + k, equalities + boxed + k]);
            } else {
                row_index.push(3 + k - boxed);
            }
            column_start.push(row_index.len());
        }
        let mut data = Data {
            equalities,
            count,
            curvature: vec![0.0; columns],
            linear: vec![0.0; columns],
            entries: Vec::with_capacity(row_index.len()),
            right_side: vec![0.0; rows],
        };
        let typical = Target {
            column: Vector3::repeat(1.0 / 3.0_f64.sqrt()),
            beta_max: 1.0,
            alpha_per_beta: 1.0,
            reward: 1.0,
        };
        data.write(problem, &typical);
        let diagonal = (0..columns).collect();
        let quadratic =
            CscMatrix::new(columns, columns, (0..=columns).collect(), diagonal, data.curvature.clone());
        let constraints = CscMatrix::new(rows, columns, column_start, row_index, data.entries.clone());
        let solver = DefaultSolver::new(
            &quadratic,
            &data.linear,
            &constraints,
            &data.right_side,
            &[ZeroConeT(equalities), NonnegativeConeT(2 * boxed)],
            settings(),
        )
        .map_err(|error| AllocatorError::Solver(error.to_string()))?;
        if solver.is_data_update_allowed() {
            Ok(Self { solver, data })
        } else {
            Err(AllocatorError::Solver("it does not allow data updates".to_owned()))
        }
    }

    /// Solves for new data.
    pub fn solve(&mut self, problem: &Problem, target: &Target, answer: &mut InteriorPoint) {
        answer.v.clear();
        answer.iterations = 0;
        let (solver, data) = (&mut self.solver, &mut self.data);
        data.write(problem, target);
        let updated = solver.update_P(&data.curvature).is_ok()
            && solver.update_q(&data.linear).is_ok()
            && solver.update_A(&data.entries).is_ok()
            && solver.update_b(&data.right_side).is_ok();
        if !updated {
            answer.outcome = Some(SolverOutcome::DataRefused);
            return;
        }
        solver.solve();

        let solution = &solver.solution;
        answer.iterations = solution.iterations;
        answer.outcome = match solution.status {
            SolverStatus::Solved | SolverStatus::AlmostSolved => None,
            SolverStatus::PrimalInfeasible
            | SolverStatus::AlmostPrimalInfeasible
            | SolverStatus::DualInfeasible
            | SolverStatus::AlmostDualInfeasible => Some(SolverOutcome::Infeasible),
            SolverStatus::MaxIterations | SolverStatus::MaxTime => Some(SolverOutcome::IterationLimit),
            _ => Some(SolverOutcome::Numerical),
        };
        if !solution.x.iter().chain(&solution.z).all(|value| value.is_finite()) {
            answer.outcome = Some(SolverOutcome::Numerical);
            return;
        }
        answer.v.extend(solution.x[..data.count].iter().map(|v| v.clamp(0.0, 1.0)));
        answer.beta = solution.x[data.count].clamp(0.0, target.beta_max);
        answer.price = -Vector3::new(solution.z[0], solution.z[1], solution.z[2]);
    }
}

impl Data {
    fn write(&mut self, problem: &Problem, target: &Target) {
        let with_force = self.equalities > 3;
        let boxed = self.count + 1;
        self.entries.clear();
        for (k, a) in problem.columns.iter().enumerate() {
            self.entries.extend_from_slice(a.as_slice());
            if with_force && k < problem.jets {
                let force = problem.force_columns.get(k).copied().unwrap_or_else(Vector3::zeros);
                self.entries.extend_from_slice(force.as_slice());
            }
            self.entries.extend([-1.0, 1.0]);
            self.curvature[k] = problem.curvature[k];
            self.linear[k] = problem.linear[k];
        }
        self.entries.extend_from_slice((-target.column).as_slice());
        self.entries.extend([-1.0, 1.0]);
        self.curvature[self.count] = 0.0;
        self.linear[self.count] = -target.reward;
        if with_force {
            self.entries.extend([-1.0; 3]);
            self.curvature[boxed..].fill(problem.force_weight.max(1e-9));
        }

        self.right_side.fill(0.0);
        self.right_side[..3].copy_from_slice((-problem.offset).as_slice());
        if with_force {
            self.right_side[3..6].copy_from_slice((-problem.force_offset).as_slice());
        }
        let upper = self.equalities + boxed;
        self.right_side[upper..upper + self.count].fill(1.0);
        self.right_side[upper + self.count] = target.beta_max;
    }
}

fn settings() -> DefaultSettings<f64> {
    DefaultSettings {
        verbose: false,
        max_iter: MAX_ITERATIONS,
        // Both must stay off, else the data cannot be updated in place.
        presolve_enable: false,
        input_sparse_dropzeros: false,
        // The dual method does better, for less time.
        iterative_refinement_enable: false,
        max_threads: 1,
        direct_solve_method: "qdldl".to_owned(),
        ..DefaultSettings::default()
    }
}

#[cfg(test)]
mod tests {
    use rand_pcg::Pcg64;

    use super::*;
    use crate::demand::{JetMask, Mode, TorqueDemand};
    use crate::layouts::{canted_pods, direction, no_wheels, uniform};
    use crate::zonotope::{LeastCost, Zonotope};

    /// The bare solver, without the dual method, against the oracle: they share only the scaling of the demand.
    #[test]
    fn bare_solver_and_oracle_agree() {
        let effectors = canted_pods(no_wheels());
        let mut rng = Pcg64::new(50, 7);
        let mut problem = Problem::default();
        problem.fill(&effectors, &TorqueDemand::nominal(&effectors, Mode::Jets, Vector3::zeros()));
        let mut program = QuadraticProgram::new(&problem, false).unwrap();
        let mut point = InteriorPoint::default();
        let mut short = 0;
        for case in 0..1300 {
            let torque = direction(&mut rng) * uniform(&mut rng, 0.01, 0.8);
            let mut demand = TorqueDemand::nominal(&effectors, Mode::Jets, torque);
            demand.jet_available = JetMask::ALL.without(case % 13);
            problem.fill(&effectors, &demand);
            let target = Target::new(&problem, 1e4);
            program.solve(&problem, &target, &mut point);
            assert_eq!(point.outcome, None);
            let alpha = point.beta * target.alpha_per_beta;
            let exact = Zonotope::new(&problem.columns, problem.offset).alpha_max(&problem.torque);
            assert!((alpha - exact.unwrap()).abs() < 1e-5, "{alpha} {exact:?}");
            let error = problem.torque_of(&point.v) - problem.torque * alpha;
            assert!(error.norm() < 1e-6, "{error:?}");
            if alpha < 0.999 {
                short += 1;
            } else {
                let table = LeastCost::new(&problem.columns, problem.offset, &problem.linear);
                let gas: f64 = point.v.iter().zip(&problem.linear).map(|(v, c)| v * c).sum();
                let least = table.of(&problem.torque);
                assert!(gas < 1.001 * least + 1e-5, "{gas} {least}");
            }
        }
        assert!(short > 200, "{short}");
    }
}
