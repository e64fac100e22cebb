//! A manoeuvre as an experiment file.

use super::family::{Envelope, Manoeuvre};

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
    let comments: String = comments.iter().map(|comment| format!("# {comment}\n")).collect();
    let lines = |of: &[String]| -> String { of.iter().map(|line| format!("      {line}\n")).collect() };
    let Manoeuvre { words, actuators, demand_deg_s: (rate, acceleration), .. } = manoeuvre;
    let (pitch, roll) = envelope.balance_deg;
    let heading = if manoeuvre.excitations.is_empty() { "" } else { "    excitations:\n" };
    format!(
        "{comments}/**:\n  ros__parameters:\n    formation:\n      platforms: [{platform}]\n\n\
         /coordinator:\n  ros__parameters:\n    experiment:\n      name: {name}\n      description: {platform} {words}\n    \
         limits:\n      {platform}: {{rate_max_deg_s: {rate:.2}, acceleration_max_deg_s2: {acceleration:.2}}}\n    \
         law: {{kind: leader_follower}}\n    steps:\n      \
         settle: {{kind: settle, duration_s: {SETTLE_S:.1}, yaw_deg: 0.0, pitch_deg: {pitch:.2}, roll_deg: {roll:.2}}}\n\
         {steps}\n/{platform}/local_control:\n  ros__parameters:\n    actuators: {actuators}\n{heading}{excitations}\n\
         # A simulated platform starts where it balances.\n\
         /{platform}/driver:\n  ros__parameters:\n    initial: {{yaw_deg: 0.0, pitch_deg: {pitch:.2}, roll_deg: {roll:.2}}}\n",
        rate = 1.25 * rate,
        acceleration = 1.25 * acceleration,
        steps = lines(&manoeuvre.steps),
        excitations = lines(&manoeuvre.excitations),
    )
}
