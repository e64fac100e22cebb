//! Physical dimensions of written effects, and units as text.

use std::fmt;
use std::ops::{Div, Mul};

/// A product of powers of the base units kg, m, s, A, K. Radians have none. Exponents are kept doubled, so that a
/// square root has one too.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Hash)]
pub struct Dimension {
    twice: [i16; 5],
}

/// Symbol, dimension (not doubled), and size in base units.
const SYMBOLS: &[(&str, [i16; 5], f64)] = &[
    ("1", [0, 0, 0, 0, 0], 1.0),
    ("rad", [0, 0, 0, 0, 0], 1.0),
    ("deg", [0, 0, 0, 0, 0], std::f64::consts::PI / 180.0),
    ("kg", [1, 0, 0, 0, 0], 1.0),
    ("g", [1, 0, 0, 0, 0], 1e-3),
    ("m", [0, 1, 0, 0, 0], 1.0),
    ("cm", [0, 1, 0, 0, 0], 1e-2),
    ("mm", [0, 1, 0, 0, 0], 1e-3),
    ("s", [0, 0, 1, 0, 0], 1.0),
    ("ms", [0, 0, 1, 0, 0], 1e-3),
    ("A", [0, 0, 0, 1, 0], 1.0),
    ("K", [0, 0, 0, 0, 1], 1.0),
    ("Hz", [0, 0, -1, 0, 0], 1.0),
    ("N", [1, 1, -2, 0, 0], 1.0),
    ("mN", [1, 1, -2, 0, 0], 1e-3),
    ("Pa", [1, -1, -2, 0, 0], 1.0),
    ("bar", [1, -1, -2, 0, 0], 1e5),
    ("J", [1, 2, -2, 0, 0], 1.0),
    ("W", [1, 2, -3, 0, 0], 1.0),
    ("V", [1, 2, -3, -1, 0], 1.0),
    ("T", [1, 0, -2, -1, 0], 1.0),
];

/// Units in which a dimension is shown, each with what it counts in the search for the shortest text.
const SHOWN: &[(&str, [i16; 5])] = &[
    ("N m", [1, 2, -2, 0, 0]),
    ("N", [1, 1, -2, 0, 0]),
    ("V", [1, 2, -3, -1, 0]),
    ("Pa", [1, -1, -2, 0, 0]),
    ("kg", [1, 0, 0, 0, 0]),
    ("m", [0, 1, 0, 0, 0]),
    ("s", [0, 0, 1, 0, 0]),
    ("A", [0, 0, 0, 1, 0]),
    ("K", [0, 0, 0, 0, 1]),
];

impl Dimension {
    /// No dimension: a number or an angle.
    pub const NONE: Self = Self { twice: [0; 5] };
    /// Torque, N m.
    pub const TORQUE: Self = Self { twice: [2, 4, -4, 0, 0] };
    /// Rate, rad/s.
    pub const RATE: Self = Self { twice: [0, 0, -2, 0, 0] };
    /// Acceleration, m/s^2.
    pub const ACCELERATION: Self = Self { twice: [0, 2, -4, 0, 0] };
    /// Time, s.
    pub const TIME: Self = Self { twice: [0, 0, 2, 0, 0] };

    /// Raised to half of `halves`; `None` where an exponent would be no multiple of a half.
    #[must_use]
    pub fn power_of_halves(self, halves: i16) -> Option<Self> {
        let mut twice = [0; 5];
        for (slot, of) in twice.iter_mut().zip(self.twice) {
            let product = of.checked_mul(halves)?;
            if product % 2 != 0 {
                return None;
            }
            *slot = product / 2;
        }
        Some(Self { twice })
    }

