//! Evaluates laws that a caller proposes by the evidence of this crate: the basis of a search for the form of a missing law.
//!
//! A torque that any function of the motion gives passes through the whitening filter like an effect; beside the
//! platform's own parameters it has a log evidence ([`LawRegression::fit`]). That only proposes. The answer follows
//! from [`LawBench::evaluate`]: effects of the catalogue, written ones as well, each fitted where it fits best, with the noise
//! that is likeliest beside it, training and held-out runs together.

use nalgebra::{DMatrix, DVector, Vector3};
use whorl_dynamics::effects::{catalogue, find};
use whorl_dynamics::{Environment, ModelPrior, PlatformModel};
use whorl_recording::Recording;

use crate::evidence::nuisance::Nuisance;
use crate::evidence::problem::{Problem, ProcessNoise};
use crate::evidence::regression::{Estimate, Normal};
use crate::explanations::hypothesis::Hypothesis;
use crate::parameters::Point;
use crate::search::Search;
use crate::search::expected_information::make_columns_for;
use crate::search::step::{NO_FIT, base_point_with, dataset};
use crate::whitening::columns::{GROUPS, LANES, UnmodelledInput, unmodelled_input_response};
use crate::whitening::mechanics::Mechanics;
use crate::{DiagnosisError, Options, prepare, threads};

/// A signal that a law would add, over the intervals between the nodes of one run.
#[derive(Debug, Clone, PartialEq)]
pub enum LawSignal {
    /// Torque on the body, body axes [N m].
    Torque(Vec<Vector3<f64>>),
    /// Torque on this wheel about its axis, its reaction on the body [N m].
    Wheel(usize, Vec<f64>),
}

impl LawSignal {
    fn unmodelled_input(self) -> UnmodelledInput {
        match self {
            Self::Torque(torque) => UnmodelledInput::Torque(torque),
            Self::Wheel(wheel, torque) => UnmodelledInput::Wheel(wheel, torque),
        }
    }
}

/// An interval between two nodes of a run, as an effect sees it half-way.
#[derive(Debug, Clone, Copy)]
pub struct Interval<'a> {
    /// What an effect sees; `acceleration` is not known.
    pub environment: Environment<'a>,
    /// Length \[s\].
    pub length_s: f64,
}

/// A law fitted linearly beside the platform's own parameters.
#[derive(Debug, Clone, PartialEq)]
pub struct LawFit {
    /// Log evidence over that of the platform's own parameters alone, training and held-out runs together.
    pub log_evidence: f64,
    /// Log likelihood gained on held-out runs by the fit to the training runs.
    pub held_out_gain: f64,
    /// Coefficients of the signals.
    pub coefficients: Vec<f64>,
    /// Their standard deviations.
    pub stddevs: Vec<f64>,
}

/// The whitened regression of signals beside the platform's own parameters, which are integrated out.
#[derive(Debug, Clone)]
pub struct LawRegression {
    all: Normal,
    training: Normal,
    held_out: Normal,
}

impl LawRegression {
    /// Fits some of the signals together; their coefficients have priors of this standard deviation about zero. `None`
    /// where they cannot be told apart.
    #[must_use]
    pub fn fit(&self, signals: &[usize], prior_stddev: f64) -> Option<LawFit> {
        let variance = prior_stddev * prior_stddev;
        let all = Estimate::new(&self.all, signals, |_| variance)?;
        let training = Estimate::new(&self.training, signals, |_| variance)?;
        let covariance = all.covariance();
        Some(LawFit {
            log_evidence: all.log_evidence,
            held_out_gain: -0.5 * training.misfit_change(&self.held_out),
            coefficients: all.value.iter().copied().collect(),
            stddevs: covariance.diagonal().iter().map(|v| v.max(0.0).sqrt()).collect(),
        })
    }

