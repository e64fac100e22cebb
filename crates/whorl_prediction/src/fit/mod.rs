//! Parameters of a model by the likelihood of recordings: Gauss and Newton's steps through the filter's own sensitivities.

mod search;

use nalgebra::{Cholesky, DMatrix, DVector};
use whorl_dynamics::PlatformModel;
use whorl_math::threads;
use whorl_recording::Recording;

use crate::levels::{Fit, follow_without, followed_from};
use crate::passes::Pass;
use crate::{Followed, Laws, Noise, PredictionError, Prepared, Settings, Varied};

/// A parameter of a family of models, counted in a unit of its own from where nothing is known better.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Parameter {
    /// What is known before: its standard deviation about zero; infinite: nothing.
    pub stddev: f64,
    /// Smallest and largest value.
    pub range: (f64, f64),
}

/// Models by their parameters; `None` where no platform has such values.
pub type ModelAt<'a> = dyn Fn(&[f64]) -> Option<PlatformModel> + Sync + 'a;

/// Parameters that recordings show.
#[derive(Debug, Clone, PartialEq)]
pub struct Fitted {
    /// The likeliest values, prior included.
    pub at: Vec<f64>,
    /// Their covariance.
    pub covariance: DMatrix<f64>,
    /// Which stay at an end of their range.
    pub at_bound: Vec<bool>,
    /// Each recording with the model there.
    pub followed: Vec<Followed>,
    /// log p of the recordings and the values, with the levels of noise that each shows [natural logarithm].
    pub log_posterior: f64,
    /// The same where the fit began.
    pub log_posterior_before: f64,
    /// log p of the recordings, whatever the values: Laplace's integral over a normal posterior, less [`Self::levels_nats`].
    pub log_evidence: f64,
    /// What the levels of random torques cost that ([`Followed::levels_nats`]).
    pub levels_nats: f64,
    /// Whether the values stand.
    pub stands: bool,
}

/// How often levels of values that stand are found, and values with these, at most.
const JUDGED: usize = 2;

/// Fits parameters to recordings, beginning with the likeliest of these values, and never less likely than it. Values that no
/// platform has are passed over. A model that competes with another one begins with its levels and starts, and is given up where twice the
/// predicted gain of a step does not bring it to what it needs; [`Fitted::stands`] then is false.
///
/// # Errors
/// See [`PredictionError`]; one of the starts must be a model.
pub fn fit(
    recordings: &[Recording],
    parameters: &[Parameter],
    model_at: &ModelAt<'_>,
    starts: &[Vec<f64>],
    rival: Rival<'_>,
    settings: &Settings,
) -> Result<Fitted, PredictionError> {
    let problem = Problem { recordings, parameters, model_at, settings };
    let begun = if rival.quiet {
        problem.begun_quiet(starts, rival.followed)?
    } else {
        problem.begun(starts, rival.followed)?
    };
    let (needed, log_posterior_before) = (rival.log_posterior_needed, begun.log_posterior);
    let mut best = problem.settled(begun, true, needed)?;
    for _ in 0..JUDGED {
        let at = best.iterate.at.clone();
        best = problem.settled_again(best, needed, |case, before| {
            Ok(followed_from(case, &Noise::stated(case)?, before, Fit::Judged))
        })?;
        if best.iterate.at == at {
            break;
        }
    }
    if !best.is_hopeless {
        best = problem.settled_again(best, needed, |case, before| Ok(follow_without(case, before)))?;
    }
    // Beside disturbances parameters hardly matter, and both shrink slowly: the model without them may explain everything by now.
    if let Some(undisturbed) = problem.without_disturbance(&best.iterate).filter(|_| !best.is_hopeless) {
        let undisturbed = problem.settled(undisturbed, true, best.iterate.log_posterior)?;
        if undisturbed.iterate.log_posterior > best.iterate.log_posterior {
            best = undisturbed;
        }
    }
    let Iterate { at, followed, log_posterior } = best.iterate;
    let levels_nats: f64 = followed.iter().map(|run| run.levels_nats(settings)).sum();
    let information = match best.information {
        Some(found) => found,
        None => problem.normal_equations(&at, &problem.passes(&at, &followed)?).2,
    };
    let n = parameters.len();
    let root = Cholesky::new(information);
    let covariance = root.as_ref().map_or_else(|| DMatrix::from_element(n, n, f64::NAN), Cholesky::inverse);
    // log of the posterior's determinant over the prior's.
    let narrower: f64 = root.map_or(f64::NAN, |root| root.l().diagonal().iter().map(|x| x.ln()).sum());
    let known: f64 = parameters.iter().filter(|p| p.stddev.is_finite()).map(|p| p.stddev.ln()).sum();
    Ok(Fitted {
        covariance,
        at_bound: problem.held(&at, &DVector::zeros(n)),
        at,
        followed,
        log_posterior,
        log_posterior_before,
        log_evidence: log_posterior - narrower - known - levels_nats,
        levels_nats,
        stands: best.stands,
    })
}

/// A model that was fitted to the same recordings.
#[derive(Debug, Clone, Copy)]
pub struct Rival<'a> {
    /// Each recording with it; none: a fit begins anew.
    pub followed: &'a [Followed],
    /// What a fit must reach to be of use [natural logarithm].
    pub log_posterior_needed: f64,
    /// Whether the fit begins without random torques: what these explain of the rival, its parameters may. Levels are those that the likeliest values leave.
    pub quiet: bool,
}

impl Rival<'_> {
    /// Nobody.
    pub const NONE: Self = Self { followed: &[], log_posterior_needed: f64::NEG_INFINITY, quiet: false };
}