    /// Reads a unit such as `N m s^2`, `rad/s/sqrt(s)` or `kg m^2`: factors side by side, each `/` dividing by the one
    /// factor that follows. Returns the dimension and the size of the unit in base units.
    ///
    /// # Errors
    /// What is no unit, and what is.
    pub fn parse(text: &str) -> Result<(Self, f64), String> {
        let bad = |what: &str| {
            let known: Vec<&str> = SYMBOLS.iter().map(|(symbol, ..)| *symbol).collect();
            format!("{what} in the unit `{text}`; allowed: {}, powers (m^2) and sqrt(s)", known.join(", "))
        };
        let (mut dimension, mut size) = (Self::NONE, 1.0);
        let (mut rest, mut divides, mut read) = (text.trim(), false, 0);
        while !rest.is_empty() {
            if let Some(after) = rest.strip_prefix('/') {
                if divides || read == 0 {
                    return Err(bad("a / without a unit before or after it"));
                }
                divides = true;
                rest = after.trim_start();
                continue;
            }
            let (inner, after, halves_each) = match rest.strip_prefix("sqrt(") {
                Some(inside) => {
                    let (inner, after) = inside.split_once(')').ok_or_else(|| bad("sqrt( without its )"))?;
                    (inner, after, 1)
                }
                None => {
                    let end = rest.find([' ', '/', '^', '*']).unwrap_or(rest.len());
                    let (inner, after) = rest.split_at(end);
                    (inner, after, 2)
                }
            };
            let inner = inner.trim();
            let (_, exponents, factor) = SYMBOLS
                .iter()
                .find(|(symbol, ..)| *symbol == inner)
                .ok_or_else(|| bad(&format!("`{inner}` is no unit")))?;
            let (mut power, mut after) = (1_i16, after);
            if let Some(raised) = after.strip_prefix('^') {
                let end = raised
                    .char_indices()
                    .find(|(i, c)| !(c.is_ascii_digit() || (*i == 0 && *c == '-')))
                    .map_or(raised.len(), |(i, _)| i);
                let (number, behind) = raised.split_at(end);
                power = number
                    .parse()
                    .ok()
                    .filter(|p: &i16| p.abs() <= 9)
                    .ok_or_else(|| bad("a power that is no whole number from -9 to 9"))?;
                after = behind;
            }
            let halves = if divides { -power } else { power } * halves_each;
            let mut base = [0; 5];
            base.iter_mut().zip(exponents).for_each(|(slot, of)| *slot = 2 * of);
            let raised = Self { twice: base }
                .power_of_halves(halves)
                .ok_or_else(|| bad("an exponent that is no multiple of a half"))?;
            dimension = dimension * raised;
            size *= factor.powf(0.5 * f64::from(halves));
            (divides, read) = (false, read + 1);
            rest = after.trim_start_matches([' ', '*']);
        }
        if divides || read == 0 {
            return Err(bad("something is missing"));
        }
        Ok((dimension, size))
    }

    /// A unit of this dimension that [`Self::parse`] reads: the usual one, else of base units.
    #[must_use]
    pub fn unit(self) -> String {
        let usual = self.to_string();
        if Self::parse(&usual).is_ok_and(|(dimension, _)| dimension == self) {
            return usual;
        }
        let factor = |(name, halves): (&str, &i16)| match *halves {
            0 => None,
            h if h % 2 == 0 => Some(format!("{name}^{}", h / 2)),
            h => Some(format!("sqrt({name})^{h}")),
        };
        let parts: Vec<String> =
            ["kg", "m", "s", "A", "K"].into_iter().zip(&self.twice).filter_map(factor).collect();
        parts.join(" ")
    }

    fn plain(of: [i16; 5]) -> Self {
        Self { twice: of.map(|x| 2 * x) }
    }
}

impl Mul for Dimension {
    type Output = Self;
    fn mul(self, other: Self) -> Self {
        let mut twice = self.twice;
        twice.iter_mut().zip(other.twice).for_each(|(a, b)| *a = a.saturating_add(b));
        Self { twice }
    }
}

impl Div for Dimension {
    type Output = Self;
    fn div(self, other: Self) -> Self {
        let mut twice = self.twice;
        twice.iter_mut().zip(other.twice).for_each(|(a, b)| *a = a.saturating_sub(b));
        Self { twice }
    }
}

