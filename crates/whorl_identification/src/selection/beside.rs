//! What the samples say of every effect beside a set that was fitted to them: normal equations of one pass, which rank thousands of sets.
//!
//! A random torque that is loud hides what follows the motion slowly, and without one a model that lacks something else looks far more wrong
//! than it is. So there are two views where a run needs such a torque: with it, and without.

use std::collections::BTreeSet;

use nalgebra::DVector;
use whorl_dynamics::Effect;
use whorl_dynamics::effects::{Clues, Direction, Role, find};
use whorl_math::normal_equations::{Estimate, Normal};
use whorl_prediction::{Followed, Hints, Laws, Parameter, hints};
use whorl_recording::Recording;

use crate::fitting::refit::{Entered, about};
use crate::parameter_space::ways::{Entry, Ways, joined};
use crate::selection::hidden::{Carriage, Carried};
use crate::selection::hypothesis::{Evaluated, Hypothesis, Runs};
use crate::selection::{SIZES, log_prior, size_penalty_nats};
use crate::verdict::diagnosis::ParameterEstimate;
use crate::{DiagnosisError, Outcome, Settings};

/// Effects that are tried in pairs, those that gain most alone.
const MOST_PAIRED: usize = 30;
/// Sets that are proposed in each view at most.
const MOST_PROPOSED: usize = 12;
/// Share of what random torques, or an effect, explain that another effect may leave by a quadratic, and still be tried in their place.
/// Measured: a turbine, a cable and a dipole of fifty nats left a tenth at most, late inertial data a tenth of late valves, and a false exchange over half.
const LEFT_OPEN: f64 = 0.25;
/// Prior variance of a column of which nothing is known, in its unit.
const ANY_SIZE: f64 = 1e6;

/// How an effect, or a pair, enters.
pub(crate) struct Entering {
    id: &'static str,
    /// Log evidence of the whole set, over that of the set without it; ways and sizes included.
    pub gain: f64,
    pub columns: Vec<usize>,
    pub estimate: Estimate,
    /// By how much twice the log posterior is more.
    pub drop: f64,
    /// Over the catalogue's prior.
    size: f64,
    /// Ways in which it might have entered.
    ways: usize,
}

/// One view of the samples: what they say of values, priors left out, and log p of the training runs over that of the fit where all values are 0.
struct View {
    normal: Normal,
    log: f64,
    without: Estimate,
    /// log p over that of the fit with the values of the fit.
    at_fit: f64,
    /// Without random torques.
    quiet: bool,
}

#[derive(Debug, Clone)]
pub(crate) struct Proposal {
    pub hypothesis: Hypothesis,
    gain: f64,
}

/// The normal equations of every effect beside a set.
pub(crate) struct Beside<'a> {
    runs: Runs<'a>,
    pub set: Evaluated,
    /// Every column: those of the set, other parameters of the model, and effects that are carried along.
    entries: Vec<Entry>,
    carried: Vec<Carried>,
    /// Effects with the ways in which each may enter, by columns.
    offered: Vec<(&'static str, Vec<Vec<usize>>)>,
    views: Vec<View>,
}

