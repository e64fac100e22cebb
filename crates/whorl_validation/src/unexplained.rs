//! What pushed a platform beside its model, over a run.

use nalgebra::{Matrix3, Vector3};
use whorl_dynamics::{Freedom, PlatformModel};
use whorl_math::noise::typical_step_s;
use whorl_prediction::{
    CELL_S, Disturbance, Followed, Noise, PredictionError, Prepared, Settings, SmoothedState, follow,
    longest_cell_s, smoothed,
};
use whorl_recording::{Needs, Recording, Refusal, Why, check};

use crate::dependence::Residual;
use crate::remarks::remarks;

/// Time between estimates \[s\], and so many readings of what is read fastest: the torque is taken to change within a second.
const EVERY_S: f64 = 0.1;
const EVERY_READINGS: f64 = 10.0;
/// Share of the largest variance below which a direction is one in which nothing can push.
const NOTHING: f64 = 1e-12;

/// Torques that a model does not have, over a run: the smoothed disturbance ([`whorl_prediction::smoothed`]) of the filter that predicts it.
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

/// The recording, ready for passes, with the noise that the model states and what the run shows of it, if not `known`.
pub(crate) fn followed<'a>(
    recording: &'a Recording,
    model: &'a PlatformModel,
    known: Option<&Followed>,
) -> Result<(Prepared<'a>, Noise, Followed), PredictionError> {
    check(recording, model, &Needs { shortest_s: 0.0, free: false, accelerometer: false })?;
    let case = Prepared::new(recording, model, Settings::default())?;
    let stated = Noise::stated(&case)?;
    if let Some(known) = known.filter(|of| of.is_of(&case)) {
        return Ok((case, stated, known.clone()));
    }
    // Levels and start are those of means of readings, as they are where models are fitted.
    let longest = Settings { cell_s: CELL_S, ..Settings::default() };
    let cell_s = longest_cell_s(std::slice::from_ref(recording), model, &longest)?;
    let by_cells = Prepared::new(recording, model, Settings { cell_s, ..longest })?;
    let followed = follow(&by_cells, &stated);
    Ok((case, stated, followed))
}

/// The torques that `model` does not explain in a recording; `known` is the run as a fit that ended with this model has followed it, if one
/// has. The error of a wrong inertia counts as torque unless the platform's own parameters were refitted to the run before.
///
/// # Errors
/// If the recording cannot be used, with advice.
pub fn unexplained_torques(
    recording: &Recording,
    model: &PlatformModel,
    known: Option<&Followed>,
) -> Result<UnexplainedTorques, PredictionError> {
    let (case, stated, followed) = followed(recording, model, known)?;
    let read = [&recording.gyro_b_rad_s.time_s, &recording.wheel_speed_rad_s.time_s];
    let steps = read.into_iter().filter(|times| times.len() > 1).map(|times| typical_step_s(times));
    let every_s = EVERY_S.min(EVERY_READINGS * steps.fold(f64::INFINITY, f64::min));
    let run = recording.name.clone();
    let states = smoothed(&case, &followed.noise, &followed.fitted.start, every_s);
    Ok(UnexplainedTorques {
        states: states.ok_or_else(|| Refusal { run: run.clone(), why: Why::Lost })?,
        run,
        remarks: remarks(&case, &followed.noise, &stated),
        levels: followed.noise.disturbance,
    })
}

impl UnexplainedTorques {
    /// Adds what pushed the body: an estimate of covariance P of a torque of covariance S is (S - P) S^-1 of it and noise of P - P S^-1 P.
    pub(crate) fn on_body(&self, freedom: &Freedom, to: &mut Residual) {
        let level = Vector3::from(self.levels.body_stddev_b_n_m());
        let free = freedom.projection();
        let before = free * Matrix3::from_diagonal(&level.component_mul(&level)) * free.transpose();
        let scale = before.amax();
        if scale <= 0.0 {
            return;
        }
        let inverse = (before / scale).pseudo_inverse(NOTHING).unwrap_or_default() / scale;
        for state in &self.states {
            let (torque, p) = (&state.torque_b_n_m, &state.torque_covariance_b);
            let noise = p - p * inverse * p;
            if let Some(axis) = freedom.hinge_axis_b() {
                to.push_about_one((axis.dot(torque), axis.dot(&(noise * *axis)).max(0.0).sqrt()));
            } else {
                to.push_on_body(torque, &noise, state.q_world_body.to_rotation_matrix().matrix());
            }
        }
    }

    /// The same of one wheel's motor.
    pub(crate) fn of_motor(&self, wheel: usize, to: &mut Residual) {
        let level = self.levels.motors_n_m.get(wheel).filter(|level| **level > 0.0);
        for (state, level) in self.states.iter().zip(level.into_iter().cycle()) {
            let of = state.motor_torque_n_m.get(wheel).zip(state.motor_torque_stddev_n_m.get(wheel));
            of.into_iter().for_each(|(torque, stddev)| {
                to.push_about_one((*torque, stddev * (1.0 - (stddev / level).powi(2)).max(0.0).sqrt()));
            });
        }
    }
}
