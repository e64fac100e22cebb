//! Which set of effects explains the data: forward search with swaps, each step on a new linearisation.

use whorl_dynamics::effects::Rhythm;

use crate::candidates::{Available, Layout, Lines};
use crate::converge::{Converged, Standings};
use crate::hypothesis::{Hypothesis, Member, cross_validated_gain};
use crate::latency::Lateness;
use crate::parameters::Point;
use crate::problem::{Dataset, Problem};
use crate::regression::{BLOCKS_PER_RUN, Colour};
use crate::step::{NO_FIT, base_point_with, dataset, point_of, smooth_all};
use crate::{DiagnosisError, Options, Progress};

/// Log evidence that an effect must add. The number of effects that compete is paid for here too.
pub(crate) const LEAST_EVIDENCE: f64 = 6.0;

/// Drop of the whitened misfit that an effect must bring: below, a name would often be wrong.
pub(crate) const LEAST_DROP: f64 = 30.0;

/// Held-out data veto an effect by a loss of log likelihood of this share of its log evidence.
const AGAINST: f64 = 0.1;

/// Log evidence and held-out gain that an effect must bring together: odds of 20,000 to 1, so that the some forty that
/// compete and the noise that is not quite as measured leave it beyond doubt.
pub(crate) const LEAST_TOGETHER: f64 = 10.0;

/// A gain on held-out data that is this many standard deviations short of what was promised refutes a member: noise
/// does that in fewer than one case of a hundred.
const REFUTED: f64 = 2.5;

/// Share of its promise by which the gain of a real effect may differ as its formula, of an amplitude that is right to
/// an eighth, is not quite that of the catalogue.
const FORMULA_OF_MEMBER: f64 = 0.25;

/// A rest of this many standard deviations is worth the columns of hidden states.
const SOMETHING_LEFT: f64 = 3.0;

/// So is log evidence of this size for any effect.
const FAINT: f64 = 3.0;

/// Effects that promise less log evidence than this are not fitted at a point of their own.
const LEAST_PROMISE: f64 = 4.0;

/// Rivals that promise this share of what the first does are fitted as well (those for which it is known to be
/// taken in any case): first regressions of effects that do not act in proportion to their parameters may miss
/// half of what they explain.
const RIVAL_SHARE: f64 = 0.4;

/// Effects that explain this share of what a member does, in the regression at its point, are fitted in its place.
const NEAR_SHARE: f64 = 0.7;

/// Rivals that are fitted in each round, at most.
const MOST_RIVALS: usize = 4;

/// The search's state: where the model is, and the regression there.
pub(crate) struct Search<'a> {
    pub problem: &'a mut Problem,
    pub held_out: Option<&'a mut Problem>,
    pub available: Available,
    pub options: &'a Options,
    pub lines: Lines,
    /// Hidden states compete as well: their many columns are made only when something is missing.
    pub with_hidden: bool,
    /// Colours of the noise, kept from the first full regression.
    pub colours: Option<Vec<Vec<Colour>>>,
    pub held_colours: Option<Vec<Vec<Colour>>>,
    pub point: Point,
    pub layout: Layout,
    pub data: Dataset,
    pub held_data: Option<Dataset>,
    pub base: Hypothesis,
    pub best: Hypothesis,
    /// How sets explain the data where each fits best.
    pub standings: Standings,
    /// The best set with an inertial latency.
    pub late: Option<Lateness>,
    /// Misfit that the best set may leave beyond noise; not limited until it is known.
    pub rest: f64,
}

/// A set that has taken the place of the best one.
enum Swapped {
    /// It was fitted where it fits best just now.
    Fitted(Box<Converged>),
    /// It was fitted from another point.
    Known,
}

