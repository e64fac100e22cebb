//! Units: as names say, and by plausibility.

use whorl_bag::{Channel, LookedColumn};
use whorl_math::statistics::median;

use whorl_math::GRAVITY_M_S2;

use super::lines::{Origin, Sourced, number};
use super::names::Named;

/// Standard gravity in the units of specific force.
const GRAVITY: [(&str, f64); 3] = [("m/s^2", GRAVITY_M_S2), ("g", 1.0), ("mg", 1000.0)];

/// The unit in which a length is gravity, within a share of it.
#[must_use]
pub fn of_gravity(length: f64, share: f64) -> Option<&'static str> {
    GRAVITY.iter().find(|(_, gravity)| (length / gravity - 1.0).abs() < share).map(|(unit, _)| *unit)
}

/// A steady length within this share of gravity says the unit \[1\].
const NEAR: f64 = 0.25;
/// No usual gyro turns as fast: 2000 deg/s in rad/s.
const FASTEST_RAD_S: f64 = 35.0;
/// Nor as fast: the widest ranges there are, in deg/s.
pub const FASTEST_DEG_S: f64 = 4_000.0;
/// Gyros are noisier than this in deg/s, and less so in rad/s: MEMS sensors have 0.02 to 0.3 deg/s per sample.
const NOISE_BETWEEN: f64 = 0.01;
/// Wheels of such rigs turn slower than 19,000 revolutions a minute \[rad/s\].
const FASTEST_WHEEL_RAD_S: f64 = 2_000.0;
/// Their motors have less torque \[N m\] and current \[A\].
const STRONGEST_N_M: f64 = 2.0;
const LARGEST_A: f64 = 40.0;

/// The unit of a channel's columns; `None` where it has none. `length`: the steady length of three columns; `partial`: the usual
/// length of fewer.
#[must_use]
pub fn of(
    channel: Channel,
    members: &[(&Named, &LookedColumn)],
    length: Option<f64>,
    partial: Option<f64>,
) -> Option<Sourced<String>> {
    let info = channel.info();
    if info.units.is_empty() || channel == Channel::Vector {
        return None;
    }
    let stated = members.iter().find_map(|(name, _)| name.unit);
    let stated = stated.filter(|unit| info.units.iter().any(|known| known.name == *unit));
    let largest =
        members.iter().flat_map(|(_, column)| column.present()).fold(0.0, |m: f64, x| m.max(x.abs()));
    let say = |unit: &str, origin: Origin, words: String| Sourced::new(unit.to_owned(), origin, words);
    let by_name = |unit: &str| say(unit, Origin::Stated, "its name says the unit".to_owned());
    let assumed = |unit: &str, why: &str| say(unit, Origin::Assumed, format!("{why}; check it"));
    let size = number(largest);
    Some(match (channel, stated) {
        (Channel::Accelerometer, _) => match (length.and_then(|length| of_gravity(length, NEAR)), stated) {
            (Some(seen), _) => say(
                seen,
                Origin::Measured,
                format!("its usual length is {}", number(length.unwrap_or_default())),
            ),
            (None, Some(unit)) => by_name(unit),
            (None, None) => match (partial, partial.and_then(|length| of_gravity(length, NEAR))) {
                (Some(length), Some(unit)) => {
                    let size = number(length);
                    assumed(
                        unit,
                        &format!("without all axes it is usually {size} long, which is gravity in {unit}"),
                    )
                }
                (Some(_), None) => assumed("m/s^2", "without all axes it does not show gravity's size"),
                (None, _) => assumed("m/s^2", "its length is no steady gravity"),
            },
        },
        (_, Some(unit)) => by_name(unit),
        (Channel::Gyro | Channel::TrueRate, None) if largest > FASTEST_DEG_S => {
            assumed("mdeg/s", &format!("up to {size}, more than a usual gyro measures in deg/s"))
        }
        (Channel::Gyro | Channel::TrueRate, None) if largest > FASTEST_RAD_S => {
            assumed("deg/s", &format!("up to {size}, more than a usual gyro measures in rad/s"))
        }
        (Channel::Gyro | Channel::TrueRate, None) => {
            let noise = median(members.iter().map(|(_, column)| neighbours(column)));
            if noise > NOISE_BETWEEN {
                assumed("deg/s", &format!("its noise of {} is more likely deg/s", number(noise)))
            } else {
                assumed("rad/s", &format!("its noise of {} is more likely rad/s", number(noise)))
            }
        }
        (Channel::WheelSpeed, None) => {
            let is_called_rpm = members.iter().any(|(name, _)| matches!(name.stem.as_str(), "n" | "rpm"));
            if is_called_rpm {
                assumed("rpm", "n is what revolutions a minute are often called")
            } else if largest > FASTEST_WHEEL_RAD_S {
                assumed("rpm", &format!("up to {size}, more than wheels turn in rad/s"))
            } else {
                assumed("rad/s", &format!("up to {size}"))
            }
        }
        (
            Channel::WheelTorqueCommand
            | Channel::BodyTorque
            | Channel::BallastMoment
            | Channel::GimbalTorque,
            None,
        ) => {
            let unit = if largest > STRONGEST_N_M { "mN m" } else { "N m" };
            assumed(unit, &format!("up to {size}"))
        }
        (Channel::WheelCurrent, None) => {
            assumed(if largest > LARGEST_A { "mA" } else { "A" }, &format!("up to {size}"))
        }
        (Channel::BusVoltage, None) => {
            assumed(if largest > 1_000.0 { "mV" } else { "V" }, &format!("up to {size}"))
        }
        (Channel::TankPressure, None) => {
            assumed(if largest > 1e4 { "Pa" } else { "bar" }, &format!("up to {size}"))
        }
        (Channel::Temperature, None) => {
            let usual = median(members.iter().flat_map(|(_, column)| column.present()));
            assumed(
                if (200.0..400.0).contains(&usual) { "K" } else { "degC" },
                &format!("about {}", number(usual)),
            )
        }
        (_, None) => {
            let first = info.units.first().map(|unit| unit.name).unwrap_or_default();
            assumed(first, &format!("up to {size}"))
        }
    })
}

/// The usual noise of a column, from differences of neighbours that differ.
fn neighbours(column: &LookedColumn) -> f64 {
    let values: Vec<f64> = column.present().collect();
    let differences = values.windows(3).filter_map(|three| {
        let [a, b, c] = three else { return None };
        let bend = (c - 2.0 * b + a).abs();
        (bend > 0.0).then_some(bend)
    });
    // Of second differences, whose variance is six times the noise's; the median of |x| is 0.67 standard deviations.
    let typical = median(differences) / 0.6745 / 6f64.sqrt();
    if typical.is_finite() { typical } else { 0.0 }
}
