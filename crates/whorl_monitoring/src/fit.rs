//! What a monitor says.

use nalgebra::Vector3;

use crate::sources::Hole;

/// A probability that is plain.
const PLAIN: f64 = 0.95;

/// What the monitor says.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum State {
    /// Not enough to say anything yet, or nobody moves the platform.
    Waiting,
    /// The platform moves as its model says.
    Agrees,
    /// The evidence is half-way to the limit.
    Doubt,
    /// The platform no longer moves as its model says.
    Mismatch,
}

/// The effect that explains the mismatch best.
#[derive(Debug, Clone, PartialEq)]
pub struct Likeliest {
    /// Id in the catalogue, or `unknown_torque`.
    pub effect: String,
    /// Its probability among single effects that begin within memory.
    pub probability: f64,
    /// Parameters of the likeliest way in which it enters, with estimates, standard deviations and units.
    pub parameters: Vec<Parameter>,
    /// It had begun by \[ns\].
    pub since_ns: i64,
}

/// One parameter and its change.
#[derive(Debug, Clone, PartialEq)]
pub struct Parameter {
    /// Its name.
    pub name: String,
    /// What it has become.
    pub estimate: f64,
    /// Standard deviation.
    pub stddev: f64,
    /// Unit, "1" for none.
    pub unit: String,
}

/// How well the model fits.
#[derive(Debug, Clone, PartialEq)]
pub struct Fit {
    /// End of the newest bin \[ns\].
    pub stamp_ns: i64,
    /// What the monitor says.
    pub state: State,
    /// Whitened residual of the newest bin: gyro; NaN where nothing was read.
    pub gyro: Vector3<f64>,
    /// The same of each wheel's speed.
    pub wheel_speed: Vec<f64>,
    /// Sum of squares of the whitened residuals since the last fit, and their number.
    pub squares: (f64, u32),
    /// ln of the running evidence against the model \[nats\].
    pub ln_evidence: f64,
    /// The likeliest single effect, once there is a mismatch.
    pub likeliest: Option<Likeliest>,
    /// What of the data was missing last, while the monitor waits.
    pub hole: Option<Hole>,
    /// How often something was missing.
    pub holes: u64,
}

impl Likeliest {
    /// Whether it is plain.
    #[must_use]
    pub fn is_plain(&self) -> bool {
        self.probability >= PLAIN
    }
}
