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
use crate::candidates::{Layout, Lines};
use crate::hypothesis::{Hypothesis, Member};
use crate::motion::Motion;
use crate::parameters::Point;
use crate::physical::between;
use crate::problem::{Dataset, Problem};
use crate::regression::Estimate;
use crate::run::Run;
use crate::search::{LEAST_DROP, Search};
use crate::step::{NO_FIT, dataset, point_of};

/// Steps of a fit, those taken back included.
const MOST_STEPS: usize = 8;

/// Times that the first step of a fit is shortened.
const MOST_SHORTER: usize = 3;

/// A further step that promises less log likelihood is not taken.
const CONVERGED: f64 = 0.3;

/// What a fit may still gain: so many times what its next step promises, and this much log evidence. Steps promise
/// what straight formulas would bring, and formulas bend.
const SURPRISE: (f64, f64) = (4.0, 3.0);

/// How a set explains the data at its own point.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Standing {
    /// Log evidence; comparable between sets.
    pub log_evidence: f64,
    /// Whitened misfit, prior's penalty included.
    pub misfit: f64,
    /// By how much a further step would lower the misfit: of a fit that ended before its minimum.
    pub promise: f64,
    /// Whitened misfit of held-out data.
    pub held_misfit: Option<f64>,
}

/// Standings by the names of the sets.
pub(crate) type Standings = BTreeMap<Vec<String>, Standing>;

/// A set fitted at its own point.
pub(crate) struct Converged {
    pub names: Vec<String>,
    pub standing: Standing,
    pub point: Point,
    motions: Vec<Motion>,
    layout: Layout,
    members: Vec<Member>,
}

