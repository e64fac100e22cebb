//! What a name stands for beside other columns, and by its numbers.

use whorl_bag::Channel;

use super::group::{Group, Groups, steady_length};
use super::names::Meaning;
use super::{Preset, units};

/// Lengths that are gravity, in each unit of specific force, within this share \[1\].
const NEAR: f64 = 0.2;
/// One reading in so many may be wrong.
const FEW: usize = 20;

/// What three columns of one name are, by their length.
pub fn by_numbers(group: &Group<'_>) -> Option<Meaning> {
    let length = steady_length(group)?;
    let is_gravity = units::of_gravity(length, NEAR).is_some();
    Some(Meaning::Channel(if is_gravity { Channel::Accelerometer } else { Channel::Vector }))
}

/// What a name stands for beside other columns: `u_x, u_y, u_z` of length one are a direction and no torques, `w` beside `u` is a
/// wheel's speed, and so is what is faster than gyros measure; `velocity` is that of a hinge where nothing else turns, and a lone
/// `torque` then acts on the body.
pub fn seen_otherwise(
    meaning: Meaning,
    group: &Group<'_>,
    all: &Groups<'_>,
    preset: Option<Preset>,
) -> Option<Channel> {
    let named = |wanted: Channel| {
        all.iter().filter(move |((_, meaning), _)| *meaning == Some(Meaning::Channel(wanted)))
    };
    let has =
        |wanted: Channel| named(wanted).any(|(_, group)| group.iter().any(|(name, _)| name.axis.is_some()));
    let is_called = |wanted: Meaning| all.keys().any(|(_, meaning)| *meaning == Some(wanted));
    let alone = group.iter().all(|(name, _)| name.axis.is_none());
    let is_wheel = match preset {
        Some(preset) => preset == Preset::WheelBench,
        None => has(Channel::Gyro) || turns_as_a_wheel(all),
    };
    let turns_alone = [Meaning::Turning, Meaning::Angle, Meaning::Encoder].into_iter().any(is_called);
    let is_hinge = match preset {
        Some(preset) => preset == Preset::Hinge,
        None => turns_alone && !is_wheel && !is_called(Meaning::Channel(Channel::WheelSpeed)),
    };
    let has_angle = is_called(Meaning::Angle) && !has(Channel::Gyro);
    let channel = match meaning {
        Meaning::Channel(channel) => channel,
        Meaning::Turning if is_wheel => Channel::WheelSpeed,
        // Beside the angle of a hinge it is that angle's, whatever else turns.
        Meaning::Turning if is_hinge || has_angle => Channel::Gyro,
        _ => return None,
    };
    Some(match channel {
        Channel::WheelTorqueCommand
            if steady_length(group).is_some_and(|length| (length - 1.0).abs() < 0.02) =>
        {
            Channel::Vector
        }
        Channel::WheelTorqueCommand if alone && is_hinge && named(Channel::WheelSpeed).next().is_none() => {
            Channel::BodyTorque
        }
        Channel::Gyro
            if alone
                && meaning != Meaning::Turning
                && !has(Channel::Gyro)
                && is_called(Meaning::Channel(Channel::WheelTorqueCommand)) =>
        {
            Channel::WheelSpeed
        }
        Channel::Gyro if alone && !is_called_gyro(group) && is_fast(group) => Channel::WheelSpeed,
        other => other,
    })
}

/// Whether what is only called a speed is that of a wheel: it is faster than gyros measure, or a motor's torque or current stands
/// beside it and no angle of a hinge.
fn turns_as_a_wheel(all: &Groups<'_>) -> bool {
    let turning = all.iter().filter(|((_, meaning), _)| *meaning == Some(Meaning::Turning));
    let has_angle = all.keys().any(|(_, meaning)| *meaning == Some(Meaning::Angle));
    let of_a_motor = |(stem, meaning): &(String, Option<Meaning>)| {
        let drives = [Channel::WheelTorqueCommand, Channel::WheelCurrent].map(Meaning::Channel);
        let is_named =
            stem.split(' ').any(|word| ["motor", "wheel", "rw"].iter().any(|of| word.starts_with(of)));
        is_named && meaning.is_some_and(|meaning| drives.contains(&meaning))
    };
    let has_motor = all.keys().any(of_a_motor);
    // A motor may as well drive a hinge, whose rate is called a velocity sooner than a speed.
    let is_speed = |stem: &str| stem.ends_with("speed");
    turning.clone().any(|((stem, _), group)| is_fast(group) || has_motor && !has_angle && is_speed(stem))
}

/// Whether a sensor's own name says that it is a gyro.
fn is_called_gyro(group: &Group<'_>) -> bool {
    group.iter().any(|(name, _)| name.stem.contains("gyr"))
}

/// Whether more than a few readings are beyond what the widest gyros measure. Without a unit, in the finest that is usual.
fn is_fast(group: &Group<'_>) -> bool {
    group.iter().any(|(name, column)| {
        let known = Channel::Gyro.info().units.iter().find(|known| Some(known.name) == name.unit);
        let rad_s = known.map_or(1f64.to_radians(), |unit| unit.factor);
        let fast = column.present().filter(|x| x.abs() * rad_s > units::FASTEST_DEG_S.to_radians()).count();
        fast * FEW > column.present().count()
    })
}