impl<'a> Beside<'a> {
    /// Of the effects that are `asked` for, each once; `None` where the samples say nothing.
    pub fn new(
        runs: &Runs<'a>,
        set: &Evaluated,
        clues: &Clues<'_>,
        asked: Vec<&'static dyn Effect>,
    ) -> Outcome<Option<Self>> {
        let reference = runs.reference;
        let step = reference.settings.prediction.fit_difference;
        let at_set = set.refit(reference).point(&set.fitted.at);
        // Some step to one side or the other leads to a platform.
        let is_possible = |entry: &Entry| {
            let is_there = |step: f64| (entry.column.range.0..=entry.column.range.1).contains(&step);
            let model = |step: f64| reference.possible_model_at(&entry.moved(reference, &at_set, step));
            [step, -step].into_iter().any(|step| is_there(step) && model(step).is_some())
        };
        let is_hidden = |effect: &dyn Effect| reference.is_hidden(effect.info().id);
        let is_open = |effect: &&dyn Effect| {
            let id = effect.info().id;
            let is_in_model = reference.model.effects.contains_key(id) && !effect.is_base();
            let is_new = !is_in_model && !set.names().contains(&id);
            is_new && runs.available.can_test(*effect)
        };
        let mut open: Vec<&'static dyn Effect> = asked.into_iter().filter(is_open).collect();
        open.sort_by_key(|effect| is_hidden(*effect));
        let mut entries: Vec<Entry> = set.columns.iter().cloned().map(Entry::of_column).collect();
        let (mut offered, mut carried) = (Vec::new(), Vec::new());
        for effect in open {
            let ways = Ways::of(reference, effect, clues, is_possible);
            let mut places: Vec<usize> = Vec::new();
            for entry in ways.entries {
                let is_own = |own: &_| entry.direction.is_none() && entry.column.is(own);
                let known = set.columns.iter().position(is_own);
                places.push(known.unwrap_or(entries.len()));
                if known.is_none() {
                    let one_unit = || entry.values(reference, effect, 1.0);
                    carried.extend(is_hidden(effect).then(|| Carried { effect, values: one_unit() }));
                    entries.push(entry);
                }
            }
            let placed = |option: &Vec<usize>| option.iter().map(|i| places[*i]).collect();
            offered.push((effect.info().id, ways.options.iter().map(placed).collect()));
        }
        let mut beside = Self { runs: *runs, set: set.clone(), entries, carried, offered, views: Vec::new() };
        let loud = &set.fitted.followed;
        let quiet: Vec<Followed> = loud.iter().map(Followed::without_disturbance).collect();
        let log = |all: &[Followed]| all.iter().map(Followed::log_likelihood).sum::<f64>();
        let lost = log(&quiet) - log(loud) + set.fitted.levels_nats;
        let of_quiet = (lost.is_finite() && lost < 0.0).then_some((&quiet, lost, true));
        for (followed, log, quiet) in std::iter::once((loud, 0.0, false)).chain(of_quiet) {
            let view = DiagnosisError::possible(beside.view(followed, log, quiet))?.flatten();
            beside.views.extend(view);
        }
        Ok((!beside.views.is_empty()).then_some(beside))
    }

    pub fn settings(&self) -> &Settings {
        &self.runs.reference.settings
    }

    pub fn own(&self) -> usize {
        self.set.columns.len()
    }

    /// From where a column of the set is counted: amplitudes from none, shapes from where they were found, as one without an amplitude does nothing.
    pub fn counted_from(&self, i: usize) -> f64 {
        let is_shape = self.set.columns.get(i).is_some_and(|column| column.role != Role::Amplitude);
        if is_shape { self.set.fitted.at[i] } else { 0.0 }
    }

    /// One pass over the training runs, which have this much more log p than at the fit.
    fn view(&self, followed: &[Followed], log: f64, quiet: bool) -> Outcome<Option<View>> {
        let mut normal = about(&self.hints(self.runs.training, followed)?, &[], &[]);
        let mut at = DVector::zeros(normal.vector.len());
        (0..self.own()).for_each(|i| at[i] = self.set.fitted.at[i] - self.counted_from(i));
        normal.vector += &normal.matrix * &at;
        let own: Vec<usize> = (0..self.own()).collect();
        let of_prior: f64 = own.iter().map(|i| at[*i].powi(2) / self.prior_variance(*i)).sum();
        let of_fit = normal.vector.dot(&at) - 0.5 * (at.dot(&(&normal.matrix * &at)) + of_prior);
        let without = Estimate::new(&normal, &own, |i| self.prior_variance(i));
        Ok(without.map(|without| View { normal, log: log - of_fit, without, at_fit: log, quiet }))
    }

