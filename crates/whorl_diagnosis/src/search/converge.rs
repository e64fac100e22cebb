//! Fits sets of effects where they fit best, and remembers how well.
//!
//! A first regression is taken where an effect is absent. There, a lag looks like a delay, a resonance has
//! whatever frequency the grid offered, and a signal extrapolated back to nothing from a point far away has
//! any size. So sets that compete are each fitted by Gauss-Newton steps with motion and sensitivities made
//! anew, and compared by their evidence there (Laplace's approximation at its own maximum).

use std::collections::BTreeMap;

use nalgebra::DVector;
use whorl_dynamics::effects::find;

use crate::DiagnosisError;
use crate::evidence::nuisance::Nuisance;
use crate::evidence::regression::{Estimate, Normal};
use crate::explanations::candidates::{Layout, Lines};
use crate::explanations::hypothesis::{Hypothesis, Member};
use crate::explanations::parameters::Point;
use crate::explanations::physical::between;
use crate::layout::motion::Motion;
use crate::layout::run::Run;
use crate::search::Search;
use crate::search::problem::Problem;
use crate::search::step::{NO_FIT, point_of, regression_at};

/// Steps of a fit, those taken back included.
const MOST_STEPS: usize = 8;

/// Fits of a set, each with the noise that is likeliest where the last one ended.
const MOST_TURNS: usize = 3;

/// Times that the first step of a fit is shortened.
const MOST_SHORTER: usize = 3;

/// A further step that promises less log likelihood is not taken.
const CONVERGED: f64 = 0.3;

/// What a fit may still gain: so many times what its next step promises, and this much log evidence. Steps promise
/// what straight formulas would bring, and formulas bend.
const SURPRISE: (f64, f64) = (4.0, 3.0);

/// Misfit by which a larger set may fall behind the leading one on its way to where it fits best: beyond it, a step went
/// too far.
const LEAST_DROP: f64 = 30.0;

/// How a set explains the data at its own point.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Standing {
    /// Log evidence of training and held-out data together, errors of formulas and noise of unknown size integrated out;
    /// comparable between sets.
    pub log_evidence: f64,
    /// Log evidence of the training data alone, at the search's own noise.
    pub training_evidence: f64,
    /// Log likelihood of the training data where the set fits them best.
    pub log_likelihood: f64,
    /// Log likelihood of held-out data with values that were fitted to the training data.
    pub held_log_likelihood: Option<f64>,
    /// Whitened misfit of the training data, prior's penalty included.
    pub misfit: f64,
    /// By how much a further step would lower the misfit: of a fit that ended before its minimum.
    pub promise: f64,
    /// Relative error of formulas that is likeliest.
    pub relative_error: f64,
    /// Noise beside the model's that is likeliest.
    pub nuisance: Nuisance,
}

impl Standing {
    /// What it is worth to believe: a fit that ended before its minimum is given what its next step promised, as far as
    /// straight formulas can be trusted.
    pub fn worth(&self) -> f64 {
        self.log_evidence + (0.5 * self.promise).min(SURPRISE.1)
    }
}

/// Standings by the names of the sets.
pub(crate) type Standings = BTreeMap<Vec<String>, Standing>;

/// A set fitted at its own point.
pub(crate) struct Converged {
    pub names: Vec<String>,
    pub standing: Standing,
    pub point: Point,
    pub motions: Vec<Motion>,
    pub layout: Layout,
    pub members: Vec<Member>,
}

/// Where a fit begins.
struct Begin {
    point: Point,
    layout: Layout,
    members: Vec<Member>,
}

