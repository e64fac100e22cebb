//! Which sets of explanations come near the best one: proposals from a regression of all effects, each fitted and evaluated
//! where it fits best. The search only proposes; the answer follows from the weights ([`crate::verdict::posterior`]).

use std::collections::BTreeMap;

use whorl_dynamics::effects::Periodicity;

use crate::diagnosis::FittedSet;
use crate::evidence::ar_noise::ArModels;
use crate::evidence::nuisance::Nuisance;
use crate::evidence::problem::{Dataset, Problem, ProcessNoise};
use crate::explanations::candidates::Design;
use crate::explanations::hypothesis::{Hypothesis, Term};
use crate::explanations::lines::Lines;
use crate::explanations::place::Place;
use crate::parameters::Point;
use crate::parameters::available::Available;
use crate::search::judge::{Judge, Judgement, Said};
use crate::search::latency::SetWithLatency;
use crate::search::prior::log_prior;
use crate::search::residual::{residual_powers, worst};
use crate::search::sampled::Beside;
use crate::search::score::{Converged, Fitted};
use crate::search::step::{NO_FIT, base_point_with, dataset, regression_at};
use crate::{DiagnosisError, Options, Progress};

/// Sets that are fitted in each round beside the declared rivals of the best one, at most.
const MOST_PROPOSALS: usize = 4;

/// Rounds of proposals, at most.
const MOST_ROUNDS: usize = 6;

/// The search's state: where the model is, and the regression there.
pub(crate) struct Search<'a> {
    pub problem: &'a mut Problem,
    pub held_out: Option<&'a mut Problem>,
    pub available: Available,
    pub options: &'a Options,
    pub lines: Lines,
    /// Wheels whose turning shows in the samples themselves.
    pub turning: Vec<usize>,
    /// Hidden states compete as well: their many columns are made only when something is missing.
    pub with_hidden: bool,
    /// AR models of the residual of all effects together, with the stated noise alone: the fit of every set begins with these. AR models
    /// of its own residual would contain what it does not explain yet.
    pub sharp: ArModels,
    pub point: Point,
    /// Relative error of formulas that is integrated out of the present regression.
    pub relative_error: f64,
    pub design: Design,
    pub data: Dataset,
    pub held_data: Option<Dataset>,
    pub base: Hypothesis,
    pub best: Hypothesis,
    /// Sets that were fitted, each where it fits best.
    pub fitted: Fitted,
    /// Log evidence of the samples less that of the bins for the most probable judged set: it is added to the log evidence of the bins of
    /// other sets, so that the two compare.
    pub samples_over_bins: f64,
    /// The normal equations of the samples about sets that were judged.
    pub besides: Vec<Beside>,
    /// What the samples have said already, in a search with other bins.
    pub said: Said,
    /// Log evidence in bins of each of them.
    pub of_bins: BTreeMap<Vec<String>, f64>,
    /// Sets that were fitted and are not compared any more.
    pub forgotten: Vec<FittedSet>,
    /// The best set with an inertial latency.
    pub latency: Option<SetWithLatency>,
}

impl<'a> Search<'a> {
    /// Fits the base model and makes the first full regression.
    pub fn start(
        problem: &'a mut Problem,
        mut held_out: Option<&'a mut Problem>,
        options: &'a Options,
        progress: &mut dyn FnMut(Progress),
    ) -> Result<Self, DiagnosisError> {
        progress(Progress { share: 0.02, doing: "smoothing the motion" });
        let point = base_point_with(problem, &mut held_out)?;
        progress(Progress { share: 0.08, doing: "passing every effect through the filter" });
        Self::at(problem, held_out, options, point)
    }

    /// Makes the first full regression at a fit of the base model.
    pub fn at(
        problem: &'a mut Problem,
        held_out: Option<&'a mut Problem>,
        options: &'a Options,
        point: Point,
    ) -> Result<Self, DiagnosisError> {
        let available = Available::of(&problem.runs);
        let lines = Lines::default();
        let design = Design::new(&problem.reference, &point, &available, &options.exclude, &lines, false);
        let data = dataset(problem, &point, &design, None)?;
        let base = Hypothesis::base(&design, &data.total).ok_or(NO_FIT)?;
        let sharp = if problem.nuisance == Nuisance::default() {
            data.ar_models.clone()
        } else {
            let mut quiet = problem.clone();
            quiet.nuisance = Nuisance::default();
            dataset(&quiet, &point, &design, None)?.ar_models
        };
        Ok(Self {
            problem,
            held_out,
            available,
            options,
            lines,
            turning: Vec::new(),
            with_hidden: false,
            sharp,
            point,
            relative_error: 0.0,
            design,
            data,
            held_data: None,
            best: base.clone(),
            base,
            fitted: Fitted::new(),
            samples_over_bins: 0.0,
            besides: Vec::new(),
            said: Said::default(),
            of_bins: BTreeMap::new(),
            forgotten: Vec::new(),
            latency: None,
        })
    }

