//! What column names say: the quantity, its axis, its unit.

mod known;

use whorl_bag::{Channel, Form};

use Meaning::{Angle, Channel as Is, Encoder, Turning};
use known::{COMMANDS, STEMS, TURNS, UNITS};

pub use known::Meaning;

/// What a column seems to be.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Named {
    /// Name in the file.
    pub column: String,
    /// Name without axis and unit: columns of one sensor share it.
    pub stem: String,
    /// Axis of the body, or number of the wheel or jet from 0; of a quaternion w, x, y, z.
    pub axis: Option<Axis>,
    /// Unit as maps write it.
    pub unit: Option<&'static str>,
    /// What it is called.
    pub meaning: Option<Meaning>,
}

/// Where a number of several belongs.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum Axis {
    /// The scalar of a quaternion.
    W,
    /// Along x, y, z: 0, 1, 2.
    Body(usize),
    /// The number in its name.
    Number(usize),
}

/// Whether a column's name says that it holds what was commanded.
#[must_use]
pub fn is_commanded(column: &str) -> bool {
    words(&apart(column).to_lowercase()).iter().any(|word| COMMANDS.contains(&word.as_str()))
}

/// Reads a column's name. A group in front (`imu.`, `/imu/data/`) is part of the stem only where the last part says nothing.
#[must_use]
pub fn named(column: &str) -> Named {
    let (bare, mut unit) = bracketed(column);
    let mut words = words(&apart(&bare).to_lowercase());
    if unit.is_none() {
        unit = taken_unit(&mut words);
    }
    let mut axis = taken_axis(&mut words).or_else(|| taken_number(&mut words));
    // `gyro_rad[0]` has its unit in the middle.
    if unit.is_none() && axis.is_some() {
        unit = taken_unit(&mut words);
    }
    // Words from the last on: `imu angular velocity` is an angular velocity.
    let known = |from: usize| {
        let joined = words.get(from..).unwrap_or_default().concat();
        STEMS.iter().find(|(stem, _)| *stem == joined).map(|(_, meaning)| *meaning)
    };
    let from_front = || {
        let first = words.first().map(String::as_str).unwrap_or_default();
        STEMS.iter().find(|(stem, _)| *stem == first && stem.len() > 2).map(|(_, meaning)| *meaning)
    };
    // What is commanded in a unit of torque is a torque; other commands may be anything.
    let is_torque = || {
        let is_command = words.iter().any(|word| COMMANDS.contains(&word.as_str()));
        let units = Channel::WheelTorqueCommand.info().units;
        let has_unit = unit.is_some_and(|unit| units.iter().any(|known| known.name == unit));
        (is_command && has_unit).then_some(Is(Channel::WheelTorqueCommand))
    };
    let meaning = (0..words.len()).find_map(known).or_else(from_front).or_else(is_torque);
    // A gyro in rad measures rad/s.
    if meaning == Some(Is(Channel::Gyro)) {
        unit = unit.map(|unit| match unit {
            "rad" => "rad/s",
            "deg" => "deg/s",
            other => other,
        });
    }
    let meaning = meaning.and_then(|meaning| in_unit(meaning, unit)).filter(|meaning| {
        // A setpoint of what moves is no measurement of it.
        let moves = match meaning {
            Is(channel) => channel.info().is_motion,
            other => matches!(other, Angle | Encoder | Turning),
        };
        !(moves && words.iter().any(|word| COMMANDS.contains(&word.as_str())))
    });
    let meaning = match meaning {
        Some(Is(Channel::Gyro) | Turning) if axis.is_none() => {
            taken_turn(&mut words).map_or(meaning, |about| {
                axis = Some(about);
                Some(Is(Channel::Gyro))
            })
        }
        other => other,
    };
    Named { column: column.to_owned(), stem: words.join(" "), axis, unit, meaning }
}

/// The body's axis about which a name says that something turns: `yaw rate` is about z.
fn taken_turn(words: &mut Vec<String>) -> Option<Axis> {
    let (at, about) = words.iter().enumerate().find_map(|(at, word)| Some((at, turn(word)?)))?;
    words.remove(at);
    Some(Axis::Body(about))
}

