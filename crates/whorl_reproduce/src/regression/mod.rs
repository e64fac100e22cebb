//! The dissertation's batch least squares (section 4.6.3), as printed and corrected.
//!
//! All methods write one linear equation in the nine parameters per time and axis, from *estimated*
//! attitude and rate:
//!
//! - **torque method** (eqs. 4.77-4.83): Omega' Pi = g_ext - A I_s dw_s/dt - w x A I_s w_s, natural or
//!   integrated from the start. The integral of eq. 4.83 lacks the wheels' speed at the start, here
//!   A I_s (w_s - w_s(t0)).
//! - **momentum integral** (eqs. 4.84-4.85): row at t_2 less R^21 times row at t_1, over one, two or
//!   three steps. As the residual of the torque method is zero at every time, these are linear
//!   combinations of its rows and add no information.
//! - **energy balance** (eqs. 4.86-4.91): rows dotted with the rate. Its integral is
//!   1/2 w^T I w less its start, not w^T I w as eq. 4.91 prints. The gyrostat has one as well: the wheels
//!   add the integral of w^T A I_s dw_s, a sum over increments of measured speed, in which no
//!   derivative is taken.
//!
//! Noise of the rate is in the matrix, so the pseudo-inverse is biased towards zero wherever a
//! parameter is hardly excited: that is Table 4.3's I_zz. [`Weighting::TotalLeastSquares`] corrects for
//! it. [`whorl_identification::identify`] avoids it, and is the method to use.

mod estimated;
mod on_run;
mod rows;
mod series;
mod solve;
#[cfg(test)]
mod tests;

pub use estimated::estimated_series;
pub use on_run::{Regressed, RegressionSettings, Weights, regress};
pub use rows::{Form, Method, System, rows};
pub use series::{StateSample, StateSeries};
pub use solve::{RegressionError, Solution, Weighting, solve};