    /// The normal equations of each of these recordings about the set.
    pub fn hints(&self, recordings: &[Recording], followed: &[Followed]) -> Outcome<Vec<Hints>> {
        let (reference, own, count) = (self.runs.reference, self.own(), self.carried.len());
        let refit = self.set.refit(reference);
        let model_at = |x: &[f64]| {
            let further = self.entries.iter().zip(x).skip(own).filter(|(_, units)| **units != 0.0);
            let moved = |point, (entry, units): (&Entry, &f64)| entry.moved(reference, &point, *units);
            reference.possible_model_at(&further.fold(refit.point(&x[..own]), moved))
        };
        let carriages: Vec<Carriage<'_>> =
            recordings.iter().filter(|_| count > 0).map(|_| Carriage::new(&self.carried)).collect();
        let laws: Vec<Laws<'_>> = carriages
            .iter()
            .map(|carriage| Laws::new(count, count, move |plant, pushes| carriage.push(plant, pushes)))
            .collect();
        let mut at = self.set.fitted.at.clone();
        at.resize(self.entries.len() - count, 0.0);
        let parameter = |(i, entry): (usize, &Entry)| {
            let stddev = self.set.stddevs.get(i).copied().unwrap_or(entry.column.catalogue_stddev);
            Parameter { stddev, range: entry.column.range }
        };
        let parameters: Vec<Parameter> = self.entries[..at.len()].iter().enumerate().map(parameter).collect();
        Ok(hints(recordings, &parameters, &model_at, &at, followed, &laws, &self.runs.prediction())?)
    }

    pub fn prior_variance(&self, i: usize) -> f64 {
        self.set.stddevs.get(i).map_or(1.0, |stddev| stddev * stddev)
    }

    pub fn entering_variance(&self, i: usize, size: f64) -> f64 {
        let entry = &self.entries[i];
        let stddev = size * entry.column.catalogue_stddev;
        let is_squared = entry.direction.as_ref().is_some_and(|direction| direction.squared);
        let entering = (if is_squared { stddev * stddev } else { stddev }).powi(2);
        if i < self.own() { self.prior_variance(i).max(entering) } else { entering }
    }

    /// More columns in a view, at the likeliest size; columns whose values no platform can have are left out. `None` where none remains.
    fn enter(&self, view: &View, columns: &[usize], left_out: &[usize]) -> Option<Entering> {
        let of_sizes = SIZES.iter().filter_map(|size| self.enter_at(view, columns.to_vec(), left_out, *size));
        of_sizes.max_by(|a, b| a.gain.total_cmp(&b.gain))
    }

    fn enter_at(&self, view: &View, columns: Vec<usize>, left_out: &[usize], size: f64) -> Option<Entering> {
        let own = self.own();
        let kept = (0..own).filter(|i| !left_out.contains(i));
        let all: Vec<usize> = kept.chain(columns.iter().copied().filter(|i| *i >= own)).collect();
        let variance = |i: usize| {
            if columns.contains(&i) { self.entering_variance(i, size) } else { self.prior_variance(i) }
        };
        let estimate = Estimate::new(&view.normal, &all, variance).filter(|_| !columns.is_empty())?;
        let is_impossible = |i: &usize| {
            let (low, high) = self.entries[*i].column.range;
            !(low..=high).contains(&estimate.of(*i))
        };
        let impossible: Vec<usize> = columns.iter().copied().filter(is_impossible).collect();
        if impossible.is_empty() {
            let first = &self.views[0];
            let gain = self.gain(view, &estimate) - size_penalty_nats(size, self.settings());
            let drop = 2.0 * (view.log - first.log) + estimate.drop - first.without.drop;
            return Some(Entering { id: "", gain, size, columns, estimate, drop, ways: 1 });
        }
        // Without what is essential the others are another effect under this one's name.
        if impossible.iter().any(|i| self.entries[*i].column.essential) {
            return None;
        }
        self.enter_at(view, columns.into_iter().filter(|i| !impossible.contains(i)).collect(), left_out, size)
    }

    /// Log evidence of an estimate in a view over that of the set.
    fn gain(&self, view: &View, estimate: &Estimate) -> f64 {
        let first = &self.views[0];
        view.log + estimate.log_evidence - first.log - first.without.log_evidence
    }

