//! What is fitted: recordings, parameters, and passes over the recordings at any of their values.

use rayon::prelude::*;
use whorl_dynamics::PlatformModel;
use whorl_recording::Recording;

use super::ModelAt;
use crate::error::PredictionError;
use crate::laws::Laws;
use crate::levels::{Followed, follow, follow_on, judged_again};
use crate::noise::Noise;
use crate::other::Varied;
use crate::parameter::Parameter;
use crate::passes::{Pass, Passes, pass, pass_near};
use crate::prepared::Prepared;
use crate::settings::Settings;
use crate::start::Start;

/// An iterate: values, their log posterior, and the recordings with the model there.
#[derive(Debug, Clone)]
pub(super) struct Iterate {
    pub at: Vec<f64>,
    pub log_posterior: f64,
    pub followed: Vec<Followed>,
}

impl Iterate {
    pub fn runs(&self) -> Vec<(Noise, Start)> {
        runs_of(&self.followed)
    }
}

/// With what filters run through recordings that were followed.
pub(super) fn runs_of(followed: &[Followed]) -> Vec<(Noise, Start)> {
    followed.iter().map(|run| (run.noise.clone(), run.fitted.start.clone())).collect()
}

/// Recordings, and models with parameters.
pub(super) struct Problem<'a> {
    pub recordings: &'a [Recording],
    pub parameters: &'a [Parameter],
    pub model_at: &'a ModelAt<'a>,
    pub settings: &'a Settings,
}

impl Problem<'_> {
    fn model(&self, at: &[f64]) -> Result<PlatformModel, PredictionError> {
        (self.model_at)(at).ok_or(PredictionError::NoModel)
    }

    pub fn log_prior(&self, at: &[f64]) -> f64 {
        self.parameters.iter().zip(at).map(|(p, x)| -0.5 * (x / p.stddev).powi(2)).sum()
    }

    pub fn log_posterior(&self, at: &[f64], followed: &[Followed]) -> f64 {
        followed.iter().map(Followed::log_likelihood).sum::<f64>() + self.log_prior(at)
    }

    /// Each recording with the levels and the start that it shows with the model there; where there are disturbances, what the model without them
    /// makes of it may be that of the values before.
    pub fn followed(
        &self,
        at: &[f64],
        before: Option<&[Followed]>,
    ) -> Result<Vec<Followed>, PredictionError> {
        self.each_case(at, |case, run| {
            let stated = Noise::stated(case)?;
            let before = before.and_then(|before| before.get(run));
            Ok(before.map_or_else(|| follow(case, &stated), |before| follow_on(case, &stated, before)))
        })
    }

    /// The same at the end of a fit.
    pub fn judged_again(&self, iterate: &Iterate) -> Result<Iterate, PredictionError> {
        let followed = self.each_case(&iterate.at, |case, run| {
            Ok(judged_again(case, &Noise::stated(case)?, &iterate.followed[run]))
        })?;
        let log_posterior = self.log_posterior(&iterate.at, &followed);
        Ok(Iterate { at: iterate.at.clone(), log_posterior, followed })
    }

    /// Passes over all recordings, which keep how innovations change.
    pub fn passes(&self, at: &[f64], runs: &[(Noise, Start)]) -> Result<Passes, PredictionError> {
        let varied = self.varied(at)?;
        self.each_pass(at, runs, |case, _, (noise, start)| pass(case, noise, start, &varied, None, true))
    }

    /// The same without what they say of parameters.
    pub fn passes_without_columns(
        &self,
        at: &[f64],
        runs: &[(Noise, Start)],
    ) -> Result<Passes, PredictionError> {
        self.each_pass(at, runs, |case, _, (noise, start)| Ok(pass_near(case, noise, start, None)))
    }

    /// The same with the changes that innovations had in passes close by.
    pub fn passes_near(
        &self,
        at: &[f64],
        runs: &[(Noise, Start)],
        close: &Passes,
    ) -> Result<Passes, PredictionError> {
        self.each_pass(at, runs, |case, run, (noise, start)| {
            Ok(pass_near(case, noise, start, close.kept(run)))
        })
    }

    /// Passes with columns for laws as well, which are as many for each recording.
    pub fn passes_with(
        &self,
        at: &[f64],
        runs: &[(Noise, Start)],
        varied: &[Varied],
        laws: &[Laws<'_>],
    ) -> Result<Passes, PredictionError> {
        self.each_pass(at, runs, |case, run, (noise, start)| {
            pass(case, noise, start, varied, laws.get(run), false)
        })
    }

    /// Whether starts of recordings have the states of the model there.
    pub fn are_of(&self, at: &[f64], runs: &[(Noise, Start)]) -> bool {
        let Ok(model) = self.model(at) else { return false };
        let with = self.recordings.iter().zip(runs);
        let is_of = |(recording, (_, start)): (_, &(Noise, Start))| {
            Prepared::new(recording, &model, *self.settings).is_ok_and(|case| start.is_of(&case))
        };
        with.into_iter().all(is_of)
    }

    fn each_pass(
        &self,
        at: &[f64],
        runs: &[(Noise, Start)],
        of: impl Fn(&Prepared<'_>, usize, &(Noise, Start)) -> Result<Pass, PredictionError> + Sync,
    ) -> Result<Passes, PredictionError> {
        self.each_case(at, |case, run| of(case, run, runs.get(run).ok_or(PredictionError::NoModel)?))
            .map(Passes)
    }

    /// Something of each recording with the model there.
    fn each_case<T: Send>(
        &self,
        at: &[f64],
        of: impl Fn(&Prepared<'_>, usize) -> Result<T, PredictionError> + Sync,
    ) -> Result<Vec<T>, PredictionError> {
        let model = self.model(at)?;
        let numbers: Vec<usize> = (0..self.recordings.len()).collect();
        let found = each(&numbers, self.settings.threads, |run| {
            of(&Prepared::new(&self.recordings[*run], &model, *self.settings)?, *run)
        });
        found.into_iter().collect()
    }

    /// Models a little further along each parameter, on the side where there is one.
    pub fn varied(&self, at: &[f64]) -> Result<Vec<Varied>, PredictionError> {
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

/// The same for each, in order; on one thread, or on all.
fn each<T: Sync, R: Send>(items: &[T], threads: usize, of: impl Fn(&T) -> R + Sync) -> Vec<R> {
    if threads.min(items.len()) < 2 {
        return items.iter().map(of).collect();
    }
    items.par_iter().map(&of).collect()
}