impl Converged {
    /// The random walk of the gyro's bias that data support beside this set: [`Problem::likeliest_gyro_bias_walk`].
    pub fn likeliest_gyro_bias_walk(&self, problem: &Problem) -> Result<Option<f64>, DiagnosisError> {
        let mut along = problem.clone();
        along.motions.clone_from(&self.motions);
        along.likeliest_gyro_bias_walk(&self.point)
    }
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
/// deflection that goes with a frequency must not be charged to a gravity offset that has not moved yet.
fn at_itself(
    search: &Search<'_>,
    layout: &Layout,
    data: &Dataset,
    fit: &Hypothesis,
    point: &Point,
) -> Option<(f64, Point)> {
    let reference = &search.problem.reference;
    let variances = fit.variances(layout);
    let variance = |i: usize| variances[i].max(1e-12);
    let (shapes, others): (Vec<usize>, Vec<usize>) =
        fit.estimate.active.iter().partition(|i| layout.columns[**i].is_shape);
    let held = if shapes.is_empty() { &others } else { &shapes };
    let mut at = DVector::zeros(layout.columns.len());
    let mut penalty = 0.0;
    for &i in held {
        at[i] = reference.distance(point, &layout.columns[i]);
        penalty += at[i] * at[i] / variance(i);
    }
    let mut left = data.total.clone();
    let carried = &left.matrix * &at;
    left.sum_of_squares += at.dot(&carried) - 2.0 * at.dot(&left.vector);
    left.vector -= carried;
    if shapes.is_empty() {
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

    /// As [`Self::converge`]; given up where it is, once it cannot come to a log evidence of `least`.
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
        self.descend(&mut problem, start, &ids, least)
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

    fn descend(
        &self,
        problem: &mut Problem,
        start: &Hypothesis,
        ids: &[&'static str],
        least: f64,
    ) -> Result<Option<Converged>, DiagnosisError> {
        let mut point = point_of(self.problem, &self.layout, &self.point, start);
        // Effects that have left the set leave the point.
        point.effects.retain(|id, _| {
            ids.contains(id)
                || crate::parameters::is_base(id)
                || self.problem.reference.model.effects.contains_key(*id)
        });
        let mut members = start.members.clone();
        let mut layout = self.layout.clone();
        let entered_as_place = members.last().is_some_and(|m| {
            let of_last = m.columns.iter().filter_map(|i| layout.columns.get(*i));
            of_last.clone().any(|c| c.origin.is_some()) && of_last.flat_map(|c| &c.step).all(|s| *s == 0.0)
        });
        let mut best: Option<Converged> = None;
        let (mut share, mut target): (f64, Option<Point>) = (1.0, None);
        // A set that holds the present best one starts from there, with a misfit that is known.
        let (anchor, first) = (self.point.clone(), point.clone());
        let holds_best =
            self.best.members.iter().all(|b| start.members.iter().any(|m| m.candidate == b.candidate));
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
            let data = dataset(problem, &point, &layout, self.colours.clone())?;
            let Some(mut fit) = Hypothesis::of(&layout, &data.total, members.clone()) else { break };
            if fit.members.len() < ids.len() {
                break;
            }
            // A place on a grid has become a value: how far it is from neutral, no column has said before.
            if step == 0 && entered_as_place {
                fit = fit.resized(&layout, &data.total);
                members.clone_from(&fit.members);
            }
            let Some((misfit, here)) = at_itself(self, &layout, &data, &fit, &point) else { break };
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
                standing: Standing { log_evidence, misfit, promise: promised.max(0.0), held_misfit: None },
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

    /// Makes a converged set the present best: the full regression at its point.
    pub(crate) fn settle(&mut self, converged: Converged) -> Result<(), DiagnosisError> {
        self.point = converged.point;
        self.problem.motions = converged.motions;
        if let Some(held) = &mut self.held_out {
            held.smooth(&self.point, None)?;
        }
        self.regress()?;
        let members: Vec<Member> =
            converged.members.iter().filter_map(|m| carried(m, &converged.layout, &self.layout)).collect();
        self.best =
            Hypothesis::of(&self.layout, &self.data.total, members).unwrap_or_else(|| self.base.clone());
        let held_misfit = self
            .held_data
            .as_ref()
            .map(|held| held.total.sum_of_squares + self.best.estimate.misfit_change(&held.total));
        if self.best.names(&self.layout) == converged.names {
            self.note(converged.names, Standing { held_misfit, ..converged.standing });
        }
        Ok(())
    }

    /// Remembers how well a set stands.
    pub(crate) fn remember(&mut self, converged: &Converged) {
        self.watch_latency(&converged.names, converged.standing.log_evidence, &converged.point);
        self.note(converged.names.clone(), converged.standing);
    }

    fn note(&mut self, names: Vec<String>, standing: Standing) {
        let known = self.standings.get(&names).map_or(f64::NEG_INFINITY, |s| s.log_evidence);
        if standing.log_evidence >= known {
            self.standings.insert(names, standing);
        }
    }

    /// Whitened misfit of held-out data with a converged set.
    pub(crate) fn held_misfit(&self, converged: &Converged) -> Result<Option<f64>, DiagnosisError> {
        let Some(mut held) = self.held_out.as_deref().cloned() else { return Ok(None) };
        held.smooth(&converged.point, None)?;
        let data = dataset(&held, &converged.point, &converged.layout, self.held_colours.clone())?;
        let mut at = DVector::zeros(converged.layout.columns.len());
        for (slot, column) in at.iter_mut().zip(&converged.layout.columns) {
            *slot = held.reference.distance(&converged.point, column);
        }
        let total = &data.total;
        Ok(Some(total.sum_of_squares - 2.0 * at.dot(&total.vector) + at.dot(&(&total.matrix * &at))))
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

    /// What a rival may at most have over the best set, as [`Self::advantage`]: one whose fit has not come to its minimum
    /// is given what it promised, and is not refuted by where it happened to stop.
    pub(crate) fn advantage_of_rival(&self, rival: &Hypothesis) -> (f64, f64) {
        let (evidence, drop) = self.advantage(rival, &self.best);
        let promise = match (self.standing(rival), self.standing(&self.best)) {
            (Some(standing), Some(_)) => standing.promise,
            _ => 0.0,
        };
        (evidence + 0.5 * promise, drop + promise)
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
