//! Whether a recording can be used at all; if not, a sentence says why.

use nalgebra::Vector3;
use thiserror::Error;
use whorl_dynamics::platform::TiltLimit;
use whorl_dynamics::{Freedom, GyrostatError, PlatformModel};

use crate::recording::Recording;

const FEWEST_SAMPLES: usize = 50;
/// RMS rate that no platform on a bearing reaches [rad/s], and the limit of any rig as a multiple of the gyro's range.
const FASTEST_RAD_S: f64 = 20.0;
const FASTEST_RANGES: f64 = 20.0;
/// Plausible mean specific force of a platform on its bearing [m/s^2]: 9.81, with margins for tilt and a wrong scale factor.
const FORCE_M_S2: std::ops::RangeInclusive<f64> = 6.0..=14.0;

/// Why a recording cannot be used, with advice.
#[derive(Debug, Clone, PartialEq, Error)]
#[error("{run}: {why}")]
pub struct Refusal {
    /// Name of the run.
    pub run: String,
    /// What is wrong with it.
    pub why: Why,
}

/// What is wrong with a recording.
#[derive(Debug, Clone, PartialEq, Error)]
pub enum Why {
    /// An indispensable channel is missing: which, and what would help.
    #[error("there are no {0} data; {1}")]
    Missing(&'static str, &'static str),
    /// So long is the recording without gaps, and so long it must be \[s\].
    #[error("{0:.1} s of data are too short; record at least {1:.0} s")]
    TooShort(f64, f64),
    /// So many readings of a channel are too few, and so many are needed, however long it is.
    #[error("{1} readings of the {0} are too few; record at least {2}")]
    TooFew(&'static str, usize, usize),
    /// The platform was clamped but must be free.
    #[error("the platform was clamped, but this analysis needs its motion; record it on its bearing")]
    Clamped,
    /// Another number of wheels or jets in the data than in the model.
    #[error("{1} {0} in the data, {2} in the model: data of another platform, or the wrong --model")]
    Count(&'static str, usize, usize),
    /// A channel never changes.
    #[error(
        "the {0} never changes: it is frozen, or not this platform's; check the sensor and the channel's name"
    )]
    Constant(String),
    /// Anything else that is wrong, and what would help.
    #[error("{0}; {1}")]
    Unusable(String, &'static str),
    /// The motion of the model does not stay finite.
    #[error(
        "the model's motion is lost in this run: a number of its file is off by far, or a channel has another unit"
    )]
    Lost,
    /// The model is not physical.
    #[error("the model cannot be simulated: {0}")]
    Model(#[from] GyrostatError),
}

impl Why {
    /// Of a recording.
    #[must_use]
    pub fn of(self, recording: &Recording) -> Refusal {
        Refusal { run: recording.name.clone(), why: self }
    }
}

/// Requirements of a method on a recording.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Needs {
    /// Shortest recording \[s\].
    pub shortest_s: f64,
    /// The platform must be on its bearing.
    pub free: bool,
    /// The direction of gravity must be measured.
    pub accelerometer: bool,
}

/// Refuses recordings that no platform of this model can produce, and those that do not meet `needs`.
///
/// # Errors
/// With a sentence that gives advice.
pub fn check(recording: &Recording, model: &PlatformModel, needs: &Needs) -> Result<(), Refusal> {
    let clamped = recording.is_clamped(model);
    needed(recording, model, needs, clamped)
        .and_then(|()| counts(recording, model))
        .and_then(|()| if clamped { Ok(()) } else { gyro(recording, model) })
        .and_then(|()| if clamped { Ok(()) } else { accelerometer(recording, model) })
        .map_err(|why| why.of(recording))
}

fn refuse(is_so: bool, why: impl FnOnce() -> Why) -> Result<(), Why> {
    if is_so { Err(why()) } else { Ok(()) }
}

