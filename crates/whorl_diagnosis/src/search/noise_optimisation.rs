//! The noise beside what the model states that is likeliest at a point.

use std::collections::BTreeMap;

use crate::evidence::ar_noise::{ArModels, ar_log_density, ar_models_of, rows_by_reading, whiten_series};
use crate::evidence::nuisance::Nuisance;
use crate::evidence::problem::Problem;
use crate::parameters::Point;
use crate::whitening::columns::predict;
use crate::whitening::filter::{Linear, System};
use crate::whitening::mechanics::Mechanics;
use crate::{DiagnosisError, threads};

/// Sizes of the slow random torque over which the noise is optimised.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Sizes {
    /// Of what is background.
    Background,
    Any,
}

/// The noise that is likeliest at a point.
#[derive(Debug, Clone)]
pub(crate) struct Noise {
    /// Beside what the model states.
    pub sizes: Nuisance,
    /// AR models of the innovations with it.
    pub ar_models: ArModels,
}

/// What linearised runs may hold together, their measurements apart \[bytes\]. Those of a quarter of an hour fit for every kind of
/// noise; of longer runs the kinds that are looked at alternately.
const MOST_BYTES: usize = 64 << 20;

/// Runs linearised for kinds of noise, the one that was used last behind the others.
pub(crate) struct Linears {
    list: Vec<(Nuisance, Vec<Linear>)>,
    most_bytes: usize,
}

impl Linears {
    pub fn within(most_bytes: usize) -> Self {
        Self { list: Vec::new(), most_bytes }
    }

    /// Those of a kind: made at need, and then others may have to go.
    pub fn of(&mut self, kind: Nuisance, systems: &[System<'_>], threads: usize) -> &[Linear] {
        let known = self.list.iter().position(|(of, _)| *of == kind).map(|at| self.list.remove(at));
        let wanted = known.unwrap_or_else(|| {
            let alike = self.list.first().map(|(_, linears)| linears.as_slice()).unwrap_or_default();
            let all: Vec<_> = systems.iter().enumerate().collect();
            let made = threads::map(threads, &all, |(r, system)| match alike.get(*r) {
                Some(alike) => system.linear_as(alike),
                None => system.linear(),
            });
            (kind, made)
        });
        self.list.push(wanted);
        while self.list.len() > 1 && self.bytes() > self.most_bytes {
            self.list.remove(0);
        }
        self.list.last().map(|(_, linears)| linears.as_slice()).unwrap_or_default()
    }

    /// Bytes that they hold, their measurements apart.
    pub fn bytes(&self) -> usize {
        self.list.iter().flat_map(|(_, linears)| linears).map(Linear::own_bytes).sum()
    }
}

impl Problem {
    /// The noise beside what the model states that is likeliest with the model at a point, its prior included: an optimisation
    /// from the noise in use and from some other kinds, step by step along each of its sizes.
    pub fn likeliest_noise(
        &self,
        point: &Point,
        others: &[Nuisance],
        sizes: Sizes,
    ) -> Result<Noise, DiagnosisError> {
        let mut starts = self.nuisance.starts();
        starts.extend(others);
        Ok(self.optimise_noise(point, &starts, sizes)?.0)
    }

    /// AR models of the innovations with the model at a point and the noise in use.
    pub fn ar_models_at(&self, point: &Point) -> Result<ArModels, DiagnosisError> {
        let mechanics = Mechanics::new(&self.reference.model_at(point)?)?;
        let all: Vec<_> = self.runs.iter().zip(self.motions.iter()).enumerate().collect();
        Ok(threads::map(self.threads, &all, |(r, (run, motion))| {
            let (_, prediction) = predict(&mechanics, run, motion);
            let settings = self.settings(*r);
            let system = System { run, motion, mechanics: &mechanics, prediction: &prediction, settings };
            let linear = system.linear();
            let rows = rows_by_reading(linear.rows().iter().map(|row| row.reading));
            ar_models_of(&system.innovations(&linear).0, &rows, &self.reference.settings)
        }))
    }

