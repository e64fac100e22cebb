//! What data show without any regression: clipped readings, sensors that contradict each other, periodicities.

use whorl_dynamics::effects::{Signature, catalogue};

use crate::Unknown;
use crate::bins::noise::Digits;
use crate::bins::run::Run;
use crate::diagnosis::{Candidate, ParameterEstimate};
use crate::evidence::problem::Problem;
use crate::explanations::spectrum::lines;
use crate::parameters::Point;
use crate::search::Search;
use crate::search::step::point_of;

/// Power of what the other sensors say against the gyro, if no motion at all fits both.
fn contradicting_power(problem: &Problem, point: &Point) -> Option<f64> {
    let power = problem.kinematic_power(point).unwrap_or(1.0);
    (power > problem.reference.settings.contradiction_power).then_some(power)
}

impl Search<'_> {
    /// The gyro against the other sensors, if no motion at all fits both.
    pub(crate) fn contradiction(&self) -> Option<Unknown> {
        let point = point_of(self.problem, &self.design, &self.point, &self.best);
        contradicting_power(self.problem, &point).map(|power| Unknown {
            variable: "gyro_rate".to_owned(),
            frame: "body".to_owned(),
            axis: "x".to_owned(),
            parity: "odd".to_owned(),
            frequency_hz: None,
            share: (1.0 - 1.0 / power).clamp(0.0, 1.0),
            size: 0.0,
            unit: "rad/s".to_owned(),
        })
    }

    /// A periodicity of the residual that no effect explains, and its log evidence: the height of the peak as that of
    /// a normal variable, less the number of frequencies at which it might have been.
    pub(crate) fn periodicity(&self) -> Option<(Unknown, f64)> {
        let lines = lines(self.place(), &self.best);
        let least =
            if self.best.terms.is_empty() { 1.5 } else { 2.0 } * self.options.settings.certain_stddevs;
        if lines.strongest < least {
            return None;
        }
        let wheels = self.problem.reference.model.wheels();
        let (variable, frequency_hz) = match lines.orders.first() {
            Some((wheel, _)) => {
                (format!("{}_angle", wheels.get(*wheel).map_or("wheel", |w| w.name.as_str())), None)
            }
            None => ("time".to_owned(), lines.torque_hz.first().copied()),
        };
        let unknown = Unknown { variable, frequency_hz, ..Unknown::torque_in_time(0.0) };
        Some((unknown, 0.5 * lines.strongest.powi(2) - self.problem.frequencies().ln()))
    }

    /// Clipping and coarse steps of the gyro, which the readings themselves show.
    pub(crate) fn digital(&self) -> Option<Candidate> {
        let (effect, range_name, step_name) =
            catalogue().iter().find_map(|effect| match effect.signature() {
                Some(Signature::GyroDigits { range, step }) => Some((effect.info().id, range, step)),
                _ => None,
            })?;
        if self.options.exclude.iter().any(|e| e == effect) {
            return None;
        }
        let errors = &self.problem.reference.model.sensors.gyro.errors;
        let range = self
            .problem
            .runs
            .iter()
            .filter_map(|r| r.gyro_digits.clips_at_rad_s)
            .filter(|limit| *limit < 0.98 * errors.range)
            .fold(f64::INFINITY, f64::min);
        let step = self.problem.runs.iter().map(|r| r.gyro_digits.step_rad_s).fold(f64::INFINITY, f64::min);
        let coarse =
            step.is_finite() && step > 1.5 * errors.quantum && step > 0.3 * errors.noise_stddev.amin();
        if !range.is_finite() && !coarse {
            return None;
        }
        let parameter = |name: &str, estimate: f64, stddev: f64| ParameterEstimate {
            name: name.to_owned(),
            unit: "rad/s".to_owned(),
            estimate,
            stddev,
            at_bound: false,
            smallest_detectable: 5.0 * stddev,
        };
        let mut parameters = Vec::new();
        if range.is_finite() {
            parameters.push(parameter(range_name, range, 0.5 * step.clamp(1e-6, 1e-3)));
        }
        if coarse {
            parameters.push(parameter(step_name, step, 1e-3 * step));
        }
        let seen_nats = |run: &Run| {
            let Digits { clips_nats, step_nats, .. } = run.gyro_digits;
            clips_nats * f64::from(range.is_finite()) + step_nats * f64::from(coarse)
        };
        let log_evidence: f64 = self.problem.runs.iter().map(seen_nats).sum();
        Some(Candidate {
            effect: effect.to_owned(),
            delta_log_evidence: log_evidence,
            held_out_gain: self.held_out.as_ref().map(|held| held.runs.iter().map(seen_nats).sum()),
            // Readings that are rounded or cut off are no torque, and no other constant absorbs them.
            share_of_excess: 0.0,
            swallowed_by_base: 0.0,
            detectability: 2.0 * log_evidence,
            indistinguishable_from: Vec::new(),
            parameters,
        })
    }
}