/// Whether everything that is needed was recorded, and long enough.
fn needed(recording: &Recording, model: &PlatformModel, needs: &Needs, clamped: bool) -> Result<(), Why> {
    const BENCH: &str = "a bench test of the wheels needs their speeds and the torque commands";
    let missing = |is_so, what, advice| refuse(is_so, || Why::Missing(what, advice));
    let (gyro, speeds) = (&recording.gyro_b_rad_s.time_s, &recording.wheel_speed_rad_s.time_s);
    if clamped {
        refuse(needs.free, || Why::Clamped)?;
        missing(speeds.len() < 2, "wheel speed", BENCH)?;
        missing(recording.wheel_torque_command_n_m.is_empty(), "wheel torque command", BENCH)?;
    } else {
        missing(
            gyro.len() < 2,
            "gyro",
            "record rates (topic imu/data_raw, or columns that the map names as gyro), or check that its values are numbers: the motion cannot be \
             analysed without them",
        )?;
        let turns = model.freedom.rate_from_gyro_b_rad_s(&Vector3::zeros(), recording.gyro_axes());
        missing(
            turns.is_none(),
            "gyro",
            "on all axes that the platform turns about: the file's freedom says which these are, and the map which axes were \
             recorded; the motion cannot be analysed without rates",
        )?;
    }
    let has_force = !recording.specific_force_b_m_s2.is_empty();
    refuse(has_force && !model.sensors.accelerometer.fitted, || {
        let what = "there are accelerometer data, and the model says nothing of this sensor";
        let advice = "add the group sensors.accelerometer to the platform's file, or leave the channel out";
        Why::Unusable(what.to_owned(), advice)
    })?;
    missing(
        needs.accelerometer && !recording.has_whole_accelerometer(),
        if has_force { "accelerometer x, y, z" } else { "accelerometer" },
        "without the direction of gravity neither the gravity offset nor the bias of the gyro can be determined",
    )?;
    let (channel, times) = if clamped { ("wheel speed", speeds) } else { ("gyro", gyro) };
    let duration_s = times.last().copied().unwrap_or(0.0) - times.first().copied().unwrap_or(0.0);
    let is_short = duration_s.is_nan() || duration_s < needs.shortest_s;
    refuse(is_short, || Why::TooShort(duration_s, needs.shortest_s))?;
    refuse(times.len() < FEWEST_SAMPLES, || Why::TooFew(channel, times.len(), FEWEST_SAMPLES))
}

/// Refuses recordings of another number of wheels, gyros or jets than the model's, and a model whose actuators are impossible.
///
/// # Errors
/// [`Why::Count`], [`Why::Model`].
pub fn counts(recording: &Recording, model: &PlatformModel) -> Result<(), Why> {
    let other = recording.other_count(model);
    other.map_or(Ok(()), |(what, given, expected)| Err(Why::Count(what, given, expected)))?;
    Ok(model.actuators.check().map_err(GyrostatError::from)?)
}

fn gyro(recording: &Recording, model: &PlatformModel) -> Result<(), Why> {
    let rates = &recording.gyro_b_rad_s.value;
    let first = rates.first().copied().unwrap_or_default();
    for axis in (0..3).filter(|axis| !recording.no_gyro_axis[*axis]) {
        let is_frozen = rates.iter().all(|rate| rate[axis] == first[axis]);
        refuse(is_frozen, || Why::Constant(format!("gyro's {} axis", ["x", "y", "z"][axis])))?;
    }
    let rms = (rates.iter().map(Vector3::norm_squared).sum::<f64>() / rates.len() as f64).sqrt();
    let range = model.sensors.gyro.errors.range;
    let fastest = if model.freedom == Freedom::OnBearing { FASTEST_RAD_S } else { f64::INFINITY };
    refuse(rms > fastest.min(FASTEST_RANGES * range), || {
        let what = format!(
            "the gyro reads {rms:.0} rad/s on average, more than such a platform can reach (the gyro's range is {range:.2} rad/s)"
        );
        Why::Unusable(what, "probably deg/s were taken for rad/s; check the unit in the channel map")
    })
}

fn accelerometer(recording: &Recording, model: &PlatformModel) -> Result<(), Why> {
    let forces = &recording.specific_force_b_m_s2.value;
    let Some(first) = forces.first() else { return Ok(()) };
    refuse(forces.iter().all(|v| v == first), || Why::Constant("accelerometer".to_owned()))?;
    // Without all of its axes neither length nor direction of gravity is there to be checked.
    if !model.freedom.has_weight() || !recording.has_whole_accelerometer() {
        return Ok(());
    }
    let mean = |of: fn(&Vector3<f64>) -> f64| forces.iter().map(of).sum::<f64>() / forces.len() as f64;
    let (size, up) = (mean(Vector3::norm), mean(|f| f.z));
    refuse(!FORCE_M_S2.contains(&size), || {
        let what = format!("the accelerometer reads {size:.2} m/s^2 on average, and gravity is 9.81 m/s^2");
        Why::Unusable(what, "check its unit (g or m/s^2) and its axes in the channel map")
    })?;
    // A platform that is free in pitch, or on a shaft, may lie on its side or upside down.
    let any_attitude =
        matches!(model.tilt_limit, TiltLimit::Pitch { .. }) || model.freedom.hinge_axis_b().is_some();
    refuse(up < *FORCE_M_S2.start() && !any_attitude, || {
        let what = format!(
            "the accelerometer's z axis reads {up:.2} m/s^2 on average and must be near +9.81 with the platform upright"
        );
        Why::Unusable(what, "check the order and the signs of its axes (specific force points up at rest)")
    })
}
