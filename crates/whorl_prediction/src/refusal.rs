//! Whether a recording can be used at all; if not, a sentence says why.

use nalgebra::Vector3;
use thiserror::Error;
use whorl_dynamics::platform::TiltLimit;
use whorl_dynamics::{Freedom, GyrostatError, PlatformModel};
use whorl_recording::{Mounting, Recording};

/// Fewest samples of the channel that is predicted.
const FEWEST_SAMPLES: usize = 50;
/// RMS rate that no platform on a bearing reaches [rad/s], and the limit of any rig as a multiple of the gyro's range.
const FASTEST_RAD_S: f64 = 20.0;
const FASTEST_RANGES: f64 = 20.0;
/// Plausible mean specific force of a platform on its bearing [m/s^2]: 9.81, with margins for tilt and a wrong scale
/// factor.
const FORCE_M_S2: std::ops::RangeInclusive<f64> = 6.0..=14.0;

/// Why a recording cannot be used, with advice.
#[derive(Debug, Clone, PartialEq, Error)]
pub enum Refusal {
    /// An indispensable channel is missing.
    #[error("{run}: there are no {channel} data; {help}")]
    MissingChannel {
        /// Name of the run.
        run: String,
        /// Which channel.
        channel: &'static str,
        /// What would help.
        help: &'static str,
    },
    /// The recording without gaps is too short.
    #[error("{run}: {duration_s:.1} s of data are too short; record at least {needed_s:.0} s")]
    TooShort {
        /// Name of the run.
        run: String,
        /// Length \[s\].
        duration_s: f64,
        /// Shortest length accepted \[s\].
        needed_s: f64,
    },
    /// Too few readings, however long it is.
    #[error("{run}: {readings} readings of the {channel} are too few; record at least {needed}")]
    TooFew {
        /// Name of the run.
        run: String,
        /// Which channel.
        channel: &'static str,
        /// Readings.
        readings: usize,
        /// Fewest accepted.
        needed: usize,
    },
    /// The model does not describe a sensor that was recorded.
    #[error(
        "{run}: there are {channel} data, and the model says nothing of this sensor; add the group {key} to the platform's file, or leave the channel out"
    )]
    NotInModel {
        /// Name of the run.
        run: String,
        /// Which channel.
        channel: &'static str,
        /// The missing group of parameters.
        key: &'static str,
    },
    /// The platform was clamped but must be free.
    #[error("{run}: the platform was clamped, but this analysis needs its motion; record it on its bearing")]
    Clamped {
        /// Name of the run.
        run: String,
    },
    /// The number of wheels or jets differs from the model's.
    #[error(
        "{run}: {given} {what} in the data, {expected} in the model: data of another platform, or the wrong --model"
    )]
    Count {
        /// Name of the run.
        run: String,
        /// wheels or jets.
        what: &'static str,
        /// In the recording.
        given: usize,
        /// In the model.
        expected: usize,
    },
    /// A channel never changes.
    #[error(
        "{run}: the {channel} never changes: it is frozen, or not this platform's; check the sensor and the channel's name"
    )]
    Constant {
        /// Name of the run.
        run: String,
        /// Which channel.
        channel: String,
    },
    /// Readings that no motion of the platform can produce.
    #[error("{run}: {what}; {help}")]
    Implausible {
        /// Name of the run.
        run: String,
        /// What is wrong.
        what: String,
        /// What would help.
        help: &'static str,
    },
    /// The model is not physical.
    #[error("the model cannot be simulated: {0}")]
    Model(#[from] GyrostatError),
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
    let run = || recording.name.clone();
    let clamped = recording.mounting == Mounting::Clamped || !model.freedom.turns();
    if clamped && needs.free {
        return Err(Refusal::Clamped { run: run() });
    }
    let missing = |channel, help| Err(Refusal::MissingChannel { run: run(), channel, help });
    if clamped {
        let help = "a bench test of the wheels needs their speeds and the torque commands";
        if recording.wheel_speed_rad_s.len() < 2 {
            return missing("wheel speed", help);
        }
        if recording.wheel_torque_command_n_m.is_empty() {
            return missing("wheel torque command", help);
        }
    } else if recording.gyro_b_rad_s.len() < 2 {
        return missing(
            "gyro",
            "record rates (topic imu/data_raw, or columns that the map names as gyro), or check that its values are numbers: the motion cannot be \
             analysed without them",
        );
    }
    let axes = recording.gyro_axes();
    if !clamped && model.freedom.rate_from_gyro_b_rad_s(&Vector3::zeros(), axes).is_none() {
        return missing(
            "gyro",
            "on all axes that the platform turns about: the file's freedom says which these are, and the map which axes were \
             recorded; the motion cannot be analysed without rates",
        );
    }
    if !recording.specific_force_b_m_s2.is_empty() && !model.sensors.accelerometer.fitted {
        let (channel, key) = ("accelerometer", "sensors.accelerometer");
        return Err(Refusal::NotInModel { run: run(), channel, key });
    }
    if needs.accelerometer && !recording.has_whole_accelerometer() {
        let partial = !recording.specific_force_b_m_s2.is_empty();
        return missing(
            if partial { "accelerometer x, y, z" } else { "accelerometer" },
            "without the direction of gravity neither the gravity offset nor the bias of the gyro can be determined",
        );
    }
    length(recording, needs, clamped)?;
    counts(recording, model)?;
    if clamped { Ok(()) } else { gyro(recording, model).and_then(|()| accelerometer(recording, model)) }
}