    fn best_way(&self, view: &View, id: &'static str, left_out: &[usize]) -> Option<Entering> {
        let options = self.options(id);
        let ways = options.len();
        // A start with one of its directions left out is another start: all of them are essential.
        let tried = options.iter().filter_map(|option| self.enter(view, option, left_out));
        let best = tried.max_by(|a, b| a.gain.total_cmp(&b.gain))?;
        Some(Entering { id, gain: best.gain - (ways as f64).ln(), ways, ..best })
    }

    /// An effect as the samples would have it enter, with the random torque that they show.
    pub fn entering(&self, id: &'static str) -> Option<Entering> {
        self.best_way(&self.views[0], id, &[])
    }

    pub fn effects(&self) -> impl Iterator<Item = &'static str> + '_ {
        self.offered.iter().map(|(id, _)| *id)
    }

    /// Of these those that are no corrections of the platform's own parameters.
    pub fn tested(&self) -> impl Iterator<Item = &'static str> + '_ {
        self.effects().filter(|id| find(id).is_none_or(|effect| !effect.is_base()))
    }

    /// The set with these effects more, each as it enters best in some view.
    pub fn with(&self, ids: &[&'static str]) -> Option<Hypothesis> {
        let enter = |id: &&'static str| self.views.iter().find_map(|view| self.best_way(view, id, &[]));
        let each: Vec<Entering> = ids.iter().map(enter).collect::<Option<_>>()?;
        let columns: Vec<usize> = each.iter().flat_map(|e| e.columns.iter().copied()).collect();
        let joint =
            self.enter(&self.views[0], &columns, &[]).filter(|joint| joint.columns.len() == columns.len());
        let estimate = &joint.as_ref().or(each.first())?.estimate;
        Some(self.hypothesis(&each.iter().map(|e| (e, e.size)).collect::<Vec<_>>(), estimate))
    }

    /// Sets with one or two effects more, or another one, that might be more probable; foremost of a view first. `known`: sets that were fitted.
    pub fn proposals(&self, with_pairs: bool, known: &[Evaluated]) -> Vec<Proposal> {
        let window_nats = self.settings().window_nats;
        let of_view = |view: &View| {
            let all = self.proposals_of(view, with_pairs);
            let least = all.first().map_or(0.0, |best| best.gain - window_nats);
            let foremost = all.iter().take_while(|proposal| proposal.gain >= least);
            // What a pair is worth shows beside the better half of it.
            let with_half = foremost.flat_map(|of| {
                let effects = &of.hypothesis.effects;
                let is_half = |half: &&Proposal| {
                    let own = &half.hypothesis.effects;
                    own.len() + 1 == effects.len() && own.iter().all(|id| effects.contains(id))
                };
                all.iter().find(is_half).into_iter().chain([of]).cloned()
            });
            with_half.collect::<Vec<_>>().into_iter()
        };
        let exchanges: Vec<Proposal> =
            self.views.iter().flat_map(|view| self.exchanges_of(view, known)).collect();
        let mut of_views: Vec<_> =
            std::iter::once(exchanges.into_iter()).chain(self.views.iter().map(of_view)).collect();
        let mut all: Vec<Proposal> = Vec::new();
        for _ in 0..MOST_PROPOSED {
            for proposal in of_views.iter_mut().filter_map(Iterator::next) {
                let is_same = |known: &Proposal| {
                    let (known, new) = (&known.hypothesis, &proposal.hypothesis);
                    (&known.effects, known.quiet) == (&new.effects, new.quiet)
                };
                if !all.iter().any(is_same) {
                    all.push(proposal);
                }
            }
        }
        all
    }

    /// Sets in which another effect takes the place of one that may only have stood in for it: where they gain by that, or lose no more than what a view
    /// says of leaving that one out is wrong by, with the set without it `known`, and little of it. What is late by a pulse is beyond any quadratic.
    fn exchanges_of(&self, view: &View, known: &[Evaluated]) -> Vec<Proposal> {
        let (settings, set) = (self.settings(), &self.set);
        let worth = |of: &Evaluated| of.log_evidence + log_prior(of.names(), settings);
        let exchanged = |out: &&'static str| {
            let columns = set.columns_of(out);
            let kept: Vec<usize> = (0..self.own()).filter(|i| !columns.contains(i)).collect();
            let choice_nats = set.hypothesis.entered.get(out).map_or(0.0, |entered| entered.choice_nats);
            let back = choice_nats - log_prior(&[out], settings);
            let others: Vec<&str> = set.names().iter().copied().filter(|id| id != out).collect();
            let without = Estimate::new(&view.normal, &kept, |i| self.prior_variance(i));
            let lost = without.map_or(0.0, |without| -self.gain(view, &without) - back);
            // Fits are beside random torques, and so is what they came to.
            let smaller = known.iter().find(|known| known.names() == others && !view.quiet);
            let wrong = smaller.map_or(0.0, |known| worth(known) - worth(set) + lost);
            let gain = |e: &Entering| e.gain + log_prior(&[e.id], settings) + back;
            let doubt_nats = |id| if self.runs.reference.is_hidden(id) { 0.0 } else { f64::max(wrong, 0.0) };
            let entering = self.effects().filter_map(|id| self.best_way(view, id, &columns));
            let best = entering.filter(|e| gain(e) > -doubt_nats(e.id).min(LEFT_OPEN * lost));
            let best = best.max_by(|a, b| gain(a).total_cmp(&gain(b)))?;
            let mut hypothesis = self.hypothesis(&[(&best, best.size)], &best.estimate);
            hypothesis.leave_out(out);
            hypothesis.quiet = view.quiet;
            hypothesis.doubt_nats = doubt_nats(best.id);
            Some(Proposal { hypothesis, gain: gain(&best) })
        };
        set.names().iter().filter_map(exchanged).collect()
    }

