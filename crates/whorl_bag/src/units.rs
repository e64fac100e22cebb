//! Units that columns may have, and what turns them into SI.

use std::f64::consts::PI;

/// SI value = `factor` * number + `offset`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Unit {
    /// Its name in maps.
    pub name: &'static str,
    /// SI units per unit.
    pub factor: f64,
    /// SI value of a zero.
    pub offset: f64,
}

const fn unit(name: &'static str, factor: f64) -> Unit {
    Unit { name, factor, offset: 0.0 }
}

/// Standard gravity [m/s^2], by definition of the unit g (CGPM 1901).
const STANDARD_GRAVITY_M_S2: f64 = 9.806_65;

/// The first of each is the default. [rad/s]
pub(crate) const RATE: &[Unit] =
    &[unit("rad/s", 1.0), unit("deg/s", PI / 180.0), unit("mrad/s", 1e-3), unit("mdeg/s", PI / 180e3)];
/// \[rad\]
pub(crate) const ANGLE: &[Unit] = &[unit("rad", 1.0), unit("deg", PI / 180.0)];

/// [m/s^2]
pub(crate) const SPECIFIC_FORCE: &[Unit] =
    &[unit("m/s^2", 1.0), unit("g", STANDARD_GRAVITY_M_S2), unit("mg", STANDARD_GRAVITY_M_S2 * 1e-3)];
/// [rad/s]
pub(crate) const WHEEL_SPEED: &[Unit] =
    &[unit("rad/s", 1.0), unit("rpm", PI / 30.0), unit("rev/s", 2.0 * PI), unit("deg/s", PI / 180.0)];
/// [N m]
pub(crate) const TORQUE: &[Unit] =
    &[unit("N m", 1.0), unit("mN m", 1e-3), unit("uN m", 1e-6), unit("N cm", 1e-2)];
/// \[A\]
pub(crate) const CURRENT: &[Unit] = &[unit("A", 1.0), unit("mA", 1e-3)];

/// \[s\]
pub(crate) const ON_TIME: &[Unit] = &[unit("s", 1.0), unit("ms", 1e-3), unit("us", 1e-6)];
/// [1]
pub(crate) const SHARE: &[Unit] = &[unit("1", 1.0), unit("%", 1e-2)];
/// \[V\]
pub(crate) const VOLTAGE: &[Unit] = &[unit("V", 1.0), unit("mV", 1e-3)];
/// \[Pa\]
pub(crate) const PRESSURE: &[Unit] = &[
    unit("Pa", 1.0),
    unit("hPa", 1e2),
    unit("kPa", 1e3),
    unit("MPa", 1e6),
    unit("bar", 1e5),
    // Pound-force per square inch: 0.453 592 37 kg * 9.806 65 m/s^2 / (0.0254 m)^2.
    unit("psi", 6_894.757_293_168),
];
/// \[K\]
pub(crate) const TEMPERATURE: &[Unit] = &[
    unit("K", 1.0),
    Unit { name: "degC", factor: 1.0, offset: whorl_math::CELSIUS_ZERO_K },
    Unit { name: "degF", factor: 5.0 / 9.0, offset: 273.15 - 32.0 * 5.0 / 9.0 },
];

/// Time units with their power of ten.
pub(crate) const TIME: &[(&str, i32)] = &[("s", 0), ("ms", -3), ("us", -6), ("ns", -9)];

/// The number in a cell as whole nanoseconds: without rounding for what has at most nanoseconds, so that also
/// seconds since 1970 keep theirs.
pub(crate) fn nanoseconds(text: &str, unit_power: i32) -> Option<i64> {
    let (negative, unsigned) = match text.strip_prefix('-') {
        Some(rest) => (true, rest),
        None => (false, text.strip_prefix('+').unwrap_or(text)),
    };
    let (whole, fraction) = unsigned.split_once('.').unwrap_or((unsigned, ""));
    let places = usize::try_from(9 + unit_power).ok()?;
    let digits = |s: &str| s.bytes().all(|b| b.is_ascii_digit());
    let exact = fraction.trim_end_matches('0').len() <= places;
    if !digits(whole) || !digits(fraction) || whole.len() + fraction.len() == 0 || !exact {
        let ns = text.parse::<f64>().ok()? * 10f64.powi(9 + unit_power);
        return (ns.abs() < LARGEST_NS as f64).then_some(ns.round() as i64);
    }
    let mut ns: i64 = 0;
    let padded = fraction.bytes().chain(std::iter::repeat(b'0')).take(places);
    for digit in whole.bytes().chain(padded) {
        ns = ns.checked_mul(10)?.checked_add(i64::from(digit - b'0'))?;
    }
    (ns < LARGEST_NS).then_some(if negative { -ns } else { ns })
}

/// Times beyond +-127 years are none; so differences of two fit.
const LARGEST_NS: i64 = 4_000_000_000_000_000_000;

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn times_keep_their_nanoseconds() {
        let table = [
            ("1700000000.123456789", 0, Some(1_700_000_000_123_456_789)),
            ("1700000000123456789", -9, Some(1_700_000_000_123_456_789)),
            ("-0.5", 0, Some(-500_000_000)),
            ("2.5", -3, Some(2_500_000)),
            ("1e-3", 0, Some(1_000_000)),
            (".25", -6, Some(250)),
            ("3.1400000000000", 0, Some(3_140_000_000)),
            ("0.30000000000000004", 0, Some(300_000_000)),
            ("1.5", -9, Some(2)),
            ("5e18", -9, None),
            ("1e300", 0, None),
            ("99999999999999999999", -9, None),
            ("nan", 0, None),
            ("", 0, None),
            (".", 0, None),
            ("1,5", 0, None),
        ];
        for (text, power, expected) in table {
            assert_eq!(nanoseconds(text, power), expected, "{text}");
        }
    }

    #[test]
    fn units_are_those_of_the_tables() {
        let si = |table: &[Unit], name: &str, x: f64| {
            let unit = table.iter().find(|unit| unit.name == name).unwrap();
            unit.factor * x + unit.offset
        };
        for (given, expected) in [
            (si(RATE, "deg/s", 180.0), PI),
            (si(SPECIFIC_FORCE, "mg", 1000.0), 9.806_65),
            (si(WHEEL_SPEED, "rpm", 60.0), 2.0 * PI),
            (si(TORQUE, "N cm", 100.0), 1.0),
            (si(PRESSURE, "psi", 14.695_948_775), 101_325.0),
            (si(TEMPERATURE, "degC", 20.0), 293.15),
            (si(TEMPERATURE, "degF", 212.0), 373.15),
            (si(SHARE, "%", 25.0), 0.25),
        ] {
            assert!((given - expected).abs() < 1e-8 * expected.abs().max(1.0), "{given} {expected}");
        }
    }
}
