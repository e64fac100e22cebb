//! Noise that a hypothesis expects beside what the model states: a gyro's bias that walks, a slow random torque, and noise
//! of the wheels' torques.
//!
//! All exist in any laboratory, at an unknown size. Each set of explanations is evaluated with the sizes that are
//! likeliest beside it, so that a missing effect must explain what no noise of this kind explains. Sizes are steps of a
//! factor of three: with finer steps the noise would fit the misspecification leakage of a set that explains the data.
//! A correlation time that is wrong by a factor of three would leave slower, or faster, residuals to other explanations.

/// Factor from size to size.
pub(crate) const STEP: f64 = 3.0;

/// Sizes of each kind beside none.
const SIZES: u8 = 12;

/// Size at which a kind of noise begins to show.
const SHOWS: u8 = 3;

/// Initial guess of the size of each kind.
const SOME: u8 = 6;

/// Correlation times of a slow random torque, as shares of the whitening filter's memory, slowest first.
pub(crate) const CORRELATION_TIMES: [f64; 3] = [1.0, 0.316_227_766_016_837_94, 0.1];

/// The fastest of them.
const FASTEST: u8 = CORRELATION_TIMES.len() as u8 - 1;

/// A bias that does not walk: it would show after so long \[s\].
const STEADY_S: f64 = 1e4;

/// Sizes of the noise beside what the model states, as steps: 0 = there is none.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Default)]
pub(crate) struct Nuisance {
    /// Walk of the gyro's bias.
    pub bias: u8,
    /// Slow random torque.
    pub torque: u8,
    /// Noise of the wheels' torques.
    pub wheel: u8,
    /// Its correlation time: index into [`CORRELATION_TIMES`].
    pub correlation_time: u8,
}

impl Nuisance {
    /// Log prior: each kind is absent in half of all cases, and else of any size.
    pub fn log_prior(self) -> f64 {
        let of_kind = |step: u8, choices: f64| if step == 0 { 0.5f64.ln() } else { (0.5 / choices).ln() };
        of_kind(self.bias, f64::from(SIZES))
            + of_kind(self.torque, CORRELATION_TIMES.len() as f64 * f64::from(SIZES))
            + of_kind(self.wheel, f64::from(SIZES))
    }

    /// Walk of a gyro's bias [rad/s/sqrt(s)], for a gyro of this noise density [rad/s sqrt(s)]; the slowest shows above it after so long \[s\].
    pub fn gyro_bias_walk(self, density: f64, shows_after_s: f64) -> f64 {
        match self.bias {
            0 => density / STEADY_S,
            step => density / shows_after_s * STEP.powi(i32::from(step) - 1),
        }
    }

    /// Initial guesses of the likeliest noise: here, and where there is noise, also without any, and with some of each
    /// kind. A large torque hides that the wheels have noise, and no single step leads from there.
    pub fn starts(self) -> Vec<Self> {
        let mut all = vec![self];
        if self.torque > 0 || self.wheel > 0 {
            let kinds = [(0, 0), (SOME, 0), (SOME, FASTEST)];
            let of_kind = |(torque, correlation_time)| {
                [0, SOME].map(|wheel| Self { torque, correlation_time, wheel, ..self })
            };
            all.extend(kinds.into_iter().flat_map(of_kind));
        }
        all
    }

    /// What is one step away. Where a kind is absent the likelihood is flat, up to where it begins to show.
    pub fn neighbours(self, has_body: bool, has_wheels: bool) -> Vec<Self> {
        let steps = |at: u8| match at {
            0 => vec![SHOWS],
            at => vec![at - 1, (at + 1).min(SIZES)],
        };
        let mut all: Vec<Self> = Vec::new();
        if has_wheels {
            all.extend(steps(self.wheel).into_iter().map(|wheel| Self { wheel, ..self }));
        }
        if !has_body {
            return all;
        }
        all.extend(steps(self.torque).into_iter().map(|torque| Self { torque, ..self }));
        if self.torque > 0 {
            let correlation_times = [
                self.correlation_time.checked_sub(1),
                Some(self.correlation_time + 1).filter(|correlation_time| *correlation_time <= FASTEST),
            ];
            all.extend(
                correlation_times
                    .into_iter()
                    .flatten()
                    .map(|correlation_time| Self { correlation_time, ..self }),
            );
        }
        all.extend(steps(self.bias).into_iter().map(|bias| Self { bias, ..self }));
        for other in &mut all {
            if other.torque == 0 {
                other.correlation_time = 0;
            }
        }
        all
    }
}
