//! Effects that the samples themselves ask for.
//!
//! Bins of a smoothed motion may miss an effect: noise that they need for what is missing hides it, or a fit ends elsewhere. One pass of the
//! causal filter with a column for every effect, about a set that was fitted to the samples, says what each would bring beside it.

use std::collections::BTreeMap;

use whorl_dynamics::Effect;
use whorl_dynamics::effects::Role;
use whorl_prediction::Settings;
use whorl_recording::Recording;

use crate::DiagnosisError;
use crate::evidence::regression::{Estimate, Normal};
use crate::explanations::hypothesis::{Hypothesis, Member, rarity_nats};
use crate::parameters::{Column, is_base};
use crate::refit::{Entered, Refit};
use crate::search::Search;
use crate::search::prior::log_prior;
use crate::search::standing::{Converged, JudgedFit};

/// Prior sizes that are tried, in units of the catalogue's.
const SIZES: [f64; 3] = [1.0, 10.0, 100.0];
/// Effects that are looked at at most.
const MOST_ASKED: usize = 3;

/// An effect that the samples ask for.
pub(crate) struct Asked {
    pub id: &'static str,
    /// Parameters that it enters with.
    pub entered: Entered,
    /// Log evidence that it promises, prior included.
    pub promise: f64,
}

/// Columns of an effect behind those of a set.
struct Offered {
    id: &'static str,
    columns: Vec<usize>,
}

impl Search<'_> {
    /// Effects beside a set that was fitted to the samples, the most promising first.
    pub(crate) fn asked_for(
        &self,
        names: &[String],
        fit: &JudgedFit,
        training: &[Recording],
    ) -> Result<Vec<Asked>, DiagnosisError> {
        let mut refit = fit.refit(&self.problem.reference);
        let mut at = fit.fitted.at.clone();
        let own: Vec<usize> = (0..at.len()).collect();
        let mut offered = Vec::new();
        for candidate in &self.layout.candidates {
            if is_base(candidate.id) || names.iter().any(|name| name == candidate.id) {
                continue;
            }
            let columns = self.offer(&mut refit, &mut at, candidate.effect);
            offered.push(Offered { id: candidate.id, columns });
        }
        let normal = fit.normal(&refit, &[], training, self.options.threads)?;
        let known = |i: usize| refit.stddevs[i].powi(2);
        let Some(without) = Estimate::new(&normal, &own, known) else { return Ok(Vec::new()) };
        let mut asked: Vec<Asked> = offered
            .iter()
            .filter_map(|effect| {
                let (gain, size, columns) = gain_of(&normal, &own, &known, effect, &refit)?;
                let promise = gain - without.log_evidence + log_prior(&[effect.id], &self.options.settings);
                let indices = columns.iter().map(|i| refit.columns[*i].index).collect();
                Some(Asked { id: effect.id, entered: Entered { indices, size }, promise })
            })
            .filter(|asked| asked.promise > 0.0)
            .collect();
        asked.sort_by(|a, b| b.promise.total_cmp(&a.promise));
        let least = asked.first().map_or(0.0, |best| best.promise - self.options.settings.window_nats);
        asked.retain(|one| one.promise >= least);
        asked.truncate(MOST_ASKED);
        Ok(asked)
    }

    /// Adds the amplitudes of an effect that any platform may have, at none; where they are.
    fn offer(&self, refit: &mut Refit<'_>, at: &mut Vec<f64>, effect: &'static dyn Effect) -> Vec<usize> {
        let model = &self.problem.reference.model;
        if effect.hidden_states(model) > 0 {
            return Vec::new();
        }
        let specs = effect.parameters(model);
        let mut places = Vec::new();
        for column in self.problem.reference.parameter_columns(effect) {
            let is_amplitude = specs.get(column.index).is_some_and(|spec| spec.role == Role::Amplitude);
            let is_own = |own: &Column| (own.group, own.index) == (column.group, column.index);
            if !is_amplitude || refit.columns.iter().any(is_own) {
                continue;
            }
            let stddev = column.catalogue_stddev;
            let range = column.range;
            refit.columns.push(column);
            refit.stddevs.push(stddev);
            at.push(0.0);
            let place = at.len() - 1;
            let step = Settings::default().fit_difference * stddev.min(1.0);
            let is_possible = [step, -step].into_iter().any(|step| {
                let mut moved = at.clone();
                moved[place] = step;
                (range.0..=range.1).contains(&step) && refit.model_at(&moved).is_some()
            });
            if is_possible {
                places.push(place);
            } else {
                refit.columns.pop();
                refit.stddevs.pop();
                at.pop();
            }
        }
        places
    }

    /// A set with one effect more, as bins see it; `None` where it cannot stand there.
    pub(crate) fn with_effect(&self, set: &Converged, id: &str) -> Result<Option<Converged>, DiagnosisError> {
        let mut names = set.names.clone();
        names.push(id.to_owned());
        names.sort();
        if let Some(known) = self.fitted.get(&names) {
            return Ok(Some(known.clone()));
        }
        let members: Vec<Member> =
            set.members.iter().filter_map(|m| m.carried(&set.layout, &self.layout)).collect();
        let candidate = self.layout.candidates.iter().position(|candidate| candidate.id == id);
        let start = Hypothesis::of(&self.layout, &self.data.total, members)
            .zip(candidate)
            .and_then(|(start, candidate)| start.with(&self.layout, &self.data.total, candidate));
        let Some(start) = start else { return Ok(None) };
        Ok(self.converge(&start)?.filter(|found| found.names == names))
    }
}

/// Log evidence with an effect, at the size that is likeliest, and the columns with which it enters: those that would have values that no
/// platform has leave.
fn gain_of(
    normal: &Normal,
    own: &[usize],
    known: &impl Fn(usize) -> f64,
    effect: &Offered,
    refit: &Refit<'_>,
) -> Option<(f64, f64, Vec<usize>)> {
    let columns = &refit.columns;
    let with = |entered: &[usize], size: f64| {
        let all: Vec<usize> = own.iter().chain(entered).copied().collect();
        let variance = |i: usize| if i < own.len() { known(i) } else { known(i) * size * size };
        Estimate::new(normal, &all, variance)
    };
    let mut best: Option<(f64, f64, Vec<usize>)> = None;
    for size in SIZES {
        let price = rarity_nats(size, &refit.reference.settings);
        let mut entered = effect.columns.clone();
        while !entered.is_empty() {
            let Some(found) = with(&entered, size) else { break };
            let is_possible = |i: &usize| (columns[*i].range.0..=columns[*i].range.1).contains(&found.of(*i));
            if entered.iter().all(is_possible) {
                let gain = found.log_evidence - price;
                if best.as_ref().is_none_or(|(most, ..)| gain > *most) {
                    best = Some((gain, size, entered.clone()));
                }
                break;
            }
            entered.retain(|i| is_possible(i));
        }
    }
    best
}

/// How effects enter a fit: as bins found them, and with what the samples ask for.
pub(crate) fn entered(set: &Converged, asked: Option<&Asked>) -> BTreeMap<&'static str, Entered> {
    let mut all = Entered::of(&set.layout, &set.members);
    if let Some(asked) = asked {
        let own = all.entry(asked.id).or_insert_with(|| asked.entered.clone());
        own.indices.extend(&asked.entered.indices);
        own.size = own.size.max(asked.entered.size);
    }
    all
}
