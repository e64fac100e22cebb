//! Which readings may be taken in together where models of a platform are fitted and compared.

use whorl_dynamics::PlatformModel;
use whorl_recording::Recording;

use crate::cells::{SHARE_OF_MOTION_RAD, SHARE_OF_TIME};
use crate::error::PredictionError;
use crate::levels::times_s;
use crate::prepared::Prepared;
use crate::settings::Settings;

/// The longest time of which readings may be taken in together, [`Settings::cell_s`], up to that of the settings \[s\]: a quarter of a radian of the fastest
/// motion, and a sixth of the shortest time of a random torque that the recordings show. None where only wheels move: their friction holds them and lets go between one reading
/// and the next.
///
/// # Errors
/// See [`PredictionError`].
pub fn longest_cell_s(
    recordings: &[Recording],
    model: &PlatformModel,
    settings: &Settings,
) -> Result<f64, PredictionError> {
    let each = Settings { cell_s: 0.0, ..*settings };
    recordings.iter().try_fold(settings.cell_s, |longest_s, recording| {
        let case = Prepared::new(recording, model, each)?;
        if case.is_clamped() {
            return Ok(0.0);
        }
        let shortest_s = times_s(&case).iter().copied().fold(f64::INFINITY, f64::min);
        Ok(longest_s.min(SHARE_OF_TIME * shortest_s).min(SHARE_OF_MOTION_RAD / case.fastest_1_s().max(1e-9)))
    })
}