impl<'a> Search<'a> {
    /// Fits the base model and makes the first full regression.
    pub fn start(
        problem: &'a mut Problem,
        mut held_out: Option<&'a mut Problem>,
        options: &'a Options,
        progress: &mut dyn FnMut(Progress),
    ) -> Result<Self, DiagnosisError> {
        progress(Progress { share: 0.1, doing: "smoothing the motion" });
        let available = Available::of(&problem.runs);
        let point = base_point_with(problem, &mut held_out)?;
        progress(Progress { share: 0.45, doing: "passing every effect through the filter" });
        let lines = Lines::default();
        let layout = Layout::new(&problem.reference, &point, &available, &options.exclude, &lines, false);
        let data = dataset(problem, &point, &layout, None)?;
        let held_data = match &held_out {
            Some(held) => Some(dataset(held, &point, &layout, None)?),
            None => None,
        };
        let base = Hypothesis::base(&layout, &data.total).ok_or(NO_FIT)?;
        Ok(Self {
            problem,
            held_out,
            available,
            options,
            lines,
            with_hidden: false,
            colours: Some(data.colours.clone()),
            held_colours: held_data.as_ref().map(|h| h.colours.clone()),
            point,
            layout,
            data,
            held_data,
            best: base.clone(),
            base,
            standings: Standings::new(),
            late: None,
            rest: f64::INFINITY,
        })
    }

    /// The full regression at the present point, along the present motion.
    pub(crate) fn regress(&mut self) -> Result<(), DiagnosisError> {
        self.layout = Layout::new(
            &self.problem.reference,
            &self.point,
            &self.available,
            &self.options.exclude,
            &self.lines,
            self.with_hidden,
        );
        // The old columns make room for the new ones.
        self.data.whitened = Vec::new();
        self.held_data = None;
        self.data = dataset(self.problem, &self.point, &self.layout, self.colours.clone())?;
        self.held_data = match &self.held_out {
            Some(held) => Some(dataset(held, &self.point, &self.layout, self.held_colours.clone())?),
            None => None,
        };
        self.base = Hypothesis::base(&self.layout, &self.data.total).ok_or(NO_FIT)?;
        Ok(())
    }

    /// Log likelihood gained on held-out runs, or by cross-validation over blocks of time.
    pub fn gain(&self, with: &Hypothesis, without: &Hypothesis) -> f64 {
        let held = |set| self.standing(set).and_then(|s| s.held_misfit);
        if let (Some(a), Some(b)) = (held(with), held(without)) {
            return 0.5 * (b - a);
        }
        match &self.held_data {
            Some(held) => {
                0.5 * (without.estimate.misfit_change(&held.total) - with.estimate.misfit_change(&held.total))
            }
            None => {
                let per_fold = if self.problem.runs.len() >= 3 { BLOCKS_PER_RUN } else { 1 };
                cross_validated_gain(
                    &self.layout,
                    &self.data.blocks,
                    &self.data.total,
                    with,
                    without,
                    per_fold,
                )
            }
        }
    }

    /// Every effect added in turn to a hypothesis that does not hold it, best first.
    pub fn additions(&self, to: &Hypothesis) -> Vec<Hypothesis> {
        let free: Vec<usize> = (0..self.layout.candidates.len())
            .filter(|c| to.members.iter().all(|m| m.candidate != *c))
            .collect();
        let mut found: Vec<Hypothesis> =
            crate::threads::map(self.problem.threads, &free, |c| to.with(&self.layout, &self.data.total, *c))
                .into_iter()
                .flatten()
                .collect();
        found.sort_by(|a, b| b.log_evidence.total_cmp(&a.log_evidence));
        found
    }

