//! Mass properties while the platform moves (section 4.6.5).
//!
//! [`JointFilter`] has attitude, rate, gyro bias and the nine parameters in one state (eqs. 4.92-4.94), as extended,
//! iterated or unscented filter.
//!
//! It forgets with the factor lambda of eqs. 4.97-4.99, but a parameter is never forgotten beyond what was
//! known before the start: its variance stops at the prior's. So a parameter that is not excited keeps its
//! value and its uncertainty instead of wandering off (covariance wind-up).

mod extended;
mod forgetting;
mod joint;
mod joint_model;
mod noise;
mod online;
mod physics;
mod sample;
mod unscented;

pub use forgetting::forget;
pub use joint::{JointFilter, JointUpdate};
pub use online::OnlineFilter;
pub use sample::{AveragedSample, CONTACT_LASTS_S, Direction, Surroundings, touches};

use whorl_dynamics::mass_parameters::{MassCovariance, MassVector};

/// The current estimate of a sequential filter.
#[derive(Debug, Clone, PartialEq)]
pub struct SequentialEstimate {
    /// Time \[s\].
    pub time_s: f64,
    /// The nine parameters.
    pub estimate: MassVector,
    /// Their covariance.
    pub covariance: MassCovariance,
    /// Standard deviations before the start.
    pub prior_stddev: MassVector,
}

impl SequentialEstimate {
    /// Standard deviations now.
    #[must_use]
    pub fn stddev(&self) -> MassVector {
        self.covariance.diagonal().map(|v| v.max(0.0).sqrt())
    }
}