/// The body's axis, from 0, of a word for a turn about it.
#[must_use]
pub fn turn(word: &str) -> Option<usize> {
    TURNS.iter().position(|known| *known == word)
}

/// What a name stands for whose unit tells more: `wheel_x_n_m` is no speed. `None` where the unit is one of other quantities. A direction
/// may be in any unit: magnetometers measure in gauss.
fn in_unit(meaning: Meaning, unit: Option<&str>) -> Option<Meaning> {
    let is_rate = |unit: &str| Channel::Gyro.info().units.iter().any(|known| known.name == unit);
    if matches!(meaning, Angle | Encoder) && unit.is_some_and(is_rate) {
        return Some(Turning);
    }
    let (Is(channel), Some(unit)) = (meaning, unit) else { return Some(meaning) };
    let has = |channel: &Channel| channel.info().units.iter().any(|known| known.name == unit);
    let is_any = channel.info().units.is_empty() || channel.info().form == Form::Directions;
    if is_any || has(&channel) || !Channel::ALL.iter().any(has) {
        return Some(meaning);
    }
    let form = |channel: &Channel| std::mem::discriminant(&channel.info().form);
    let is_like = |other: &&Channel| has(other) && form(other) == form(&channel);
    Channel::ALL.iter().find(is_like).map(|other| Is(*other))
}

/// Words that are written together, apart: `gyroRotationX` is `gyro Rotation X`. One letter alone is no word: `mNm`.
fn apart(name: &str) -> String {
    let mut apart = String::with_capacity(name.len() + 8);
    let mut small = 0;
    for c in name.chars() {
        if c.is_uppercase() && small > 1 {
            apart.push(' ');
        }
        apart.push(c);
        small = if c.is_lowercase() { small + 1 } else { 0 };
    }
    apart
}

/// Unit in brackets, and the name without it.
fn bracketed(name: &str) -> (String, Option<&'static str>) {
    for (open, close) in [('(', ')'), ('[', ']')] {
        if let (Some(from), Some(to)) = (name.find(open), name.rfind(close))
            && from < to
        {
            let inner = name.get(from + 1..to).unwrap_or_default().trim().to_lowercase();
            if let Some((_, unit)) = UNITS.iter().find(|(written, _)| *written == inner) {
                let rest = [name.get(..from), name.get(to + 1..)];
                return (rest.into_iter().flatten().collect::<Vec<_>>().join(" "), Some(unit));
            }
        }
    }
    (name.to_owned(), None)
}

fn words(name: &str) -> Vec<String> {
    let parts = name.split(|c: char| !c.is_alphanumeric() && c != '°' && c != '²');
    parts.filter(|part| !part.is_empty()).map(str::to_owned).collect()
}

/// The unit at the end, as in `gyro_x_rad_s` or `t_ms`; one word may be all the name there is.
fn taken_unit(words: &mut Vec<String>) -> Option<&'static str> {
    for count in [2, 1] {
        if words.len() <= count {
            continue;
        }
        let at = words.len() - count;
        let end = words.get(at..).unwrap_or_default().join("_");
        // One letter is an axis or a number sooner than a unit, but behind these.
        let alone = end.len() > 1 || matches!(end.as_str(), "s" | "a" | "v" | "k" | "g");
        if let Some((_, unit)) = UNITS.iter().find(|(written, _)| *written == end && alone) {
            words.truncate(at);
            return Some(unit);
        }
    }
    None
}

/// The number of a wheel or jet at the end of its name, before other words: `RW1 n`.
fn taken_number(words: &mut [String]) -> Option<Axis> {
    let numbered = ["rw", "wheel", "motor", "jet", "thruster", "valve"];
    words.iter_mut().find_map(|word| {
        let stem = word.trim_end_matches(|c: char| c.is_ascii_digit());
        let number = word.get(stem.len()..)?.parse().ok().filter(|n| *n < 100)?;
        let stem = numbered.contains(&stem).then(|| stem.to_owned())?;
        *word = stem;
        Some(Axis::Number(number))
    })
}