    /// Grows the set while an effect passes every gate, swapping and removing members on the way. If it `watches`
    /// the gyro's bias, it ends with the walk of that bias as soon as a faint effect is found beside one.
    pub fn run(
        &mut self,
        watches: bool,
        progress: &mut dyn FnMut(Progress),
    ) -> Result<Option<f64>, DiagnosisError> {
        let mut additions = self.additions(&self.base);
        // A second effect that the data show beside the first one is not to be taken for a bias that wanders.
        let watches = watches && !self.shows_a_second(additions.first());
        if watches && self.expects_wandering(additions.first())? {
            additions = self.additions(&self.base);
        }
        let rest = crate::answer::rest(self.problem, &self.data, &self.layout, &self.base);
        self.lines = crate::spectrum::lines(self, &self.base);
        let faint = additions.first().is_some_and(|h| h.log_evidence - self.base.log_evidence > FAINT);
        if faint
            || !self.lines.modes.is_empty()
            || self.lines.strongest > 0.8 * crate::spectrum::CERTAIN
            || rest[crate::answer::worst(&rest)].significance() > SOMETHING_LEFT
            || self.has_faint_line()?
        {
            progress(Progress { share: 0.55, doing: "looking for lines and hidden states" });
            self.with_hidden = true;
            self.relinearise()?;
        }
        for round in 0..self.options.largest_set {
            progress(Progress { share: 0.6 + 0.1 * round as f64, doing: "comparing explanations" });
            let mut additions = self.additions(&self.best);
            if round == 0 {
                additions.splice(0..0, self.strong_pair(&additions));
            }
            let Some(next) = self.strongest(&additions)? else { break };
            if watches && round == 0 && self.problem.has_steady_bias() {
                let base = self.standing(&self.base).map_or(f64::NEG_INFINITY, |base| base.log_evidence);
                let is_faint = next.standing.log_evidence - base < crate::BEYOND_NOISE;
                if let Some(walk) = if is_faint { next.likeliest_gyro_bias_walk(self.problem)? } else { None }
                {
                    return Ok(Some(walk));
                }
            }
            self.settle(next)?;
            self.tidy()?;
            if self.best.members.is_empty() {
                break;
            }
        }
        Ok(None)
    }

    /// Of the best single effects two together, if they explain far more than any of them: a pair can beat the best single
    /// effect that neither of the two is.
    fn strong_pair(&self, additions: &[Hypothesis]) -> Option<Hypothesis> {
        let best_single = additions.first()?.log_evidence;
        if best_single <= self.base.log_evidence + 4.0 * LEAST_EVIDENCE {
            return None;
        }
        let singles: Vec<usize> =
            additions.iter().take(8).filter_map(|h| h.members.last().map(|m| m.candidate)).collect();
        let pairs: Vec<(usize, usize)> = singles
            .iter()
            .enumerate()
            .flat_map(|(i, a)| singles.iter().skip(i + 1).map(move |b| (*a, *b)))
            .collect();
        let total = &self.data.total;
        crate::threads::map(self.problem.threads, &pairs, |(a, b)| {
            self.base.with(&self.layout, total, *a)?.with(&self.layout, total, *b)
        })
        .into_iter()
        .flatten()
        .filter(|h| h.members.len() == 2 && h.log_evidence > best_single + 2.0 * LEAST_EVIDENCE)
        .max_by(|a, b| a.log_evidence.total_cmp(&b.log_evidence))
    }

    /// Whether another effect explains what the first one leaves.
    fn shows_a_second(&self, first: Option<&Hypothesis>) -> bool {
        first.is_some_and(|first| {
            let second = self.additions(first).into_iter().next();
            second.is_some_and(|both| {
                both.log_evidence - first.log_evidence > LEAST_TOGETHER * self.data.temper
            })
        })
    }

    /// Takes into account that the gyro's bias wanders, if it does beside the first explanation and that one will be
    /// faint: what was found without would have to be searched for again.
    fn expects_wandering(&mut self, first: Option<&Hypothesis>) -> Result<bool, DiagnosisError> {
        let Some(first) = first else { return Ok(false) };
        let gain = first.log_evidence - self.base.log_evidence;
        if !(LEAST_TOGETHER * self.data.temper..crate::BEYOND_NOISE).contains(&gain) {
            return Ok(false);
        }
        let beside = point_of(self.problem, &self.layout, &self.point, first);
        let Some(walk) = self.problem.likeliest_gyro_bias_walk(&beside)? else { return Ok(false) };
        crate::expect_walk(walk, self.problem, self.held_out.as_deref_mut());
        smooth_all(self.problem, &mut self.held_out, &self.point, None)?;
        (self.colours, self.held_colours) = (None, None);
        self.regress()?;
        self.colours = Some(self.data.colours.clone());
        self.held_colours = self.held_data.as_ref().map(|held| held.colours.clone());
        self.best = self.base.clone();
        Ok(true)
    }