    fn proposals_of(&self, view: &View, with_pairs: bool) -> Vec<Proposal> {
        let settings = self.settings();
        let mut singles: Vec<Entering> =
            self.effects().filter_map(|id| self.best_way(view, id, &[])).collect();
        singles.sort_by(|a, b| b.gain.total_cmp(&a.gain));
        let alone = |e: &Entering| e.gain + log_prior(&[e.id], settings);
        // As far from the fit as a view may go, a quadratic is not quite log p; states of their own take ten times as long to follow as to doubt.
        let doubt = |e: &Entering, ids: &[&str]| {
            let is_hidden = ids.iter().any(|id| self.runs.reference.is_hidden(id));
            let share = if is_hidden { 0.0 } else { settings.misspecification };
            share * (0.5 * e.drop - view.at_fit).max(0.0)
        };
        let proposal = |parts: &[(&Entering, f64)], estimate: &Estimate, gain: f64| {
            let hypothesis = Hypothesis { quiet: view.quiet, ..self.hypothesis(parts, estimate) };
            Proposal { hypothesis, gain }
        };
        // What explains less than most of what random torques explain leaves them there, and shows beside them.
        let of_torques = -LEFT_OPEN * self.gain(view, &view.without);
        let least = |e: &Entering| {
            let is_hidden = self.runs.reference.is_hidden(e.id);
            if view.quiet && !is_hidden { of_torques.max(0.0) } else { doubt(e, &[e.id]) }
        };
        let one = |e: &Entering| proposal(&[(e, e.size)], &e.estimate, alone(e));
        let mut all: Vec<Proposal> = singles.iter().filter(|e| alone(e) > -least(e)).map(one).collect();
        singles.truncate(if with_pairs { MOST_PAIRED } else { 0 });
        for (n, first) in singles.iter().enumerate() {
            for second in &singles[n + 1..] {
                let mut columns = first.columns.clone();
                columns.extend(second.columns.iter().filter(|i| !first.columns.contains(i)));
                let Some(joint) = self.enter(view, &columns, &[]) else { continue };
                let ways = ((first.ways * second.ways) as f64).ln();
                let gain = joint.gain - ways + log_prior(&[first.id, second.id], settings);
                let is_more =
                    gain > alone(first).max(alone(second)).max(-doubt(&joint, &[first.id, second.id]));
                if joint.columns.len() == columns.len() && is_more {
                    let parts = [(first, joint.size), (second, joint.size)];
                    all.push(proposal(&parts, &joint.estimate, gain));
                }
            }
        }
        all.sort_by(|a, b| b.gain.total_cmp(&a.gain));
        all
    }

