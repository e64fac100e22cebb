//! Terms as columns of the regression.

use nalgebra::Vector3;
use whorl_dynamics::Environment;
use whorl_dynamics::effects::written::Formula;
use whorl_prediction::Push;

use super::DiscoveryError;
use super::bench::{Bench, Pushing};
use crate::grammar::SHARE;
use crate::grammar::terms::{Direction, Term};

/// A term as one column of the regression, or one for each wheel.
#[derive(Debug, Clone)]
pub(super) struct Column {
    /// The term, by its place in the list.
    pub term: usize,
    /// Size of the factor whose coefficient is 1 in the regression: of the column's unit, so that all columns have a
    /// root mean square of the same torque.
    pub scale: f64,
    /// Its place among all that terms push.
    place: usize,
}

enum Compiled {
    Torque {
        factor: Formula,
        direction: Formula,
        lag_s: Option<f64>,
    },
    /// On each wheel: the factor of its speed, given as text of `wheel_speed[n]`.
    Wheels(Vec<Formula>),
}

fn compiled(term: &Term, wheels: usize, largest_rate_rad_s: f64) -> Result<Compiled, DiscoveryError> {
    let text = term.factor_in_numbers();
    if term.direction == Direction::Wheels {
        let own = |j: usize| {
            // Whole words only.
            let named = text.replace("speed", &format!("wheel_speed[{}]", j + 1));
            Formula::new(&named)
        };
        return Ok(Compiled::Wheels((0..wheels).map(own).collect::<Result<_, _>>()?));
    }
    let direction = term.direction_text(largest_rate_rad_s).unwrap_or_else(|| "vertical".to_owned());
    Ok(Compiled::Torque {
        factor: Formula::new(&text)?,
        direction: Formula::new(&direction)?,
        lag_s: term.shape.as_ref().filter(|_| term.is_lag).map(|shape| shape.value),
    })
}

/// Terms, compiled, and the columns that they have; terms that vanish or are not finite have none.
pub(super) struct Signals {
    compiled: Vec<Compiled>,
    pub columns: Vec<Column>,
}

impl Signals {
    pub fn of(
        bench: &Bench<'_>,
        terms: &[Term],
        wheels: usize,
        largest_rate_rad_s: f64,
    ) -> Result<Self, DiscoveryError> {
        let compiled: Vec<Compiled> =
            terms.iter().map(|term| compiled(term, wheels, largest_rate_rad_s)).collect::<Result<_, _>>()?;
        let of_term = |(term, compiled): (usize, &Compiled)| match compiled {
            Compiled::Torque { .. } => vec![term],
            Compiled::Wheels(factors) => vec![term; factors.len()],
        };
        let owners: Vec<usize> = compiled.iter().enumerate().flat_map(of_term).collect();
        let signals = Self { compiled, columns: Vec::new() };
        let begin = (Lags::of(&signals.compiled), vec![0.0; owners.len()], 0.0_f64);
        let sums = bench.over_runs(&begin, |(lags, squares, count), environment, step_s| {
            let mut pushes = Vec::with_capacity(squares.len());
            lags.push(&signals.compiled, environment, step_s, &mut pushes);
            for (square, push) in squares.iter_mut().zip(&pushes) {
                *square += size(push).powi(2);
            }
            *count += 1.0;
        })?;
        let count: f64 = sums.iter().map(|(.., count)| count).sum();
        let size_n_m = SHARE * bench.applied_n_m;
        let column = |(place, term): (usize, &usize)| {
            let square: f64 = sums.iter().map(|(_, squares, _)| squares[place]).sum();
            let rms = (square / count.max(1.0)).sqrt();
            (rms.is_finite() && rms > 1e-12).then(|| Column { term: *term, scale: size_n_m / rms, place })
        };
        let columns = owners.iter().enumerate().filter_map(column).collect();
        Ok(Self { columns, ..signals })
    }

    /// What the columns push in a run.
    pub fn pushing(&self) -> Pushing<'_> {
        let mut lags = Lags::of(&self.compiled);
        let mut all = Vec::new();
        Box::new(move |environment, step_s, pushes| {
            all.clear();
            lags.push(&self.compiled, environment, step_s, &mut all);
            let none = Push::Body(Vector3::zeros());
            let own = self.columns.iter().map(|c| scaled(all.get(c.place).unwrap_or(&none), c.scale));
            pushes.extend(own);
        })
    }
}

/// States of terms that lag.
#[derive(Clone)]
struct Lags(Vec<f64>);

impl Lags {
    fn of(compiled: &[Compiled]) -> Self {
        Self(vec![0.0; compiled.len()])
    }

    /// What all terms push; a lag is a first-order state that starts at zero and follows the factor.
    fn push(
        &mut self,
        compiled: &[Compiled],
        environment: &Environment<'_>,
        step_s: f64,
        to: &mut Vec<Push>,
    ) {
        for (term, state) in compiled.iter().zip(&mut self.0) {
            match term {
                Compiled::Torque { factor, direction, lag_s } => {
                    let now = factor.number(environment);
                    let size = lag_s.map_or(now, |lag_s| {
                        // Exact for a factor that stays the same over the step.
                        *state = now + (*state - now) * (-step_s / lag_s).exp();
                        *state
                    });
                    to.push(Push::Body(direction.vector_b(environment).unwrap_or_default() * size));
                }
                Compiled::Wheels(factors) => {
                    to.extend(factors.iter().enumerate().map(|(j, f)| Push::Wheel(j, f.number(environment))));
                }
            }
        }
    }
}

/// Size of what is pushed [N m].
fn size(push: &Push) -> f64 {
    match push {
        Push::Body(torque) => torque.norm(),
        Push::Wheel(_, torque) => torque.abs(),
        Push::Gyro(_) | Push::Turn(_) => 0.0,
    }
}

fn scaled(push: &Push, by: f64) -> Push {
    match *push {
        Push::Body(torque) => Push::Body(torque * by),
        Push::Wheel(wheel, torque) => Push::Wheel(wheel, torque * by),
        other => other,
    }
}
