//! Effects whose amplitude changes: that begin, end or change within a run, or that not all runs have.
//!
//! An effect is a constant amplitude times a signal. Here the amplitude has one value before a time and another after it, of
//! which one may be zero. What the effect changes within each of some stretches of a run passes through the whitening filter
//! as a column of its own, so a step at any bound between stretches is a sum of such columns, and the evidence of all steps
//! follows from one regression (the exact posterior of a change point in a linear model: Chernoff and Zacks, Annals of
//! Mathematical Statistics 35, 1964; Smith, Biometrika 62, 1975). Steps pay for the time at which they are, which may be any;
//! the posterior over it is the onset with its uncertainty. Stretches are made finer about it until nodes bound it.

pub(crate) mod regression;
mod stage;
mod suspects;

use std::collections::BTreeMap;

use crate::DiagnosisError;
use crate::diagnosis::{Change, ChangedParameter};
use crate::evidence::nuisance::Nuisance;
use crate::search::Search;
use crate::search::standing::Converged;

use regression::{Place, Steps};
use stage::{Grid, Stage};
use suspects::Suspect;

/// Probability that an effect which is missing does not act alike throughout the data: one in ten cables snags, one in ten
/// valves clogs.
const CHANGES: f64 = 0.1;

/// Grids about an onset, each finer than the last.
const MOST_GRIDS: usize = 4;

/// A step whose evidence is below that of the constant effect by more has no part in the answer.
const HOPELESS: f64 = -10.0;

/// An effect whose amplitude changes, beside a set of effects.
#[derive(Debug, Clone)]
pub(crate) struct Changed {
    /// The set, the changing effect included, in alphabetical order.
    pub effects: Vec<String>,
    pub change: Change,
    /// Log evidence, comparable with [`super::standing::Standing::log_evidence`].
    pub log_evidence: f64,
}

/// Regressions beside one set, by the noise that they expect.
type Stages = BTreeMap<String, Stage>;

impl Search<'_> {
    /// Sets in which an effect changes that come near the constant ones: members of the best set, and effects that the
    /// residual suggests.
    ///
    /// Where the best set leaves nothing (`is_clean`), only its own members may change.
    pub(crate) fn changed(&self, is_clean: bool) -> Result<Vec<Changed>, DiagnosisError> {
        let mut anchors: Vec<&Converged> = self.fitted(&self.best).into_iter().collect();
        let names = self.best.names(&self.layout);
        if is_clean {
            let suggested = self.suggested_members();
            anchors.retain(|at| at.names.iter().any(|name| suggested.contains(name)));
        } else if names.len() > 1 {
            anchors.extend(names.iter().filter_map(|id| self.fitted.get(std::slice::from_ref(id))));
        }
        if !names.is_empty() && !is_clean {
            anchors.extend(self.fitted(&self.base));
        }
        let mut found: Vec<Changed> = Vec::new();
        for at in anchors {
            for suspect in self.suspects(at, is_clean) {
                found.extend(self.change_of(at, &suspect)?);
            }
        }
        found.sort_by(|a, b| b.log_evidence.total_cmp(&a.log_evidence));
        Ok(found)
    }

    /// One effect beside a set where that fits best, or a member of it, with an amplitude that changes.
    fn change_of(&self, at: &Converged, suspect: &Suspect) -> Result<Option<Changed>, DiagnosisError> {
        let own = at.standing.nuisance;
        let mut noises = vec![own, Nuisance { torque: 0, ..own }];
        noises.dedup();
        let mut errors = vec![at.standing.relative_error, 0.0];
        errors.dedup();
        // What the constant set has here, by the same formulas.
        let (mut constant, mut best) = (None, None::<(Steps, Nuisance, f64)>);
        let mut stages = Stages::new();
        for &nuisance in &noises {
            let stage = Stage::new(self, at, nuisance)?;
            let grid = Grid::coarse(&stage);
            for &error in &errors {
                let Some(steps) = stage.steps(self, at, suspect, &grid, error)? else { continue };
                if nuisance == own && error.to_bits() == at.standing.relative_error.to_bits() {
                    constant = Some(steps.constant);
                }
                // Beside a torque that is no background, it would be something without a name as well.
                if self.problem.is_large(nuisance) {
                    continue;
                }
                if best.as_ref().is_none_or(|b| steps.log_evidence > b.0.log_evidence) {
                    best = Some((steps, nuisance, error));
                }
            }
            stages.insert(format!("{nuisance:?}"), stage);
        }
        let (Some(constant), Some((mut steps, nuisance, error))) = (constant, best) else { return Ok(None) };
        let price = CHANGES.ln() - (suspect.options.max(1) as f64).ln();
        if steps.log_evidence + price - constant < HOPELESS {
            return Ok(None);
        }
        let Some(mut stage) = stages.remove(&format!("{nuisance:?}")) else { return Ok(None) };
        // The constants of the platform where the step leaves them: the regression holds there.
        let mut moved = at.clone();
        moved.point = steps.point(self, at);
        stage.motions_of(&mut moved);
        stage = Stage::new(self, &moved, nuisance)?;
        let mut grid = Grid::coarse(&stage);
        for turn in 0..MOST_GRIDS {
            let Some(next) = stage.steps(self, &moved, suspect, &grid, error)? else { return Ok(None) };
            steps = next;
            match grid.finer(&stage, &steps) {
                Some(finer) if turn + 1 < MOST_GRIDS => grid = finer,
                _ => break,
            }
        }
        let log_evidence = at.standing.log_evidence + steps.log_evidence + price - constant;
        let mut effects = at.names.clone();
        if !suspect.is_own(at) {
            effects.push(suspect.id.to_owned());
            effects.sort();
        }
        let change = self.described(&stage, &moved, suspect, &steps);
        Ok(change.map(|change| Changed { effects, change, log_evidence }))
    }

    /// The likeliest step, in words and numbers of the platform.
    fn described(&self, stage: &Stage, at: &Converged, suspect: &Suspect, steps: &Steps) -> Option<Change> {
        let Place { run, onward, .. } = steps.best.place;
        let within = steps.best.place.bound > 0;
        let time = within.then(|| steps.onset(stage)).flatten();
        let parameters = suspect.columns.iter().enumerate().map(|(q, column)| {
            let from = self.problem.reference.counted_from(&at.point, column);
            let physical = |units: f64| from + units * column.scale;
            let ([before, after], [before_stddev, after_stddev]) = steps.values(suspect, &at.layout, q);
            ChangedParameter {
                name: column.name.clone(),
                unit: column.unit.to_owned(),
                before: physical(before),
                before_stddev: before_stddev * column.scale,
                after: physical(after),
                after_stddev: after_stddev * column.scale,
            }
        });
        Some(Change {
            effect: suspect.id.to_owned(),
            run: stage.runs.get(run)?.name.clone(),
            onset: time,
            in_later_runs: onward && run + 1 < stage.runs.len(),
            parameters: parameters.collect(),
            probability: 0.0,
            delta_log_evidence: 0.0,
        })
    }
}
