//! What the samples say of every effect beside a set that was fitted to them: normal equations of one pass, from which thousands of sets
//! are ranked.
//!
//! A random torque that is loud hides what follows the motion slowly, and without one a model that lacks something else looks far more wrong
//! than it is. So there are two views where a run needs such a torque: with it, and without.

use std::collections::BTreeSet;

use nalgebra::DVector;
use whorl_dynamics::Effect;
use whorl_dynamics::effects::{Clues, Direction, catalogue, find};
use whorl_prediction::{Followed, Hints, Laws, Parameter, hints};
use whorl_recording::Recording;

use crate::DiagnosisError;
use crate::fitting::normal_equations::{Estimate, Normal};
use crate::fitting::refit::Entered;
use crate::parameter_space::Reference;
use crate::parameter_space::ways::{Entry, Ways, joined};
use crate::selection::hidden::{Carriage, Carried};
use crate::selection::hypothesis::{Evaluated, Hypothesis, Runs};
use crate::selection::prior::{SIZES, log_prior, size_penalty_nats};
use crate::verdict::diagnosis::ParameterEstimate;

/// Effects that are tried in pairs, those that gain most alone.
const MOST_PAIRED: usize = 30;
/// Sets that are proposed in each view at most.
const MOST_PROPOSED: usize = 12;
/// Prior variance of a column of which nothing is known, in its unit.
const ANY_SIZE: f64 = 1e6;

/// An effect with the ways in which it may enter, by columns.
struct Offered {
    effect: &'static dyn Effect,
    options: Vec<Vec<usize>>,
}

/// How an effect, or a pair, enters.
#[derive(Debug, Clone)]
pub(crate) struct Entering {
    /// Log evidence of the whole set, over that of the set without it; ways and sizes included.
    pub gain: f64,
    pub size: f64,
    pub columns: Vec<usize>,
    /// Steps from where the set was fitted.
    pub estimate: Estimate,
    /// By how much twice the log posterior is more.
    pub drop: f64,
    /// Ways in which it might have entered.
    ways: usize,
}

/// One view of the samples.
#[derive(Clone)]
pub(crate) struct View {
    normal: Normal,
    without: Estimate,
    /// log p of the training runs in it, over that of the fit.
    log: f64,
}

/// A set that may be worth a fit.
#[derive(Debug, Clone)]
pub(crate) struct Proposal {
    pub hypothesis: Hypothesis,
    /// Predicted gain of log posterior.
    pub gain: f64,
}

/// The normal equations of every effect beside a set.
pub(crate) struct Beside<'a> {
    reference: &'a Reference,
    pub set: &'a Evaluated,
    /// Every column: those of the set, other parameters of the model, and from so many on effects that are carried along.
    entries: Vec<Entry>,
    of_model: usize,
    carried: Vec<Carried>,
    offered: Vec<Offered>,
    views: Vec<View>,
}