/// Unit raised to half of `halves`, as text.
fn shown(unit: &str, halves: i16) -> String {
    match halves {
        2 => unit.to_owned(),
        1 => format!("sqrt({unit})"),
        h if h % 2 == 0 && unit.contains(' ') => format!("({unit})^{}", h / 2),
        h if h % 2 == 0 => format!("{unit}^{}", h / 2),
        h => format!("{unit}^{}", 0.5 * f64::from(h)),
    }
}

impl fmt::Display for Dimension {
    /// The shortest product of usual units.
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        if *self == Self::NONE {
            return f.write_str("1");
        }
        // One or two derived units in front, what is left in base units behind.
        let mut best: Option<(i16, Vec<(usize, i16)>)> = None;
        let derived = 4;
        for first in 0..derived {
            for second in 0..derived {
                for (a, b) in (-4..=4).flat_map(|a| (-4..=4).map(move |b| (a, b))) {
                    if b != 0 && (first == second || a == 0) {
                        continue;
                    }
                    let of = |i: usize, halves: i16| {
                        SHOWN.get(i).and_then(|(_, d)| Self::plain(*d).power_of_halves(halves))
                    };
                    let (Some(x), Some(y)) = (of(first, a), of(second, b)) else { continue };
                    let left = *self / x / y;
                    let mut parts = vec![(first, a), (second, b)];
                    parts.extend(left.twice.iter().enumerate().map(|(i, h)| (derived + i, *h)));
                    parts.retain(|(_, halves)| *halves != 0);
                    // Torques come first: what an effect gives is said in N m.
                    let cost = parts
                        .iter()
                        .map(|(i, h)| if *i == 0 { 0 } else { 3 } + h.abs() + i16::from(*h < 0))
                        .sum();
                    if best.as_ref().is_none_or(|(least, _)| cost < *least) {
                        best = Some((cost, parts));
                    }
                }
            }
        }
        let parts = best.map(|(_, parts)| parts).unwrap_or_default();
        let name = |i: usize| SHOWN.get(i).map_or("", |(name, _)| *name);
        let above: Vec<String> =
            parts.iter().filter(|(_, h)| *h > 0).map(|(i, h)| shown(name(*i), *h)).collect();
        f.write_str(if above.is_empty() { "1" } else { "" })?;
        f.write_str(&above.join(" "))?;
        for (i, halves) in parts.iter().filter(|(_, h)| *h < 0) {
            let below = shown(name(*i), -halves);
            if below.contains(' ') && !below.contains('(') {
                write!(f, "/({below})")?;
            } else {
                write!(f, "/{below}")?;
            }
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn of(text: &str) -> Dimension {
        Dimension::parse(text).unwrap().0
    }

    #[test]
    fn units_are_read_and_shown() {
        for text in
            ["N m", "N m/V", "N m s", "kg m^2", "1/s", "Pa", "N m/sqrt(s)", "m/s^2", "K", "A m^2", "N m/K"]
        {
            assert_eq!(of(&of(text).to_string()), of(text), "{text} shown as {}", of(text));
        }
        assert_eq!(of("N m").to_string(), "N m");
        assert_eq!(of("A s").to_string(), "N m/V");
        for text in ["1/N/m", "m^3/N/s", "V^3/K^2", "N m/V/V/K"] {
            assert_eq!(of(&of(text).unit()), of(text), "{text} as {}", of(text).unit());
        }
        assert_eq!((of("N m/V") * of("V") * of("V")).to_string(), "N m V");
        assert_eq!(of("rad/s"), Dimension::RATE);
        assert_eq!(of("rad/s/sqrt(s)") * of("sqrt(s)"), Dimension::RATE);
        // 1 T A m^2 = 1 N m, by their definitions.
        assert_eq!(of("T A m^2"), Dimension::TORQUE);
        assert_eq!(Dimension::parse("mN cm").unwrap().1, 1e-5);
        assert!((Dimension::parse("deg/s").unwrap().1 - 0.017_453_292_519_943_295).abs() < 1e-17);
    }

    #[test]
    fn what_is_no_unit_is_refused() {
        for text in ["", "N q", "/s", "m/", "m^x", "m^77", "sqrt(m", "m//s"] {
            let error = Dimension::parse(text).unwrap_err();
            assert!(error.contains("unit"), "{error}");
        }
    }
}
