//! The allocator: chooses the path, checks the answer, falls back.

use nalgebra::Vector3;

use crate::allocation::{Allocation, FallbackReason, SolverOutcome, Status};
use crate::closed_form::{self, ClosedForm};
use crate::demand::{JetMask, Mode, TorqueDemand, TorqueDemandError};
use crate::dual;
use crate::effectors::Effectors;
use crate::least_squares;
use crate::problem::Problem;
use crate::quadratic_program::{AllocatorError, InteriorPoint, QuadraticProgram, Target};
use crate::zonotope::{CrossCheck, Zonotope};

/// Rewards M for meeting the demand, in units of the thirstiest jet per unit of torque, tried in
/// turn. M must exceed the marginal price of torque; larger ones cost the solver accuracy.
const REWARDS: [f64; 3] = [1e2, 1e3, 1e4];
/// Relative shortfall of an interior point's alpha that counts as zero.
const ALPHA_TOLERANCE: f64 = 1e-6;
/// Miss of the torque equation, in units of full torque, above which a solution is refused.
const TORQUE_TOLERANCE: f64 = 1e-7;

/// Splits torque demands over jets and motors. See the crate's page for the program, the unique
/// cases and the fallback.
///
/// The answer depends on the demand alone, not on earlier calls; buffers are all it keeps.
pub struct Allocator {
    effectors: Effectors,
    program: QuadraticProgram,
    /// The program with net force priced, when the layout has jet forces.
    program_with_force: Option<QuadraticProgram>,
    problem: Problem,
    point: InteriorPoint,
    dual_first: bool,
}

impl Allocator {
    /// Sets up the program for these effectors.
    ///
    /// # Errors
    /// [`AllocatorError`] when the solver cannot be set up.
    pub fn new(effectors: Effectors) -> Result<Self, AllocatorError> {
        let mut problem = Problem::default();
        let mut demand = TorqueDemand::nominal(&effectors, Mode::Both, Vector3::zeros());
        problem.fill(&effectors, &demand);
        let program = QuadraticProgram::new(&problem, false)?;
        let program_with_force = if effectors.layout().jet_force_b_n.is_some() {
            demand.net_force_weight = 1.0;
            problem.fill(&effectors, &demand);
            Some(QuadraticProgram::new(&problem, true)?)
        } else {
            None
        };
        let point = InteriorPoint::default();
        Ok(Self { effectors, program, program_with_force, problem, point, dual_first: true })
    }

    /// An allocator that always starts the dual method from the interior point: the same answers,
    /// but slower. For comparisons.
    #[must_use]
    pub fn by_interior_point(mut self) -> Self {
        self.dual_first = false;
        self
    }

    /// The effectors this allocator serves.
    #[must_use]
    pub fn effectors(&self) -> &Effectors {
        &self.effectors
    }

    /// Changes the torque on the body per unit of command of one motor, body axes: what a gyro's gimbal gives
    /// depends on its angle. Does nothing if there is no such motor or a number is not finite.
    pub fn set_motor_torque(&mut self, motor: usize, torque_b: &Vector3<f64>) {
        self.effectors.set_motor_torque(motor, torque_b);
    }

    /// Splits one demand.
    ///
    /// # Errors
    /// [`TorqueDemandError`] when the demand is not well formed. A demand that cannot be met is not an
    /// error: see [`Allocation::alpha`] and [`Allocation::status`].
    pub fn allocate(&mut self, demand: &TorqueDemand) -> Result<Allocation, TorqueDemandError> {
        demand.check(&self.effectors)?;
        self.problem.fill(&self.effectors, demand);
        if self.problem.asks_nothing(demand) {
            let rest: Vec<f64> = (0..self.problem.len()).map(|k| self.problem.rest(k)).collect();
            return Ok(self.answer(demand, &rest, 1.0, Status::ClosedForm));
        }
        let outcome = match closed_form::solve(&self.problem) {
            ClosedForm::Solution(v, alpha) => Ok((v, alpha, Status::ClosedForm)),
            ClosedForm::Unattainable(reason) => Err(reason),
            ClosedForm::NotUnique => self.solve_program(),
        };
        Ok(match outcome {
            Ok((v, alpha, status)) => self.answer(demand, &v, alpha, status),
            Err(reason) => self.fall_back(demand, reason),
        })
    }

    /// Compares an allocation with the exact oracle; see [`CrossCheck`].
    ///
    /// # Errors
    /// [`TorqueDemandError`] when the demand is not well formed.
    pub fn check(
        &self,
        demand: &TorqueDemand,
        allocation: &Allocation,
    ) -> Result<CrossCheck, TorqueDemandError> {
        CrossCheck::new(&self.effectors, demand, allocation)
    }