impl<'a> Beside<'a> {
    /// Of the effects that `is_asked` chooses; `known`: views of the same, if it was made before.
    pub fn new(
        runs: &Runs<'a>,
        set: &'a Evaluated,
        clues: &Clues<'_>,
        is_asked: &dyn Fn(&dyn Effect) -> bool,
        known: Option<&[View]>,
    ) -> Result<Option<Self>, DiagnosisError> {
        let reference = runs.reference;
        let step = reference.settings.prediction.fit_difference;
        let at_set = set.refit(reference).point(&set.fitted.at);
        // Some step to one side or the other leads to a platform.
        let is_possible = |entry: &Entry| {
            let is_there = |step: f64| (entry.column.range.0..=entry.column.range.1).contains(&step);
            let model = |step: f64| reference.possible_model_at(&entry.moved(reference, &at_set, step));
            [step, -step].into_iter().any(|step| is_there(step) && model(step).is_some())
        };
        let mut entries: Vec<Entry> = set.columns.iter().cloned().map(Entry::from).collect();
        let (mut offered, mut carried) = (Vec::new(), Vec::new());
        let mut of_model = entries.len();
        let is_hidden = |effect: &dyn Effect| effect.hidden_states(&reference.model) > 0;
        for hidden in [false, true] {
            let all = catalogue().iter().copied().filter(|effect| is_hidden(*effect) == hidden);
            for effect in all.filter(|effect| is_asked(*effect)) {
                let id = effect.info().id;
                let is_in_model = reference.model.effects.contains_key(id) && !effect.is_base();
                if set.names().contains(&id) || is_in_model || !runs.available.can_test(effect) {
                    continue;
                }
                let ways = Ways::of(reference, effect, clues, is_possible);
                let mut places: Vec<usize> = Vec::new();
                for entry in ways.entries {
                    let is_own = |own: &_| entry.direction.is_none() && entry.column.is(own);
                    let known = set.columns.iter().position(is_own);
                    places.push(known.unwrap_or(entries.len()));
                    if known.is_none() {
                        let one_unit = || entry.values(reference, effect, 1.0);
                        carried.extend(hidden.then(|| Carried { effect, values: one_unit() }));
                        entries.push(entry);
                    }
                }
                let placed = |option: &Vec<usize>| option.iter().map(|i| places[*i]).collect();
                offered.push(Offered { effect, options: ways.options.iter().map(placed).collect() });
            }
            if !hidden {
                of_model = entries.len();
            }
        }
        let mut beside = Self { reference, set, entries, of_model, carried, offered, views: Vec::new() };
        if let Some(known) = known {
            beside.views = known.to_vec();
            return Ok(Some(beside));
        }
        let loud = &set.fitted.followed;
        let quiet: Vec<Followed> = loud.iter().map(Followed::without_disturbance).collect();
        let log = |all: &[Followed]| all.iter().map(Followed::log_likelihood).sum::<f64>();
        let lost = log(&quiet) - log(loud);
        let of_quiet = (lost.is_finite() && lost < 0.0).then_some((&quiet, lost));
        for (followed, log) in std::iter::once((loud, 0.0)).chain(of_quiet) {
            let view = DiagnosisError::possible(beside.view(runs, followed, log))?.flatten();
            beside.views.extend(view);
        }
        Ok((!beside.views.is_empty()).then_some(beside))
    }

    /// What the samples say, for [`Self::new`] of the same set.
    pub fn views(&self) -> &[View] {
        &self.views
    }

    /// How many columns the set has itself.
    pub fn own(&self) -> usize {
        self.set.columns.len()
    }

    /// One pass over the training runs.
    fn view(&self, runs: &Runs<'_>, followed: &[Followed], log: f64) -> Result<Option<View>, DiagnosisError> {
        let by_run = self.hints(runs, runs.training, followed)?;
        let normal = Normal::about(&by_run, &self.set.fitted.at, &self.parameters());
        let own: Vec<usize> = (0..self.own()).collect();
        let without = Estimate::new(&normal, &own, |i| self.known(i));
        Ok(without.map(|without| View { normal, without, log }))
    }

    /// The normal equations of each of these recordings about the set.
    pub fn hints(
        &self,
        runs: &Runs<'_>,
        recordings: &[Recording],
        followed: &[Followed],
    ) -> Result<Vec<Hints>, DiagnosisError> {
        let (reference, own, count) = (self.reference, self.own(), self.carried.len());
        let refit = self.set.refit(reference);
        let model_at = |x: &[f64]| {
            let further = self.entries.iter().zip(x).skip(own).filter(|(_, units)| **units != 0.0);
            let point = refit.point(&x[..own]);
            reference.possible_model_at(
                &further.fold(point, |point, (entry, units)| entry.moved(reference, &point, *units)),
            )
        };
        let carriages: Vec<Carriage<'_>> = recordings.iter().map(|_| Carriage::new(&self.carried)).collect();
        let carriages = carriages.iter().take(if count > 0 { carriages.len() } else { 0 });
        let laws: Vec<Laws<'_>> = carriages
            .map(|carriage| Laws::new(count, count, |plant, pushes| carriage.push(plant, pushes)))
            .collect();
        let mut at = self.set.fitted.at.clone();
        at.resize(self.of_model, 0.0);
        Ok(hints(recordings, &self.parameters(), &model_at, &at, followed, &laws, &runs.prediction())?)
    }

    /// Columns that are parameters of the model.
    fn parameters(&self) -> Vec<Parameter> {
        let stddev = |i: usize, entry: &Entry| {
            self.set.stddevs.get(i).copied().unwrap_or(entry.column.catalogue_stddev)
        };
        let all = self.entries.iter().take(self.of_model).enumerate();
        all.map(|(i, entry)| Parameter { stddev: stddev(i, entry), range: entry.column.range }).collect()
    }

