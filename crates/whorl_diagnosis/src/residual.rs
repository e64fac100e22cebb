//! The torque that the model does not explain.

use nalgebra::{UnitQuaternion, Vector3};
use whorl_dynamics::{ModelPrior, PlatformModel};
use whorl_recording::Recording;

use crate::DiagnosisError;
use crate::columns::predict;
use crate::filter::{Settings, System, WHEEL};
use crate::mechanics::Mechanics;
use crate::parameters::Reference;
use crate::problem::Problem;
use crate::step::base_point;

/// Torque on the body that the model does not explain, smoothed from a whole recording as a random walk,
/// with the motion along which it acted. All vectors have the same length.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct ResidualTorque {
    /// Time since the start of the run \[s\].
    pub time_s: Vec<f64>,
    /// The torque, body axes [N m].
    pub torque_b_n_m: Vec<Vector3<f64>>,
    /// Its standard deviation per axis [N m]; neighbours are correlated over about `memory_s`.
    pub stddev_b_n_m: Vec<Vector3<f64>>,
    /// Time over which the smoother averages \[s\].
    pub memory_s: f64,
    /// Smoothed attitude, v_world = q v_body.
    pub q_world_body: Vec<UnitQuaternion<f64>>,
    /// Smoothed rate, body axes [rad/s].
    pub omega_wb_b_rad_s: Vec<Vector3<f64>>,
    /// Smoothed wheel speeds [rad/s].
    pub wheel_speed_rad_s: Vec<Vec<f64>>,
    /// Share of each interval that each jet was open.
    pub jet_open: Vec<Vec<f64>>,
    /// Tank pressure \[Pa\], measured, else as the model predicts.
    pub tank_pressure_pa: Vec<f64>,
    /// Bus voltage \[V\], measured, else as the model predicts.
    pub bus_voltage_v: Vec<f64>,
    /// Temperature \[K\], measured, else as the model predicts.
    pub temperature_k: Vec<f64>,
}

/// Random-walk intensities of the torque that compete [N m/sqrt(s)].
const WALKS_N_M_SQRT_S: [f64; 6] = [1e-4, 3e-4, 1e-3, 3e-3, 1e-2, 3e-2];

/// Smooths the torque that `model` does not explain out of a recording. The platform's own parameters are
/// first refitted within the typical prior: what a wrong inertia does is no missing torque.
///
/// # Errors
/// When the motion cannot be reconstructed: no gyro, too short, clamped, another platform's data.
pub fn residual_torque(
    recording: &Recording,
    model: &PlatformModel,
) -> Result<ResidualTorque, DiagnosisError> {
    if recording.mounting == whorl_recording::Mounting::Clamped {
        return Err(DiagnosisError::MissingChannel {
            run: recording.name.clone(),
            channel: "body motion",
            help: "the platform was clamped, so no torque on it can be seen",
        });
    }
    let reference = Reference::new(model, &ModelPrior::typical(model));
    let mut problem = Problem::new(std::slice::from_ref(recording), reference, recording.duration_s(), 1)?;
    let point = base_point(&mut problem)?;
    let mechanics = Mechanics::new(&problem.reference.model_at(&point)?)?;
    let (Some(run), Some(motion)) = (problem.runs.first(), problem.motions.first()) else {
        return Err(DiagnosisError::NoRecording);
    };
    let (inputs, prediction) = predict(&mechanics, run, motion);
    let system = |torque_walk: f64| System {
        run,
        motion,
        mechanics: &mechanics,
        prediction: &prediction,
        settings: Settings { torque_walk, ..problem.settings(0) },
    };
    let linear = system(WALKS_N_M_SQRT_S[0]).linear();
    let mut best = (f64::NEG_INFINITY, WALKS_N_M_SQRT_S[0]);
    for walk in WALKS_N_M_SQRT_S {
        let log_likelihood = system(walk).log_likelihood(&linear);
        if log_likelihood > best.0 {
            best = (log_likelihood, walk);
        }
    }
    let smoothed = system(best.1).smoothed(&linear);
    let wheels = mechanics.model().wheels().len();
    let torque = WHEEL + wheels;
    let mut result = ResidualTorque {
        time_s: run.times.node_s.clone(),
        tank_pressure_pa: run.pressure_pa.clone(),
        bus_voltage_v: run.voltage_v.clone(),
        temperature_k: run.temperature_k.clone(),
        ..ResidualTorque::default()
    };
    // The rate's noise over the torque's walk sets how long the smoother averages.
    let inertia = mechanics.model().mass_properties.inertia_b_kg_m2().diagonal().mean();
    let density = problem.settings(0).rate_walk * crate::problem::MEMORY_S;
    result.memory_s = (inertia * density / best.1).sqrt();
    let mut motion = motion.clone();
    for (k, state) in smoothed.state.chunks_exact(linear.n).enumerate() {
        let part = |first: usize| Vector3::new(state[first], state[first + 1], state[first + 2]);
        motion.correct(k, &part(0), &part(3), &state[WHEEL..WHEEL + wheels]);
        result.torque_b_n_m.push(part(torque));
    }
    result.stddev_b_n_m = smoothed
        .torque_variance
        .chunks_exact(3)
        .map(|v| Vector3::new(v[0], v[1], v[2]).map(f64::sqrt))
        .collect();
    result.jet_open = (0..run.nodes()).map(|k| inputs.jets_at(k).to_vec()).collect();
    result.wheel_speed_rad_s =
        motion.wheel.iter().map(|w| w.iter().copied().take(wheels).collect()).collect();
    result.q_world_body = motion.q;
    result.omega_wb_b_rad_s = motion.omega;
    Ok(result)
}
