//! The answer to a demand.

use nalgebra::Vector3;

use crate::demand::JetMask;

/// The commands of all effectors, and the torque that results.
#[derive(Debug, Clone, PartialEq)]
pub struct Allocation {
    /// On-time fraction of each jet, within its bounds.
    pub jet_on_fraction: Vec<f64>,
    /// Command of each motor in its unit, within its bounds.
    pub motor_command: Vec<f64>,
    /// Share of the demanded torque that is met, 0..=1.
    pub alpha: f64,
    /// Torque on the body that the numbers above give, body axes [N m].
    pub achieved_torque_b_n_m: Vector3<f64>,
    /// Demanded less achieved torque, body axes [N m].
    pub unallocated_torque_b_n_m: Vector3<f64>,
    /// Jets at their upper bound.
    pub saturated_jets: JetMask,
    /// Mean gas flow over the slot, in the unit of the layout's gas rates [kg/s].
    pub gas_rate_kg_s: f64,
    /// How the answer was found.
    pub status: Status,
}

/// How an allocation was found.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Status {
    /// Optimum of the quadratic program.
    Solved {
        /// Interior-point iterations, over all tries; 0 when the dual method needed no start from one.
        iterations: u32,
        /// True when the optimum is exact and proven; otherwise (net force priced, or rounding) the
        /// interior point was corrected onto the torque equation.
        exact: bool,
    },
    /// The solution was unique: no program needed.
    ClosedForm,
    /// No such allocation: bounded least squares instead. See the crate's page.
    Fallback(FallbackReason),
}

/// Why the fallback was used.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
pub enum FallbackReason {
    /// No effector is free to move.
    #[error("no effector may be used")]
    NoEffector,
    /// The effectors in use give no torque at all along the demanded direction.
    #[error("the effectors in use give no torque along the demand")]
    DirectionUnattainable,
    /// Lower bounds force a torque that no share of the demand matches.
    #[error("the bounds exclude every share of the demand")]
    BoundsExcludeDemand,
    /// The solver gave no usable solution.
    #[error("the quadratic program was not solved: {0:?}")]
    NotSolved(SolverOutcome),
}

/// Outcome of the solver.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum SolverOutcome {
    /// A certificate of infeasibility, not a solution.
    Infeasible,
    /// Iteration limit.
    IterationLimit,
    /// Numerical error or lack of progress.
    Numerical,
    /// The solver refused the data.
    DataRefused,
    /// A solution that misses the torque equation by more than 1e-7 of full torque, or falls short
    /// of the attainable share.
    Inaccurate,
}