    /// Prior variance of a column of the set.
    pub fn known(&self, i: usize) -> f64 {
        self.set.stddevs.get(i).map_or(1.0, |stddev| stddev * stddev)
    }

    fn at_of(&self, i: usize) -> f64 {
        self.set.fitted.at.get(i).copied().unwrap_or(0.0)
    }

    /// Prior variance of a column with which an effect of this size enters.
    pub fn entering_variance(&self, i: usize, size: f64) -> f64 {
        let entry = &self.entries[i];
        let stddev = size * entry.column.catalogue_stddev;
        let is_squared = entry.direction.as_ref().is_some_and(|direction| direction.squared);
        let own = (if is_squared { stddev * stddev } else { stddev }).powi(2);
        if i < self.own() { self.known(i).max(own) } else { own }
    }

    /// More columns in a view, at the likeliest size; columns whose values no platform can have are left out. `None` where none remains.
    fn enter(&self, view: &View, further: &[usize]) -> Option<Entering> {
        let settings = &self.reference.settings;
        let own = self.own();
        let mut best: Option<Entering> = None;
        for size in SIZES {
            let mut entered = further.to_vec();
            while !entered.is_empty() {
                let all: Vec<usize> = (0..own).chain(entered.iter().copied().filter(|i| *i >= own)).collect();
                let variance = |i: usize| {
                    if entered.contains(&i) { self.entering_variance(i, size) } else { self.known(i) }
                };
                // With a wider prior a parameter that is far from its mean is pulled back less, and has a smaller penalty.
                let mut normal = view.normal.clone();
                let mut saved = 0.0;
                for i in entered.iter().copied().filter(|i| *i < own) {
                    let less = self.known(i).recip() - variance(i).recip();
                    normal.vector[i] += less * self.at_of(i);
                    saved += 0.5 * less * self.at_of(i).powi(2);
                }
                let Some(estimate) = Estimate::new(&normal, &all, variance) else { break };
                let is_possible = |i: &usize| {
                    let (low, high) = self.entries[*i].column.range;
                    (low..=high).contains(&(self.at_of(*i) + estimate.of(*i)))
                };
                if entered.iter().all(is_possible) {
                    let reference = self.views.first().unwrap_or(view);
                    let gain = view.log + estimate.log_evidence + saved
                        - reference.without.log_evidence
                        - size_penalty_nats(size, settings);
                    let drop = 2.0 * view.log + estimate.drop + 2.0 * saved - reference.without.drop;
                    if best.as_ref().is_none_or(|best| gain > best.gain) {
                        best = Some(Entering { gain, size, columns: entered, estimate, drop, ways: 1 });
                    }
                    break;
                }
                // Without what is essential the others are another effect under this one's name.
                if entered.iter().any(|i| !is_possible(i) && self.entries[*i].column.essential) {
                    break;
                }
                entered.retain(|i| is_possible(i));
            }
        }
        best
    }

    /// The likeliest way of an effect to enter in a view.
    fn best_way(&self, view: &View, offered: &Offered) -> Option<Entering> {
        let ways = offered.options.len();
        // A start with one of its directions left out is another start: all of them are essential.
        let tried = offered.options.iter().filter_map(|option| self.enter(view, option));
        let best = tried.max_by(|a, b| a.gain.total_cmp(&b.gain))?;
        Some(Entering { gain: best.gain - (ways as f64).ln(), ways, ..best })
    }

    fn offered(&self, id: &str) -> Option<&Offered> {
        self.offered.iter().find(|offered| offered.effect.info().id == id)
    }

    /// An effect as the samples would have it enter, with the random torque that they show.
    pub fn entering(&self, id: &str) -> Option<Entering> {
        self.best_way(self.views.first()?, self.offered(id)?)
    }

    /// Effects beside the set.
    pub fn effects(&self) -> impl Iterator<Item = &'static str> + '_ {
        self.offered.iter().map(|offered| offered.effect.info().id)
    }

