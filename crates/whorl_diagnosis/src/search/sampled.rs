//! Effects that the samples propose.
//!
//! Bins of a smoothed motion may miss an effect: the noise that stands in for it hides it, or a fit ends in another optimum. One pass of
//! the causal filter with a column for every effect, about a set that was fitted to the samples, predicts the gain of each effect.

use std::collections::BTreeMap;

use whorl_dynamics::Effect;
use whorl_dynamics::effects::Role;
use whorl_prediction::Settings as OfPredictor;
use whorl_recording::Recording;

use crate::evidence::regression::{Estimate, Normal};
use crate::explanations::candidates::Candidate;
use crate::explanations::hypothesis::{Hypothesis, Term, rarity_nats};
use crate::parameters::Column;
use crate::refit::{Entered, Refit};
use crate::search::Search;
use crate::search::prior::log_prior;
use crate::search::score::{Converged, JudgedFit};
use crate::{DiagnosisError, Settings};

/// Prior sizes that are tried, in units of the catalogue's.
const SIZES: [f64; 3] = [1.0, 10.0, 100.0];
/// Most effects that are proposed at once.
const MOST_ASKED: usize = 3;

/// An effect that the samples propose.
pub(crate) struct Asked {
    pub id: &'static str,
    /// Parameters that it enters with.
    pub entered: Entered,
    /// Predicted gain of log evidence, prior included.
    pub predicted_gain: f64,
}

/// Columns of an effect behind those of a set.
struct Offered {
    id: &'static str,
    /// Columns with which it may enter.
    options: Vec<Vec<usize>>,
    /// Whether it has amplitudes only: an effect with a shape (a frequency, a knee) might fit at another value of it.
    is_linear: bool,
}

/// An effect as it enters beside a set, by the sums of the samples.
pub(crate) struct Entry {
    /// Log evidence of the sums with it, less the log-prior penalty of how it enters.
    pub gain: f64,
    /// Prior size, in units of the catalogue's.
    pub size: f64,
    /// Columns that remain: those whose values no platform can have are left out.
    pub columns: Vec<usize>,
    /// Steps from where the set was fitted.
    pub estimate: Estimate,
    /// By how much the misfit is lower than without it.
    pub drop: f64,
}

/// The normal equations of the samples for every effect beside a set that was fitted to them.
pub(crate) struct Beside {
    pub names: Vec<String>,
    pub normal: Normal,
    /// Columns of the set itself.
    pub own: Vec<usize>,
    offered: Vec<Offered>,
    pub columns: Vec<Column>,
    pub stddevs: Vec<f64>,
    /// Where each is, in its units.
    pub at: Vec<f64>,
    /// The sums without any of them.
    pub without: Estimate,
}

impl Beside {
    /// Effects beside the set, that with the largest predicted gain first.
    pub fn asked(&self, settings: &Settings) -> Vec<Asked> {
        let mut asked: Vec<Asked> = self
            .offered
            .iter()
            .filter_map(|effect| {
                let entry = self.best_of(effect, settings)?;
                let predicted_gain =
                    entry.gain - self.without.log_evidence + log_prior(&[effect.id], settings);
                let indices = entry.columns.iter().map(|i| self.columns[*i].index).collect();
                let entered = Entered { indices, size: entry.size };
                Some(Asked { id: effect.id, entered, predicted_gain })
            })
            .filter(|asked| asked.predicted_gain > 0.0)
            .collect();
        asked.sort_by(|a, b| b.predicted_gain.total_cmp(&a.predicted_gain));
        let least = asked.first().map_or(0.0, |best| best.predicted_gain - settings.window_nats);
        asked.retain(|one| one.predicted_gain >= least);
        asked.truncate(MOST_ASKED);
        asked
    }