/// A member as the columns of another layout.
pub(crate) fn carried(member: &Member, from: &Layout, to: &Layout) -> Option<Member> {
    let id = from.candidates.get(member.candidate)?.id;
    let candidate = to.candidates.iter().position(|c| c.id == id)?;
    let old: Vec<_> = member.columns.iter().filter_map(|i| from.columns.get(*i)).collect();
    let special = old.iter().any(|c| c.origin.is_some());
    let mut columns: Vec<usize> = to.candidates[candidate]
        .options
        .iter()
        .flatten()
        .copied()
        .filter(|i| special || to.columns.get(*i).is_some_and(|c| old.iter().any(|o| o.index == c.index)))
        .collect();
    columns.sort_unstable();
    columns.dedup();
    // Columns that had to leave a fit elsewhere, against their sign, may have theirs here.
    let options = &to.candidates[candidate].options;
    if !columns.is_empty() && !options.contains(&columns) {
        let holds = |option: &&Vec<usize>| columns.iter().all(|i| option.contains(i));
        if let Some(whole) = options.iter().filter(holds).min_by_key(|option| option.len()) {
            columns.clone_from(whole);
        }
    }
    // A place on a grid is paid for by the prior of what it became.
    let was_place = special && old.iter().all(|c| c.step.iter().all(|s| *s == 0.0));
    let is_paid = was_place || (special && columns.iter().any(|i| to.columns[*i].is_shape));
    let options = if is_paid { 1 } else { member.options };
    Some(Member { candidate, columns, size: member.size, options })
}

/// Misfit at a point itself, not where the regression's minimum is, and that point. Where an effect's shape is
/// fitted, all else follows it to where it fits best (variable projection, Golub and Pereyra 1973): a static
/// deflection that goes with a frequency must not be charged to a gravity offset that has not moved yet. So it does if it
/// `follows` in any case: to further data.
pub(crate) fn at_itself(
    search: &Search<'_>,
    layout: &Layout,
    total: &Normal,
    fit: &Hypothesis,
    point: &Point,
    follows: bool,
) -> Option<(f64, Point)> {
    let reference = &search.problem.reference;
    let variances = fit.variances(layout);
    let variance = |i: usize| variances[i].max(1e-12);
    let (shapes, others): (Vec<usize>, Vec<usize>) =
        fit.estimate.active.iter().partition(|i| layout.columns[**i].is_shape);
    let follows = follows || !shapes.is_empty();
    let mut at = DVector::zeros(layout.columns.len());
    let mut penalty = 0.0;
    // What has left the fit stays where it is, too.
    for i in (0..layout.columns.len()).filter(|i| !(follows && others.contains(i))) {
        at[i] = reference.distance(point, &layout.columns[i]);
        if fit.estimate.active.contains(&i) {
            penalty += at[i] * at[i] / variance(i);
        }
    }
    let mut left = total.clone();
    let carried = &left.matrix * &at;
    left.sum_of_squares += at.dot(&carried) - 2.0 * at.dot(&left.vector);
    left.vector -= carried;
    if !follows {
        return Some((left.sum_of_squares + penalty, point.clone()));
    }
    let followed = Estimate::new(&left, &others, variance)?;
    let mut there = point.clone();
    for &i in &others {
        let column = &layout.columns[i];
        there = reference.moved(&there, column, followed.of(i) - reference.distance(point, column));
    }
    Some((left.sum_of_squares - followed.drop + penalty, reference.towards(point, there)))
}

