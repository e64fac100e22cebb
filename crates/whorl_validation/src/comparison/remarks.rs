//! What limits a comparison, in sentences.

use whorl_dynamics::Freedom;
use whorl_prediction::Prepared;
use whorl_recording::Channel;

use super::ChannelErrors;

/// Ratio of the noise that a run shows to the stated one, and its inverse, from which on it is said.
const WORTH_SAYING: f64 = 1.25;

pub(super) fn remarks(case: &Prepared<'_>, channels: &[ChannelErrors]) -> Vec<String> {
    let (recording, model, clamped) = (case.recording(), case.model(), case.is_clamped());
    let mut remarks = Vec::new();
    let mut say = |applies: bool, text: &str| {
        if applies {
            remarks.push(text.to_owned());
        }
    };
    say(
        case.commands().wheel_torque_from_speed,
        "The wheels' torque commands were not recorded: the model's wheels are driven along their measured speeds, so errors of the wheels themselves do not show.",
    );
    say(
        !clamped && recording.wheel_speed_rad_s.is_empty() && !recording.wheel_torque_command_n_m.is_empty(),
        "The wheels' speeds were not recorded: they are assumed to start at rest.",
    );
    say(
        model.freedom == Freedom::OnBearing && !clamped && recording.specific_force_b_m_s2.is_empty(),
        "The accelerometer was not recorded: the platform is assumed to start near balance, so tilt, and with it the gravity torque, is poorly known.",
    );
    say(
        model.freedom.axes() == 3 && !clamped && recording.vectors.is_empty(),
        "No vector sensor was recorded: heading starts at zero and drifts with the gyro; effects fixed to the room cannot be distinguished by heading.",
    );
    say(
        !model.jets().is_empty() && recording.jet_pulses.is_empty() && !clamped,
        "The jets' commands were not recorded: firings would appear as unknown torques.",
    );
    let rates =
        channels.iter().filter(|channel| matches!(channel.quantity, Channel::Gyro | Channel::WheelSpeed));
    say(
        rates.flat_map(|channel| channel.horizons.last()).all(|run| run.fit_percent.is_none()),
        "No rate and no speed moves beyond its noise in this run: whether the model moves as the platform does, it does not show.",
    );
    for (quantity, whose) in [
        (Channel::Gyro, "gyro's"),
        (Channel::Accelerometer, "accelerometer's"),
        (Channel::Vector, "vector sensor's"),
        (Channel::WheelSpeed, "tachometers'"),
    ] {
        let ratios = channels.iter().filter(|channel| channel.quantity == quantity);
        let ratios: Vec<f64> = ratios.map(|channel| channel.noise_floor / channel.stated_noise).collect();
        let (least, most) =
            ratios.iter().fold((f64::INFINITY, 0f64), |(least, most), r| (least.min(*r), most.max(*r)));
        if most > WORTH_SAYING || least < 1.0 / WORTH_SAYING {
            let times =
                if ratios.len() > 1 { format!("{least:.2} to {most:.2}") } else { format!("{most:.2}") };
            remarks.push(format!(
                "The {whose} noise in this run is {times} times what the platform's file states; that of the run is used."
            ));
        }
    }
    remarks
}