    /// Whether a line that hardly stands out of the spectrum is worth a look as a torque of the room, after all
    /// frequencies at which it might have been are paid for. Each is weighed by a regression of the base model and
    /// both phases of that torque: a peak's height does not say that it has one phase in every run.
    fn has_faint_line(&mut self) -> Result<bool, DiagnosisError> {
        let hz = std::mem::take(&mut self.lines.faint_hz);
        let mut candidates = self.layout.candidates.iter();
        let periodic = candidates.find(|c| c.effect.rhythm() == Some(Rhythm::Torque)).map(|c| c.id);
        let Some(periodic) = periodic.filter(|_| !hz.is_empty()) else { return Ok(false) };
        let lines = Lines { torque_hz: hz.clone(), ..Lines::default() };
        let layout =
            Layout::of_effects(&self.problem.reference, &self.point, &self.available, &[periodic], &lines);
        let data = dataset(self.problem, &self.point, &layout, self.colours.clone())?;
        let base = Hypothesis::base(&layout, &data.total).ok_or(NO_FIT)?;
        let places = self.problem.runs.iter().map(|r| r.nodes()).max().unwrap_or(1) as f64;
        let mut worth: Vec<(f64, f64)> = Vec::new();
        for (columns, hz) in layout.candidates.iter().flat_map(|c| &c.options).zip(hz) {
            let member = Member { candidate: 0, columns: columns.clone(), size: 0.1, options: 1 };
            let Some(fit) = Hypothesis::of(&layout, &data.total, vec![member]) else { continue };
            let evidence = fit.resized(&layout, &data.total).log_evidence - base.log_evidence - places.ln();
            if evidence > 0.0 {
                worth.push((evidence, hz));
            }
        }
        worth.sort_by(|a, b| b.0.total_cmp(&a.0));
        if !worth.is_empty() {
            self.lines.torque_hz = worth.iter().map(|w| w.1).take(2).collect();
        }
        Ok(!worth.is_empty())
    }

    /// Of sets that add to the best one, those that may be the strongest are fitted where each fits best; the
    /// strongest there that passes every gate.
    fn strongest(&mut self, additions: &[Hypothesis]) -> Result<Option<Converged>, DiagnosisError> {
        let gain = |h: &Hypothesis| self.advantage(h, &self.best).0;
        // On a grid, the price of all its places comes before what the right one between them brings.
        let drops_enough = |h: &Hypothesis| self.advantage(h, &self.best).1 > LEAST_DROP * self.data.temper;
        let effect = |h: &Hypothesis| {
            h.members.last().and_then(|m| self.layout.candidates.get(m.candidate)).map(|c| c.effect.info())
        };
        let first = additions.iter().max_by(|a, b| gain(a).total_cmp(&gain(b)));
        let mistaken_for = first.and_then(effect).map_or(&[][..], |info| info.confusable_with);
        let least = LEAST_PROMISE.max(RIVAL_SHARE * first.map_or(0.0, gain));
        let rivals: Vec<&Hypothesis> = additions
            .iter()
            .filter(|h| {
                let known = effect(h).is_some_and(|info| mistaken_for.contains(&info.id));
                gain(h) > if known { LEAST_PROMISE } else { least }
                    || (least <= LEAST_PROMISE && drops_enough(h))
            })
            .take(MOST_RIVALS)
            .collect();
        let needed = LEAST_EVIDENCE * self.data.temper;
        let least = self.standing(&self.best).map_or(f64::NEG_INFINITY, |best| best.log_evidence + needed);
        let converged = self.converge_all(&rivals, least)?;
        let mut found: Vec<(&Hypothesis, Converged)> =
            rivals.into_iter().zip(converged).filter_map(|(set, at)| Some((set, at?))).collect();
        for (_, converged) in &found {
            self.remember(converged);
        }
        found.sort_by(|a, b| b.1.standing.log_evidence.total_cmp(&a.1.standing.log_evidence));
        // One that held-out data refuse gives way to the next.
        for (set, mut converged) in found {
            converged.standing.held_misfit = self.held_misfit(&converged)?;
            self.remember(&converged);
            if self.passes(set, &self.best) {
                return Ok(Some(converged));
            }
        }
        Ok(None)
    }