    /// Correlation of two signals, what the platform's own parameters explain of them left out.
    #[must_use]
    pub fn correlation(&self, a: usize, b: usize) -> f64 {
        let of = |i: usize, j: usize| self.all.matrix.get((i, j)).copied().unwrap_or(0.0);
        of(a, b) / (of(a, a) * of(b, b)).sqrt().max(f64::MIN_POSITIVE)
    }
}

/// Normal equations with some columns, of this prior precision, integrated out (Schur complement); the columns stay in
/// place and become empty.
fn reduced(normal: &Normal, out: &[usize], precision: &[f64]) -> Option<Normal> {
    let count = out.len();
    let mut own = DMatrix::from_fn(count, count, |i, j| normal.matrix[(out[i], out[j])]);
    for (i, p) in precision.iter().enumerate() {
        own[(i, i)] += p;
    }
    let factor = own.cholesky()?;
    let columns = normal.vector.len();
    let cross = DMatrix::from_fn(count, columns, |i, j| normal.matrix[(out[i], j)]);
    let vector = DVector::from_fn(count, |i, _| normal.vector[out[i]]);
    let solved = factor.solve(&cross);
    let mut left = normal.clone();
    left.matrix -= cross.transpose() * &solved;
    left.vector -= solved.transpose() * &vector;
    left.sum_of_squares -= vector.dot(&factor.solve(&vector));
    for &i in out {
        left.matrix.row_mut(i).fill(0.0);
        left.matrix.column_mut(i).fill(0.0);
        left.vector[i] = 0.0;
    }
    Some(left)
}

/// A set of effects where it fits best.
#[derive(Debug, Clone, PartialEq)]
pub struct Evaluated {
    /// The effects, by their ids.
    pub effects: Vec<String>,
    /// Log evidence, training and held-out runs together; comparable between the sets of one call.
    pub log_evidence: f64,
    /// Log likelihood of the training data where it fits best.
    pub log_likelihood: f64,
    /// Log likelihood of the held-out runs with values fitted to the training runs; `None` without such runs.
    pub held_log_likelihood: Option<f64>,
    /// Values of each effect, in the order of its parameters.
    pub values: Vec<(String, Vec<f64>)>,
    /// Slow random torque that is needed beside it [N m].
    pub background_n_m: f64,
}

/// Recordings and a model against which laws are evaluated.
pub struct LawBench {
    options: Options,
    problem: Problem,
    held_out: Option<Problem>,
    /// The base model fitted along a smoothed motion.
    point: Point,
}

impl LawBench {
    /// Smooths the motion of the recordings and fits the base model.
    ///
    /// # Errors
    /// As [`crate::diagnose`].
    pub fn new(
        training: &[Recording],
        held_out: &[Recording],
        model: &PlatformModel,
        prior: &ModelPrior,
        options: &Options,
    ) -> Result<Self, DiagnosisError> {
        let (mut problem, mut held_out) =
            prepare(training, held_out, model, prior, options, None, &mut |_| {})?;
        let point = base_point_with(&mut problem, &mut held_out.as_mut())?;
        // A law must show as clearly as it can: process noise that stands in for it would hide it.
        problem.nuisance = Nuisance::default();
        if let Some(held) = &mut held_out {
            held.nuisance = problem.nuisance;
            held.smooth(&point, ProcessNoise::Estimated)?;
        }
        Ok(Self { options: options.clone(), problem, held_out, point })
    }

    /// Root mean square of the torque applied to the platform [N m].
    #[must_use]
    pub fn applied_torque_rms_n_m(&self) -> f64 {
        self.problem.torques.body_n_m
    }

