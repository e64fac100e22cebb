//! What limits what a run says of a model, in sentences.

use whorl_dynamics::Freedom;
use whorl_prediction::{Noise, Prepared};
use whorl_recording::{Channel, Component};

/// Ratio of the noise that a run shows to the stated one, and its inverse, from which on it is said.
const WORTH_SAYING: f64 = 1.25;
/// Ratio of the variance of readings to that of their noise above which they show a motion.
pub(crate) const MOVES: f64 = 1.2;

/// Of a run with the noise that it shows, and the stated one.
pub(crate) fn remarks(case: &Prepared<'_>, noise: &Noise, stated: &Noise) -> Vec<String> {
    let (recording, model, clamped) = (case.recording(), case.model(), case.is_clamped());
    let unread = recording.wheel_speed_rad_s.is_empty();
    let uncommanded = recording.wheel_torque_command_n_m.is_empty();
    let of_channels = [
        (
            case.commands().wheel_torque_from_speed,
            "The wheels' torque commands were not recorded: the model's wheels are driven along their measured speeds, so errors of the wheels themselves do not show.",
        ),
        (
            !clamped && unread && !uncommanded,
            "The wheels' speeds were not recorded: they are assumed to start at rest.",
        ),
        (
            !model.wheels().is_empty() && unread && uncommanded,
            "Neither the wheels' speeds nor their torque commands were recorded: the model's wheels rest, and what the platform's do would appear as unknown torques.",
        ),
        (
            model.freedom == Freedom::OnBearing && !clamped && recording.specific_force_b_m_s2.is_empty(),
            "The accelerometer was not recorded: the platform is assumed to start near balance, so tilt, and with it the gravity torque, is poorly known.",
        ),
        (
            model.freedom.axes() == 3 && !clamped && recording.vectors.is_empty(),
            "No vector sensor was recorded: heading starts at zero and drifts with the gyro; effects fixed to the room cannot be distinguished by heading.",
        ),
        (
            !model.jets().is_empty() && recording.jet_pulses.is_empty() && !clamped,
            "The jets' commands were not recorded: firings would appear as unknown torques.",
        ),
        (
            !is_moving(case, noise),
            "No rate and no speed moves beyond its noise in this run: whether the model moves as the platform does, it does not show.",
        ),
    ];
    let applies = of_channels.into_iter().filter(|(applies, _)| *applies);
    let mut remarks: Vec<String> = applies.map(|(_, text)| text.to_owned()).collect();
    remarks.extend(recording.partial_accelerometer().filter(|_| !clamped && model.freedom.has_weight()));
    remarks.extend(levels(case, noise, stated));
    remarks
}

/// Sensors whose noise is not the stated one; each vector sensor has its own.
fn levels(case: &Prepared<'_>, noise: &Noise, stated: &Noise) -> Vec<String> {
    let several = case.recording().vectors.len() > 1;
    let components: Vec<Component> = case.components().collect();
    let told = |of: &[Component]| {
        let whose = match of.first()?.channel {
            Channel::Gyro => "gyro's".to_owned(),
            Channel::Accelerometer => "accelerometer's".to_owned(),
            Channel::WheelSpeed => "tachometers'".to_owned(),
            Channel::Vector if several => format!("vector sensor {}'s", of[0].sensor() + 1),
            Channel::Vector => "vector sensor's".to_owned(),
            _ => return None,
        };
        let ratios = || of.iter().map(|component| noise.of(*component) / stated.of(*component));
        let (least, most) = (ratios().fold(f64::INFINITY, f64::min), ratios().fold(0.0, f64::max));
        let times =
            if least < 0.995 * most { format!("{least:.2} to {most:.2}") } else { format!("{most:.2}") };
        (most > WORTH_SAYING || least < 1.0 / WORTH_SAYING).then(|| {
            format!("The {whose} noise in this run is {times} times what the platform's file states; that of the run is used.")
        })
    };
    components.chunk_by(|a, b| (a.channel, a.sensor()) == (b.channel, b.sensor())).filter_map(told).collect()
}

/// Whether any rate or speed changes by more than its noise.
fn is_moving(case: &Prepared<'_>, noise: &Noise) -> bool {
    let moves = |component: Component| {
        let series = case.recording().series(component.channel, component.sensor())?;
        let numbers = || {
            let of = |k| series.number(k, component.index()).filter(|x| x.is_finite());
            (0..series.time_s().len()).filter_map(of)
        };
        let first = numbers().next()?;
        let (sum, squares, count) = numbers().fold((0.0, 0.0, 0.0), |(sum, squares, count), x| {
            (sum + (x - first), squares + (x - first).powi(2), count + 1.0)
        });
        Some(squares - sum * sum / count > MOVES * noise.of(component).powi(2) * count)
    };
    let rates = case.components().filter(|c| matches!(c.channel, Channel::Gyro | Channel::WheelSpeed));
    rates.into_iter().any(|component| moves(component).unwrap_or(false))
}
