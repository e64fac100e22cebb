//! A manoeuvre as an experiment file.

use std::fmt::Write as _;

use super::family::{Actuators, Drive, Envelope, Excitation, Manoeuvre, Step};

/// Initial time for settling at balance \[s\].
const SETTLE_S: f64 = 8.0;

/// The experiment file, with `comments` at its top, one line each.
pub fn yaml(
    name: &str,
    platform: &str,
    envelope: &Envelope,
    manoeuvre: &Manoeuvre,
    comments: &[String],
) -> String {
    let mut out = String::new();
    for comment in comments {
        let _ = writeln!(out, "# {comment}");
    }
    let (rate, acceleration) = manoeuvre.demand_deg_s();
    let (pitch, roll) = envelope.balance_deg;
    let actuators = match manoeuvre.actuators {
        Actuators::Wheels => "wheels",
        Actuators::Jets => "jets",
    };
    // Writing to a String cannot fail.
    let _ = write!(
        out,
        "/**:\n  ros__parameters:\n    formation:\n      platforms: [{platform}]\n\n\
         /coordinator:\n  ros__parameters:\n    experiment:\n      name: {name}\n      description: {platform} {words}\n    \
         limits:\n      {platform}: {{rate_max_deg_s: {rate:.2}, acceleration_max_deg_s2: {acceleration:.2}}}\n    \
         law: {{kind: leader_follower}}\n    steps:\n      \
         settle: {{kind: settle, duration_s: {SETTLE_S:.1}, yaw_deg: 0.0, pitch_deg: {pitch:.2}, roll_deg: {roll:.2}}}\n",
        words = manoeuvre.words,
        rate = 1.25 * rate,
        acceleration = 1.25 * acceleration,
    );
    for (k, step) in manoeuvre.steps.iter().enumerate() {
        let _ = writeln!(out, "      {}", line(k + 1, step));
    }
    let excitations = if manoeuvre.excitations.is_empty() {
        String::new()
    } else {
        let lines: Vec<String> = manoeuvre.excitations.iter().map(excitation).collect();
        format!("    excitations:\n{}", lines.concat())
    };
    let _ = write!(
        out,
        "\n/{platform}/local_control:\n  ros__parameters:\n    actuators: {actuators}\n{excitations}\n\
         # A simulated platform starts where it balances.\n\
         /{platform}/driver:\n  ros__parameters:\n    initial: {{yaw_deg: 0.0, pitch_deg: {pitch:.2}, roll_deg: {roll:.2}}}\n"
    );
    out
}

fn line(number: usize, step: &Step) -> String {
    match step {
        Step::Slew { yaw_deg, tilt_deg, rate_deg_s, acceleration_deg_s2, duration_s } => {
            let kind = if yaw_deg.is_some() { "turn" } else { "tilt" };
            let mut angles = String::new();
            if let Some(yaw) = yaw_deg {
                let _ = write!(angles, ", yaw_deg: {:.1}", wrapped_deg(*yaw));
            }
            if let Some((pitch, roll)) = tilt_deg {
                let _ = write!(angles, ", pitch_deg: {pitch:.2}, roll_deg: {roll:.2}");
            }
            format!(
                "{kind}_{number}: {{kind: slew, duration_s: {duration_s:.1}{angles}, rate_max_deg_s: {rate_deg_s:.2}, acceleration_max_deg_s2: {acceleration_deg_s2:.2}}}"
            )
        }
        Step::Scan { axis, amplitude_deg, period_s, duration_s } => format!(
            "swing_{number}: {{kind: scan, duration_s: {duration_s:.1}, axis: {axis}, amplitude_deg: {amplitude_deg:.2}, period_s: {period_s:.1}}}"
        ),
        Step::Excite { excitation, duration_s, .. } => {
            format!(
                "{excitation}_{number}: {{kind: excite, duration_s: {duration_s:.1}, excitation: {excitation}}}"
            )
        }
        Step::Hold { duration_s } => format!("hold_{number}: {{kind: hold, duration_s: {duration_s:.1}}}"),
    }
}

fn excitation(excitation: &Excitation) -> String {
    let Excitation { name, hold, drive } = excitation;
    let rest = match drive {
        Drive::Nothing => String::new(),
        Drive::Wheels { names, signal, torque_n_m, period_s, highest_hz } => format!(
            ", wheels: [{}], signal: {signal}, torque_n_m: {torque_n_m:.4}, period_s: {period_s:.1}, highest_hz: {highest_hz:.2}",
            names.join(", ")
        ),
        Drive::Jets { names, on_time_s, every_s } => {
            let on_time_s: Vec<String> = on_time_s.iter().map(|t| format!("{t:.3}")).collect();
            format!(
                ", jets: [{}], on_time_s: [{}], every_s: {every_s:.1}",
                names.join(", "),
                on_time_s.join(", ")
            )
        }
    };
    format!("      {name}: {{hold: {hold}{rest}}}\n")
}

/// Wrapped to -180 to 180.
fn wrapped_deg(angle: f64) -> f64 {
    (angle + 180.0).rem_euclid(360.0) - 180.0
}