    /// Shows the intervals of every run, training runs first, to `see`, and returns what it makes of each.
    ///
    /// # Errors
    /// When the model at the fit is physically impossible.
    pub fn over_runs<T: Send>(
        &self,
        see: impl Fn(usize, &[Interval<'_>]) -> T + Sync,
    ) -> Result<Vec<T>, DiagnosisError> {
        let mut seen = Vec::new();
        for problem in std::iter::once(&self.problem).chain(&self.held_out) {
            let mechanics = Mechanics::new(&problem.reference.model_at(&self.point)?)?;
            let first = seen.len();
            let runs: Vec<usize> = (0..problem.runs.len()).collect();
            let of_run = |r: &usize| {
                let (run, motion) = (problem.runs.get(*r)?, problem.motions.get(*r)?);
                let inputs = mechanics.inputs(run);
                let drives: Vec<_> = (0..run.nodes()).map(|k| mechanics.drive(run, motion, k)).collect();
                let intervals: Vec<Interval<'_>> = drives
                    .iter()
                    .enumerate()
                    .filter_map(|(k, drive)| {
                        let environment = mechanics.interval_environment(run, motion, &inputs, drive, k)?;
                        Some(Interval { environment, length_s: run.length_or_zero(k) })
                    })
                    .collect();
                Some(see(first + r, &intervals))
            };
            seen.extend(threads::map(problem.threads, &runs, of_run).into_iter().flatten());
        }
        Ok(seen)
    }

    /// What recordings hold of slow quantities: pressure, voltage, temperature; in every run.
    #[must_use]
    pub fn recorded(&self) -> Recorded {
        let problems = || std::iter::once(&self.problem).chain(&self.held_out);
        let every = |has: fn(&crate::bins::run::Run) -> bool| problems().all(|p| p.runs.iter().all(has));
        Recorded {
            pressure: every(|r| r.has_pressure),
            voltage: every(|r| r.has_voltage),
            temperature: every(|r| r.has_temperature),
            wheel_commands: every(|r| r.has_wheel_command),
            ballast: problems()
                .any(|p| p.runs.iter().any(|r| r.ballast_direction.iter().any(|d| d.norm() > 0.0))),
        }
    }

    /// The regression of signals, one entry for each, in which one entry for each run in the order of
    /// [`Self::over_runs`].
    ///
    /// # Errors
    /// When the regression has no solution.
    pub fn regression(&self, signals: &[Vec<LawSignal>]) -> Result<LawRegression, DiagnosisError> {
        let first_held = self.problem.runs.len();
        let training = self.regression_of(&self.problem, 0, signals)?;
        let mut all = training.clone();
        if let Some(held) = &self.held_out {
            all.add(&self.regression_of(held, first_held, signals)?, 1.0);
        }
        let base = self.base_design();
        let own: Vec<usize> = (0..base.columns.len()).collect();
        let precision: Vec<f64> = own.iter().map(|i| 1.0 / base.base_variance(*i).max(1e-12)).collect();
        let alone = |normal: &Normal| -> Result<Normal, DiagnosisError> {
            let left = reduced(normal, &own, &precision).ok_or(NO_FIT)?;
            let mut only = Normal::zeros(signals.len());
            for i in 0..signals.len() {
                only.vector[i] = left.vector[own.len() + i];
                for j in 0..signals.len() {
                    only.matrix[(i, j)] = left.matrix[(own.len() + i, own.len() + j)];
                }
            }
            (only.sum_of_squares, only.rows) = (left.sum_of_squares, left.rows);
            Ok(only)
        };
        let (all, training) = (alone(&all)?, alone(&training)?);
        let mut held_out = all.clone();
        held_out.add(&training, -1.0);
        Ok(LawRegression { all, training, held_out })
    }

    fn base_design(&self) -> crate::explanations::candidates::Design {
        let available = crate::parameters::available::Available::of(&self.problem.runs);
        let lines = crate::explanations::lines::Lines::default();
        crate::explanations::candidates::Design::of_effects(
            &self.problem.reference,
            &self.point,
            &available,
            &[],
            &lines,
        )
    }

    /// Normal equations of the base columns and the signals behind them; `first` is the problem's first run.
    fn regression_of(
        &self,
        problem: &Problem,
        first: usize,
        signals: &[Vec<LawSignal>],
    ) -> Result<Normal, DiagnosisError> {
        let design = self.base_design();
        let data = dataset(problem, &self.point, &design, None)?;
        let linearised = problem.linearise(&self.point)?;
        let base = design.columns.len();
        let mut normal = Normal::zeros(base + signals.len());
        let all: Vec<usize> = (0..base).collect();
        for (r, run) in problem.runs.iter().enumerate() {
            let (Some(linear), Some(old)) = (linearised.get(r), data.whitened.get(r)) else { continue };
            let chunks: Vec<&[Vec<LawSignal>]> = signals.chunks(GROUPS * LANES).collect();
            let responses = threads::map(problem.threads, &chunks, |chunk| {
                let own = |signal: &Vec<LawSignal>| {
                    let none = || LawSignal::Torque(Vec::new());
                    signal.get(first + r).cloned().unwrap_or_else(none).unmodelled_input()
                };
                let inputs: Vec<UnmodelledInput> = chunk.iter().map(own).collect();
                unmodelled_input_response(run, linear, &inputs)
            });
            let responses = responses.into_iter().flatten().collect();
            let ar_models = data.ar_models.get(r).map_or(&[][..], Vec::as_slice);
            let widened = old.widened(&all, responses, signals.len(), ar_models, problem.threads);
            widened.add_unfilled(&widened.normal(problem.threads), &mut normal);
        }
        Ok(normal)
    }

    /// Evaluates sets of effects, each where it fits best; the empty set is the model as it is. `None` for a set that cannot
    /// stand: an effect would have to act against its sign.
    ///
    /// # Errors
    /// An id that is no effect; as [`crate::diagnose`].
    pub fn evaluate(&self, sets: &[Vec<String>]) -> Result<Vec<Option<Evaluated>>, DiagnosisError> {
        let ids: Vec<&str> = sets.iter().flatten().map(String::as_str).collect();
        if let Some(id) = ids.iter().find(|id| find(id).is_none()) {
            return Err(DiagnosisError::UnknownEffect { id: (*id).to_owned() });
        }
        let others = catalogue().iter().map(|effect| effect.info().id).filter(|id| !ids.contains(id));
        let options = Options { exclude: others.map(str::to_owned).collect(), ..self.options.clone() };
        let (mut problem, mut held_out) = (self.problem.clone(), self.held_out.clone());
        let mut search = Search::at(&mut problem, held_out.as_mut(), &options, self.point.clone())?;
        make_columns_for(&mut search, &ids)?;
        let mut evaluated = Vec::new();
        for set in sets {
            let mut start = Some(search.base.clone());
            for id in set {
                let candidate = search.design.candidates.iter().position(|c| c.id == id);
                start = start
                    .zip(candidate)
                    .and_then(|(h, c): (Hypothesis, usize)| h.with(&search.design, &search.data.total, c));
            }
            let Some(start) = start else {
                evaluated.push(None);
                continue;
            };
            let found = search.converge(&start)?.map(|c| Evaluated {
                effects: set.clone(),
                log_evidence: c.score.worth(&options.settings),
                log_likelihood: c.score.log_likelihood,
                held_log_likelihood: c.score.held_log_likelihood,
                values: set
                    .iter()
                    .filter_map(|id| Some((id.clone(), c.point.effects.get(id.as_str())?.clone())))
                    .collect(),
                background_n_m: search.problem.background(c.score.nuisance).stddev_n_m,
            });
            evaluated.push(found);
        }
        Ok(evaluated)
    }
}

/// Slow quantities that the recordings hold.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Recorded {
    /// Tank pressure.
    pub pressure: bool,
    /// Bus voltage.
    pub voltage: bool,
    /// Temperature.
    pub temperature: bool,
    /// Torques of the wheels' motors.
    pub wheel_commands: bool,
    /// The linear mass actuators move.
    pub ballast: bool,
}
