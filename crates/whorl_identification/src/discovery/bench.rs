//! Recordings and a model against which laws are evaluated: by the causal filter, along its own motion.

use std::sync::{Mutex, PoisonError};

use whorl_dynamics::{Effect, Environment, Plant};
use whorl_prediction::{Followed, Laws, PredictionError, Prepared, Push, followed_with, hints};
use whorl_recording::Recording;

use crate::fitting::normal_equations::{Estimate, Normal};
use crate::selection::{Beside, Evaluated, Runs, Selection, Told};
use crate::signals::observed::Applied;
use crate::{DiagnosisError, Options};

/// Makes what columns push, step by step of a run: the environment, the time since the step before \[s\], and where to append it.
pub(super) type Pushing<'a> = Box<dyn FnMut(&Environment<'_>, f64, &mut Vec<Push>) + Send + 'a>;

/// A law fitted linearly beside the platform's own parameters.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct LawFit {
    /// Log evidence over that of the platform's own parameters alone, training and held-out runs together.
    pub log_evidence: f64,
    /// Coefficients of the columns.
    pub coefficients: Vec<f64>,
    /// Their standard deviations.
    pub stddevs: Vec<f64>,
}

/// Sizes of the slow random torque beside which laws are compared, over that which the runs show without any law: a loud one hides what
/// follows the motion slowly, and the filter without one does not follow the motion of which the law is a function. The likelier counts.
const LOUDNESS: [f64; 2] = [1.0, 0.1];

/// The normal equations of columns behind those of the platform's own parameters, by loudness: with log p that the data have there.
#[derive(Debug, Clone)]
pub(super) struct Regression {
    views: Vec<(Normal, f64)>,
    stddevs: Vec<f64>,
    without: f64,
}

impl Regression {
    /// Fits some of the columns together; their coefficients have priors of this standard deviation about zero. `None`
    /// where they cannot be told apart.
    pub fn fit(&self, columns: &[usize], prior_stddev: f64) -> Option<LawFit> {
        let own = self.stddevs.len();
        let active: Vec<usize> = (0..own).chain(columns.iter().map(|i| own + i)).collect();
        let variance = |i: usize| self.stddevs.get(i).map_or(prior_stddev, |stddev| *stddev).powi(2);
        let of_views = self.views.iter().filter_map(|(normal, log)| {
            let found = Estimate::new(normal, &active, variance)?;
            Some((found.log_evidence + log - self.without, found))
        });
        let (log_evidence, found) = of_views.max_by(|a, b| a.0.total_cmp(&b.0))?;
        let covariance = found.covariance();
        let of_columns = own..active.len();
        Some(LawFit {
            log_evidence,
            coefficients: of_columns.clone().map(|i| found.value[i]).collect(),
            stddevs: of_columns.map(|i| covariance[(i, i)].max(0.0).sqrt()).collect(),
        })
    }
}

/// A set of effects where it fits best.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct FittedLaw {
    /// Log evidence, held-out runs as far as they count against it; comparable between the sets of one call.
    pub log_evidence: f64,
    /// Log likelihood of the held-out runs with values fitted to the training runs; `None` without such runs.
    pub held_log_likelihood: Option<f64>,
    /// Values of each effect, in the order of its parameters.
    pub values: Vec<(String, Vec<f64>)>,
    /// Slow random torque that is needed beside it [N m].
    pub background_n_m: f64,
}

/// Recordings and a model fitted to them.
pub(super) struct Bench<'a> {
    selection: Selection<'a>,
    /// Training and held-out runs, by loudness.
    views: Vec<[Vec<Followed>; 2]>,
    pub applied_n_m: f64,
}