    /// As [`Self::allocate`], but never by the closed form: lets a test compare the two.
    #[cfg(test)]
    pub(crate) fn allocate_by_program(
        &mut self,
        demand: &TorqueDemand,
    ) -> Result<Allocation, TorqueDemandError> {
        demand.check(&self.effectors)?;
        self.problem.fill(&self.effectors, demand);
        Ok(match self.solve_program() {
            Ok((v, alpha, status)) => self.answer(demand, &v, alpha, status),
            Err(reason) => self.fall_back(demand, reason),
        })
    }

    fn solve_program(&mut self) -> Result<(Vec<f64>, f64, Status), FallbackReason> {
        let problem = &self.problem;
        let attainable = Zonotope::new(&problem.columns, problem.offset);
        let Some(reach) = attainable.reach(&problem.torque) else {
            return Err(FallbackReason::BoundsExcludeDemand);
        };
        let torque_norm = problem.torque.norm();
        if reach.most * torque_norm < 1e-9 && torque_norm > 1e-6 {
            return Err(FallbackReason::DirectionUnattainable);
        }
        let goal = problem.torque * reach.most;
        // The dual method knows a fixed cost per effector only.
        let with_force = problem.force_weight > 0.0;
        if self.dual_first
            && !with_force
            && let Some(optimum) = dual::solve(problem, goal, reach.facet_normal, None)
        {
            return Ok((optimum.v, reach.most, Status::Solved { iterations: 0, exact: true }));
        }
        let program = match &mut self.program_with_force {
            Some(program) if with_force => program,
            _ => &mut self.program,
        };
        let point = &mut self.point;
        let mut iterations = 0;
        let mut outcome = SolverOutcome::Inaccurate;
        for reward in REWARDS {
            let target = Target::new(problem, reward);
            program.solve(problem, &target, point);
            iterations += point.iterations;
            if point.v.len() != problem.len() {
                outcome = point.outcome.unwrap_or(SolverOutcome::Numerical);
                continue;
            }
            // Where the dual method ends, the conditions of optimality hold, whatever the solver said.
            if !with_force
                && let Some(optimum) = dual::solve(problem, goal, reach.facet_normal, Some(point.price))
            {
                return Ok((optimum.v, reach.most, Status::Solved { iterations, exact: true }));
            }
            if let Some(unsolved) = point.outcome {
                outcome = unsolved;
                continue;
            }
            let shortfall = reach.most - point.beta * target.alpha_per_beta;
            if shortfall <= ALPHA_TOLERANCE * reach.most {
                dual::onto_torque(problem, goal, &mut point.v);
                if (problem.torque_of(&point.v) - goal).norm() <= TORQUE_TOLERANCE {
                    let status = Status::Solved { iterations, exact: false };
                    return Ok((point.v.clone(), reach.most, status));
                }
            }
            outcome = SolverOutcome::Inaccurate;
        }
        Err(FallbackReason::NotSolved(outcome))
    }

    fn fall_back(&self, demand: &TorqueDemand, reason: FallbackReason) -> Allocation {
        let v = least_squares::solve(&self.problem);
        let achieved = self.problem.torque_of(&v);
        let square = self.problem.torque.norm_squared();
        let alpha =
            if square > 0.0 { (achieved.dot(&self.problem.torque) / square).clamp(0.0, 1.0) } else { 0.0 };
        self.answer(demand, &v, alpha, Status::Fallback(reason))
    }

    fn answer(&self, demand: &TorqueDemand, v: &[f64], alpha: f64, status: Status) -> Allocation {
        let jets = self.effectors.jets();
        let value = |k: usize| self.problem.value(k, v[k]);
        let jet_on_fraction: Vec<f64> = (0..jets).map(value).collect();
        let motor_command: Vec<f64> = (jets..self.problem.len()).map(value).collect();
        let achieved = self.effectors.torque_b_n_m(&jet_on_fraction, &motor_command);
        let mut saturated_jets = JetMask::NONE;
        for (j, &fraction) in jet_on_fraction.iter().enumerate() {
            let most = demand.jet_on_fraction_max[j];
            if demand.jet_available.contains(j) && most > 0.0 && fraction >= most - 1e-9 {
                saturated_jets = saturated_jets.with(j);
            }
        }
        let rates = &self.effectors.layout().jet_gas_rate_kg_s;
        let gas_rate_kg_s = jet_on_fraction.iter().zip(rates).map(|(u, rate)| u * rate).sum();
        Allocation {
            jet_on_fraction,
            motor_command,
            alpha,
            achieved_torque_b_n_m: achieved,
            unallocated_torque_b_n_m: demand.torque_b_n_m - achieved,
            saturated_jets,
            gas_rate_kg_s,
            status,
        }
    }
}