    /// Optimises the noise from the likeliest of several initial guesses; where that ends, and the logarithm of the density with the
    /// noise in use.
    ///
    /// The AR models of the innovations depend on how much torque the filter expects, and on what the model lacks: each kind
    /// of noise is evaluated with the AR models that the innovations have with it, at this point.
    pub fn optimise_noise(
        &self,
        point: &Point,
        starts: &[Nuisance],
        sizes: Sizes,
    ) -> Result<(Noise, f64), DiagnosisError> {
        let mechanics = Mechanics::new(&self.reference.model_at(point)?)?;
        let predictions: Vec<_> = self
            .runs
            .iter()
            .zip(self.motions.iter())
            .map(|(run, motion)| predict(&mechanics, run, motion).1)
            .collect();
        let systems = |nuisance: Nuisance| -> Vec<System<'_>> {
            let all = self.runs.iter().zip(self.motions.iter()).zip(&predictions).enumerate();
            all.map(|(r, ((run, motion), prediction))| System {
                run,
                motion,
                mechanics: &mechanics,
                prediction,
                settings: self.settings_with(nuisance, r),
            })
            .collect()
        };
        let mut linears = Linears::within(MOST_BYTES);
        let mut known: BTreeMap<Nuisance, (f64, ArModels)> = BTreeMap::new();
        let mut posterior = |nuisance: Nuisance| -> f64 {
            if let Some((found, _)) = known.get(&nuisance) {
                return *found;
            }
            let kind = Nuisance { bias: 0, wheel: 0, torque: nuisance.torque.min(1), ..nuisance };
            let systems = systems(nuisance);
            let linear = linears.of(kind, &systems, self.threads);
            let all: Vec<_> = systems.into_iter().zip(linear.iter()).collect();
            let (densities, ar_models): (Vec<f64>, ArModels) =
                threads::map(self.threads, &all, |(system, linear)| {
                    let (mut innovations, log_density) = system.innovations(linear);
                    let rows = rows_by_reading(linear.rows().iter().map(|row| row.reading));
                    let ar_models = ar_models_of(&innovations, &rows, &self.reference.settings);
                    whiten_series(&mut innovations, &rows, &ar_models);
                    let misfit: f64 = innovations.iter().map(|e| e * e).sum();
                    (log_density + ar_log_density(&rows, &ar_models) - 0.5 * misfit, ar_models)
                })
                .into_iter()
                .unzip();
            let found = densities.iter().sum::<f64>() + self.log_prior(nuisance);
            known.insert(nuisance, (found, ar_models));
            found
        };
        let in_use = posterior(self.nuisance);
        let mut likeliest = (self.nuisance, f64::NEG_INFINITY);
        let is_allowed = |nuisance: &Nuisance| sizes == Sizes::Any || !self.is_large(*nuisance);
        for start in starts.iter().filter(|start| is_allowed(start)) {
            let value = posterior(*start);
            if value > likeliest.1 {
                likeliest = (*start, value);
            }
        }
        let (has_body, has_wheels) = (self.watches_body(), !self.reference.model.wheels().is_empty());
        loop {
            let mut next = None;
            let neighbours = likeliest.0.neighbours(has_body, has_wheels);
            for neighbour in neighbours.into_iter().filter(is_allowed) {
                let here = posterior(neighbour);
                if here > next.map_or(likeliest.1, |n: (Nuisance, f64)| n.1) + 1e-9 {
                    next = Some((neighbour, here));
                }
            }
            match next {
                Some(better) => likeliest = better,
                None => break,
            }
        }
        let (sizes, _) = likeliest;
        let ar_models = known.remove(&sizes).map(|(_, ar_models)| ar_models).unwrap_or_default();
        Ok((Noise { sizes, ar_models }, in_use))
    }
}
