//! A recording as the filter follows it with a model.

use whorl_dynamics::PlatformModel;
use whorl_prediction::{Followed, Noise, Prepared, Settings, follow_as};
use whorl_prediction::{Needs, check};
use whorl_recording::Recording;

use crate::error::ValidationError;

/// The recording, ready for passes, with the noise that the model states and with what it shows; `known`: as a fit that ended with this
/// model has followed it.
pub(crate) fn followed<'a>(
    recording: &'a Recording,
    model: &'a PlatformModel,
    known: Option<&Followed>,
) -> Result<(Prepared<'a>, Noise, Followed), ValidationError> {
    check(recording, model, &Needs { shortest_s: 0.0, free: false, accelerometer: false })?;
    let case = Prepared::new(recording, model, Settings::default())?;
    let stated = Noise::stated(&case)?;
    let followed = follow_as(&case, &stated, known);
    Ok((case, stated, followed))
}