/// The axis: a word of its own, or the last letter or number of the last word.
fn taken_axis(words: &mut Vec<String>) -> Option<Axis> {
    let letter = |word: &str| match word {
        "w" => Some(Axis::W),
        "x" => Some(Axis::Body(0)),
        "y" => Some(Axis::Body(1)),
        "z" => Some(Axis::Body(2)),
        number => number.parse().ok().filter(|n| (0..100).contains(n)).map(Axis::Number),
    };
    if words.len() > 1 {
        for at in (0..words.len()).rev() {
            if let Some(axis) = words.get(at).and_then(|word| letter(word)) {
                words.remove(at);
                return Some(axis);
            }
        }
    }
    let last = words.last_mut()?;
    let digits = last.chars().rev().take_while(char::is_ascii_digit).count();
    let taken = if digits > 0 { digits } else { 1 };
    let (stem, end) = last.split_at_checked(last.len().checked_sub(taken)?)?;
    let axis = letter(end)?;
    // `max`, `index` and `raw` end in such a letter and are words; `w` alone is a rate.
    if stem.is_empty()
        || matches!(
            last.as_str(),
            "max"
                | "index"
                | "raw"
                | "aux"
                | "new"
                | "day"
                | "delay"
                | "yaw"
                | "battery"
                | "velocity"
                | "gravity"
        )
    {
        return None;
    }
    let stem = stem.to_owned();
    *last = stem;
    Some(axis)
}

#[cfg(test)]
mod tests {
    use super::Meaning::{Count, Derived, Time};
    use super::*;

    /// What `whorl export csv` calls its columns: exported by one rig, they are read by another.
    #[test]
    fn names_of_exported_columns_are_read() {
        let [wheels, jets] = [["wheel_x", "wheel_y", "wheel_z"], ["jet_1", "jet_2", "jet_3"]];
        let is_gimbals = |channel: &Channel| matches!(channel.info().form, Form::Gimbals { .. });
        for channel in Channel::ALL.iter().copied().filter(|channel| !is_gimbals(channel)) {
            let given = if channel == Channel::Jets { jets } else { wheels }.map(str::to_owned);
            for name in whorl_recording::column_names(channel, 0, 3, &given) {
                assert_eq!(named(&name).meaning, Some(Is(channel)), "{name}");
            }
        }
    }

