//! The torque that comes and goes at random beside everything that is explained.

use serde::{Deserialize, Serialize};

/// Slow random torque that was found beside what is explained: a first-order Markov process (an Ornstein-Uhlenbeck process; Gelb 1974,
/// section 3.8).
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
pub struct BackgroundTorque {
    /// Standard deviation about each axis [N m]; 0 = none was found.
    pub stddev_n_m: f64,
    /// Time over which it changes \[s\].
    pub correlation_s: f64,
}
