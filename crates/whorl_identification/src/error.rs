//! Why recordings cannot be diagnosed.

use thiserror::Error;
use whorl_dynamics::effects::RegisterError;
use whorl_dynamics::effects::written::DefinitionError;
use whorl_dynamics::{EffectError, GyrostatError};
use whorl_prediction::PredictionError;
use whorl_recording::Refusal;

/// Why recordings cannot be diagnosed, with advice.
#[derive(Debug, Clone, PartialEq, Error)]
pub enum DiagnosisError {
    /// No recording was given.
    #[error("no recording was given; name at least one run")]
    NoRecording,
    /// The recording cannot be used.
    #[error(transparent)]
    Refused(#[from] Refusal),
    /// Data of another platform.
    #[error("{run}: {what}: the data and the model belong to different platforms; check --model")]
    OtherPlatform {
        /// Name of the run.
        run: String,
        /// What does not fit.
        what: String,
    },
    /// An id that is not in the catalogue.
    #[error("there is no effect \"{0}\"; `whorl effects` lists them")]
    UnknownEffect(String),
    /// The data demand the wrong sign of the effect, or contain no information about it.
    #[error("{0} explains nothing in these recordings: its estimate is zero, or its channels are missing")]
    NoEffect(String),
    /// The model is not physical.
    #[error(transparent)]
    Model(#[from] GyrostatError),
    /// An effect of the model is not physical.
    #[error(transparent)]
    Effect(#[from] EffectError),
    /// A recording cannot be predicted.
    #[error(transparent)]
    Prediction(#[from] PredictionError),
    /// A law that a search made is no equation.
    #[error("a term of the search is wrong: {0}")]
    Term(#[from] DefinitionError),
    /// An effect of the catalogue has the id of a law that was found.
    #[error(transparent)]
    Taken(#[from] RegisterError),
}

pub(crate) type Outcome<T> = Result<T, DiagnosisError>;

impl DiagnosisError {
    /// What came of a trial; `None` where no platform can be as it was tried, or none that moves so: that ends the trial, not the diagnosis.
    pub(crate) fn possible<T>(result: Result<T, Self>) -> Result<Option<T>, Self> {
        match result {
            Ok(found) => Ok(Some(found)),
            Err(
                Self::Model(_)
                | Self::Effect(_)
                | Self::Prediction(
                    PredictionError::Model(_) | PredictionError::Plant(_) | PredictionError::NoModel,
                ),
            ) => Ok(None),
            Err(error) => Err(error),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_trial_that_no_platform_can_be_ends_the_trial_alone() {
        for error in [GyrostatError::NothingLeft.into(), PredictionError::NoModel.into()] {
            assert_eq!(DiagnosisError::possible::<()>(Err(error)), Ok(None));
        }
        assert_eq!(
            DiagnosisError::possible::<()>(Err(DiagnosisError::NoRecording)),
            Err(DiagnosisError::NoRecording)
        );
    }
}
