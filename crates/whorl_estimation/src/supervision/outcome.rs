//! Outcomes of samples, and their counts.

use crate::kernels::DirectionMeasurement;
use nalgebra::{Unit, Vector3};
use std::fmt;

/// Why a sample was refused.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Rejection {
    /// NaN or infinite, or a direction of length zero.
    NotFinite,
    /// Beyond the credible range of the sensor.
    OutOfRange,
    /// The same values too often in a row.
    Frozen,
    /// The stamp of the previous sample again.
    DuplicateStamp,
    /// A stamp before the previous one.
    OutOfOrder,
    /// Older than the filter can still use.
    Late,
    /// A stamp further ahead of the IMU than the filter waits.
    TooEarly,
    /// A lone jump between samples.
    Spike,
    /// Unlikely under the estimate and its covariance; the normalised innovation squared.
    Outlier {
        /// Normalised innovation squared.
        nis: f64,
    },
    /// A specific force whose length is not that of gravity.
    NotGravity,
    /// The sensor does not apply: it is not configured, or its partner sample was refused.
    NotUsable,
    /// The sensor's axes turn against the gyro: one is reversed, or their order is wrong.
    Contradicted,
}

impl Rejection {
    /// Number of kinds.
    pub const KINDS: usize = 12;

    /// Stable index of the kind, below [`Self::KINDS`].
    #[must_use]
    pub fn kind(&self) -> usize {
        match self {
            Self::NotFinite => 0,
            Self::OutOfRange => 1,
            Self::Frozen => 2,
            Self::DuplicateStamp => 3,
            Self::OutOfOrder => 4,
            Self::Late => 5,
            Self::TooEarly => 6,
            Self::Spike => 7,
            Self::Outlier { .. } => 8,
            Self::NotGravity => 9,
            Self::NotUsable => 10,
            Self::Contradicted => 11,
        }
    }
}

impl fmt::Display for Rejection {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        let text = match self {
            Self::NotFinite => "not finite",
            Self::OutOfRange => "out of range",
            Self::Frozen => "frozen",
            Self::DuplicateStamp => "duplicate stamp",
            Self::OutOfOrder => "out of order",
            Self::Late => "late",
            Self::TooEarly => "too far ahead of the IMU",
            Self::Spike => "spike",
            Self::Outlier { nis } => return write!(formatter, "outlier (NIS {nis:.1})"),
            Self::NotGravity => "not the length of gravity",
            Self::NotUsable => "not usable",
            Self::Contradicted => "turns against the gyro",
        };
        formatter.write_str(text)
    }
}

/// Outcome of one sensor's sample.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum SampleOutcome {
    /// It corrected or propagated the estimate.
    Used,
    /// It went into the average of the start.
    Collected,
    /// It waits for the IMU sample that follows its stamp.
    Deferred,
    /// It was refused.
    Rejected(Rejection),
}

impl SampleOutcome {
    /// The reason, if it was refused.
    #[must_use]
    pub fn rejection(&self) -> Option<Rejection> {
        match self {
            Self::Rejected(rejection) => Some(*rejection),
            _ => None,
        }
    }
}

/// What [`crate::AttitudeBiasEstimator::on_imu`] did.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ImuOutcome {
    /// The gyro half.
    pub gyro: SampleOutcome,
    /// The accelerometer half.
    pub accelerometer: SampleOutcome,
    /// A vector sample that waited for this one.
    pub vector: Option<SampleOutcome>,
    /// Something larger that happened in this step.
    pub event: Option<FilterEvent>,
}

/// A direction that corrected the estimate, for a filter that runs in parallel.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct UsedDirection {
    /// Current body axes.
    pub(crate) direction_b: Unit<Vector3<f64>>,
    /// Variance about each axis across it \[rad^2\].
    pub(crate) variance: f64,
}

impl UsedDirection {
    /// With what it should be in the world.
    pub(crate) fn seen(&self, reference_w: Unit<Vector3<f64>>) -> DirectionMeasurement {
        DirectionMeasurement { direction_b: self.direction_b, reference_w, variance: self.variance }
    }
}

/// What a filter that runs in parallel takes from one inertial sample.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(crate) struct UsedSample {
    /// Time since the sample before \[s\].
    pub(crate) interval_s: f64,
    /// The vertical.
    pub(crate) vertical: Option<UsedDirection>,
    /// A direction of the vector sensor that waited for this sample.
    pub(crate) vector: Option<UsedDirection>,
}

/// Events worth logging.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum FilterEvent {
    /// The first attitude was found, with gravity and the vector sensor.
    StartedWithVector,
    /// The first attitude was found, with gravity and the initial heading parameter.
    StartedWithoutVector,
    /// The attitude restarts: the IMU was silent for too long.
    RestartedAfterGap,
    /// The attitude restarts: the accelerometer disagreed for too long.
    RestartedAfterOutliers,
    /// The attitude restarts: stamps went back and stayed back.
    RestartedAfterClockStep,
    /// The attitude restarts: a number was no longer finite.
    RestartedAfterDivergence,
    /// The heading restarts: the vector sensor disagreed for too long.
    HeadingForgotten,
    /// The vector sensor is used no more and the heading is unknown: its axes turn against the gyro.
    VectorContradicted,
    /// The accelerometer is used no more and the inclination is doubtful: its axes turn against the gyro.
    AccelerometerContradicted,
}

/// Refused samples of one sensor, by kind.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct RejectionCounts {
    by_kind: [u32; Rejection::KINDS],
}

impl RejectionCounts {
    pub(crate) fn add(&mut self, rejection: Rejection) {
        if let Some(count) = self.by_kind.get_mut(rejection.kind()) {
            *count = count.saturating_add(1);
        }
    }

    /// How many of this kind (the value inside `Outlier` does not matter).
    #[must_use]
    pub fn of(&self, rejection: Rejection) -> u32 {
        self.by_kind.get(rejection.kind()).copied().unwrap_or(0)
    }

    /// All kinds together.
    #[must_use]
    pub fn total(&self) -> u32 {
        self.by_kind.iter().fold(0, |sum, count| sum.saturating_add(*count))
    }
}
