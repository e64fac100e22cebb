//! What a monitor is told beside the platform's model, and what it says.

use whorl_dynamics::PlatformModel;
use whorl_recording::Component;

/// Angular acceleration of a background torque that nobody would miss in a model [rad/s^2]: a tenth of a usual disturbance's, 5 mN m at 8.6 kg m^2.
const BACKGROUND_RAD_S2: f64 = 5.8e-5;
/// A break of the model is looked for from every multiple of this on \[s\].
pub(crate) const START_EVERY_S: f64 = 40.0;

/// Settings of a monitor.
#[derive(Debug, Clone, PartialEq)]
pub struct Settings {
    /// False alarms in an hour at most, in the mean, > 0.
    pub false_alarms_per_h: f64,
    /// Slow torque that the model need not know, standard deviation about each axis [N m].
    pub background_torque_n_m: f64,
}

impl Settings {
    /// Those of a platform.
    pub fn of(model: &PlatformModel) -> Self {
        let inertia_kg_m2 = model.mass_properties.inertia_b_kg_m2().trace() / 3.0;
        Self { false_alarms_per_h: 0.1, background_torque_n_m: BACKGROUND_RAD_S2 * inertia_kg_m2 }
    }

    /// The evidence that is an alarm \[nats\]. The sum of likelihood ratios over all starts less their number is a martingale while the model is right:
    /// it reaches c after c starts or more in the mean (Shiryaev 1963, Roberts 1966; composite hypotheses: Shin, Ramdas and Rinaldo 2023, theorem 2.4).
    pub fn limit_nats(&self) -> f64 {
        (3600.0 / START_EVERY_S / self.false_alarms_per_h).max(1.0).ln()
    }
}

/// What the monitor says.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub enum State {
    /// Not enough to say anything yet, or nobody moves the platform.
    #[default]
    Waiting,
    /// The platform moves as its model says.
    Agrees,
    /// The evidence is half-way to the limit.
    Doubt,
    /// The platform no longer moves as its model says.
    Mismatch,
}

/// The effect that explains a mismatch best.
#[derive(Debug, Clone, PartialEq)]
pub struct Likeliest {
    /// Id in the catalogue, or `unknown_torque`.
    pub effect: String,
    /// Its probability among single effects that begin within memory.
    pub probability: f64,
    /// Parameters of the likeliest way in which it enters: name, value and standard deviation, and unit, "1" for none.
    pub parameters: Vec<(String, [f64; 2], &'static str)>,
    /// It had begun by \[ns\].
    pub since_ns: i64,
}

/// How well the model fits.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Fit {
    /// End of the newest cell \[ns\]; `None` before the first.
    pub stamp_ns: Option<i64>,
    /// What the monitor says.
    pub state: State,
    /// Whitened residuals of the newest cell: of gyro and wheel speeds, as far as they were read.
    pub whitened: Vec<(Component, f64)>,
    /// Sum of squares of the whitened residuals since the last fit, and their number.
    pub squares: (f64, u32),
    /// ln of the running evidence against the model \[nats\].
    pub ln_evidence: f64,
    /// The likeliest single effect, once there is a mismatch.
    pub likeliest: Option<Likeliest>,
    /// What of the data was missing last, while the monitor waits.
    pub hole: Option<String>,
    /// How often something was missing.
    pub holes: u64,
}