    /// Gates for a larger hypothesis over a smaller one.
    pub fn passes(&self, larger: &Hypothesis, smaller: &Hypothesis) -> bool {
        let added = larger.members.len().saturating_sub(smaller.members.len()).max(1) as f64;
        let least = added * self.data.temper;
        // What a large first effect leaves of its own wrong formula is no second effect.
        let echo = 0.01 * self.advantage(smaller, &self.base).1.max(0.0);
        let (evidence, drop) = self.advantage(larger, smaller);
        if evidence <= LEAST_EVIDENCE * least || drop <= (LEAST_DROP * least).max(echo) {
            return false;
        }
        // Held-out data may hold little of the effect, so what they say against it counts only if it is much;
        // a faint effect needs them on its side. What they confirm by itself may have promised more.
        let gain = self.gain(larger, smaller);
        let is_confirmed = smaller.members.is_empty() || gain > LEAST_TOGETHER * least;
        gain > -AGAINST * evidence
            && evidence + gain.min(evidence) > LEAST_TOGETHER * least
            && (is_confirmed || !self.falls_short(larger, smaller, gain))
    }

    /// Whether held-out data gain less by a larger hypothesis than it promises them, beyond what noise, the
    /// uncertainty of its parameters and errors of its formula explain. A second effect that only follows what the
    /// formula of the first one leaves in the training data is seen by this: it does the same in no other run.
    pub fn falls_short(&self, larger: &Hypothesis, smaller: &Hypothesis, gain: f64) -> bool {
        let Some(held) = &self.held_data else { return false };
        let normal = &held.total.matrix;
        let columns = self.layout.columns.len();
        let step = larger.estimate.spread(columns) - smaller.estimate.spread(columns);
        let promised = 0.5 * step.dot(&(normal * &step));
        // Of which this much is owed to errors of the estimate.
        let covariance = larger.estimate.covariance();
        let active = &larger.estimate.active;
        let mut errors = 0.0;
        for (a, i) in active.iter().enumerate() {
            for (b, j) in active.iter().enumerate() {
                errors += normal[(*i, *j)] * covariance[(b, a)];
            }
        }
        // A log likelihood ratio has a variance of twice its mean.
        let noise = 2.0 * promised * self.data.temper;
        let short = promised - errors.min(promised) - gain;
        short > REFUTED * (noise + (FORMULA_OF_MEMBER * promised).powi(2)).sqrt()
    }

    /// Swaps and removes members as long as that is better.
    fn tidy(&mut self) -> Result<(), DiagnosisError> {
        for _ in 0..3 {
            let (mut changed, mut fitted) = (false, None);
            for member in 0..self.best.members.len() {
                let Some(rest) = self.best.without(&self.layout, &self.data.total, member) else { continue };
                if !self.passes(&self.best, &rest) {
                    self.best = rest;
                    changed = true;
                    break;
                }
                match self.swapped(&rest)? {
                    Some(Swapped::Fitted(converged)) => {
                        changed = true;
                        fitted = Some(*converged);
                        break;
                    }
                    Some(Swapped::Known) => {
                        changed = true;
                        break;
                    }
                    None => {}
                }
            }
            match fitted {
                Some(converged) => self.settle(converged)?,
                None if changed => self.relinearise()?,
                None => return Ok(()),
            }
        }
        Ok(())
    }

