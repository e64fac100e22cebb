//! Effects whose amplitude may change: which of them the residual suggests. It only proposes.

use whorl_dynamics::effects::Role;

use crate::explanations::hypothesis::Hypothesis;
use crate::parameters::{Column, Reference, Target};
use crate::search::Search;
use crate::search::standing::Converged;

/// Stretches of each run by which effects are suspected.
const STRETCHES: usize = 16;

/// Effects that are suspected beside the members of a set, at most.
const MOST: usize = 4;

/// Log likelihood that a step must promise: less cannot pay for its time and its prior.
const LEAST: f64 = 8.0;

/// Columns of a changing effect, at most.
const MOST_COLUMNS: usize = 4;

/// An effect whose amplitude may change.
#[derive(Debug, Clone)]
pub(crate) struct Suspect {
    pub id: &'static str,
    /// Its amplitudes that may change.
    pub columns: Vec<Column>,
    /// Ways in which it could have entered: evidence is shared among them.
    pub options: usize,
    /// It corrects the platform's own parameters, which are in every set: what it was before is theirs.
    pub is_base: bool,
}

impl Suspect {
    /// Whether it is a member of a set, or of the base model in every set.
    pub fn is_own(&self, at: &Converged) -> bool {
        at.names.iter().any(|name| name == self.id)
    }
}

/// Whether a column is an amplitude: its signal is in proportion to it.
fn is_amplitude(reference: &Reference, column: &Column) -> bool {
    let Target::Effect(effect) = column.target else { return false };
    let specs = effect.parameters(&reference.model);
    let is_scale = specs.get(column.index).is_some_and(|spec| spec.role == Role::Amplitude);
    is_scale && !column.quadratic && !column.is_shape
}

impl Search<'_> {
    /// Members of the best set for which a step promises anything.
    pub(crate) fn suggested_members(&self) -> Vec<String> {
        let members = self.best.names(&self.layout);
        let suggested = self.suggested(&self.best).into_iter().map(|(_, s)| s.id.to_owned());
        suggested.filter(|id| members.contains(id)).collect()
    }

    /// Members of a set, then, if not its own only, other effects that a change in the residual of the present regression
    /// suggests.
    pub(crate) fn suspects(&self, at: &Converged, own_only: bool) -> Vec<Suspect> {
        let reference = &self.problem.reference;
        let mut found = Vec::new();
        for member in &at.members {
            let Some(candidate) = at.layout.candidates.get(member.candidate) else { continue };
            let columns: Vec<Column> = member
                .columns
                .iter()
                .filter_map(|i| at.layout.columns.get(*i))
                .filter(|c| is_amplitude(reference, c) && c.origin.is_none())
                .cloned()
                .collect();
            if !columns.is_empty() && columns.len() <= MOST_COLUMNS {
                let (id, options) = (candidate.id, member.options);
                let is_base = candidate.effect.is_base();
                found.push(Suspect { id, columns, options, is_base });
            }
        }
        if own_only {
            return found;
        }
        let set = if at.names.is_empty() { &self.base } else { &self.best };
        let mut others = self.suggested(set);
        others.retain(|(_, s)| !s.is_own(at) && !self.best.names(&self.layout).iter().any(|n| n == s.id));
        others.truncate(MOST);
        found.extend(others.into_iter().map(|(_, suspect)| suspect));
        found
    }

    /// Effects for which a step of the amplitude promises log likelihood by the scores of the residual over stretches of
    /// time (the test of parameter constancy of Nyblom, Journal of the American Statistical Association 84, 1989), most
    /// first.
    fn suggested(&self, set: &Hypothesis) -> Vec<(f64, Suspect)> {
        let reference = &self.problem.reference;
        let scores = self.step_scores(set);
        let score = |i: &usize| scores.get(*i).copied().unwrap_or(0.0);
        let mut all = Vec::new();
        for candidate in &self.layout.candidates {
            let fits = |option: &&Vec<usize>| {
                option.len() <= MOST_COLUMNS
                    && option
                        .iter()
                        .all(|i| self.layout.columns.get(*i).is_some_and(|c| is_amplitude(reference, c)))
            };
            // Columns of one step are nearly independent: scores add up, and each pays for itself.
            let worth = |option: &Vec<usize>| option.iter().map(|i| score(i) - 2.0).sum::<f64>();
            let best = candidate
                .options
                .iter()
                .filter(fits)
                .map(|option| (worth(option), option))
                .max_by(|a, b| a.0.total_cmp(&b.0));
            let Some((worth, option)) = best else { continue };
            if worth < LEAST {
                continue;
            }
            let columns = option.iter().filter_map(|i| self.layout.columns.get(*i)).cloned().collect();
            let id = candidate.id;
            let (options, is_base) = (candidate.options.len(), candidate.effect.is_base());
            all.push((worth, Suspect { id, columns, options, is_base }));
        }
        all.sort_by(|a, b| b.0.total_cmp(&a.0));
        all
    }

    /// For each column, the log likelihood that its best step promises, nothing else being refitted.
    fn step_scores(&self, set: &Hypothesis) -> Vec<f64> {
        let count = self.layout.columns.len();
        let values = set.estimate.spread(count);
        let mut best = vec![0.0_f64; count];
        for whitened in &self.data.whitened {
            let residual = whitened.residual(&values);
            for (i, slot) in best.iter_mut().enumerate() {
                let (mut score, mut power) = ([0.0; STRETCHES], [0.0; STRETCHES]);
                whitened.column(i).zip(&residual).zip(&whitened.node).for_each(|((x, e), node)| {
                    let at = (*node as usize * STRETCHES / whitened.nodes.max(1)).min(STRETCHES - 1);
                    score[at] += x * e;
                    power[at] += x * x;
                });
                let promise = |stretches: std::ops::Range<usize>| {
                    let sum = |list: &[f64; STRETCHES]| list[stretches.clone()].iter().sum::<f64>();
                    let power = sum(&power);
                    if power > 0.0 { 0.5 * sum(&score).powi(2) / power } else { 0.0 }
                };
                for k in 0..STRETCHES {
                    *slot = slot.max(promise(k..STRETCHES)).max(promise(0..k));
                }
            }
        }
        best
    }
}
