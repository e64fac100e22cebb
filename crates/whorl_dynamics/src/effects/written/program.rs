//! An equation in the form in which it is evaluated: a list of steps without jumps or loops, each writing one number
//! that later steps read.

use super::quantity::Read;
use super::spline::Spline;
use crate::Environment;

/// Most steps of an equation: bounds its cost, whatever a file holds.
pub(super) const MOST_STEPS: usize = 192;

/// Where a step's number stands.
pub(super) type At = u16;

/// One step.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum Step {
    Constant(f64),
    Read(Read),
    Parameter(u16),
    State(u16),
    Negative(At),
    Sum(At, At),
    Difference(At, At),
    Product(At, At),
    Quotient(At, At),
    WholePower(At, i32),
    Power(At, At),
    /// `|a|^b` with the sign of a.
    OddPower(At, At),
    Abs(At),
    Root(At),
    Sine(At),
    Cosine(At),
    Tanh(At),
    Exponential(At),
    Logarithm(At),
    Arctangent(At, At),
    Least(At, At),
    Largest(At, At),
    Hypotenuse(At, At),
    /// a / hypot(a, b): -1 to 1, smooth over a width b.
    Sign(At, At),
    /// a within -b and b.
    Limited(At, At),
    /// What of a is beyond -b and b.
    Beyond(At, At),
    /// Angle within half a turn either side of zero.
    Wrapped(At),
    /// Curve number `.1` at a.
    Curve(At, u16),
}

/// Steps in order; the last one, two or three results are named by `results`.
#[derive(Debug, Clone, PartialEq, Default)]
pub(super) struct Program {
    pub steps: Vec<Step>,
    pub results: Vec<At>,
    pub curves: Vec<Spline>,
}

impl Program {
    /// The first three results; what the equation does not give is zero. `own` are the parameters of `wheel`.
    #[inline]
    pub fn evaluate(
        &self,
        own: &[f64],
        environment: &Environment<'_>,
        hidden: &[f64],
        wheel: usize,
    ) -> [f64; 3] {
        // The smaller, the less is cleared.
        if self.steps.len() <= 24 {
            self.within::<24>(own, environment, hidden, wheel)
        } else if self.steps.len() <= 64 {
            self.within::<64>(own, environment, hidden, wheel)
        } else {
            self.within::<MOST_STEPS>(own, environment, hidden, wheel)
        }
    }

    fn within<const N: usize>(
        &self,
        own: &[f64],
        environment: &Environment<'_>,
        hidden: &[f64],
        wheel: usize,
    ) -> [f64; 3] {
        let mut numbers = [0.0_f64; N];
        for (at, step) in self.steps.iter().enumerate().take(N) {
            let of = |i: At| numbers.get(usize::from(i)).copied().unwrap_or(0.0);
            let value = match *step {
                Step::Constant(value) => value,
                Step::Read(read) => read.of(environment, wheel),
                Step::Parameter(i) => own.get(usize::from(i)).copied().unwrap_or(0.0),
                Step::State(i) => hidden.get(usize::from(i)).copied().unwrap_or(0.0),
                Step::Negative(a) => -of(a),
                Step::Sum(a, b) => of(a) + of(b),
                Step::Difference(a, b) => of(a) - of(b),
                Step::Product(a, b) => of(a) * of(b),
                Step::Quotient(a, b) => of(a) / of(b),
                Step::WholePower(a, n) => of(a).powi(n),
                Step::Power(a, b) => of(a).powf(of(b)),
                Step::OddPower(a, b) => {
                    let a = of(a);
                    if a == 0.0 { 0.0 } else { a.abs().powf(of(b)).copysign(a) }
                }
                Step::Abs(a) => of(a).abs(),
                Step::Root(a) => of(a).sqrt(),
                Step::Sine(a) => of(a).sin(),
                Step::Cosine(a) => of(a).cos(),
                Step::Tanh(a) => of(a).tanh(),
                Step::Exponential(a) => of(a).exp(),
                Step::Logarithm(a) => of(a).ln(),
                Step::Arctangent(a, b) => of(a).atan2(of(b)),
                Step::Least(a, b) => of(a).min(of(b)),
                Step::Largest(a, b) => of(a).max(of(b)),
                Step::Hypotenuse(a, b) => of(a).hypot(of(b)),
                Step::Sign(a, b) => of(a) / of(a).hypot(of(b)),
                Step::Limited(a, b) => {
                    let b = of(b).abs();
                    of(a).min(b).max(-b)
                }
                Step::Beyond(a, b) => {
                    let b = of(b).abs();
                    of(a) - of(a).min(b).max(-b)
                }
                Step::Wrapped(a) => whorl_math::wrap_angle_rad(of(a)),
                Step::Curve(a, curve) => {
                    self.curves.get(usize::from(curve)).map_or(0.0, |curve| curve.at(of(a), own))
                }
            };
            if let Some(slot) = numbers.get_mut(at) {
                *slot = value;
            }
        }
        let mut results = [0.0; 3];
        for (slot, at) in results.iter_mut().zip(&self.results) {
            *slot = numbers.get(usize::from(*at)).copied().unwrap_or(0.0);
        }
        results
    }

    /// What it reads of the environment.
    pub fn reads(&self) -> impl Iterator<Item = Read> {
        self.steps.iter().filter_map(|step| match step {
            Step::Read(read) => Some(*read),
            _ => None,
        })
    }

    /// Whether a parameter takes part.
    pub fn uses_parameter(&self, parameter: usize) -> bool {
        let of_curves = self.curves.iter().any(|c| c.parameters().contains(&parameter));
        of_curves
            || self
                .steps
                .iter()
                .any(|step| matches!(step, Step::Parameter(i) if usize::from(*i) == parameter))
    }
}
