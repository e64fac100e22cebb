//! What a filter has learnt of its start, and how that moves with parameters.

use nalgebra::{DMatrix, DVector};

use crate::design::Design;
use crate::filter::Filter;
use crate::sums::Sums;

/// What a filter says of its start behind a run. With P the covariance with which it began, g and G slope and information of the columns of the
/// start and C what these have in common with those of the parameters,
///
/// ```text
/// shift = P g        covariance = P - P G P        d start/d parameters = -P C
/// ```
pub(crate) struct FromStart {
    /// How the start moves that the run shows, from where it was given.
    pub shift: DVector<f64>,
    /// Covariance of the start given the run.
    pub own: DMatrix<f64>,
    /// What columns say of the parameters.
    pub sums: Sums,
    pub design: Option<Design>,
}

impl FromStart {
    /// Of a filter that has columns of its start, which it gives away.
    pub fn of(filter: &mut Filter<'_>) -> Self {
        let Some(columns) = filter.columns.take() else {
            let (known, begun) = filter.begun();
            let sums = Sums::none(known.nrows(), 0);
            return Self { shift: begun.clone(), own: known.clone(), sums, design: None };
        };
        let said = columns.said();
        let (known, begun) = filter.begun();
        let states = known.nrows();
        let parameters = said.slope.len() - states;
        let of_states = said.information.view((0, 0), (states, states));
        let common = said.information.view((0, states), (states, parameters));
        let sums = Sums {
            information: said.information.view((states, states), (parameters, parameters)).into_owned(),
            slope: said.slope.rows(states, parameters).into_owned(),
            of_start: -(known * common),
        };
        Self {
            shift: begun + known * said.slope.rows(0, states),
            own: known - known * of_states * known,
            sums,
            design: said.design,
        }
    }
}