    /// The set with these effects more, each with its size, where an estimate has them.
    fn hypothesis(&self, parts: &[(&Entering, f64)], estimate: &Estimate) -> Hypothesis {
        let reference = self.runs.reference;
        let mut hypothesis = Hypothesis { doubt_nats: 0.0, quiet: false, ..self.set.hypothesis.clone() };
        // The platform's own parameters move along.
        let own: Vec<f64> = (0..self.own()).map(|i| self.counted_from(i) + estimate.of(i)).collect();
        let mut point = self.set.refit(reference).point(&own);
        for (entering, size) in parts.iter().copied() {
            let Some(effect) = find(entering.id) else { continue };
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
                point.insert(entering.id, values);
            }
            indices.sort_unstable();
            indices.dedup();
            let choice_nats = (entering.ways as f64).ln() + size_penalty_nats(size, self.settings());
            hypothesis.entered.insert(entering.id, Entered { indices, size, choice_nats });
            hypothesis.effects.push(entering.id);
        }
        hypothesis.effects.sort_unstable();
        hypothesis.point = point;
        hypothesis
    }

    /// What the training runs say of values, without priors.
    pub fn normal(&self) -> &Normal {
        &self.views[0].normal
    }

    /// Share of the signal of such a step along some columns that refitting the set's others absorbs.
    pub fn absorbed(&self, columns: &[usize], step: impl Fn(usize) -> f64) -> f64 {
        let others: Vec<usize> = (0..self.own()).filter(|i| !columns.contains(i)).collect();
        self.normal().followed(columns, step, &others, |i| self.prior_variance(i))
    }

    /// Drop of the misfit that an effect of the catalogue's usual size brings by some data, the largest of its columns; 0 where none shows.
    pub fn detectability(&self, normal: &Normal, id: &str) -> f64 {
        let columns: BTreeSet<usize> = self.options(id).into_iter().flatten().collect();
        let of_column = |column: usize| {
            let mut active: Vec<usize> = (0..self.own()).filter(|i| *i != column).collect();
            active.push(column);
            let variance = |i: usize| if i == column { ANY_SIZE } else { self.prior_variance(i) };
            let fit = Estimate::new(normal, &active, variance)?;
            let variance = fit.covariance()[(active.len() - 1, active.len() - 1)];
            (variance > 0.0).then(|| self.entries[column].column.catalogue_stddev.powi(2) / variance)
        };
        columns.into_iter().filter_map(of_column).fold(0.0, f64::max)
    }

    pub fn values(&self, entering: &Entering) -> Vec<ParameterEstimate> {
        let (estimate, covariance) = (&entering.estimate, entering.estimate.covariance());
        let of = |i: &usize| {
            let place = estimate.active.iter().position(|active| active == i)?;
            let stddev = covariance[(place, place)].max(0.0).sqrt();
            Some(self.entries[*i].estimate(estimate.of(*i), stddev))
        };
        entering.columns.iter().filter_map(of).collect()
    }

    /// The ways in which an effect may enter, by columns; of one of the set the columns that it has.
    pub fn options(&self, id: &str) -> Vec<Vec<usize>> {
        if self.set.names().contains(&id) {
            return vec![self.set.columns_of(id)];
        }
        let known = self.offered.iter().find(|(own, _)| *own == id);
        known.map_or_else(Vec::new, |(_, options)| options.clone())
    }
}
