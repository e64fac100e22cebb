//! The shapes of a law: functions of one quantity.

use serde::Serialize;

use Growth::{Linear, Saturates, Superlinear, Unclear};
use Parity::{Even, Odd};

/// Symmetry about zero.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Parity {
    /// f(-x) = -f(x), as friction.
    Odd,
    /// f(-x) = f(x).
    Even,
    /// Neither, or the data lie on only one side of zero.
    None,
}

/// How a law grows from zero to the end of the data.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Growth {
    /// Saturates, as Coulomb friction.
    Saturates,
    /// In proportion, as viscous friction.
    Linear,
    /// Faster than in proportion, as drag.
    Superlinear,
    /// Undetermined.
    Unclear,
}

/// A function of one quantity.
#[derive(Debug)]
pub struct Shape {
    /// Its value at u, the quantity in units of [`crate::Quantity::scale`].
    pub of: fn(f64) -> f64,
    /// As an equation of the quantity `{x}`, with its parameter `{p}`.
    pub text: &'static str,
    /// In words, `{x}` being those of the quantity.
    pub words: &'static str,
    /// Symmetry.
    pub parity: Parity,
    /// Growth.
    pub growth: Growth,
    /// Symbols of the equation beyond the quantity.
    pub symbols: f64,
    /// Power of the quantity's unit that the equation has.
    pub power: i32,
    /// A number in it: name, value in units of u, meaning.
    pub parameter: Option<(&'static str, f64, &'static str)>,
}

const fn shape(
    of: fn(f64) -> f64,
    (text, words): (&'static str, &'static str),
    (parity, growth, symbols, power): (Parity, Growth, f64, i32),
    parameter: Option<(&'static str, f64, &'static str)>,
) -> Shape {
    Shape { of, text, words, parity, growth, symbols, power, parameter }
}

const NEITHER: Parity = Parity::None;
const WIDTH: Option<(&str, f64, &str)> = Some(("width", 0.05, "Width of the step."));
const LIMIT: Option<(&str, f64, &str)> = Some(("limit", 0.6, "Where it saturates."));
/// How many shapes a diagnosis tries.
pub const OF_DIAGNOSIS: usize = 5;

/// Every shape; a diagnosis tries the first [`OF_DIAGNOSIS`].
pub static SHAPES: [Shape; 8] = [
    shape(|u| u, ("{x}", "{x}"), (Odd, Linear, 0.0, 1), None),
    shape(|u| u * u, ("{x}^2", "the square of {x}"), (Even, Superlinear, 1.0, 2), None),
    shape(|u| u * u * u, ("{x}^3", "the cube of {x}"), (Odd, Superlinear, 1.0, 3), None),
    shape(f64::abs, ("abs({x})", "the size of {x}"), (Even, Linear, 1.0, 1), None),
    shape(|u| u / u.hypot(0.05), ("sign({x}, {p})", "the sign of {x}"), (Odd, Saturates, 1.0, 0), WIDTH),
    shape(|u| u * u.abs(), ("abs({x}) * {x}", "the signed square of {x}"), (Odd, Superlinear, 1.0, 2), None),
    shape(|u| u.clamp(-0.6, 0.6), ("limit({x}, {p})", "{x}, saturating"), (Odd, Saturates, 2.0, 1), LIMIT),
    shape(
        |u| u - u.clamp(-0.6, 0.6),
        ("beyond({x}, {p})", "{x} beyond a dead zone"),
        (Odd, Superlinear, 2.0, 1),
        Some(("edge", 0.6, "Half-width of the dead zone.")),
    ),
];

/// Those of an angle, sine and cosine of each harmonic.
pub static HARMONICS: [Shape; 6] = [
    shape(|u| u.sin(), ("sin({x})", "the sine of {x}"), (NEITHER, Unclear, 1.0, 0), None),
    shape(|u| u.cos(), ("cos({x})", "the cosine of {x}"), (NEITHER, Unclear, 1.0, 0), None),
    shape(|u| (2.0 * u).sin(), ("sin(2 * {x})", "the sine of 2 * {x}"), (NEITHER, Unclear, 2.0, 0), None),
    shape(|u| (2.0 * u).cos(), ("cos(2 * {x})", "the cosine of 2 * {x}"), (NEITHER, Unclear, 2.0, 0), None),
    shape(|u| (3.0 * u).sin(), ("sin(3 * {x})", "the sine of 3 * {x}"), (NEITHER, Unclear, 3.0, 0), None),
    shape(|u| (3.0 * u).cos(), ("cos(3 * {x})", "the cosine of 3 * {x}"), (NEITHER, Unclear, 3.0, 0), None),
];
