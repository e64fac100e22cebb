//! Prediction errors by channel and horizon.

mod absolute;
mod channels;
mod gaps;
mod words;

pub use absolute::{Absolute, InputCorrelation, Whiteness};
pub use channels::{ChannelErrors, HorizonError, Overlay};
pub use whorl_recording::Channel;

use serde::Serialize;
use whorl_dynamics::{Freedom, Gyrostat, PlatformModel};
use whorl_recording::{Mounting, Recording};

use channels::Errors;

use crate::error::ValidationError;
use crate::noise_floor::{NoiseFloors, StillSearch};
use crate::prediction::Simulator;
use whorl_trajectory::commands::Commands;
use whorl_trajectory::smoothing::{Motion, SmoothedMotion, smooth};
use whorl_trajectory::{Needs, check};

/// Prediction horizons \[s\], in addition to the whole run.
pub const HORIZONS_S: [f64; 3] = [0.1, 1.0, 10.0];

/// Predictions are compared this much at a time \[s\]: all of them at once would need many times the memory of the
/// recording.
const CHUNK_S: f64 = 10.0;

/// How the initial state of every prediction is determined, to be printed with the numbers.
pub const INITIAL_STATE_RULE: &str = "each prediction starts from the smoothed state at its first instant: attitude by \
     gyro, accelerometer and vector sensor of the whole run (no torques of the model), rate and wheel speeds by \
     removing the change that the model predicts and averaging over half a second to either side; gyro and accelerometer \
     biases estimated once per run; from there on, the model is driven by the recorded commands alone";

/// A recording against a model.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Comparison {
    /// Name of the run.
    pub run: String,
    /// Length \[s\].
    pub duration_s: f64,
    /// Samples of the gyro (clamped platform: of the wheels) per second \[Hz\].
    pub rate_hz: f64,
    /// Errors of every channel.
    pub channels: Vec<ChannelErrors>,
    /// Test against noise alone.
    pub absolute: Option<Absolute>,
    /// Whiteness of each channel's residual after fitting the initial states.
    pub whiteness: Vec<Whiteness>,
    /// Whether a controller was running.
    pub closed_loop: bool,
    /// Gyro bias beyond the model's, as estimated [rad/s].
    pub gyro_bias_rad_s: [f64; 3],
    /// Consequences of missing channels, and other remarks, one sentence each.
    pub remarks: Vec<String>,
    /// Curves for plots; not part of the JSON.
    #[serde(skip)]
    pub overlays: Vec<Overlay>,
}

/// Compares a recording with a model.
///
/// # Errors
/// If no comparison is possible, with advice: see [`ValidationError`].
pub fn compare(recording: &Recording, model: &PlatformModel) -> Result<Comparison, ValidationError> {
    check(recording, model, &Needs { shortest_s: 0.0, free: false, accelerometer: false })?;
    let gyrostat = Gyrostat::new(model)?;
    let commands = Commands::of(recording, &gyrostat);
    let motion = smooth(recording, &gyrostat, &commands);
    let simulator = Simulator::new(
        model,
        recording,
        &commands,
        motion.attitude.gyro_bias_rad_s,
        motion.attitude.accelerometer_bias_m_s2,
    )?;
    let start = |time_s: f64| -> Motion { motion.at(time_s) };
    let duration_s = recording.duration_s();
    let horizons: Vec<Option<f64>> =
        HORIZONS_S.iter().copied().filter(|h| *h < duration_s).map(Some).chain([None]).collect();
    let mut errors = Errors::new(recording, gyrostat.model(), &simulator, &horizons);
    let mut still = StillSearch::new(gyrostat.model());
    for (h, horizon_s) in horizons.iter().enumerate() {
        let mut walk = simulator.walk(*horizon_s);
        while let Some(from_s) = walk.time_s() {
            let predicted = walk.next(|t| t < from_s + CHUNK_S, &start);
            let measured = simulator.measured(&predicted);
            errors.add(h, &measured, &predicted);
            // The shortest shows best where the platform is still.
            if h == 0 {
                still.add(&simulator, &measured, &predicted);
            }
        }
    }
    let floors = still.floors();
    let (channels, overlays) = errors.finish(&floors);
    let tested = absolute::test(recording, gyrostat.model(), &simulator, &start, &floors, &commands);
    let (absolute, residuals) = tested.unzip();
    let whiteness = residuals.map_or_else(Vec::new, |residuals| residuals.tests(recording.closed_loop));
    let times = if recording.gyro_b_rad_s.is_empty() {
        &recording.wheel_speed_rad_s.time_s
    } else {
        &recording.gyro_b_rad_s.time_s
    };
    Ok(Comparison {
        run: recording.name.clone(),
        duration_s,
        rate_hz: times.len().saturating_sub(1) as f64 / duration_s,
        remarks: remarks(recording, model, &commands, &motion, &floors),
        channels,
        absolute,
        whiteness,
        closed_loop: recording.closed_loop,
        gyro_bias_rad_s: motion.attitude.gyro_bias_rad_s.into(),
        overlays,
    })
}

fn remarks(
    recording: &Recording,
    model: &PlatformModel,
    commands: &Commands<'_>,
    motion: &SmoothedMotion,
    floors: &NoiseFloors,
) -> Vec<String> {
    let (freedom, has_jets) = (&model.freedom, !model.jets().is_empty());
    let mut remarks = Vec::new();
    let mut say = |text: &str| remarks.push(text.to_owned());
    let clamped = recording.mounting == Mounting::Clamped || !freedom.turns();
    if commands.wheel_torque_from_speed {
        say(
            "The wheels' torque commands were not recorded: the model's wheels are driven along their measured speeds, so errors of the wheels themselves do not show.",
        );
    }
    if !clamped && recording.wheel_speed_rad_s.is_empty() && !recording.wheel_torque_command_n_m.is_empty() {
        say("The wheels' speeds were not recorded: they are assumed to start at rest.");
    }
    if *freedom == Freedom::OnBearing && !clamped && recording.specific_force_b_m_s2.is_empty() {
        say(
            "The accelerometer was not recorded: the platform is assumed to stay near balance, so tilt, and with it the gravity torque, is poorly known.",
        );
    }
    if freedom.axes() == 3 && !clamped && !motion.attitude.heading_measured {
        say(
            "No vector sensor was recorded: heading starts at zero and drifts with the gyro; effects fixed to the room cannot be distinguished by heading.",
        );
    }
    if has_jets && recording.jet_pulses.is_empty() && !clamped {
        say("The jets' commands were not recorded: firings would appear as unknown torques.");
    }
    // Axes that are there.
    let gyro: Vec<_> =
        floors.gyro.iter().zip(recording.gyro_axes()).filter(|(_, there)| *there).map(|(f, _)| f).collect();
    let worst = gyro.iter().map(|f| f.sigma / f.by_parameters).fold(0.0, f64::max);
    let least = gyro.iter().map(|f| f.sigma / f.by_parameters).fold(f64::INFINITY, f64::min);
    if worst > 1.25 || least < 0.8 {
        remarks.push(format!(
            "The gyro's noise while still is {least:.2} to {worst:.2} times that of the model's sensor parameters; the measured one is used."
        ));
    }
    if let Some(whiteness) = gyro.iter().filter_map(|f| f.whiteness).reduce(f64::min).filter(|w| *w < 0.8) {
        remarks.push(format!(
            "The gyro's noise is coloured (Allan deviation of one sample {whiteness:.2} of the standard deviation): tests for whiteness will fail for that reason alone."
        ));
    }
    remarks
}