impl<'a> Bench<'a> {
    pub fn new(runs: Runs<'a>, options: &Options) -> Result<Self, DiagnosisError> {
        let selection = Selection::begun(runs, options)?;
        let base = selection.base();
        let model = base.refit(runs.reference).model_at(&base.fitted.at).ok_or(PredictionError::NoModel)?;
        let of_list =
            |recordings: &[Recording], all: &[Followed], by: f64| -> Result<Vec<Followed>, DiagnosisError> {
                let each = recordings.iter().zip(all).map(|(recording, followed)| {
                    let case = Prepared::new(recording, &model, runs.prediction())?;
                    Ok(followed_with(&case, followed, followed.noise.disturbance.scaled(by)))
                });
                each.collect()
            };
        let mut views = vec![[base.fitted.followed.clone(), base.held_out.clone()]];
        if views.iter().flatten().flatten().any(|run| run.noise.disturbance.is_some()) {
            for by in LOUDNESS.into_iter().skip(1) {
                views.push([
                    of_list(runs.training, &base.fitted.followed, by)?,
                    of_list(runs.held_out, &base.held_out, by)?,
                ]);
            }
        }
        let at_work_s = runs.reference.settings.at_work_s;
        let applied_n_m = Applied::of(&selection.observed, &runs.reference.model, at_work_s).body_n_m();
        Ok(Self { views, applied_n_m, selection })
    }