    /// The present regression, for those who look for explanations in it.
    pub(crate) fn place(&self) -> Place<'_> {
        Place {
            problem: self.problem,
            available: &self.available,
            lines: &self.lines,
            turning: &self.turning,
            design: &self.design,
            data: &self.data,
        }
    }

    /// The full regression at the present point, along the present motion.
    pub(crate) fn regress(&mut self) -> Result<(), DiagnosisError> {
        self.design = Design::new(
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
        self.data = regression_at(self.problem, &self.point, &self.design, self.relative_error)?;
        self.base = Hypothesis::base(&self.design, &self.data.total).ok_or(NO_FIT)?;
        Ok(())
    }

    /// The same of the held-out runs: nothing is searched in them, so it is made when it is asked for.
    pub(crate) fn regress_held(&mut self) -> Result<(), DiagnosisError> {
        if let Some(held) = &mut self.held_out {
            held.smooth(&self.point, ProcessNoise::Estimated)?;
            self.held_data = Some(regression_at(held, &self.point, &self.design, self.relative_error)?);
        }
        Ok(())
    }

    /// Log likelihood gained on held-out runs by one set over another; `None` without such runs.
    pub fn gain(&self, with: &Hypothesis, without: &Hypothesis) -> Option<f64> {
        let held = |set| self.score(set).and_then(|s| s.held_log_likelihood);
        if let (Some(a), Some(b)) = (held(with), held(without)) {
            return Some(a - b);
        }
        let held = &self.held_data.as_ref()?.total;
        Some(0.5 * (without.estimate.misfit_change(held) - with.estimate.misfit_change(held)))
    }

    /// Every effect added in turn to a hypothesis that does not hold it, best first.
    pub fn additions(&self, to: &Hypothesis) -> Vec<Hypothesis> {
        let free: Vec<usize> = (0..self.design.candidates.len())
            .filter(|c| to.terms.iter().all(|m| m.candidate != *c))
            .collect();
        let mut found: Vec<Hypothesis> =
            crate::threads::map(self.problem.threads, &free, |c| to.with(&self.design, &self.data.total, *c))
                .into_iter()
                .flatten()
                .collect();
        found.sort_by(|a, b| b.log_evidence.total_cmp(&a.log_evidence));
        found
    }

    /// Evaluates the base model and the sets that the samples propose, then sets near the best one until none of them is better; ends at
    /// the most probable set. Sets that the samples rule out are not fitted. `None` where no filter can be run on the samples.
    pub fn run<'j>(
        &mut self,
        judge: Judge<'j>,
        progress: &mut dyn FnMut(Progress),
    ) -> Result<Option<Judgement<'j>>, DiagnosisError> {
        self.open_hidden(progress)?;
        let base = self.base.clone();
        self.best = base.clone();
        self.evaluate_base(&base)?;
        let judgement = self.judge_first(judge, progress)?;
        if let Some(most) = self.most_probable_judged().filter(|most| !most.names.is_empty()).cloned() {
            self.settle(most)?;
        }
        for round in 0..MOST_ROUNDS {
            progress(Progress { share: 0.6 + 0.05 * round as f64, doing: "comparing explanations" });
            let proposals = self.proposals(round == 0);
            if round > 0
                && self
                    .score(&self.base)
                    .is_some_and(|s| s.predicted_decrease > 2.0 * self.options.settings.unfinished_nats)
            {
                // The base model did not come to its minimum from where it began; from here it may.
                let base = self.base.clone();
                if let Some(converged) = self.converge(&base)? {
                    self.remember(converged);
                }
            }
            let least = self
                .score(&self.best)
                .map_or(f64::NEG_INFINITY, |s| s.training_evidence - 2.0 * self.options.settings.window_nats);
            let fitted: Vec<Converged> =
                self.converge_all(&proposals, least)?.into_iter().flatten().collect();
            for converged in &fitted {
                self.remember(converged.clone());
            }
            self.fit_beside_noise(&fitted)?;
            match self.better()? {
                Some(converged) => {
                    self.settle(converged)?;
                }
                // Without the noise that is likeliest beside the base model, other effects may come near.
                None if round == 0 && judgement.is_none() && self.problem.nuisance != Nuisance::default() => {
                    let mut quiet = self.fitted(&self.base).cloned().ok_or(NO_FIT)?;
                    quiet.score.nuisance = Nuisance::default();
                    self.settle(quiet)?;
                }
                None => break,
            }
        }
        self.settle_most_probable()?;
        Ok(judgement)
    }

    /// The most probable set, if it is more probable than the present best one and than each smaller one that it holds, fitted
    /// from where it ended.
    fn better(&mut self) -> Result<Option<Converged>, DiagnosisError> {
        for _ in 0..MOST_ROUNDS {
            let leading = self.fitted(&self.best).map_or(f64::NEG_INFINITY, Converged::log_posterior);
            let Some(better) = self.most_probable().filter(|c| c.log_posterior() > leading + 1e-6).cloned()
            else {
                return Ok(None);
            };
            self.fit_smaller_sets(&better)?;
            if self.most_probable().is_some_and(|most| most.names == better.names) {
                return Ok(Some(better));
            }
        }
        Ok(None)
    }

    /// Fits the base model from the noise in use, and as sharply as any other set: constants of the platform that are far
    /// from the given ones look like noise until they are fitted, and beside so much noise they stay where they are.
    fn evaluate_base(&mut self, base: &Hypothesis) -> Result<(), DiagnosisError> {
        let converged = self.converge(base)?.ok_or(NO_FIT)?;
        self.remember(converged);
        if self.problem.nuisance == Nuisance::default() {
            return Ok(());
        }
        let beside = self.score(base).map(|s| s.nuisance);
        if let Some(sharp) = self.converge_sharply(base)? {
            self.remember(sharp);
        }
        match self.fitted(base).cloned() {
            Some(best) if Some(best.score.nuisance) != beside => self.settle(best),
            _ => Ok(()),
        }
    }

    /// Ends where the most probable set fits best.
    pub(crate) fn settle_most_probable(&mut self) -> Result<(), DiagnosisError> {
        let best = self.best.names(&self.design);
        let (nuisance, point) = (self.problem.nuisance, &self.point);
        let is_there = |c: &&Converged| c.names == best && c.score.nuisance == nuisance && c.point == *point;
        if let Some(most) = self.most_probable().filter(|c| !is_there(c)).cloned() {
            self.settle(most)?;
        }
        self.regress_held()
    }

    /// Sets that may come near the best one and were not evaluated: with one effect more, one less, or another in the place
    /// of one. The declared rivals of its terms are among them however small their predicted gain.
    fn proposals(&self, with_pairs: bool) -> Vec<Hypothesis> {
        let settings = &self.options.settings;
        let mut all = self.additions(&self.best);
        if with_pairs {
            all.extend(self.strong_pair(&all));
        }
        let mut rivals: Vec<Hypothesis> = Vec::new();
        for (at, term) in self.best.terms.iter().enumerate() {
            let Some(smaller) = self.best.without(&self.design, &self.data.total, at) else { continue };
            let declared =
                self.design.candidates.get(term.candidate).map(|c| c.effect.info().confusable_with);
            for swap in self.additions(&smaller) {
                let id =
                    swap.terms.last().and_then(|m| self.design.candidates.get(m.candidate)).map(|c| c.id);
                if id.is_some_and(|id| declared.is_some_and(|list| list.contains(&id))) {
                    rivals.push(swap);
                } else {
                    all.push(swap);
                }
            }
            if !smaller.terms.is_empty() {
                all.push(smaller);
            }
        }
        let weight = |h: &Hypothesis| h.log_evidence + log_prior(&h.names(&self.design), settings);
        let is_new = |h: &Hypothesis| {
            // One that did not come to its minimum may from here.
            let is_finished =
                self.score(h).is_some_and(|s| s.predicted_decrease < 2.0 * settings.unfinished_nats);
            h.terms.len() <= self.options.largest_set && !is_finished && !h.terms.is_empty()
        };
        let leading = weight(&self.best);
        // An effect that adds nothing loses little more than its prior odds, and there are dozens of these.
        let is_larger = |h: &Hypothesis| h.terms.len() > self.best.terms.len();
        let window = |h: &Hypothesis| if is_larger(h) { settings.doubt_nats } else { settings.window_nats };
        let is_open = |h: &Hypothesis| is_new(h) && !self.is_ruled_out(&h.names(&self.design));
        all.retain(|h| weight(h) > leading - window(h) && is_open(h));
        all.sort_by(|a, b| weight(b).total_cmp(&weight(a)));
        let mut names: Vec<Vec<String>> = Vec::new();
        let mut chosen: Vec<Hypothesis> = Vec::new();
        rivals.retain(is_open);
        for h in all.into_iter().take(MOST_PROPOSALS).chain(rivals) {
            let own = h.names(&self.design);
            if !names.contains(&own) {
                names.push(own);
                chosen.push(h);
            }
        }
        chosen
    }

    /// Of the best single effects two together, if they explain far more than any of them: a pair can beat the best single
    /// effect that neither of the two is.
    fn strong_pair(&self, additions: &[Hypothesis]) -> Option<Hypothesis> {
        let window_nats = self.options.settings.window_nats;
        let best_single = additions.first()?.log_evidence;
        if best_single <= self.base.log_evidence + 2.0 * window_nats {
            return None;
        }
        let singles: Vec<usize> =
            additions.iter().take(8).filter_map(|h| h.terms.last().map(|m| m.candidate)).collect();
        let pairs: Vec<(usize, usize)> = singles
            .iter()
            .enumerate()
            .flat_map(|(i, a)| singles.iter().skip(i + 1).map(move |b| (*a, *b)))
            .collect();
        let total = &self.data.total;
        crate::threads::map(self.problem.threads, &pairs, |(a, b)| {
            self.base.with(&self.design, total, *a)?.with(&self.design, total, *b)
        })
        .into_iter()
        .flatten()
        .filter(|h| h.terms.len() == 2 && h.log_evidence > best_single + window_nats)
        .max_by(|a, b| a.log_evidence.total_cmp(&b.log_evidence))
    }

    /// Makes the columns of lines and hidden states where something is missing.
    fn open_hidden(&mut self, progress: &mut dyn FnMut(Progress)) -> Result<(), DiagnosisError> {
        let additions = self.additions(&self.base);
        let left = residual_powers(self.problem, &self.data, &self.design, &self.base);
        self.lines = crate::explanations::spectrum::lines(self.place(), &self.base);
        let settings = &self.options.settings;
        let faint =
            additions.first().is_some_and(|h| h.log_evidence - self.base.log_evidence > settings.doubt_nats);
        if faint
            || !self.lines.modes.is_empty()
            || self.lines.strongest > 0.8 * settings.certain_stddevs
            || left[worst(&left)].significance() > settings.noticed_stddevs
            || self.has_faint_line()?
        {
            progress(Progress { share: 0.1, doing: "looking for lines and hidden states" });
            self.with_hidden = true;
            self.regress()?;
            self.best = self.base.clone();
        }
        Ok(())
    }

    /// Whether a line that hardly stands out of the spectrum is worth a look as a torque of the room, after all
    /// frequencies at which it might have been are paid for. Each is evaluated by a regression of the base model and
    /// both phases of that torque: a peak's height does not say that it has one phase in every run.
    fn has_faint_line(&mut self) -> Result<bool, DiagnosisError> {
        let hz = std::mem::take(&mut self.lines.faint_hz);
        let mut candidates = self.design.candidates.iter();
        let periodic = candidates.find(|c| c.effect.periodicity() == Some(Periodicity::Torque)).map(|c| c.id);
        let Some(periodic) = periodic.filter(|_| !hz.is_empty()) else { return Ok(false) };
        let lines = Lines { torque_hz: hz.clone(), ..Lines::default() };
        let design =
            Design::of_effects(&self.problem.reference, &self.point, &self.available, &[periodic], &lines);
        let data = dataset(self.problem, &self.point, &design, None)?;
        let base = Hypothesis::base(&design, &data.total).ok_or(NO_FIT)?;
        let mut worth: Vec<(f64, f64)> = Vec::new();
        for (columns, hz) in design.candidates.iter().flat_map(|c| &c.options).zip(hz) {
            let term = Term { candidate: 0, columns: columns.clone(), size: 0.1, options: 1 };
            let Some(fit) = Hypothesis::of(&design, &data.total, vec![term]) else { continue };
            let evidence = fit.resized(&design, &data.total).log_evidence
                - base.log_evidence
                - self.problem.frequencies().ln();
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

    /// The kind of the first term.
    pub fn kind(&self) -> Option<String> {
        let term = self.best.terms.first()?;
        let candidate = self.design.candidates.get(term.candidate)?;
        Some(candidate.effect.info().kind.to_string())
    }
}
