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
            uncommanded && !unread,
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
            !case.components().any(|component| moves(case, component, noise.of(component))),
            "No rate and no speed moves beyond its noise in this run: whether the model moves as the platform does, it does not show.",
        ),
    ];
    let applies = of_channels.into_iter().filter(|(applies, _)| *applies);
    let mut remarks: Vec<String> = applies.map(|(_, text)| text.to_owned()).collect();
    remarks.extend(recording.partial_accelerometer().filter(|_| !clamped && model.freedom.has_weight()));
    // Sensors whose noise is not the stated one; each vector sensor has its own.
    let components: Vec<Component> = case.components().collect();
    for of in components.chunk_by(|a, b| (a.channel, a.sensor()) == (b.channel, b.sensor())) {
        let whose = match of[0].channel {
            Channel::Gyro => "gyro's".to_owned(),
            Channel::Accelerometer => "accelerometer's".to_owned(),
            Channel::WheelSpeed => "tachometers'".to_owned(),
            Channel::Vector if recording.vectors.len() < 2 => "vector sensor's".to_owned(),
            Channel::Vector => format!("vector sensor {}'s", of[0].sensor() + 1),
            _ => continue,
        };
        let ratios = || of.iter().map(|component| noise.of(*component) / stated.of(*component));
        let (least, most) = (ratios().fold(f64::INFINITY, f64::min), ratios().fold(0.0, f64::max));
        let lower = if least < 0.995 * most { format!("{least:.2} to ") } else { String::new() };
        if most > WORTH_SAYING || least < 1.0 / WORTH_SAYING {
            remarks.push(format!("The {whose} noise in this run is {lower}{most:.2} times what the platform's file states; that of the run is used."));
        }
    }
    remarks
}

/// Whether a rate or a speed changes by more than its noise.
fn moves(case: &Prepared<'_>, component: Component, noise: f64) -> bool {
    let is_rate = matches!(component.channel, Channel::Gyro | Channel::WheelSpeed);
    let series = case.recording().series(component.channel, component.sensor()).filter(|_| is_rate);
    let values = series.into_iter().flat_map(|series| {
        let number = move |k| series.number(k, component.index()).filter(|x: &f64| x.is_finite());
        (0..series.time_s().len()).filter_map(number)
    });
    let values: Vec<f64> = values.collect();
    let mean = values.iter().sum::<f64>() / values.len() as f64;
    let squares: f64 = values.iter().map(|x| (x - mean).powi(2)).sum();
    squares > MOVES * noise.powi(2) * values.len() as f64
}
