//! What the samples say of every effect beside a set that was fitted to them: normal equations of one pass, from which thousands of sets
//! are ranked.
//!
//! A random torque that is loud hides what follows the motion slowly, and without one a model that lacks something else looks far more wrong
//! than it is. So there are two views where a run needs such a torque: with it, and without.

use std::collections::BTreeMap;

use whorl_dynamics::Gyrostat;
use whorl_dynamics::effects::{Clues, Contribution, Regressed, Role, catalogue, find};
use whorl_dynamics::{Effect, PlatformModel};
use whorl_prediction::{Followed, Hints, Laws, Parameter, hints};
use whorl_recording::Recording;

use crate::DiagnosisError;
use crate::fitting::normal_equations::{Estimate, Normal};
use crate::fitting::refit::Entered;
use crate::parameter_space::Reference;
use crate::parameter_space::ways::{Entry, Ways};
use crate::selection::hidden::{Carriage, Carried};
use crate::selection::hypothesis::{Evaluated, Hypothesis, Runs};
use crate::selection::prior::{SIZES, log_prior, size_penalty_nats};

/// Effects that are tried in pairs, those that gain most alone.
const MOST_PAIRED: usize = 30;
/// Sets that are proposed in each view at most.
const MOST_PROPOSED: usize = 12;

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
    /// Each training run.
    by_run: Vec<Hints>,
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
    /// What may enter, behind the columns of the set: first so many parameters of the model, then effects that are carried along.
    entries: Vec<Entry>,
    parameters: usize,
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
        is_asked: impl Fn(&dyn Effect) -> bool,
        known: Option<&[View]>,
    ) -> Result<Option<Self>, DiagnosisError> {
        let reference = runs.reference;
        let refit = set.refit(reference);
        let own = set.columns.len();
        let step = reference.settings.prediction.fit_difference;
        let at_set = refit.point(&set.fitted.at);
        let with =
            |entry: &Entry, units: f64| possible_model(reference, &entry.moved(reference, &at_set, units));
        let (mut entries, mut hidden) = (Vec::new(), Vec::new());
        let mut offered = Vec::new();
        for effect in catalogue().iter().copied().filter(|effect| is_asked(*effect)) {
            let id = effect.info().id;
            let is_in_model = reference.model.effects.contains_key(id) && !effect.is_base();
            if set.names().contains(&id) || is_in_model || !runs.available.can_test(effect) {
                continue;
            }
            let is_possible = |entry: &Entry| {
                let (low, high) = entry.range(reference);
                [step, -step]
                    .into_iter()
                    .any(|step| (low..=high).contains(&step) && with(entry, step).is_some())
            };
            let ways = Ways::of(reference, effect, clues, is_possible);
            let list = if effect.hidden_states(&reference.model) > 0 { &mut hidden } else { &mut entries };
            let is_hidden = effect.hidden_states(&reference.model) > 0;
            let mut places = Vec::new();
            for entry in ways.entries {
                let known = match &entry {
                    Entry::Parameter(column) => set.columns.iter().position(|own| own.is(column)),
                    Entry::Direction(..) => None,
                };
                // Hidden ones come behind all others, whose number is not known yet.
                places.push(known.map_or_else(
                    || {
                        list.push(entry);
                        Place::New(is_hidden, list.len() - 1)
                    },
                    Place::Own,
                ));
            }
            offered.push((effect, places, ways.options));
        }
        let first_hidden = own + entries.len();
        let place = |place: &Place| match *place {
            Place::Own(k) => k,
            Place::New(false, k) => own + k,
            Place::New(true, k) => first_hidden + k,
        };
        let offered: Vec<Offered> = offered
            .into_iter()
            .map(|(effect, places, options)| Offered {
                effect,
                options: options
                    .into_iter()
                    .map(|option| option.iter().filter_map(|i| places.get(*i).map(place)).collect())
                    .collect(),
            })
            .collect();
        let carried: Vec<Carried> = hidden.iter().filter_map(|entry| carried(reference, entry)).collect();
        let parameters = entries.len();
        entries.extend(hidden);
        let mut beside = Self { reference, set, entries, parameters, carried, offered, views: Vec::new() };
        if let Some(known) = known {
            beside.views = known.to_vec();
            return Ok(Some(beside));
        }
        let runs_as_fitted = set.fitted.followed.clone();
        let quiet: Vec<Followed> = runs_as_fitted.iter().map(Followed::without_disturbance).collect();
        let lost: f64 = runs_as_fitted
            .iter()
            .zip(&quiet)
            .map(|(loud, quiet)| quiet.log_likelihood() - loud.log_likelihood())
            .sum();
        let mut views = vec![(runs_as_fitted, 0.0)];
        if lost.is_finite() && lost < 0.0 {
            views.push((quiet, lost));
        }
        for (followed, log) in views {
            let view = beside.view(runs, &followed, log);
            match DiagnosisError::possible(view)?.flatten() {
                Some(view) => beside.views.push(view),
                None if beside.views.is_empty() => return Ok(None),
                None => {}
            }
        }
        Ok(Some(beside))
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
        let parameters = self.of_model();
        let normal = Normal::about(&by_run, &self.set.fitted.at, &parameters[..self.own()]);
        let own: Vec<usize> = (0..self.own()).collect();
        let Some(without) = Estimate::new(&normal, &own, |i| self.known(i)) else { return Ok(None) };
        Ok(Some(View { normal, by_run, without, log }))
    }

    /// The normal equations of each of these recordings about the set.
    pub fn hints(
        &self,
        runs: &Runs<'_>,
        recordings: &[Recording],
        followed: &[Followed],
    ) -> Result<Vec<Hints>, DiagnosisError> {
        let carried = &self.carried;
        let (reference, own) = (self.reference, self.own());
        let refit = self.set.refit(reference);
        let model_at = |x: &[f64]| {
            let mut point = refit.point(&x[..own]);
            for (entry, units) in self.entries.iter().zip(&x[own..]).filter(|(_, units)| **units != 0.0) {
                point = entry.moved(reference, &point, *units);
            }
            possible_model(reference, &point)
        };
        let carriages: Vec<Carriage<'_>> = recordings.iter().map(|_| Carriage::new(carried)).collect();
        let laws: Vec<Laws<'_>> = carriages
            .iter()
            .map(|carriage| {
                Laws::new(carried.len(), carried.len(), |plant, pushes| carriage.push(plant, pushes))
            })
            .collect();
        let laws: &[Laws<'_>] = if carried.is_empty() { &[] } else { &laws };
        let settings = runs.prediction();
        let mut at = self.set.fitted.at.clone();
        at.resize(own + self.parameters, 0.0);
        Ok(hints(recordings, &self.of_model(), &model_at, &at, followed, laws, &settings)?)
    }

    /// Columns of the set, and behind them the entries that are parameters of the model.
    fn of_model(&self) -> Vec<Parameter> {
        let own = self.set.columns.iter().zip(&self.set.stddevs);
        let own = own.map(|(column, stddev)| Parameter { stddev: *stddev, range: column.range });
        let of_entry = |entry: &Entry| Parameter {
            stddev: entry.catalogue_stddev(),
            range: entry.range(self.reference),
        };
        own.chain(self.entries.iter().take(self.parameters).map(of_entry)).collect()
    }

    /// Prior variance of a column of the set.
    pub fn known(&self, i: usize) -> f64 {
        self.set.stddevs.get(i).map_or(1.0, |stddev| stddev * stddev)
    }

    fn entry(&self, i: usize) -> Option<&Entry> {
        self.entries.get(i.checked_sub(self.own())?)
    }

    fn at_of(&self, i: usize) -> f64 {
        self.set.fitted.at.get(i).copied().unwrap_or(0.0)
    }

    fn range_of(&self, i: usize) -> (f64, f64) {
        match self.entry(i) {
            Some(entry) => entry.range(self.reference),
            None => self.set.columns.get(i).map_or((f64::NEG_INFINITY, f64::INFINITY), |column| column.range),
        }
    }

    fn catalogue_stddev(&self, i: usize) -> f64 {
        match self.entry(i) {
            Some(entry) => entry.catalogue_stddev(),
            None => self.set.columns.get(i).map_or(1.0, |column| column.catalogue_stddev),
        }
    }

    /// Prior variance of a column with which an effect of this size enters.
    pub fn entering_variance(&self, i: usize, size: f64) -> f64 {
        let is_squared = matches!(self.entry(i), Some(Entry::Direction(_, direction)) if direction.squared);
        let stddev = size * self.catalogue_stddev(i);
        let own = (if is_squared { stddev * stddev } else { stddev }).powi(2);
        if i < self.own() { self.known(i).max(own) } else { own }
    }

    fn is_essential(&self, i: usize) -> bool {
        match self.entry(i) {
            Some(Entry::Parameter(column)) => column.essential,
            Some(Entry::Direction(..)) => true,
            None => self.set.columns.get(i).is_some_and(|column| column.essential),
        }
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
                    let (low, high) = self.range_of(*i);
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
                if entered.iter().any(|i| !is_possible(i) && self.is_essential(*i)) {
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

    /// An effect as the samples would have it enter, with the random torque that they show.
    pub fn entering(&self, id: &str) -> Option<Entering> {
        let offered = self.offered.iter().find(|offered| offered.effect.info().id == id)?;
        self.best_way(self.views.first()?, offered)
    }

    /// Effects beside the set.
    pub fn effects(&self) -> impl Iterator<Item = &'static str> + '_ {
        self.offered.iter().map(|offered| offered.effect.info().id)
    }

    /// The set with these effects more, each as it enters best in some view.
    pub fn with(&self, ids: &[&'static str]) -> Option<Hypothesis> {
        let view = self.views.first()?;
        let each: Option<Vec<(&'static str, Entering)>> = ids
            .iter()
            .map(|id| {
                let offered = self.offered.iter().find(|offered| offered.effect.info().id == *id)?;
                Some((
                    *id,
                    self.best_way(view, offered).or_else(|| self.best_way(self.views.last()?, offered))?,
                ))
            })
            .collect();
        let each = each?;
        let columns: Vec<usize> = each.iter().flat_map(|(_, e)| e.columns.iter().copied()).collect();
        let joint = self.enter(view, &columns).filter(|joint| joint.columns.len() == columns.len());
        let parts: Vec<(&'static str, &Entering)> = each.iter().map(|(id, e)| (*id, e)).collect();
        let estimate = joint.as_ref().map_or(&each.first()?.1.estimate, |joint| &joint.estimate);
        Some(self.hypothesis(&parts, estimate))
    }

    /// Sets with one or two effects more that might be more probable than the set, those first that are foremost in some view.
    pub fn proposals(&self, with_pairs: bool) -> Vec<Proposal> {
        let window = self.reference.settings.window_nats;
        let mut of_views: Vec<std::vec::IntoIter<Proposal>> = Vec::new();
        for view in &self.views {
            let all = self.proposals_of(view, with_pairs);
            let least = all.first().map_or(0.0, |best| best.gain - window);
            let mut own: Vec<Proposal> = Vec::new();
            for proposal in all.iter().take_while(|proposal| proposal.gain >= least) {
                // What a pair is worth shows beside the better half of it.
                own.extend(better_half(&all, proposal).cloned());
                own.push(proposal.clone());
            }
            of_views.push(own.into_iter());
        }
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
                hypothesis: self.hypothesis(&[(*id, entering)], &entering.estimate),
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
                    let with = |e: &Entering| Entering { size: joint.size, ..e.clone() };
                    let (first, second) = (with(first), with(second));
                    let hypothesis = self.hypothesis(&[(*a, &first), (*b, &second)], &joint.estimate);
                    all.push(Proposal { hypothesis, gain });
                }
            }
        }
        all.retain(|proposal| proposal.gain > 0.0);
        all.sort_by(|a, b| b.gain.total_cmp(&a.gain));
        all
    }

    /// The set with these effects more, where an estimate has them.
    fn hypothesis(&self, parts: &[(&'static str, &Entering)], estimate: &Estimate) -> Hypothesis {
        let reference = self.reference;
        let mut hypothesis = self.set.hypothesis.clone();
        // The platform's own parameters move along.
        let mut point = self.set.refit(reference).point(&self.set.fitted.at);
        for (i, column) in self.set.columns.iter().enumerate() {
            let step = estimate.of(i);
            if step != 0.0 {
                point = reference.moved(&point, column, step);
            }
        }
        for (id, entering) in parts {
            let Some(effect) = find(id) else { continue };
            let entries: Vec<(usize, &Entry)> =
                entering.columns.iter().filter_map(|i| Some((*i, self.entry(*i)?))).collect();
            let mut indices: Vec<usize> = entering
                .columns
                .iter()
                .filter_map(|i| match self.entry(*i) {
                    Some(Entry::Parameter(column)) => Some(column.index),
                    Some(Entry::Direction(..)) => None,
                    None => self.set.columns.get(*i).map(|column| column.index),
                })
                .collect();
            for (i, entry) in entries.iter().filter(|(_, e)| matches!(e, Entry::Parameter(_))) {
                point = entry.moved(reference, &point, estimate.of(*i));
            }
            let directions: Vec<(&Entry, f64)> = entries
                .iter()
                .filter(|(_, e)| matches!(e, Entry::Direction(..)))
                .map(|(i, entry)| (*entry, estimate.of(*i)))
                .collect();
            if !directions.is_empty() {
                let values = joined(reference, effect, &directions);
                indices.extend(fitted_indices(reference, effect, &directions, &values));
                point.effects.insert(id, values);
            }
            indices.sort_unstable();
            indices.dedup();
            hypothesis.entered.insert(id, Entered { indices, size: entering.size });
            hypothesis.choices_nats +=
                (entering.ways as f64).ln() + size_penalty_nats(entering.size, &reference.settings);
            hypothesis.effects.push(id);
        }
        hypothesis.effects.sort_unstable();
        hypothesis.point = point;
        hypothesis
    }

    /// Share of the signal of some columns that refitting the set's own parameters absorbs.
    pub fn absorbed(&self, entering: &Entering) -> f64 {
        let Some(view) = self.views.first() else { return 0.0 };
        let (normal, estimate) = (&view.normal, &entering.estimate);
        let of_columns: nalgebra::DVector<f64> =
            entering.columns.iter().map(|j| normal.matrix.column(*j) * estimate.of(*j)).sum();
        let alone: f64 = entering.columns.iter().map(|i| estimate.of(*i) * of_columns[*i]).sum();
        let base: Vec<usize> = (0..self.own()).filter(|i| !entering.columns.contains(i)).collect();
        let signal = Normal { vector: of_columns, matrix: normal.matrix.clone() };
        let followed = Estimate::new(&signal, &base, |i| self.known(i)).map_or(0.0, |followed| followed.drop);
        if alone > 0.0 { (followed / alone).clamp(0.0, 1.0) } else { 0.0 }
    }

    /// Drop of the misfit that an effect of the catalogue's usual size brings, the largest of its columns; 0 where none shows.
    pub fn detectability(&self, id: &str) -> f64 {
        self.views.first().map_or(0.0, |view| self.detectability_in(&view.normal, id))
    }

    /// The same by other data.
    pub fn detectability_in(&self, normal: &Normal, id: &str) -> f64 {
        let columns: std::collections::BTreeSet<usize> = self.options(id).into_iter().flatten().collect();
        columns.iter().map(|i| self.detectability_of(normal, *i)).fold(0.0, f64::max)
    }

    /// The given model.
    pub fn reference(&self) -> &Reference {
        self.reference
    }

    fn detectability_of(&self, normal: &Normal, column: usize) -> f64 {
        let mut active: Vec<usize> = (0..self.own()).filter(|i| *i != column).collect();
        active.push(column);
        let variance = |i: usize| if i == column { ANY_SIZE } else { self.known(i) };
        let Some(fit) = Estimate::new(normal, &active, variance) else { return 0.0 };
        let variance = fit.covariance()[(active.len() - 1, active.len() - 1)];
        if variance > 0.0 { self.catalogue_stddev(column).powi(2) / variance } else { 0.0 }
    }

    /// Values of the columns with which an effect enters, each with its name, unit, value, deviation and whether it is at a bound.
    pub fn values(&self, entering: &Entering) -> Vec<(String, &'static str, f64, f64, bool)> {
        let covariance = entering.estimate.covariance();
        let of = |i: &usize| {
            let place = entering.estimate.active.iter().position(|active| active == i)?;
            let stddev = covariance[(place, place)].max(0.0).sqrt();
            let units = self.at_of(*i) + entering.estimate.of(*i);
            let column = match self.entry(*i) {
                Some(Entry::Parameter(column)) => column,
                None => self.set.columns.get(*i)?,
                Some(Entry::Direction(effect, direction)) => {
                    let (index, by) = *direction.moves.first()?;
                    let spec = effect.parameters(&self.reference.model).into_iter().nth(index)?;
                    let from = direction.origin.get(index).copied().unwrap_or(0.0);
                    let along = if direction.squared { units.max(0.0).sqrt() } else { units };
                    let spread =
                        if direction.squared { 0.5 * stddev / along.max(stddev.sqrt()) } else { stddev };
                    return Some((spec.name, spec.unit, from + along * by, spread * by.abs(), false));
                }
            };
            let value = self.reference.given(column) + units * column.scale;
            Some((column.name.clone(), column.unit, value, stddev * column.scale, column.is_at_bound(units)))
        };
        entering.columns.iter().filter_map(of).collect()
    }

    /// The ways in which an effect may enter, by columns; of one of the set the columns that it has.
    pub fn options(&self, id: &str) -> Vec<Vec<usize>> {
        let own: Vec<usize> = (0..self.own()).filter(|i| self.set.columns[*i].group == id).collect();
        if self.set.names().contains(&id) {
            return vec![own];
        }
        let offered = self.offered.iter().find(|offered| offered.effect.info().id == id);
        offered.map_or_else(Vec::new, |offered| offered.options.clone())
    }

    /// What each training run says of the set's own columns, the slope of their priors not included.
    pub fn by_run(&self) -> &[Hints] {
        self.views.first().map_or(&[], |view| &view.by_run)
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

/// Prior variance of a column of which nothing is known, in its unit.
const ANY_SIZE: f64 = 1e6;

/// Where a number with which an effect may enter stands: among the columns of the set, or behind them, hidden ones last.
enum Place {
    Own(usize),
    New(bool, usize),
}

/// The platform at a point, if there can be one.
fn possible_model(reference: &Reference, point: &crate::parameter_space::Point) -> Option<PlatformModel> {
    let model = reference.model_at(point).ok()?;
    Gyrostat::new(&model).is_ok().then_some(model)
}

/// An effect with hidden states, one unit along an entry.
fn carried(reference: &Reference, entry: &Entry) -> Option<Carried> {
    let (effect, values) = match entry {
        Entry::Direction(effect, _) => (*effect, entry.values(1.0)?),
        Entry::Parameter(column) => {
            let effect = find(column.group)?;
            let mut values = reference.values(effect);
            *values.get_mut(column.index)? += column.scale;
            (effect, values)
        }
    };
    Some(Carried { effect, values })
}

/// Values of an effect to which several directions lead together.
fn joined(reference: &Reference, effect: &dyn Effect, directions: &[(&Entry, f64)]) -> Vec<f64> {
    let along = |entry: &Entry, units: f64| match entry {
        Entry::Direction(_, direction) if direction.squared => units.max(0.0).sqrt(),
        _ => units,
    };
    let contributions: Vec<Contribution<'_>> = directions
        .iter()
        .filter_map(|(entry, units)| match entry {
            Entry::Direction(_, direction) => Some(Contribution {
                name: &direction.name,
                origin: &direction.origin,
                amount: along(entry, *units) * direction.moves.first().map_or(0.0, |(_, by)| *by),
            }),
            Entry::Parameter(_) => None,
        })
        .collect();
    let sum = || {
        let mut values = contributions.first().map_or_else(Vec::new, |first| first.origin.to_vec());
        for (entry, units) in directions {
            if let Entry::Direction(_, direction) = entry {
                for (index, by) in &direction.moves {
                    if let Some(value) = values.get_mut(*index) {
                        *value += along(entry, *units) * by;
                    }
                }
            }
        }
        values
    };
    let values = effect.joined(&contributions).unwrap_or_else(sum);
    let specs = effect.parameters(&reference.model);
    values.iter().zip(&specs).map(|(value, spec)| spec.limited(*value)).collect()
}

/// Parameters of an effect that are fitted from the place to which directions lead.
fn fitted_indices(
    reference: &Reference,
    effect: &dyn Effect,
    directions: &[(&Entry, f64)],
    values: &[f64],
) -> Vec<usize> {
    let moved: BTreeMap<usize, ()> = directions
        .iter()
        .flat_map(|(entry, _)| match entry {
            Entry::Direction(_, direction) => direction.moves.as_slice(),
            Entry::Parameter(_) => &[],
        })
        .map(|(index, _)| (*index, ()))
        .collect();
    let specs = effect.parameters(&reference.model);
    let is_fitted = |(i, spec): &(usize, &whorl_dynamics::effects::ParameterSpec)| {
        let is_zero = values.get(*i).is_none_or(|value| *value == 0.0);
        let may_move = match spec.regressed {
            Regressed::Never => false,
            Regressed::UnlessZero => !is_zero,
            Regressed::Always | Regressed::WithAmplitude => true,
        };
        !spec.known && (moved.contains_key(i) || (spec.role != Role::Amplitude && may_move))
    };
    specs.iter().enumerate().filter(is_fitted).map(|(i, _)| i).collect()
}