/// What a recording says of parameters and of laws that no model has, about a model that was fitted: log p of a small change x
/// is `slope . x - x . information x / 2` more. Parameters first, in their units, then the sizes of the laws.
#[derive(Debug, Clone, PartialEq)]
pub struct Hints {
    /// -d^2 log p / dx^2, Gauss and Newton's, without what is known before.
    pub information: DMatrix<f64>,
    /// d log p / dx of the recordings alone.
    pub slope: DVector<f64>,
    /// log p of the recording there.
    pub log_likelihood: f64,
}

/// Normal equations of each recording about a model with these values; `laws` of each recording, which are as many.
///
/// # Errors
/// As [`fit`].
pub fn hints(
    recordings: &[Recording],
    parameters: &[Parameter],
    model_at: &ModelAt<'_>,
    at: &[f64],
    followed: &[Followed],
    laws: &[Laws<'_>],
    settings: &Settings,
) -> Result<Vec<Hints>, PredictionError> {
    let problem = Problem { recordings, parameters, model_at, settings };
    let varied = problem.varied(at)?;
    problem.each(at, |case, run| {
        let with = followed.get(run).ok_or(PredictionError::NoModel)?;
        let of = Pass::of(case, &with.noise, &with.fitted.start, &varied, laws.get(run), false)?;
        Ok(Hints { information: of.sums.information, slope: of.slope, log_likelihood: of.likelihood.log })
    })
}

#[derive(Debug, Clone)]
struct Iterate {
    at: Vec<f64>,
    log_posterior: f64,
    followed: Vec<Followed>,
}

struct Problem<'a> {
    recordings: &'a [Recording],
    parameters: &'a [Parameter],
    model_at: &'a ModelAt<'a>,
    settings: &'a Settings,
}

impl Problem<'_> {
    fn log_prior(&self, at: &[f64]) -> f64 {
        self.parameters.iter().zip(at).map(|(p, x)| -0.5 * (x / p.stddev).powi(2)).sum()
    }

    /// The values with recordings that were followed with the model there.
    fn iterate(&self, at: &[f64], followed: Vec<Followed>) -> Iterate {
        let log = followed.iter().map(Followed::log_likelihood).sum::<f64>();
        Iterate { log_posterior: log + self.log_prior(at), at: at.to_vec(), followed }
    }

    /// log p of passes and of the values, with its slope, and the information on the parameters.
    fn normal_equations(&self, at: &[f64], passes: &[Pass]) -> (f64, DVector<f64>, DMatrix<f64>) {
        let known = DVector::from_iterator(at.len(), self.parameters.iter().map(|p| p.stddev.powi(-2)));
        let pulls = -DVector::from_column_slice(at).component_mul(&known);
        let slope = passes.iter().fold(pulls, |sum, of| sum + &of.slope);
        let known = DMatrix::from_diagonal(&known);
        let information = passes.iter().fold(known, |sum, of| sum + &of.sums.information);
        (self.log(at, passes), slope, information)
    }

    fn log(&self, at: &[f64], passes: &[Pass]) -> f64 {
        passes.iter().map(|pass| pass.likelihood.log).sum::<f64>() + self.log_prior(at)
    }

    /// Passes over all recordings with the levels and starts of these, which keep how innovations change.
    fn passes(&self, at: &[f64], with: &[Followed]) -> Result<Vec<Pass>, PredictionError> {
        let varied = self.varied(at)?;
        self.each(at, |case, run| {
            Pass::of(case, &with[run].noise, &with[run].fitted.start, &varied, None, true)
        })
    }

    /// Without columns, or with those that innovations had in passes close by; no model where the starts are those of other states.
    fn passes_near(
        &self,
        at: &[f64],
        with: &[Followed],
        close: &[Pass],
    ) -> Result<Vec<Pass>, PredictionError> {
        self.each(at, |case, run| {
            let with = with.get(run).filter(|with| with.is_of(case)).ok_or(PredictionError::NoModel)?;
            let kept = close.get(run).and_then(|pass| pass.kept.as_ref());
            Ok(Pass::near(case, &with.noise, &with.fitted.start, kept))
        })
    }

    /// Something of each recording with the model there; on one thread, or on all.
    fn each<T: Send>(
        &self,
        at: &[f64],
        of: impl Fn(&Prepared<'_>, usize) -> Result<T, PredictionError> + Sync,
    ) -> Result<Vec<T>, PredictionError> {
        let model = (self.model_at)(at).ok_or(PredictionError::NoModel)?;
        let one = |run: &usize| of(&Prepared::new(&self.recordings[*run], &model, *self.settings)?, *run);
        let runs: Vec<usize> = (0..self.recordings.len()).collect();
        threads::map(self.settings.threads, &runs, one).into_iter().collect()
    }

    /// Models a little further along each parameter, on the side where there is one.
    fn varied(&self, at: &[f64]) -> Result<Vec<Varied>, PredictionError> {
        let step = |(i, parameter): (usize, &Parameter)| {
            let size = self.settings.fit_difference * parameter.stddev.min(1.0);
            [size, -size].into_iter().find_map(|step| {
                let mut moved = at.to_vec();
                moved[i] += step;
                let inside = (parameter.range.0..=parameter.range.1).contains(&moved[i]);
                inside.then(|| (self.model_at)(&moved)).flatten().map(|model| Varied { model, step })
            })
        };
        let all: Option<Vec<Varied>> = self.parameters.iter().enumerate().map(step).collect();
        all.ok_or(PredictionError::NoModel)
    }
}
