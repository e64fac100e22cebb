//! All runs beside a set, each cut into stretches, with the responses to what an effect changes within each.

use std::sync::Arc;

use crate::DiagnosisError;
use crate::evidence::discrepancy::Discrepancy;
use crate::evidence::nuisance::Nuisance;
use crate::evidence::problem::{Dataset, Problem, Trust};
use crate::evidence::regression::Normal;
use crate::explanations::hypothesis::Hypothesis;
use crate::search::Search;
use crate::search::changes::regression::{Cut, Regression, Steps};
use crate::search::changes::suspects::Suspect;
use crate::search::standing::Converged;
use crate::search::step::dataset;
use crate::whitening::columns::{Linearised, Moved, stretch_responses};

/// Stretches of each run on the first grid, and of one run on those that are finer.
const STRETCHES: usize = 24;

/// Mass of the posterior that a finer grid must hold.
const HELD: f64 = 0.999;

/// A problem linearised where a set fits best.
struct Part {
    problem: Problem,
    data: Dataset,
    linearised: Vec<Linearised>,
}

/// A run in the order in which runs were given, held-out ones last.
pub(crate) struct StagedRun {
    pub name: String,
    /// Time of each node \[s\].
    pub time_s: Vec<f64>,
}

/// Training and held-out runs beside a set, with one kind of noise.
pub(crate) struct Stage {
    parts: Vec<Part>,
    pub runs: Vec<StagedRun>,
    nuisance: Nuisance,
}

/// Bounds of the stretches of each run, and where a step may be.
#[derive(Debug, Clone)]
pub(crate) struct Grid {
    pub bounds: Vec<Vec<usize>>,
    /// Prior mass of a step at each bound of each run; 0 where none is looked for.
    pub mass: Vec<Vec<f64>>,
    /// The run about whose onset it is fine.
    about: Option<usize>,
}

impl Grid {
    /// Equal stretches of all runs. Half of the mass is for steps between runs, if there are several.
    pub fn coarse(stage: &Stage) -> Self {
        let cut = |run: &StagedRun| {
            let nodes = run.time_s.len();
            let mut bounds: Vec<usize> = (0..=STRETCHES).map(|m| m * nodes / STRETCHES).collect();
            bounds.dedup();
            bounds
        };
        let bounds: Vec<Vec<usize>> = stage.runs.iter().map(cut).collect();
        let count = bounds.len() as f64;
        let (between, within) = if bounds.len() > 1 { (0.5, 0.5) } else { (0.0, 1.0) };
        let total_s: f64 = stage.runs.iter().map(StagedRun::duration_s).sum();
        let of_run = |(run, bounds): (&StagedRun, &Vec<usize>)| {
            let mut mass = vec![0.0; bounds.len()];
            let inner = bounds.len().saturating_sub(2).max(1) as f64;
            mass.iter_mut().for_each(|m| *m = within * run.duration_s() / total_s.max(1e-9) / inner);
            if let Some(first) = mass.first_mut() {
                *first = between / count;
            }
            if let Some(last) = mass.last_mut() {
                *last = 0.0;
            }
            mass
        };
        let mass = stage.runs.iter().zip(&bounds).map(of_run).collect();
        Self { bounds, mass, about: None }
    }

    /// A finer one about the onset, if its stretches are longer than they need be.
    pub fn finer(&self, stage: &Stage, steps: &Steps) -> Option<Self> {
        let place = steps.best.place;
        if place.bound == 0 {
            return None;
        }
        let (run, old) = (stage.runs.get(place.run)?, self.bounds.get(place.run)?);
        let (from, to) = steps.span(place.run, HELD)?;
        let first = old.get(from.max(1) - 1).copied()?;
        let last = old.get((to + 1).min(old.len() - 1)).copied()?;
        let nodes = run.time_s.len();
        let mut fine: Vec<usize> =
            (0..=STRETCHES).map(|m| first + m * (last - first) / STRETCHES).filter(|b| *b > 0).collect();
        fine.retain(|b| *b < nodes);
        fine.dedup();
        // No finer than the last one.
        if fine.len() <= to + 3 - from.max(1) {
            return None;
        }
        let total_s: f64 = stage.runs.iter().map(StagedRun::duration_s).sum();
        let within = if stage.runs.len() > 1 { 0.5 } else { 1.0 };
        let step_s = (run.time(last) - run.time(first)) / fine.len().max(1) as f64;
        let mut bounds: Vec<Vec<usize>> = stage.runs.iter().map(|r| vec![0, r.time_s.len()]).collect();
        let mut mass: Vec<Vec<f64>> = bounds.iter().map(|b| vec![0.0; b.len()]).collect();
        let (own, own_mass) = (bounds.get_mut(place.run)?, mass.get_mut(place.run)?);
        *own = std::iter::once(0).chain(fine.iter().copied()).chain([nodes]).collect();
        *own_mass = own.iter().map(|_| within * step_s / total_s.max(1e-9)).collect();
        own_mass[0] = 0.0;
        if let Some(end) = own_mass.last_mut() {
            *end = 0.0;
        }
        Some(Self { bounds, mass, about: Some(place.run) })
    }

    /// Whether a run need not be cut.
    fn is_whole(&self, run: usize) -> bool {
        self.about.is_some_and(|about| about != run)
    }
}

impl StagedRun {
    pub fn time(&self, node: usize) -> f64 {
        self.time_s.get(node.min(self.time_s.len().saturating_sub(1))).copied().unwrap_or(0.0)
    }