    fn runs(&self) -> &Runs<'a> {
        &self.selection.runs
    }

    fn base(&self) -> &Evaluated {
        self.selection.base()
    }

    /// Duration of the shortest run \[s\].
    pub fn shortest_s(&self) -> f64 {
        let all = self.runs().training.iter().chain(self.runs().held_out);
        all.map(Recording::duration_s).fold(f64::INFINITY, f64::min)
    }

    /// Each list of runs, with how the filter follows them in a view.
    fn lists<'v>(
        &self,
        [training, held_out]: &'v [Vec<Followed>; 2],
    ) -> [(&'a [Recording], &'v [Followed]); 2] {
        [(self.runs().training, training), (self.runs().held_out, held_out)]
    }

    /// What `see` makes of a beginning at every step of every run, training runs first.
    pub fn over_runs<T: Send + Clone>(
        &self,
        begin: &T,
        see: impl Fn(&mut T, &Environment<'_>, f64) + Sync,
    ) -> Result<Vec<T>, DiagnosisError> {
        let mut all = Vec::new();
        let lists = self.views.first().map(|view| self.lists(view));
        for (recordings, followed) in lists.into_iter().flatten() {
            let seen: Vec<Mutex<T>> = recordings.iter().map(|_| Mutex::new(begin.clone())).collect();
            let laws: Vec<Laws<'_>> = seen
                .iter()
                .map(|seen| {
                    let pushing: Pushing<'_> = Box::new(|environment, step_s, pushes| {
                        see(&mut seen.lock().unwrap_or_else(PoisonError::into_inner), environment, step_s);
                        pushes.push(Push::Body(nalgebra::Vector3::zeros()));
                    });
                    laws(1, 1, pushing)
                })
                .collect();
            self.pass(recordings, followed, &laws, false)?;
            drop(laws);
            all.extend(
                seen.into_iter().map(|seen| seen.into_inner().unwrap_or_else(PoisonError::into_inner)),
            );
        }
        Ok(all)
    }

    fn pass(
        &self,
        recordings: &[Recording],
        followed: &[Followed],
        laws: &[Laws<'_>],
        with_own: bool,
    ) -> Result<Vec<whorl_prediction::Hints>, DiagnosisError> {
        let base = self.base();
        let refit = base.refit(self.runs().reference);
        let model_at = |units: &[f64]| refit.model_at(if units.is_empty() { &base.fitted.at } else { units });
        let parameters = if with_own { refit.parameters() } else { Vec::new() };
        let at = if with_own { base.fitted.at.as_slice() } else { &[] };
        Ok(hints(recordings, &parameters, &model_at, at, followed, laws, &self.runs().prediction())?)
    }

    /// The regression of so many columns, of which those that are `apart` or further take no part together; `make` makes what they
    /// push in a run.
    pub fn regression<'m>(
        &self,
        count: usize,
        apart: usize,
        make: impl Fn() -> Pushing<'m>,
    ) -> Result<Regression, DiagnosisError> {
        let base = self.base();
        let own: Vec<usize> = (0..base.columns.len()).collect();
        let mut views = Vec::new();
        for view in &self.views {
            let mut normal = Normal::zeros(base.columns.len() + count);
            let mut log = 0.0;
            for (recordings, followed) in self.lists(view) {
                let of_runs: Vec<Laws<'_>> = recordings.iter().map(|_| laws(count, apart, make())).collect();
                for of_run in self.pass(recordings, followed, &of_runs, true)? {
                    normal.matrix += of_run.information;
                    normal.vector += of_run.slope;
                    log += of_run.log_likelihood;
                }
            }
            for (i, (at, stddev)) in base.fitted.at.iter().zip(&base.stddevs).enumerate() {
                normal.vector[i] -= at / stddev.powi(2);
            }
            views.push((normal, log));
        }
        let without = views.first().and_then(|(normal, log)| {
            Some(Estimate::new(normal, &own, |i| base.stddevs[i].powi(2))?.log_evidence + log)
        });
        Ok(Regression { without: without.unwrap_or(0.0), stddevs: base.stddevs.clone(), views })
    }

    /// Evaluates sets of effects, each where it fits best; the empty set is the model as it is. `None` for a set that cannot
    /// stand: an effect would have to act against its sign.
    pub fn evaluate(&self, sets: &[Vec<String>]) -> Result<Vec<Option<FittedLaw>>, DiagnosisError> {
        let ids: Vec<&str> = sets.iter().flatten().map(String::as_str).collect();
        if let Some(id) = ids.iter().find(|id| whorl_dynamics::effects::find(id).is_none()) {
            return Err(DiagnosisError::UnknownEffect { id: (*id).to_owned() });
        }
        let selection = &self.selection;
        let told = Told::of(&selection.observed, &selection.lines, self.runs().available.sample_s);
        let is_asked = |effect: &dyn Effect| ids.contains(&effect.info().id);
        let beside = Beside::new(self.runs(), self.base(), &told.clues(), is_asked, None)?;
        sets.iter().map(|set| self.evaluated(set, beside.as_ref())).collect()
    }

    fn evaluated(
        &self,
        set: &[String],
        beside: Option<&Beside<'_>>,
    ) -> Result<Option<FittedLaw>, DiagnosisError> {
        let base = self.base();
        if set.is_empty() {
            return Ok(Some(self.fitted(base)));
        }
        let ids: Option<Vec<&'static str>> =
            set.iter().map(|id| Some(whorl_dynamics::effects::find(id)?.info().id)).collect();
        let hypothesis = beside.zip(ids).and_then(|(beside, ids)| beside.with(&ids));
        let Some(hypothesis) = hypothesis else { return Ok(None) };
        let found = DiagnosisError::possible(self.runs().evaluate(hypothesis, &[base]))?;
        Ok(found.map(|found| self.fitted(&found)))
    }

    fn fitted(&self, set: &Evaluated) -> FittedLaw {
        let point = set.refit(self.runs().reference).point(&set.fitted.at);
        let values = |id: &&'static str| Some(((*id).to_owned(), point.effects.get(id)?.clone()));
        let held = (set.held_out_log - self.base().held_out_log).min(0.0);
        FittedLaw {
            log_evidence: set.log_evidence + held,
            held_log_likelihood: (!self.runs().held_out.is_empty()).then_some(set.held_out_log),
            values: set.names().iter().filter_map(values).collect(),
            background_n_m: set.torque_n_m(),
        }
    }
}

/// Laws of one run.
fn laws(count: usize, apart: usize, pushing: Pushing<'_>) -> Laws<'_> {
    let state = Mutex::new((None::<i64>, pushing));
    Laws::new(count, apart, move |plant: &Plant, pushes| {
        let mut state = state.lock().unwrap_or_else(PoisonError::into_inner);
        let (before_ns, pushing) = &mut *state;
        let step_s = before_ns.map_or(0.0, |before_ns| (plant.now_ns() - before_ns).max(0) as f64 * 1e-9);
        *before_ns = Some(plant.now_ns());
        pushing(&plant.environment(), step_s, pushes);
    })
}