impl Search<'_> {
    /// Fits a set that holds in the present regression where it fits best. `None` if it cannot stand there.
    pub(crate) fn converge(&self, start: &Hypothesis) -> Result<Option<Converged>, DiagnosisError> {
        self.converge_towards(start, f64::NEG_INFINITY, self.problem.threads)
    }

    /// As [`Self::converge`]; given up where it is, once it cannot come to a log evidence of `least` of the training data.
    fn converge_towards(
        &self,
        start: &Hypothesis,
        least: f64,
        threads: usize,
    ) -> Result<Option<Converged>, DiagnosisError> {
        let ids: Vec<&'static str> = start
            .members
            .iter()
            .filter_map(|m| self.layout.candidates.get(m.candidate).map(|c| c.id))
            .collect();
        // Along a motion of its own.
        let mut problem = self.problem.clone();
        problem.threads = threads;
        let mut from = self.begin(start, &ids);
        let mut best: Option<Converged> = None;
        // Less noise makes a fit sharper, and a sharper fit leaves less noise.
        for turn in 0..MOST_TURNS {
            let Some(converged) = self.descend(&mut problem, from, &ids, least, turn == 0)? else { break };
            let Some(weighed) = self.weighed(converged, problem.clone())? else { break };
            let is_settled = weighed.standing.nuisance == problem.nuisance;
            problem.nuisance = weighed.standing.nuisance;
            problem.motions.clone_from(&weighed.motions);
            from = Begin {
                point: weighed.point.clone(),
                layout: weighed.layout.clone(),
                members: weighed.members.clone(),
            };
            if best.as_ref().is_none_or(|b| weighed.standing.log_evidence > b.standing.log_evidence) {
                best = Some(weighed);
            }
            if is_settled {
                break;
            }
        }
        Ok(best)
    }

    /// Fits several sets where each fits best, side by side; given up where they cannot come to a log evidence of
    /// `least`.
    pub(crate) fn converge_all(
        &self,
        starts: &[&Hypothesis],
        least: f64,
    ) -> Result<Vec<Option<Converged>>, DiagnosisError> {
        let each = if starts.len() > 1 { 1 } else { self.problem.threads };
        crate::threads::map(self.problem.threads, starts, |start| self.converge_towards(start, least, each))
            .into_iter()
            .collect()
    }

    /// Where a set that holds in the present regression begins its fit.
    fn begin(&self, start: &Hypothesis, ids: &[&'static str]) -> Begin {
        let mut point = point_of(self.problem, &self.layout, &self.point, start);
        // Effects that have left the set leave the point.
        point.effects.retain(|id, _| {
            ids.contains(id)
                || crate::explanations::parameters::is_base(id)
                || self.problem.reference.model.effects.contains_key(*id)
        });
        self.problem.reference.withdraw(&mut point, ids);
        Begin { point, layout: self.layout.clone(), members: start.members.clone() }
    }

    fn descend(
        &self,
        problem: &mut Problem,
        from: Begin,
        ids: &[&'static str],
        least: f64,
        is_first: bool,
    ) -> Result<Option<Converged>, DiagnosisError> {
        let Begin { mut point, mut layout, mut members } = from;
        let entered_as_place = members.last().is_some_and(|m| {
            let of_last = m.columns.iter().filter_map(|i| layout.columns.get(*i));
            of_last.clone().any(|c| c.origin.is_some()) && of_last.flat_map(|c| &c.step).all(|s| *s == 0.0)
        });
        let mut best: Option<Converged> = None;
        let (mut share, mut target): (f64, Option<Point>) = (1.0, None);
        // A set that holds the present best one starts from there, with a misfit that is known.
        let (anchor, first) = (self.point.clone(), point.clone());
        let of_best = self.best.names(&self.layout);
        let holds_best = is_first && of_best.iter().all(|own| ids.contains(&own.as_str()));
        let mut allowed =
            self.standing(&self.best).filter(|_| holds_best).map_or(f64::INFINITY, |s| s.misfit + LEAST_DROP);
        // What the last good step promised.
        let mut promise = 0.0;
        for step in 0..MOST_STEPS {
            problem.smooth(&point, None)?;
            let here =
                Layout::of_effects(&self.problem.reference, &point, &self.available, ids, &Lines::default());
            members = members.iter().filter_map(|m| carried(m, &layout, &here)).collect();
            layout = here;
            let data = regression_at(problem, &point, &layout, self.colours.clone(), self.relative_error)?;
            let Some(mut fit) = Hypothesis::of(&layout, &data.total, members.clone()) else { break };
            if fit.members.len() < ids.len() {
                break;
            }
            // A place on a grid has become a value: how far it is from neutral, no column has said before.
            if step == 0 && entered_as_place {
                fit = fit.resized(&layout, &data.total);
                members.clone_from(&fit.members);
            }
            let Some((misfit, here)) = at_itself(self, &layout, &data.total, &fit, &point, false) else {
                break;
            };
            // What has not come round once in any run is a drift, and periodic by name only.
            if !self.comes_round(&here) {
                return Ok(None);
            }
            // What the best set has found must not be lost on the way to a larger one: a contact's blows, say, are
            // far from linear in all else.
            if best.is_none() && misfit > allowed {
                share *= 0.4;
                point = between(&anchor, &first, share);
                if step + 1 == MOST_SHORTER {
                    (share, point, allowed) = (1.0, first.clone(), f64::INFINITY);
                }
                continue;
            }
            let last = best.as_ref().map_or(f64::INFINITY, |b| b.standing.misfit);
            // A step that went too far is shortened, and so are those after it until one is good.
            if misfit > last + 2.0 * CONVERGED {
                share *= 0.4;
                // A share s of a step to the minimum of a parabola brings 1 - (1 - s)^2 of what the whole does.
                if share * (2.0 - share) * promise < 2.0 * CONVERGED {
                    break;
                }
                let Some((back, target)) = best.as_ref().map(|b| &b.point).zip(target.as_ref()) else {
                    break;
                };
                point = between(back, target, share);
                continue;
            }
            share = (1.6 * share).min(1.0);
            let promised = misfit - (data.total.sum_of_squares - fit.estimate.drop);
            // Occam's factor and the price of choices, beside the likelihood.
            let factor = fit.log_evidence - 0.5 * fit.estimate.drop + data.log_density;
            let next = point_of(self.problem, &layout, &point, &fit);
            let log_evidence = factor - 0.5 * misfit;
            promise = promised;
            best = Some(Converged {
                names: fit.names(&layout),
                standing: Standing {
                    log_evidence,
                    training_evidence: log_evidence,
                    log_likelihood: data.log_density - 0.5 * misfit,
                    held_log_likelihood: None,
                    misfit,
                    promise: promised.max(0.0),
                    relative_error: self.relative_error,
                    nuisance: problem.nuisance,
                },
                point: here.clone(),
                motions: problem.motions.clone(),
                layout: layout.clone(),
                members: fit.members.clone(),
            });
            if promised < 2.0 * CONVERGED || log_evidence + SURPRISE.0 * 0.5 * promised + SURPRISE.1 < least {
                break;
            }
            point = between(&here, &next, share);
            target = Some(next);
        }
        Ok(best)
    }

    /// Whether a periodic torque has at least one period in the longest run.
    fn comes_round(&self, point: &Point) -> bool {
        let duration_s = |run: &Run| run.time(run.nodes().saturating_sub(1)) - run.time(0);
        let longest_s = self.problem.runs.iter().map(duration_s).fold(0.0, f64::max);
        let imposed_hz =
            |(id, values): (&&str, &Vec<f64>)| find(id).and_then(|effect| effect.imposed_hz(values));
        point.effects.iter().filter_map(imposed_hz).all(|hz| longest_s * hz >= 1.0)
    }

    /// Makes a converged set the present best: the full regression at its point, with its noise.
    pub(crate) fn settle(&mut self, converged: Converged) -> Result<(), DiagnosisError> {
        self.point = converged.point;
        self.problem.motions = converged.motions;
        self.problem.nuisance = converged.standing.nuisance;
        self.relative_error = converged.standing.relative_error;
        if let Some(held) = &mut self.held_out {
            held.nuisance = converged.standing.nuisance;
            held.smooth(&self.point, None)?;
        }
        self.regress()?;
        let members: Vec<Member> =
            converged.members.iter().filter_map(|m| carried(m, &converged.layout, &self.layout)).collect();
        self.best =
            Hypothesis::of(&self.layout, &self.data.total, members).unwrap_or_else(|| self.base.clone());
        Ok(())
    }

    /// Remembers how well a set stands.
    pub(crate) fn remember(&mut self, converged: &Converged) {
        self.watch_latency(&converged.names, converged.standing.log_evidence, &converged.point);
        let known = self.standings.get(&converged.names).map_or(f64::NEG_INFINITY, |s| s.log_evidence);
        if converged.standing.log_evidence >= known {
            self.standings.insert(converged.names.clone(), converged.standing);
        }
    }

    /// Linearises anew at the present best and finds its members there.
    pub(crate) fn relinearise(&mut self) -> Result<(), DiagnosisError> {
        let best = self.best.clone();
        let converged = match self.converge(&best)? {
            Some(converged) => converged,
            // It cannot stand at its own point: back to the base model.
            None => {
                let base = self.base.clone();
                self.converge(&base)?.ok_or(NO_FIT)?
            }
        };
        self.settle(converged)
    }

    /// Standing of a set, if it was fitted at a point of its own.
    pub(crate) fn standing(&self, set: &Hypothesis) -> Option<Standing> {
        self.standings.get(&set.names(&self.layout)).copied()
    }

    /// Log evidence and drop of the misfit that one set has over another: where each fits best if both were
    /// fitted there, else in the present regression.
    pub(crate) fn advantage(&self, with: &Hypothesis, without: &Hypothesis) -> (f64, f64) {
        match (self.standing(with), self.standing(without)) {
            (Some(a), Some(b)) => (a.log_evidence - b.log_evidence, b.misfit - a.misfit),
            _ => (with.log_evidence - without.log_evidence, with.estimate.drop - without.estimate.drop),
        }
    }
}