    fn duration_s(&self) -> f64 {
        self.time(self.time_s.len()) - self.time(0)
    }
}

impl Stage {
    /// Linearises all runs where a set fits best, with this noise.
    pub fn new(search: &Search<'_>, at: &Converged, nuisance: Nuisance) -> Result<Self, DiagnosisError> {
        let mut problem = search.problem.clone();
        problem.motions = Arc::clone(&at.motions);
        problem.nuisance = nuisance;
        let mut parts = vec![(problem, search.palette.training(nuisance).cloned())];
        if let Some(held) = search.held_out.as_deref() {
            let mut held = held.clone();
            held.nuisance = nuisance;
            held.smooth(&at.point, Trust::AsDataSay)?;
            parts.push((held, search.palette.held_out(nuisance).cloned()));
        }
        let made = parts.into_iter().map(|(problem, colours)| {
            let data = dataset(&problem, &at.point, &at.layout, colours)?;
            let linearised = problem.linearise(&at.point)?;
            Ok(Part { problem, data, linearised })
        });
        let parts: Vec<Part> = made.collect::<Result<_, DiagnosisError>>()?;
        let runs = parts.iter().flat_map(|part| part.problem.runs.iter()).map(|run| StagedRun {
            name: run.name.clone(),
            time_s: (0..run.nodes()).map(|k| run.time(k)).collect(),
        });
        let runs = runs.collect();
        Ok(Self { parts, runs, nuisance })
    }

    /// Smooths the motions of a set at its point again.
    pub fn motions_of(&mut self, at: &mut Converged) {
        if let Some(part) = self.parts.first_mut()
            && part.problem.smooth(&at.point, Trust::AsBefore).is_ok()
        {
            at.motions = Arc::clone(&part.problem.motions);
        }
    }

    /// All steps of an effect's amplitude on a grid, with errors of formulas of this relative size integrated out.
    pub fn steps(
        &self,
        search: &Search<'_>,
        at: &Converged,
        suspect: &Suspect,
        grid: &Grid,
        relative_error: f64,
    ) -> Result<Option<Steps>, DiagnosisError> {
        let Some(training) = self.parts.first().map(|part| &part.data.total) else { return Ok(None) };
        let Some(fit) = Hypothesis::free(&at.layout, training, at.members.clone()) else { return Ok(None) };
        let active = fit.estimate.active.clone();
        let variances = fit.variances(&at.layout);
        let reference = &search.problem.reference;
        let mut cuts: Vec<Cut> = Vec::new();
        let mut log_density = search.problem.log_prior(self.nuisance);
        for part in &self.parts {
            let problem = &part.problem;
            log_density += part.data.log_density;
            let Some(base) = part.linearised.first().map(|linear| &linear.mechanics) else { continue };
            let moved: Vec<Moved> = suspect
                .columns
                .iter()
                .map(|column| Moved::new(base, reference, &at.point, column))
                .collect::<Result<_, _>>()?;
            let mut signals = problem.signals(&at.point, &at.layout);
            for signal in &mut signals {
                let placed =
                    signal.iter().filter_map(|(i, size)| Some((active.iter().position(|a| a == i)?, *size)));
                *signal = placed.collect();
            }
            for (r, (run, motion)) in problem.runs.iter().zip(problem.motions.iter()).enumerate() {
                let (Some(linear), Some(old)) = (part.linearised.get(r), part.data.whitened.get(r)) else {
                    continue;
                };
                let whole = [0, run.nodes()];
                let bounds = match grid.bounds.get(cuts.len()) {
                    Some(bounds) if !grid.is_whole(cuts.len()) => bounds.as_slice(),
                    _ => &whole,
                };
                let responses = stretch_responses(run, motion, linear, &moved, bounds, problem.threads);
                let colours = part.data.colours.get(r).map_or(&[][..], Vec::as_slice);
                let stretches = bounds.len().saturating_sub(1);
                let total = suspect.columns.len() * stretches;
                let widened = old.widened(&active, responses, total, colours, problem.threads);
                let combined = std::slice::from_ref(&widened.whitened);
                let (node_s, width) = ([run.node_s()], widened.width());
                let discrepancy = Discrepancy::new(combined, &node_s, &signals, width, problem.threads);
                let (of_run, gained) =
                    discrepancy.integrated(&widened.normal(problem.threads), relative_error);
                log_density += gained;
                let mut normal = Normal::zeros(active.len() + total);
                widened.add_unfilled(&of_run, &mut normal);
                cuts.push(Cut { normal, stretches });
            }
        }
        // Prices of the other members' choices.
        let others = at
            .members
            .iter()
            .filter(|m| at.layout.candidates.get(m.candidate).is_none_or(|c| c.id != suspect.id))
            .cloned()
            .collect();
        let choices = |members| {
            Hypothesis::free(&at.layout, training, members)
                .map_or(0.0, |h| h.log_evidence - h.estimate.log_evidence)
        };
        let regression = Regression {
            own: active.iter().map(|i| suspect.is_amplitude_of(&at.layout, *i)).collect(),
            variances: active.iter().map(|i| variances.get(*i).copied().unwrap_or(1.0).max(1e-12)).collect(),
            active,
            cuts,
            log_density,
            choices: [choices(at.members.clone()), choices(others)],
        };
        Ok(regression.steps(suspect, grid))
    }
}