    #[test]
    fn names_of_many_kinds_are_read() {
        let gyro = Some(Is(Channel::Gyro));
        let force = Some(Is(Channel::Accelerometer));
        for (column, meaning, axis, unit) in [
            ("gx", gyro, Some(Axis::Body(0)), None),
            ("Gyroscope Y (deg/s)", gyro, Some(Axis::Body(1)), Some("deg/s")),
            ("gyro_z_rad_s", gyro, Some(Axis::Body(2)), Some("rad/s")),
            ("imu.angular_velocity.x", gyro, Some(Axis::Body(0)), None),
            ("wz", gyro, Some(Axis::Body(2)), None),
            ("accX [m/s^2]", force, Some(Axis::Body(0)), Some("m/s^2")),
            ("linear_acceleration_z", force, Some(Axis::Body(2)), None),
            ("acc_y_g", force, Some(Axis::Body(1)), Some("g")),
            ("mag_x", Some(Is(Channel::Vector)), Some(Axis::Body(0)), None),
            ("w", Some(Is(Channel::Gyro)), None, None),
            ("n1", Some(Is(Channel::WheelSpeed)), Some(Axis::Number(1)), None),
            ("rpm_2", Some(Is(Channel::WheelSpeed)), Some(Axis::Number(2)), None),
            ("u_x", Some(Is(Channel::WheelTorqueCommand)), Some(Axis::Body(0)), None),
            ("t_ms", Some(Time), None, Some("ms")),
            ("Time (s)", Some(Time), None, Some("s")),
            ("battery_v", Some(Is(Channel::BusVoltage)), None, Some("V")),
            ("qw", Some(Is(Channel::TrueAttitude)), Some(Axis::W), None),
            ("lamp_x", Some(Is(Channel::Vector)), Some(Axis::Body(0)), None),
            ("encoder", Some(Encoder), None, None),
            ("yaw_deg", Some(Angle), None, Some("deg")),
            ("Pendulum angle [rad]", Some(Angle), None, Some("rad")),
            ("hinge.position", Some(Encoder), None, None),
            ("wheel_angle_rad", Some(Encoder), None, Some("rad")),
            ("yaw_ref_deg", None, None, Some("deg")),
            ("theta_dot", Some(Turning), None, None),
            ("yaw_deg_s", gyro, Some(Axis::Body(2)), Some("deg/s")),
            ("Pitch rate (dps)", gyro, Some(Axis::Body(1)), Some("deg/s")),
            ("motor_n_m", Some(Is(Channel::WheelTorqueCommand)), None, Some("N m")),
            ("motor_rpm", Some(Is(Channel::WheelSpeed)), None, Some("rpm")),
            ("speed_ref_rpm", None, None, Some("rpm")),
            ("theta_deg", Some(Angle), None, Some("deg")),
            ("sample", Some(Count), None, None),
            ("mode", None, None, None),
            // SensorLog, Sensor Logger, px4 ulog, a laboratory's own.
            ("gyroRotationX(rad/s)", gyro, Some(Axis::Body(0)), Some("rad/s")),
            ("motionRotationRateZ(rad/s)", gyro, Some(Axis::Body(2)), Some("rad/s")),
            ("accelerometerAccelerationY(G)", force, Some(Axis::Body(1)), Some("g")),
            ("motionUserAccelerationX(G)", Some(Derived), Some(Axis::Body(0)), Some("g")),
            ("magnetometerX(µT)", Some(Is(Channel::Vector)), Some(Axis::Body(0)), Some("uT")),
            ("mx_ut", Some(Is(Channel::Vector)), Some(Axis::Body(0)), Some("uT")),
            ("seconds_elapsed", Some(Time), None, None),
            ("gyro_rad[0]", gyro, Some(Axis::Number(0)), Some("rad/s")),
            ("accelerometer_m_s2[2]", force, Some(Axis::Number(2)), Some("m/s^2")),
            ("magnetometer_ga[1]", Some(Is(Channel::Vector)), Some(Axis::Number(1)), Some("gauss")),
            ("RW1 n (1/min)", Some(Is(Channel::WheelSpeed)), Some(Axis::Number(1)), Some("rpm")),
            ("RW1 cmd (mNm)", Some(Is(Channel::WheelTorqueCommand)), Some(Axis::Number(1)), Some("mN m")),
            ("wheel2_torque", Some(Is(Channel::WheelTorqueCommand)), Some(Axis::Number(2)), None),
            ("velocity", Some(Turning), None, None),
            ("torque_command_n_m", Some(Is(Channel::WheelTorqueCommand)), None, Some("N m")),
            ("wheel_x_rad_s", Some(Is(Channel::WheelSpeed)), Some(Axis::Body(0)), Some("rad/s")),
            ("wheel_x_n_m", Some(Is(Channel::WheelTorqueCommand)), Some(Axis::Body(0)), Some("N m")),
            ("rw_2_a", Some(Is(Channel::WheelCurrent)), Some(Axis::Number(2)), Some("A")),
            ("gyro_temperature_degc", Some(Is(Channel::Temperature)), None, Some("degC")),
            ("gyro_degc", None, None, Some("degC")),
            ("mag_x_g", Some(Is(Channel::Vector)), Some(Axis::Body(0)), Some("g")),
            ("Mag Y (mG)", Some(Is(Channel::Vector)), Some(Axis::Body(1)), Some("mg")),
            ("torque_x_a", Some(Is(Channel::WheelCurrent)), Some(Axis::Body(0)), Some("A")),
        ] {
            let found = named(column);
            assert_eq!((found.meaning, found.axis, found.unit), (meaning, axis, unit), "{column}: {found:?}");
        }
    }
}