    /// Whether a set cannot change the answer beside one of this log posterior. Only for sets that hold the set of these normal
    /// equations, and besides it only effects that are linear. A small predicted gain is exact enough: the fit is near its optimum
    /// already. Far from an optimum the predicted gain may be half of the true one.
    fn rules_out(&self, names: &[String], own: f64, most: f64, settings: &Settings) -> bool {
        let is_own = |name: &String| self.names.contains(name);
        if names.len() <= self.names.len() || !self.names.iter().all(|name| names.contains(name)) {
            return false;
        }
        let further = names.iter().filter(|name| !is_own(name));
        let offered: Option<Vec<&Offered>> =
            further.map(|name| self.offered.iter().find(|effect| effect.id == name)).collect();
        let Some(offered) = offered.filter(|all| all.iter().all(|effect| effect.is_linear)) else {
            return false;
        };
        // Each effect with the columns that gain most alone.
        let best: Option<Vec<(usize, Vec<usize>)>> = offered
            .iter()
            .map(|effect| Some((effect.options.len(), self.best_of(effect, settings)?.columns)))
            .collect();
        let Some(best) = best else { return false };
        let columns: Vec<usize> = best.iter().flat_map(|(_, columns)| columns.iter().copied()).collect();
        let choices: f64 = best.iter().map(|(options, _)| (*options as f64).ln()).sum();
        let Some(entry) = self.enter(&columns, settings) else { return false };
        let gain = entry.gain - choices - self.without.log_evidence;
        let most_gained = if gain > settings.window_nats { 2.0 * gain } else { gain };
        let predicted_gain = most_gained + log_prior(names, settings) - log_prior(&self.names, settings);
        own + predicted_gain < most - settings.doubt_nats
    }

    /// Whether the sums hold for an effect: one with a shape may fit at another value of it.
    pub fn holds_for(&self, id: &str) -> bool {
        self.offered.iter().any(|effect| effect.id == id && effect.is_linear)
    }

    /// An effect beside the set. `None` where no platform can have it with the values that the samples ask for.
    pub fn entry(&self, id: &str, settings: &Settings) -> Option<Entry> {
        self.best_of(self.offered.iter().find(|effect| effect.id == id)?, settings)
    }

    /// An effect with the likeliest of its choices of columns.
    fn best_of(&self, effect: &Offered, settings: &Settings) -> Option<Entry> {
        let choice = (effect.options.len() as f64).ln();
        let entries = effect.options.iter().filter_map(|columns| self.enter(columns, settings));
        let best = entries.max_by(|a, b| a.gain.total_cmp(&b.gain))?;
        Some(Entry { gain: best.gain - choice, ..best })
    }

    /// More columns, at the likeliest size.
    fn enter(&self, further: &[usize], settings: &Settings) -> Option<Entry> {
        let known = |i: usize| self.stddevs[i].powi(2);
        let with = |entered: &[usize], size: f64| {
            let is_own = |i: &&usize| **i < self.own.len();
            let all: Vec<usize> =
                self.own.iter().chain(entered.iter().filter(|i| !is_own(i))).copied().collect();
            let of_effect = |i: usize| known(i).max((size * self.columns[i].catalogue_stddev).powi(2));
            let variance = |i: usize| if entered.contains(&i) { of_effect(i) } else { known(i) };
            // With a wider prior a parameter that is far from its mean is pulled back less, and has a smaller penalty.
            let mut normal = self.normal.clone();
            let mut saved = 0.0;
            for i in entered.iter().filter(is_own).copied() {
                let less = known(i).recip() - of_effect(i).recip();
                normal.vector[i] += less * self.at[i];
                saved += 0.5 * less * self.at[i].powi(2);
            }
            Estimate::new(&normal, &all, variance).map(|found| (saved, found))
        };
        let mut best: Option<Entry> = None;
        for size in SIZES {
            let mut entered = further.to_vec();
            while !entered.is_empty() {
                let Some((saved, estimate)) = with(&entered, size) else { break };
                let is_possible = |i: &usize| {
                    let (least, most) = self.columns[*i].range;
                    (least..=most).contains(&(self.at[*i] + estimate.of(*i)))
                };
                if entered.iter().all(is_possible) {
                    let gain = estimate.log_evidence + saved - rarity_nats(size, settings);
                    let drop = estimate.drop + 2.0 * saved - self.without.drop;
                    if best.as_ref().is_none_or(|most| gain > most.gain) {
                        best = Some(Entry { gain, size, columns: entered, estimate, drop });
                    }
                    break;
                }
                entered.retain(|i| is_possible(i));
            }
        }
        best
    }
}

