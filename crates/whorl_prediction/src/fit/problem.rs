//! What is fitted: recordings, parameters, and passes over the recordings at any of their values.

use nalgebra::{DMatrix, DVector};
use rayon::prelude::*;
use whorl_dynamics::PlatformModel;
use whorl_recording::Recording;

use super::{ModelAt, Parameter};
use crate::levels::Followed;
use crate::noise::Noise;
use crate::other::Varied;
use crate::passes::Pass;
use crate::prepared::Prepared;
use crate::refusal::PredictionError;
use crate::settings::Settings;
use crate::start::Start;

/// With what a filter runs through each recording.
pub(super) type Runs = Vec<(Noise, Start)>;

#[derive(Debug, Clone)]
pub(super) struct Iterate {
    pub at: Vec<f64>,
    pub log_posterior: f64,
    pub followed: Vec<Followed>,
}

/// With what filters run through recordings that were followed.
pub(super) fn runs_of(followed: &[Followed]) -> Runs {
    followed.iter().map(|run| (run.noise.clone(), run.fitted.start.clone())).collect()
}

pub(super) struct Problem<'a> {
    pub recordings: &'a [Recording],
    pub parameters: &'a [Parameter],
    pub model_at: &'a ModelAt<'a>,
    pub settings: &'a Settings,
}

impl Problem<'_> {
    pub fn log_prior(&self, at: &[f64]) -> f64 {
        self.parameters.iter().zip(at).map(|(p, x)| -0.5 * (x / p.stddev).powi(2)).sum()
    }

    /// The values with recordings that were followed with the model there.
    pub fn iterate(&self, at: &[f64], followed: Vec<Followed>) -> Iterate {
        let log = followed.iter().map(Followed::log_likelihood).sum::<f64>();
        Iterate { log_posterior: log + self.log_prior(at), at: at.to_vec(), followed }
    }

    /// log p of passes and of the values, with its slope, and the information on the parameters.
    pub fn normal_equations(&self, at: &[f64], passes: &[Pass]) -> (f64, DVector<f64>, DMatrix<f64>) {
        let each = || self.parameters.iter().zip(at);
        let pulls = DVector::from_iterator(at.len(), each().map(|(p, x)| -x * p.stddev.powi(-2)));
        let known = DVector::from_iterator(at.len(), each().map(|(p, _)| p.stddev.powi(-2)));
        let slope = passes.iter().fold(pulls, |sum, of| sum + &of.slope);
        let known = DMatrix::from_diagonal(&known);
        let information = passes.iter().fold(known, |sum, of| sum + &of.sums.information);
        (self.log(at, passes), slope, information)
    }

    /// log p of passes and of the values.
    pub fn log(&self, at: &[f64], passes: &[Pass]) -> f64 {
        passes.iter().map(|pass| pass.likelihood.log).sum::<f64>() + self.log_prior(at)
    }

    /// Passes over all recordings, which keep how innovations change.
    pub fn passes(&self, at: &[f64], runs: &Runs) -> Result<Vec<Pass>, PredictionError> {
        let varied = self.varied(at)?;
        self.each(at, |case, run| Pass::of(case, &runs[run].0, &runs[run].1, &varied, None, true))
    }

    /// Without columns, or with those that innovations had in passes close by.
    pub fn passes_near(&self, at: &[f64], runs: &Runs, close: &[Pass]) -> Result<Vec<Pass>, PredictionError> {
        self.each(at, |case, run| {
            let kept = close.get(run).and_then(|pass| pass.kept.as_ref());
            Ok(Pass::near(case, &runs[run].0, &runs[run].1, kept))
        })
    }

    /// Something of each recording with the model there; on one thread, or on all.
    pub fn each<T: Send>(
        &self,
        at: &[f64],
        of: impl Fn(&Prepared<'_>, usize) -> Result<T, PredictionError> + Sync,
    ) -> Result<Vec<T>, PredictionError> {
        let model = self.model(at)?;
        let one = |(run, recording): (usize, &Recording)| {
            of(&Prepared::new(recording, &model, *self.settings)?, run)
        };
        if self.settings.threads.min(self.recordings.len()) < 2 {
            return self.recordings.iter().enumerate().map(one).collect();
        }
        self.recordings.par_iter().enumerate().map(one).collect()
    }

    pub fn model(&self, at: &[f64]) -> Result<PlatformModel, PredictionError> {
        (self.model_at)(at).ok_or(PredictionError::NoModel)
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