    /// The set with these effects more, each as it enters best in some view.
    pub fn with(&self, ids: &[&'static str]) -> Option<Hypothesis> {
        let view = self.views.first()?;
        let enter = |id: &&'static str| {
            let offered = self.offered(id)?;
            let found = self.best_way(view, offered).or_else(|| self.best_way(self.views.last()?, offered));
            Some((*id, found?))
        };
        let each: Vec<(&'static str, Entering)> = ids.iter().map(enter).collect::<Option<_>>()?;
        let columns: Vec<usize> = each.iter().flat_map(|(_, e)| e.columns.iter().copied()).collect();
        let joint = self.enter(view, &columns).filter(|joint| joint.columns.len() == columns.len());
        let estimate = joint.as_ref().map_or(&each.first()?.1.estimate, |joint| &joint.estimate);
        Some(self.hypothesis(each.iter().map(|(id, e)| (*id, e, e.size)), estimate))
    }

    /// Sets with one or two effects more that might be more probable than the set, those first that are foremost in some view.
    pub fn proposals(&self, with_pairs: bool) -> Vec<Proposal> {
        let window = self.reference.settings.window_nats;
        let of_view = |view: &View| {
            let all = self.proposals_of(view, with_pairs);
            let least = all.first().map_or(0.0, |best| best.gain - window);
            let foremost = all.iter().take_while(|proposal| proposal.gain >= least);
            // What a pair is worth shows beside the better half of it.
            let with_half = foremost.flat_map(|of| better_half(&all, of).into_iter().chain([of]).cloned());
            with_half.collect::<Vec<_>>().into_iter()
        };
        let mut of_views: Vec<_> = self.views.iter().map(of_view).collect();
        let mut all: Vec<Proposal> = Vec::new();
        for _ in 0..MOST_PROPOSED {
            for proposal in of_views.iter_mut().filter_map(Iterator::next) {
                if all.iter().all(|known| known.hypothesis.effects != proposal.hypothesis.effects) {
                    all.push(proposal);
                }
            }
        }
        all
    }

    fn proposals_of(&self, view: &View, with_pairs: bool) -> Vec<Proposal> {
        let settings = &self.reference.settings;
        let mut singles: Vec<(&'static str, Entering)> = self
            .offered
            .iter()
            .filter_map(|offered| Some((offered.effect.info().id, self.best_way(view, offered)?)))
            .collect();
        singles.sort_by(|a, b| b.1.gain.total_cmp(&a.1.gain));
        let mut all: Vec<Proposal> = singles
            .iter()
            .map(|(id, entering)| Proposal {
                gain: entering.gain + log_prior(&[*id], settings),
                hypothesis: self.hypothesis([(*id, entering, entering.size)], &entering.estimate),
            })
            .collect();
        singles.truncate(if with_pairs { MOST_PAIRED } else { 0 });
        for (n, (a, first)) in singles.iter().enumerate() {
            for (b, second) in singles.iter().skip(n + 1) {
                let mut columns = first.columns.clone();
                columns.extend(second.columns.iter().filter(|i| !first.columns.contains(i)));
                let Some(joint) = self.enter(view, &columns) else { continue };
                let ways = ((first.ways * second.ways) as f64).ln();
                let gain = joint.gain - ways + log_prior(&[*a, *b], settings);
                let alone = [(a, first), (b, second)].map(|(id, e)| e.gain + log_prior(&[*id], settings));
                if joint.columns.len() == columns.len() && gain > alone[0].max(alone[1]).max(0.0) {
                    let parts = [(*a, first, joint.size), (*b, second, joint.size)];
                    let hypothesis = self.hypothesis(parts, &joint.estimate);
                    all.push(Proposal { hypothesis, gain });
                }
            }
        }
        all.retain(|proposal| proposal.gain > 0.0);
        all.sort_by(|a, b| b.gain.total_cmp(&a.gain));
        all
    }

    /// The set with these effects more, each with its size, where an estimate has them.
    fn hypothesis<'e>(
        &self,
        parts: impl IntoIterator<Item = (&'static str, &'e Entering, f64)>,
        estimate: &Estimate,
    ) -> Hypothesis {
        let reference = self.reference;
        let mut hypothesis = self.set.hypothesis.clone();
        // The platform's own parameters move along.
        let mut point = self.set.refit(reference).point(&self.set.fitted.at);
        for (i, column) in self.set.columns.iter().enumerate().filter(|(i, _)| estimate.of(*i) != 0.0) {
            point = reference.moved(&point, column, estimate.of(i));
        }
        for (id, entering, size) in parts {
            let Some(effect) = find(id) else { continue };
            let mut indices = Vec::new();
            let mut directions: Vec<(&Direction, f64)> = Vec::new();
            for i in &entering.columns {
                let entry = &self.entries[*i];
                match &entry.direction {
                    Some(direction) => directions.push((direction, estimate.of(*i))),
                    None => indices.push(entry.column.index),
                }
                if entry.direction.is_none() && *i >= self.own() {
                    point = entry.moved(reference, &point, estimate.of(*i));
                }
            }
            if !directions.is_empty() {
                let (values, fitted) = joined(reference, effect, &directions);
                indices.extend(fitted);
                point.effects.insert(id, values);
            }
            indices.sort_unstable();
            indices.dedup();
            hypothesis.entered.insert(id, Entered { indices, size });
            hypothesis.choices_nats +=
                (entering.ways as f64).ln() + size_penalty_nats(size, &reference.settings);
            hypothesis.effects.push(id);
        }
        hypothesis.effects.sort_unstable();
        hypothesis.point = point;
        hypothesis
    }

    /// Share of the signal of such a step along some columns that refitting the set's others absorbs.
    pub fn absorbed(&self, columns: &[usize], step: impl Fn(usize) -> f64) -> f64 {
        let others: Vec<usize> = (0..self.own()).filter(|i| !columns.contains(i)).collect();
        let share = |view: &View| view.normal.followed(columns, step, &others, |i| self.known(i));
        self.views.first().map_or(0.0, share)
    }

    /// Drop of the misfit that an effect of the catalogue's usual size brings, the largest of its columns; 0 where none shows.
    pub fn detectability(&self, id: &str) -> f64 {
        self.views.first().map_or(0.0, |view| self.detectability_in(&view.normal, id))
    }

    /// The same by other data.
    pub fn detectability_in(&self, normal: &Normal, id: &str) -> f64 {
        let columns: BTreeSet<usize> = self.options(id).into_iter().flatten().collect();
        let of_column = |column: usize| {
            let mut active: Vec<usize> = (0..self.own()).filter(|i| *i != column).collect();
            active.push(column);
            let variance = |i: usize| if i == column { ANY_SIZE } else { self.known(i) };
            let fit = Estimate::new(normal, &active, variance)?;
            let variance = fit.covariance()[(active.len() - 1, active.len() - 1)];
            (variance > 0.0).then(|| self.entries[column].column.catalogue_stddev.powi(2) / variance)
        };
        columns.into_iter().filter_map(of_column).fold(0.0, f64::max)
    }

    /// The given model.
    pub fn reference(&self) -> &Reference {
        self.reference
    }

    /// Values of the columns with which an effect enters.
    pub fn values(&self, entering: &Entering) -> Vec<ParameterEstimate> {
        let (estimate, covariance) = (&entering.estimate, entering.estimate.covariance());
        let of = |i: &usize| {
            let place = estimate.active.iter().position(|active| active == i)?;
            let stddev = covariance[(place, place)].max(0.0).sqrt();
            let units = self.at_of(*i) + estimate.of(*i);
            Some(self.entries[*i].estimate(self.reference, units, stddev))
        };
        entering.columns.iter().filter_map(of).collect()
    }

    /// The ways in which an effect may enter, by columns; of one of the set the columns that it has.
    pub fn options(&self, id: &str) -> Vec<Vec<usize>> {
        if self.set.names().contains(&id) {
            return vec![self.set.columns_of(id)];
        }
        self.offered(id).map_or_else(Vec::new, |offered| offered.options.clone())
    }

    /// What the training runs say, in values and not in steps from the set, without priors.
    pub fn in_values(&self) -> Option<Normal> {
        let mut normal = self.views.first()?.normal.clone();
        let mut at = DVector::zeros(normal.vector.len());
        at.rows_mut(0, self.own()).copy_from_slice(&self.set.fitted.at);
        normal.vector += &normal.matrix * &at;
        (0..self.own()).for_each(|i| normal.vector[i] += at[i] / self.known(i));
        Some(normal)
    }
}

/// The likeliest of `all` sets that a set has and one effect more; `None` where there is none, all that is proposed beside a set holding it.
fn better_half<'p>(all: &'p [Proposal], of: &Proposal) -> Option<&'p Proposal> {
    let effects = &of.hypothesis.effects;
    all.iter().find(|half| {
        half.hypothesis.effects.len() + 1 == effects.len()
            && half.hypothesis.effects.iter().all(|id| effects.contains(id))
    })
}
