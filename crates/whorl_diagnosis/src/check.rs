//! Whether a recording can be explained at all: what is wrong with it, said in a sentence.

use nalgebra::Vector3;
use whorl_dynamics::PlatformModel;
use whorl_recording::{Mounting, Recording, Series};

use crate::DiagnosisError;

/// Shortest run accepted \[s\].
const SHORTEST_S: f64 = 10.0;

/// Refuses what no platform of this model records.
pub(crate) fn check(recording: &Recording, model: &PlatformModel) -> Result<(), DiagnosisError> {
    let run = || recording.name.clone();
    let clamped = recording.mounting == Mounting::Clamped;
    let gyro = &recording.gyro_b_rad_s;
    if clamped {
        if recording.wheel_speed_rad_s.len() < 2 {
            return Err(DiagnosisError::MissingChannel {
                run: run(),
                channel: "wheel speed",
                help: "a bench test of the wheels needs their speeds and the torque commands",
            });
        }
        if recording.wheel_torque_command_n_m.is_empty() {
            return Err(DiagnosisError::MissingChannel {
                run: run(),
                channel: "wheel torque command",
                help: "a bench test of the wheels needs their speeds and the torque commands",
            });
        }
    } else if gyro.len() < 2 {
        return Err(DiagnosisError::MissingChannel {
            run: run(),
            channel: "gyro",
            help: "record imu/data_raw, or check that its values are numbers: a moving platform cannot be explained without its rates",
        });
    }
    let base = if clamped { &recording.wheel_speed_rad_s.time_s } else { &gyro.time_s };
    let duration_s = base.last().copied().unwrap_or(0.0) - base.first().copied().unwrap_or(0.0);
    if duration_s < SHORTEST_S {
        return Err(DiagnosisError::TooShort { run: run(), duration_s, needed_s: SHORTEST_S });
    }
    if base.len() < 50 || duration_s / (base.len() as f64) > 0.5 {
        return Err(DiagnosisError::TooShort {
            run: run(),
            duration_s: base.len() as f64 * 0.01,
            needed_s: SHORTEST_S,
        });
    }
    let (wheels, jets) = (model.wheels().len(), model.jets().len());
    let wrong_count =
        |series: &Series<Vec<f64>>| series.value.iter().map(Vec::len).find(|given| *given != wheels);
    for series in [&recording.wheel_speed_rad_s, &recording.wheel_torque_command_n_m] {
        if let Some(given) = wrong_count(series) {
            let what = format!("it holds {given} wheels and the model has {wheels}");
            return Err(DiagnosisError::OtherPlatform { run: run(), what });
        }
    }
    if !recording.jet_pulses.is_empty() && recording.jet_pulses.len() != jets {
        let what = format!("it holds {} jets and the model has {jets}", recording.jet_pulses.len());
        return Err(DiagnosisError::OtherPlatform { run: run(), what });
    }
    model.actuators.check().map_err(whorl_dynamics::GyrostatError::from)?;
    if clamped {
        return Ok(());
    }
    for axis in 0..3 {
        let name = ["x", "y", "z"].get(axis).copied().unwrap_or("");
        let mut values = gyro.value.iter().map(|v| v[axis]);
        let first = values.next().unwrap_or(0.0);
        if values.all(|v| v == first) {
            return Err(DiagnosisError::Constant { run: run(), channel: format!("gyro's {name} axis") });
        }
    }
    if let Some(first) = recording.specific_force_b_m_s2.value.first()
        && recording.specific_force_b_m_s2.value.iter().all(|v| v == first)
    {
        return Err(DiagnosisError::Constant { run: run(), channel: "accelerometer".to_owned() });
    }
    let mean_square = gyro.value.iter().map(Vector3::norm_squared).sum::<f64>() / gyro.len() as f64;
    if mean_square.sqrt() > 20.0 {
        return Err(DiagnosisError::Implausible {
            run: run(),
            what: format!(
                "the gyro reads {:.0} rad/s on average, more than any such platform turns",
                mean_square.sqrt()
            ),
            help: "perhaps degrees per second were taken for radians per second",
        });
    }
    let force = &recording.specific_force_b_m_s2.value;
    if !force.is_empty() {
        let mean = force.iter().map(Vector3::norm).sum::<f64>() / force.len() as f64;
        if !(6.0..=14.0).contains(&mean) {
            return Err(DiagnosisError::Implausible {
                run: run(),
                what: format!(
                    "the accelerometer reads {mean:.2} m/s^2 on average, and gravity is 9.81 m/s^2"
                ),
                help: "check its unit (g or m/s^2) and its axes",
            });
        }
        let mut up = force.iter().map(|f| f.z).sum::<f64>() / force.len() as f64;
        if matches!(model.tilt_limit, whorl_dynamics::platform::TiltLimit::Pitch { .. }) {
            up = up.abs().max(7.0);
        }
        if up < 6.0 {
            return Err(DiagnosisError::Implausible {
                run: run(),
                what: format!(
                    "the accelerometer's z axis reads {up:.2} m/s^2 on average and must be near +9.81 with the platform upright"
                ),
                help: "check the order and the signs of its axes (specific force points up at rest)",
            });
        }
    }
    Ok(())
}
