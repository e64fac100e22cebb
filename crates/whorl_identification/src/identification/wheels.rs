//! Wheels whose measured speeds or spin axes have the wrong sign. Another unit of the speeds shows beside their commands when a recording is
//! read ([`Recording::contradictions`]).

use whorl_dynamics::PlatformModel;
use whorl_prediction::{PredictionError, Rival, Settings, fit};
use whorl_recording::{Finding, Recording};

/// By how much likelier another sign must make the readings [natural logarithm]: a hundred thousand to one, as a wheel is accused.
const NEEDED_NATS: f64 = 11.5;

/// The wheel whose other sign makes the readings likelier than all that was fitted, `log_fitted` [natural logarithm], and likelier than that of
/// the others: of its spin axis, or of its speeds alone where commands have the right one.
///
/// # Errors
/// See [`PredictionError`].
pub(super) fn check(
    recordings: &[Recording],
    model: &PlatformModel,
    log_fitted: f64,
    settings: &Settings,
) -> Result<Option<Finding>, PredictionError> {
    let log = |recordings: &[Recording], model: &PlatformModel| -> Result<f64, PredictionError> {
        Ok(fit(recordings, &[], &|_| Some(model.clone()), &[Vec::new()], Rival::NONE, settings)?
            .log_posterior)
    };
    let mut likeliest = (log_fitted + NEEDED_NATS, None);
    for (j, wheel) in model.wheels().iter().enumerate() {
        let mut turned = model.clone();
        turned.wheels_mut()[j].spin_axis_b = -wheel.spin_axis_b;
        let mut reversed = recordings.to_vec();
        let speeds = reversed.iter_mut().flat_map(|run| &mut run.wheel_speed_rad_s.value);
        speeds.filter_map(|speeds| speeds.get_mut(j)).for_each(|speed| *speed = -*speed);
        let log = log(recordings, &turned)?.max(log(&reversed, model)?);
        if log > likeliest.0 {
            likeliest = (log, Some(&wheel.name));
        }
    }
    let said = |name: &String| {
        format!(
            "{name} turns the body the wrong way: the sign of its measured speed or of its spin axis in the model is wrong; nothing else can be trusted until that is corrected."
        )
    };
    Ok(likeliest.1.map(said).map(Finding::fatal))
}