impl Search<'_> {
    /// Whether the samples predict too low a probability for a set to be worth mentioning beside the most probable judged one.
    pub(crate) fn is_ruled_out(&self, names: &[String]) -> bool {
        let Some(most) = self.most_probable_judged().map(Converged::log_posterior) else { return false };
        let settings = &self.options.settings;
        self.besides.iter().any(|beside| {
            let own = self.fitted.get(&beside.names).map(Converged::log_posterior);
            own.is_some_and(|own| beside.rules_out(names, own, most, settings))
        })
    }

    /// The normal equations of all effects beside a set that was fitted to the samples.
    pub(crate) fn beside(
        &self,
        set: &Converged,
        fit: &JudgedFit,
        training: &[Recording],
    ) -> Result<Option<Beside>, DiagnosisError> {
        let names = &set.names;
        let mut refit = fit.refit(&self.problem.reference);
        let mut at = fit.fitted.at.clone();
        let own: Vec<usize> = (0..at.len()).collect();
        let mut offered = Vec::new();
        for candidate in &self.design.candidates {
            if names.iter().any(|name| name == candidate.id) {
                continue;
            }
            // Columns that the platform's own parameters already have of this effect, and its others.
            let is_of_it = |i: &usize| refit.columns[*i].group == candidate.id;
            let mut columns: Vec<usize> = own.iter().copied().filter(is_of_it).collect();
            columns.extend(self.offer(&mut refit, &mut at, candidate.effect));
            let options = self.options_of(candidate, &refit.columns, columns);
            let specs = candidate.effect.parameters(&self.problem.reference.model);
            let is_linear = specs.iter().all(|spec| spec.known || spec.role == Role::Amplitude);
            offered.push(Offered { id: candidate.id, options, is_linear });
        }
        let normal = fit.normal(&refit, &[], training, self.options.threads)?;
        let known = |i: usize| refit.stddevs[i].powi(2);
        let Some(without) = Estimate::new(&normal, &own, known) else { return Ok(None) };
        Ok(Some(Beside {
            names: names.clone(),
            own,
            offered,
            without,
            columns: refit.columns,
            stddevs: refit.stddevs,
            at,
            normal,
        }))
    }

    /// The ways in which a candidate may enter with some of these columns; all of them together where it states none.
    fn options_of(&self, candidate: &Candidate, columns: &[Column], of_it: Vec<usize>) -> Vec<Vec<usize>> {
        let place = |i: &usize| {
            let own = self.design.columns.get(*i)?;
            of_it.iter().copied().find(|k| own.origin.is_none() && columns[*k].index == own.index)
        };
        let placed = |option: &Vec<usize>| -> Vec<usize> { option.iter().filter_map(place).collect() };
        let mut options: Vec<Vec<usize>> =
            candidate.options.iter().map(placed).filter(|option| !option.is_empty()).collect();
        options.sort();
        options.dedup();
        if options.is_empty() && !of_it.is_empty() { vec![of_it] } else { options }
    }

    /// Adds the amplitudes of an effect that any platform may have, at zero; returns their indices.
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
            let step = OfPredictor::default().fit_difference * stddev.min(1.0);
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
        let terms: Vec<Term> =
            set.terms.iter().filter_map(|m| m.carried(&set.design, &self.design)).collect();
        let candidate = self.design.candidates.iter().position(|candidate| candidate.id == id);
        let start = Hypothesis::of(&self.design, &self.data.total, terms)
            .zip(candidate)
            .and_then(|(start, candidate)| start.with(&self.design, &self.data.total, candidate));
        let Some(start) = start else { return Ok(None) };
        Ok(self.converge(&start)?.filter(|found| found.names == names))
    }
}

/// How effects enter a fit: as the bins found them, and as the samples propose them.
pub(crate) fn entered(set: &Converged, asked: Option<&Asked>) -> BTreeMap<&'static str, Entered> {
    let mut all = Entered::of(&set.design, &set.terms);
    if let Some(asked) = asked {
        let own = all.entry(asked.id).or_insert_with(|| asked.entered.clone());
        own.indices.extend(&asked.entered.indices);
        own.size = own.size.max(asked.entered.size);
    }
    all
}