fn length(recording: &Recording, needs: &Needs, clamped: bool) -> Result<(), Refusal> {
    let (channel, times) = if clamped {
        ("wheel speed", &recording.wheel_speed_rad_s.time_s)
    } else {
        ("gyro", &recording.gyro_b_rad_s.time_s)
    };
    let duration_s = times.last().copied().unwrap_or(0.0) - times.first().copied().unwrap_or(0.0);
    let too_short = |duration_s| Refusal::TooShort {
        run: recording.name.clone(),
        duration_s,
        needed_s: needs.shortest_s,
    };
    if duration_s.is_nan() || duration_s < needs.shortest_s {
        return Err(too_short(duration_s));
    }
    if times.len() < FEWEST_SAMPLES {
        return Err(Refusal::TooFew {
            run: recording.name.clone(),
            channel,
            readings: times.len(),
            needed: FEWEST_SAMPLES,
        });
    }
    Ok(())
}

/// Refuses recordings of another number of wheels, gyros or jets than the model's.
///
/// # Errors
/// With a sentence that gives advice.
pub fn counts(recording: &Recording, model: &PlatformModel) -> Result<(), Refusal> {
    let count = |what, given, expected| Refusal::Count { run: recording.name.clone(), what, given, expected };
    let (wheels, jets) = (model.wheels().len(), model.jets().len());
    for series in [&recording.wheel_speed_rad_s, &recording.wheel_torque_command_n_m] {
        if let Some(given) = series.value.iter().map(Vec::len).find(|given| *given != wheels) {
            return Err(count("wheels", given, wheels));
        }
    }
    let gyros = model.gyros().len();
    for series in [&recording.gimbal_angle_rad, &recording.gimbal_rate_rad_s, &recording.gimbal_torque_n_m] {
        if let Some(given) = series.value.iter().map(Vec::len).find(|given| *given != gyros) {
            return Err(count("control moment gyros", given, gyros));
        }
    }
    if !recording.jet_pulses.is_empty() && recording.jet_pulses.len() != jets {
        return Err(count("jets", recording.jet_pulses.len(), jets));
    }
    model.actuators.check().map_err(GyrostatError::from)?;
    Ok(())
}

fn gyro(recording: &Recording, model: &PlatformModel) -> Result<(), Refusal> {
    let rates = &recording.gyro_b_rad_s.value;
    for (axis, name) in
        ["x", "y", "z"].into_iter().enumerate().filter(|(axis, _)| !recording.no_gyro_axis[*axis])
    {
        if rates.windows(2).all(|pair| pair.iter().all(|v| Some(v[axis]) == rates.first().map(|f| f[axis]))) {
            let channel = format!("gyro's {name} axis");
            return Err(Refusal::Constant { run: recording.name.clone(), channel });
        }
    }
    let rms = (rates.iter().map(Vector3::norm_squared).sum::<f64>() / rates.len() as f64).sqrt();
    let range = model.sensors.gyro.errors.range;
    let fastest = if model.freedom == Freedom::OnBearing { FASTEST_RAD_S } else { f64::INFINITY };
    if rms > fastest.min(FASTEST_RANGES * range) {
        return Err(Refusal::Implausible {
            run: recording.name.clone(),
            what: format!(
                "the gyro reads {rms:.0} rad/s on average, more than such a platform can reach (the gyro's range is {range:.2} rad/s)"
            ),
            help: "probably deg/s were taken for rad/s; check the unit in the channel map",
        });
    }
    Ok(())
}

fn accelerometer(recording: &Recording, model: &PlatformModel) -> Result<(), Refusal> {
    let forces = &recording.specific_force_b_m_s2.value;
    let Some(first) = forces.first() else { return Ok(()) };
    if forces.iter().all(|v| v == first) {
        return Err(Refusal::Constant { run: recording.name.clone(), channel: "accelerometer".to_owned() });
    }
    // Without all of its axes neither length nor direction of gravity is there to be checked.
    if !model.freedom.has_weight() || !recording.has_whole_accelerometer() {
        return Ok(());
    }
    let mean = |of: fn(&Vector3<f64>) -> f64| forces.iter().map(of).sum::<f64>() / forces.len() as f64;
    let implausible = |what, help| Err(Refusal::Implausible { run: recording.name.clone(), what, help });
    let size = mean(Vector3::norm);
    if !FORCE_M_S2.contains(&size) {
        return implausible(
            format!("the accelerometer reads {size:.2} m/s^2 on average, and gravity is 9.81 m/s^2"),
            "check its unit (g or m/s^2) and its axes in the channel map",
        );
    }
    let up = mean(|f| f.z);
    // A platform that is free in pitch, or on a shaft, may lie on its side or upside down.
    let any_attitude =
        matches!(model.tilt_limit, TiltLimit::Pitch { .. }) || model.freedom.hinge_axis_b().is_some();
    if up < *FORCE_M_S2.start() && !any_attitude {
        return implausible(
            format!(
                "the accelerometer's z axis reads {up:.2} m/s^2 on average and must be near +9.81 with the platform upright"
            ),
            "check the order and the signs of its axes (specific force points up at rest)",
        );
    }
    Ok(())
}