    /// Puts the best effect in a member's place, given the set without it. In the regression at the member's own point
    /// an effect that turned the platform far is off by much of what it explains, so all that come near are fitted
    /// where they fit best.
    fn swapped(&mut self, rest: &Hypothesis) -> Result<Option<Swapped>, DiagnosisError> {
        let near = rest.estimate.drop + NEAR_SHARE * (self.best.estimate.drop - rest.estimate.drop);
        let own = self.best.names(&self.layout);
        let swaps = self.additions(rest);
        let swaps = swaps.into_iter().enumerate().filter(|(i, s)| *i == 0 || s.estimate.drop > near);
        let swaps: Vec<Hypothesis> = swaps
            .map(|(_, swap)| swap)
            .take(MOST_RIVALS)
            .filter(|swap| swap.names(&self.layout) != own)
            .collect();
        for some in swaps.chunks(self.problem.threads.max(1)) {
            let new: Vec<&Hypothesis> = some.iter().filter(|swap| self.standing(swap).is_none()).collect();
            let mut fitted = self.converge_all(&new, f64::NEG_INFINITY)?.into_iter();
            for swap in some {
                let mut new = None;
                if self.standing(swap).is_none()
                    && let Some(mut converged) = fitted.next().flatten()
                {
                    converged.standing.held_misfit = self.held_misfit(&converged)?;
                    self.remember(&converged);
                    new = Some(converged);
                }
                // What held-out data refuse would only leave again, and nothing be left.
                if self.standing(swap).is_some()
                    && self.advantage(swap, &self.best).0 > 1.0
                    && self.passes(swap, rest)
                {
                    self.best = swap.clone();
                    let is_new = |converged: &Converged| converged.names == swap.names(&self.layout);
                    return Ok(Some(match new.filter(is_new) {
                        Some(converged) => Swapped::Fitted(Box::new(converged)),
                        None => Swapped::Known,
                    }));
                }
            }
        }
        Ok(None)
    }

    /// Effects that explain the data as well in place of a member of the best set.
    pub fn rivals_of(&self, member: usize) -> Vec<Hypothesis> {
        let Some(rest) = self.best.without(&self.layout, &self.data.total, member) else { return Vec::new() };
        let (_, drop) = self.advantage(&self.best, &rest);
        let own = self.best.names(&self.layout);
        let mut rivals = self.additions(&rest);
        rivals.retain(|other| {
            self.is_tie(self.advantage_of_rival(other), drop) && other.names(&self.layout) != own
        });
        rivals
    }

    /// Other sets that explain the data as well: those with `rivals` in place of one member, and sets that were
    /// fitted where they fit best.
    pub fn alternatives(&self, rivals: &[Hypothesis]) -> Vec<Vec<String>> {
        let mut sets: Vec<Vec<String>> = Vec::new();
        for rival in rivals {
            let names = rival.names(&self.layout);
            if !sets.contains(&names) {
                sets.push(names);
            }
        }
        let own = self.best.names(&self.layout);
        let (_, drop) = self.advantage(&self.best, &self.base);
        if let Some(best) = self.standing(&self.best) {
            for (names, standing) in &self.standings {
                // A fit that ended before its minimum is given what it promised.
                let advantage = (
                    standing.log_evidence + 0.5 * standing.promise - best.log_evidence,
                    best.misfit - standing.misfit + standing.promise,
                );
                if names.len() == own.len()
                    && *names != own
                    && self.is_tie(advantage, drop)
                    && !sets.contains(names)
                {
                    sets.push(names.clone());
                }
            }
        }
        sets
    }

    /// The kind of the first member.
    pub fn kind(&self) -> Option<String> {
        let member = self.best.members.first()?;
        let candidate = self.layout.candidates.get(member.candidate)?;
        Some(candidate.effect.info().kind.to_string())
    }
}
