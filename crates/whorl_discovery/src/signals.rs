//! Terms as signals over the runs.

use nalgebra::Vector3;
use rayon::prelude::*;
use whorl_diagnosis::laws::{Interval, LawBench, LawSignal};
use whorl_dynamics::effects::written::Formula;

use crate::DiscoveryError;
use crate::terms::{Direction, Term};

/// A term as one column of the regression, or one for each wheel.
#[derive(Debug, Clone)]
pub(crate) struct Column {
    /// The term, by its place in the list.
    pub term: usize,
    /// Size of the factor whose coefficient is 1 in the regression: of the column's unit, so that all columns have a
    /// root mean square of the same torque.
    pub scale: f64,
    /// By runs.
    pub signal: Vec<LawSignal>,
}

/// Share of the torque at work that a column has as root mean square.
const SHARE: f64 = 0.02;

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

/// The factor over the intervals of a run; with a lag, a first-order state that starts at zero and follows it.
fn values(factor: &Formula, lag_s: Option<f64>, intervals: &[Interval<'_>]) -> Vec<f64> {
    let mut state = 0.0;
    intervals
        .iter()
        .map(|interval| {
            let now = factor.number(&interval.environment);
            let Some(lag_s) = lag_s else { return now };
            // Exact for an input that is constant over the interval; the mean over it.
            let decay = (-interval.length_s / lag_s).exp();
            let mean = now + (state - now) * (1.0 - decay) * lag_s / interval.length_s.max(1e-9);
            state = now + (state - now) * decay;
            mean
        })
        .collect()
}

/// The columns of terms; terms that vanish or are not finite have none.
pub(crate) fn columns(
    bench: &LawBench,
    terms: &[Term],
    wheels: usize,
    largest_rate_rad_s: f64,
) -> Result<Vec<Column>, DiscoveryError> {
    let compiled: Vec<Compiled> =
        terms.iter().map(|term| compiled(term, wheels, largest_rate_rad_s)).collect::<Result<_, _>>()?;
    // One list of signals for each run.
    let by_run: Vec<Vec<(usize, LawSignal)>> =
        bench.over_runs(|_, intervals| of_run(&compiled, intervals))?;
    let size_n_m = SHARE * bench.applied_torque_rms_n_m();
    let Some(first) = by_run.first() else { return Ok(Vec::new()) };
    let terms: Vec<usize> = first.iter().map(|(term, _)| *term).collect();
    let made: Vec<Option<Column>> = terms
        .par_iter()
        .enumerate()
        .map(|(i, term)| {
            let runs: Vec<&LawSignal> = by_run.iter().filter_map(|run| run.get(i).map(|(_, s)| s)).collect();
            let (mut square, mut count) = (0.0, 0.0);
            for signal in &runs {
                match signal {
                    LawSignal::Torque(torque) => {
                        square += torque.iter().map(Vector3::norm_squared).sum::<f64>();
                        count += torque.len() as f64;
                    }
                    LawSignal::Wheel(_, torque) => {
                        square += torque.iter().map(|x| x * x).sum::<f64>();
                        count += torque.len() as f64;
                    }
                }
            }
            let rms = (square / f64::max(count, 1.0)).sqrt();
            if !(rms.is_finite() && rms > 1e-12) {
                return None;
            }
            let scale = size_n_m / rms;
            let signal = runs.iter().map(|s| scaled(s, scale)).collect();
            Some(Column { term: *term, scale, signal })
        })
        .collect();
    Ok(made.into_iter().flatten().collect())
}

fn scaled(signal: &LawSignal, by: f64) -> LawSignal {
    match signal {
        LawSignal::Torque(torque) => LawSignal::Torque(torque.iter().map(|g| g * by).collect()),
        LawSignal::Wheel(wheel, torque) => LawSignal::Wheel(*wheel, torque.iter().map(|x| x * by).collect()),
    }
}

fn of_run(compiled: &[Compiled], intervals: &[Interval<'_>]) -> Vec<(usize, LawSignal)> {
    let mut signals = Vec::new();
    for (term, compiled) in compiled.iter().enumerate() {
        match compiled {
            Compiled::Torque { factor, direction, lag_s } => {
                let torque = values(factor, *lag_s, intervals)
                    .into_iter()
                    .zip(intervals)
                    .map(|(x, i)| direction.vector_b(&i.environment).unwrap_or_default() * x)
                    .collect();
                signals.push((term, LawSignal::Torque(torque)));
            }
            Compiled::Wheels(factors) => {
                for (j, factor) in factors.iter().enumerate() {
                    let torque = values(factor, None, intervals);
                    signals.push((term, LawSignal::Wheel(j, torque)));
                }
            }
        }
    }
    signals
}
