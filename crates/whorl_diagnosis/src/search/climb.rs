//! The noise beside what the model states that is likeliest at a point.

use std::collections::BTreeMap;

use crate::evidence::nuisance::Nuisance;
use crate::evidence::palette::Palette;
use crate::evidence::problem::Problem;
use crate::evidence::regression::{colour_log_density, coloured, rows_by_reading};
use crate::parameters::Point;
use crate::whitening::columns::predict;
use crate::whitening::filter::{Linear, System};
use crate::whitening::mechanics::Mechanics;
use crate::{DiagnosisError, threads};

/// Sizes of the slow random torque among which a climb looks.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Sizes {
    /// Of what is background.
    Background,
    Any,
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
    /// The noise beside what the model states that is likeliest with the model at a point, its prior included: a climb
    /// from the noise in use, step by step along each of its sizes.
    pub fn likeliest_nuisance(
        &self,
        point: &Point,
        colours: Option<&Palette>,
        sizes: Sizes,
    ) -> Result<Nuisance, DiagnosisError> {
        let mut starts = self.nuisance.starts();
        // What another set needed may be needed here.
        starts.extend(colours.into_iter().flat_map(Palette::noise));
        Ok(self.climb(point, &starts, colours, sizes)?.0)
    }

    /// Climbs from the likeliest of several kinds of noise; where the climb ends, and the logarithms of the density there and
    /// with the noise in use.
    pub fn climb(
        &self,
        point: &Point,
        starts: &[Nuisance],
        colours: Option<&Palette>,
        sizes: Sizes,
    ) -> Result<(Nuisance, f64, f64), DiagnosisError> {
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
        let mut known: BTreeMap<Nuisance, f64> = BTreeMap::new();
        let mut posterior = |nuisance: Nuisance| -> f64 {
            if let Some(found) = known.get(&nuisance) {
                return *found;
            }
            let kind = Nuisance { bias: 0, wheel: 0, torque: nuisance.torque.min(1), ..nuisance };
            let systems = systems(nuisance);
            let linear = linears.of(kind, &systems, self.threads);
            let all: Vec<_> = systems.into_iter().zip(linear.iter()).enumerate().collect();
            let sum: f64 = threads::map(self.threads, &all, |(r, (system, linear))| {
                let (mut innovations, log_density) = system.innovations(linear);
                let mut of_colours = 0.0;
                if let Some(colours) = colours.and_then(|c| c.training(nuisance)).and_then(|c| c.get(*r)) {
                    let rows = rows_by_reading(linear.rows().iter().map(|row| row.reading));
                    coloured(&mut innovations, &rows, colours);
                    of_colours = colour_log_density(&rows, colours);
                }
                log_density + of_colours - 0.5 * innovations.iter().map(|e| e * e).sum::<f64>()
            })
            .iter()
            .sum();
            let found = sum + self.log_prior(nuisance);
            known.insert(nuisance, found);
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
        Ok((likeliest.0, likeliest.1, in_use))
    }
}
