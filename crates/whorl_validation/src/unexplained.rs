//! What pushed a platform beside its model, over a run.

use nalgebra::{Matrix3, Vector3};
use whorl_dynamics::PlatformModel;
use whorl_math::noise::typical_step_s;
use whorl_prediction::{
    Disturbance, Followed, Needs, Noise, Prepared, Settings, SmoothedState, check, follow, smoothed,
};
use whorl_recording::Recording;

use crate::error::ValidationError;
use crate::remarks::remarks;

/// Time between estimates \[s\], and so many readings of what is read fastest: the torque is taken to change within a second.
const EVERY_S: f64 = 0.1;
const EVERY_READINGS: f64 = 10.0;
/// Share of the largest variance below which a direction is one in which nothing can push.
const NOTHING: f64 = 1e-12;

/// Torques that a model does not have, over a run, as the smoothed disturbance of the filter that predicts the run
/// ([`whorl_prediction::smoothed`]) shows them.
#[derive(Debug, Clone, PartialEq)]
pub struct UnexplainedTorques {
    /// Name of the run.
    pub run: String,
    /// Motion and torques with their deviations.
    pub states: Vec<SmoothedState>,
    /// How large such torques are, as the run shows it; none where they make the run hardly likelier.
    pub levels: Disturbance,
    /// What limits the answer, one sentence each.
    pub remarks: Vec<String>,
}

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
    let known = known.filter(|known| known.is_of(&case)).cloned();
    let followed = known.unwrap_or_else(|| follow(&case, &stated));
    Ok((case, stated, followed))
}

/// The torques that `model` does not explain in a recording; `known` is the run as a fit that ended with this model has followed it, if one
/// has. The model is not refitted: the error of a wrong inertia counts as torque unless the platform's own parameters were refitted to
/// the run before.
///
/// # Errors
/// If the recording cannot be used, with advice: see [`ValidationError`].
pub fn unexplained_torques(
    recording: &Recording,
    model: &PlatformModel,
    known: Option<&Followed>,
) -> Result<UnexplainedTorques, ValidationError> {
    let (case, stated, followed) = followed(recording, model, known)?;
    let read = [&recording.gyro_b_rad_s.time_s, &recording.wheel_speed_rad_s.time_s];
    let steps = read.into_iter().filter(|times| times.len() > 1).map(|times| typical_step_s(times));
    let every_s = EVERY_S.min(EVERY_READINGS * steps.fold(f64::INFINITY, f64::min));
    let states = smoothed(&case, &followed.noise, &followed.fitted.start, every_s);
    Ok(UnexplainedTorques {
        run: recording.name.clone(),
        states: states.ok_or_else(|| ValidationError::Lost { run: recording.name.clone() })?,
        remarks: remarks(&case, &followed.noise, &stated),
        levels: followed.noise.disturbance,
    })
}

impl UnexplainedTorques {
    /// Covariance of the noise of the torque on the body at each instant, body axes [N^2 m^2]. An estimate with the covariance P of a
    /// torque of the covariance S is (S - P) S^-1 of it and noise of covariance P - P S^-1 P.
    #[must_use]
    pub fn noise_of_body(&self, model: &PlatformModel) -> Vec<Matrix3<f64>> {
        let free = model.freedom.projection();
        let level = Vector3::from(self.levels.body_stddev_b_n_m());
        let before = free * Matrix3::from_diagonal(&level.component_mul(&level)) * free.transpose();
        let scale = before.amax();
        let inverse = (before / scale).pseudo_inverse(NOTHING).unwrap_or_else(|_| Matrix3::zeros()) / scale;
        let noise = |state: &SmoothedState| {
            let p = &state.torque_covariance_b;
            p - p * inverse * p
        };
        if scale > 0.0 {
            self.states.iter().map(noise).collect()
        } else {
            vec![Matrix3::zeros(); self.states.len()]
        }
    }

    /// The torque of one wheel's motor with the standard deviation of its noise [N m]; empty where there is none.
    #[must_use]
    pub fn motor(&self, wheel: usize) -> Vec<(f64, f64)> {
        let Some(level) = self.levels.motors_n_m.get(wheel).filter(|level| **level > 0.0) else {
            return Vec::new();
        };
        let at = |state: &SmoothedState| {
            let (torque, stddev) =
                (state.motor_torque_n_m.get(wheel)?, state.motor_torque_stddev_n_m.get(wheel)?);
            Some((*torque, stddev * (1.0 - (stddev / level).powi(2)).max(0.0).sqrt()))
        };
        self.states.iter().map_while(at).collect()
    }
}
