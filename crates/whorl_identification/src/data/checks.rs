//! What is wrong with a recording, in sentences.

use thiserror::Error;

/// Why a recording cannot be used at all.
#[derive(Debug, Clone, PartialEq, Error)]
pub enum DataError {
    /// No recording, or one without gyro samples.
    #[error(
        "{run}: no rate gyro samples were recorded; identification needs at least gyro and accelerometer"
    )]
    NoGyro {
        /// Which run.
        run: String,
    },
    /// No accelerometer.
    #[error(
        "{run}: no accelerometer samples were recorded; without the direction of gravity neither the gravity offset nor the bias of the gyro can be told"
    )]
    NoAccelerometer {
        /// Which run.
        run: String,
    },
    /// Held in a clamp.
    #[error("{run}: the platform was clamped; mass properties show only on the bearing")]
    Clamped {
        /// Which run.
        run: String,
    },
    /// Too short.
    #[error("{run}: only {usable_s:.1} s without gap; at least {needed_s:.0} s are needed")]
    TooShort {
        /// Which run.
        run: String,
        /// Longest uninterrupted stretch \[s\].
        usable_s: f64,
        /// Needed \[s\].
        needed_s: f64,
    },
    /// Another number of wheels or jets than the model.
    #[error("{run}: {given} {what} recorded, the model has {expected}")]
    Count {
        /// Which run.
        run: String,
        /// wheels or jets.
        what: &'static str,
        /// In the recording.
        given: usize,
        /// In the model.
        expected: usize,
    },
    /// The model is not a possible platform.
    #[error("the model cannot be simulated: {0}")]
    Model(String),
    /// The data contradict the model in a way that is understood.
    #[error("{0}")]
    Refused(String),
    /// The fit did not succeed.
    #[error("the fit did not converge: {0}")]
    NotConverged(String),
}

/// Something a user must know about the data or the result: one plain sentence.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Finding {
    /// Whether the result must not be used because of it.
    pub fatal: bool,
    /// The sentence.
    pub text: String,
}

impl Finding {
    /// A warning.
    #[must_use]
    pub fn warning(text: String) -> Self {
        Self { fatal: false, text }
    }

    /// A reason not to use the result.
    #[must_use]
    pub fn fatal(text: String) -> Self {
        Self { fatal: true, text }
    }
}
