//! From the search's result to the answer.

use crate::adequacy::REAL_REST;
use crate::candidates::Layout;
use crate::diagnosis::{Candidate, ParameterEstimate, SlowResidual};
use crate::excess::{Power, WINDOWS_S, powers};
use crate::hypothesis::Hypothesis;
use crate::problem::{Dataset, Problem};
use crate::regression::{BLOCKS_PER_RUN, Estimate};
use crate::search::{LEAST_DROP, Search};
use crate::{Diagnosis, NextManoeuvre, SCHEMA, Verdict};

/// Log evidence of one candidate below which nothing is taken to be missing.
const FAINT: f64 = 5.0;

/// Slow power of all runs with a hypothesis.
pub(crate) fn rest(
    problem: &Problem,
    data: &Dataset,
    layout: &Layout,
    hypothesis: &Hypothesis,
) -> [Power; WINDOWS_S.len()] {
    let mut total = [Power::default(); WINDOWS_S.len()];
    for of_run in rest_by_run(problem, data, layout, hypothesis) {
        for (sum, power) in total.iter_mut().zip(of_run) {
            sum.add(power);
        }
    }
    total
}

fn rest_by_run(
    problem: &Problem,
    data: &Dataset,
    layout: &Layout,
    hypothesis: &Hypothesis,
) -> Vec<[Power; WINDOWS_S.len()]> {
    let estimate = hypothesis.estimate.spread(layout.columns.len());
    problem
        .runs
        .iter()
        .zip(&data.whitened)
        .map(|(run, whitened)| {
            let duration_s = run.time(run.nodes() - 1) - run.time(0);
            powers(whitened, &whitened.residual(&estimate), duration_s)
        })
        .collect()
}

/// Two windows, short and long: the whitened momentum residual.
fn momentum_rms(powers: &[Power; WINDOWS_S.len()]) -> f64 {
    let mut both = Power::default();
    for (power, window_s) in powers.iter().zip(WINDOWS_S) {
        if window_s == 1.0 || window_s == 8.0 {
            both.add(*power);
        }
    }
    both.rms()
}

/// The most significant window.
pub(crate) fn worst(powers: &[Power; WINDOWS_S.len()]) -> usize {
    let mut best = 0;
    for (i, power) in powers.iter().enumerate() {
        if power.significance() > powers[best].significance() {
            best = i;
        }
    }
    best
}

impl Search<'_> {
    /// The slow residual before and after.
    pub(crate) fn slow_residual(&self) -> SlowResidual {
        let rms = |problem: &Problem, data: &Dataset, hypothesis: &Hypothesis| {
            momentum_rms(&rest(problem, data, &self.layout, hypothesis))
        };
        let held = |hypothesis: &Hypothesis| match (&self.held_out, &self.held_data) {
            (Some(problem), Some(data)) => Some(rms(problem, data, hypothesis)),
            _ => None,
        };
        SlowResidual {
            before: rms(self.problem, &self.data, &self.base),
            after: rms(self.problem, &self.data, &self.best),
            held_out_before: held(&self.base),
            held_out_after: held(&self.best),
        }
    }

    /// One row of the table for a hypothesis' last member, against the hypothesis without it.
    fn row(&self, with: &Hypothesis, without: &Hypothesis, member: usize) -> Option<Candidate> {
        let member = with.members.get(member)?;
        let candidate = self.layout.candidates.get(member.candidate)?;
        let covariance = with.estimate.covariance();
        let mut parameters: Vec<ParameterEstimate> = Vec::new();
        for &i in &member.columns {
            let column = self.layout.columns.get(i)?;
            let Some(at) = with.estimate.active.iter().position(|a| *a == i) else { continue };
            let stddev = (covariance[(at, at)].max(0.0) * self.data.temper).sqrt();
            let own = self.estimate_of(column, with.estimate.value[at], stddev);
            // Sine and cosine of one amplitude.
            if let Some(sine) = parameters.iter_mut().find(|p| p.name == column.name) {
                sine.estimate = sine.estimate.hypot(own.estimate);
                sine.stddev = sine.stddev.max(own.stddev);
                continue;
            }
            parameters.push(own);
        }
        let (evidence, drop) = self.advantage(with, without);
        let rows = self.data.total.rows;
        // Where nothing is named, what is within chance is no excess.
        let chance = if self.best.members.is_empty() { 3.0 * (2.0 * rows).sqrt() } else { 1.0 };
        let excess = (self.data.total.sum_of_squares - self.base.estimate.drop - rows)
            .max(chance)
            .max(self.advantage(&self.best, &self.base).1)
            .max(drop);
        Some(Candidate {
            effect: candidate.id.to_owned(),
            delta_log_evidence: evidence,
            held_out_gain: self.gain(with, without),
            share_of_excess: (drop / excess).clamp(0.0, 1.0),
            swallowed_by_base: self.swallowed(&member.columns, with),
            detectability: drop.max(0.0),
            indistinguishable_from: Vec::new(),
            parameters,
        })
    }

    /// Share of a signal that refitting the base would swallow.
    fn swallowed(&self, columns: &[usize], fit: &Hypothesis) -> f64 {
        let normal = &self.data.total;
        let mut alone = 0.0;
        for &i in columns {
            for &j in columns {
                alone += fit.estimate.of(i) * normal.matrix[(i, j)] * fit.estimate.of(j);
            }
        }
        // What is left of the signal when the base follows it as well as it can within its prior.
        let mut signal = crate::regression::Normal::zeros(self.layout.columns.len());
        for a in 0..self.layout.columns.len() {
            signal.vector[a] = columns.iter().map(|j| normal.matrix[(a, *j)] * fit.estimate.of(*j)).sum();
        }
        signal.matrix.copy_from(&normal.matrix);
        let base: Vec<usize> = self.layout.base.iter().copied().filter(|i| !columns.contains(i)).collect();
        let followed =
            Estimate::new(&signal, &base, |i| self.layout.base_variance(i)).map_or(0.0, |e| e.drop);
        if alone > 0.0 { (followed / alone).clamp(0.0, 1.0) } else { 0.0 }
    }

    /// The last effect of each hypothesis.
    fn last_effects<'h>(&self, sets: impl IntoIterator<Item = &'h Hypothesis>) -> Vec<String> {
        sets.into_iter()
            .filter_map(|h| self.layout.candidates.get(h.members.last()?.candidate))
            .map(|c| c.id.to_owned())
            .collect()
    }

    /// Effects that these data cannot tell from the last one of `one`, where neither is strong enough to be named.
    fn as_good_as(&self, one: &Hypothesis, all: &[Hypothesis]) -> Vec<String> {
        let tie = self.tie(self.advantage(one, &self.best).1);
        let own = one.names(&self.layout);
        self.last_effects(
            all.iter().filter(|h| h.names(&self.layout) != own && self.advantage(h, one).0.abs() < tie),
        )
    }

    /// Runs that disagree with the others.
    fn odd_runs(&self) -> Vec<String> {
        let runs = self.problem.runs.len();
        if runs < 3 {
            return Vec::new();
        }
        let mut odd = Vec::new();
        let powers = rest_by_run(self.problem, &self.data, &self.layout, &self.best);
        let significance: Vec<f64> =
            powers.iter().map(|p| p.iter().map(Power::significance).fold(0.0, f64::max)).collect();
        for (r, run) in self.problem.runs.iter().enumerate() {
            // Fitted without the run, does the model predict it as well as a fit that has seen it?
            let blocks = &self.data.blocks[r * BLOCKS_PER_RUN..(r + 1) * BLOCKS_PER_RUN];
            let mut others = self.data.total.clone();
            let mut own = crate::regression::Normal::zeros(self.layout.columns.len());
            for block in blocks {
                others.add(block, -1.0);
                own.add(block, 1.0);
            }
            let Some(from_others) = self.best.refitted(&self.layout, &others) else { continue };
            let Some(from_own) = self.best.refitted(&self.layout, &own) else { continue };
            let parameters = from_others.estimate.active.len() as f64;
            let disagreement =
                from_others.estimate.misfit_change(&own) - from_own.estimate.misfit_change(&own);
            let rest = significance.get(r).copied().unwrap_or(0.0);
            let usual =
                significance.iter().enumerate().filter(|(i, _)| *i != r).map(|(_, s)| *s).fold(0.0, f64::max);
            let stands_out = rest > REAL_REST && rest > 3.0 * usual.max(1.0);
            if disagreement > 6.0 * parameters + 60.0 || stands_out {
                odd.push((disagreement.max(rest), run.name.clone()));
            }
        }
        // If most runs disagree, none of them is the odd one.
        if odd.len() * 2 >= runs {
            odd.sort_by(|a, b| b.0.total_cmp(&a.0));
            let strongest = odd.first().cloned();
            let second = odd.get(1).map_or(0.0, |o| o.0);
            odd = strongest.filter(|s| s.0 > 3.0 * second).into_iter().collect();
        }
        odd.into_iter().map(|(_, name)| name).collect()
    }

    /// The answer.
    pub(crate) fn answer(&mut self) -> Diagnosis {
        self.rest = self.rest_of_best();
        let mut candidates: Vec<Candidate> = Vec::new();
        let mut rivals: Vec<Hypothesis> = Vec::new();
        for member in 0..self.best.members.len() {
            if let Some(rest) = self.best.without(&self.layout, &self.data.total, member)
                && let Some(mut row) = self.row(&self.best, &rest, member)
            {
                if let Some(parameters) = self.averaged(&self.best, member) {
                    row.parameters = parameters;
                }
                let of_member = self.rivals_of(member);
                row.indistinguishable_from = self.last_effects(&of_member);
                rivals.extend(of_member);
                candidates.push(row);
            }
        }
        let additions = self.additions(&self.best);
        for addition in &additions {
            let last = addition.members.len().saturating_sub(1);
            if let Some(mut row) = self.row(addition, &self.best, last) {
                if self.best.members.is_empty() && row.detectability > LEAST_DROP {
                    row.indistinguishable_from = self.as_good_as(addition, &additions);
                }
                candidates.push(row);
            }
        }
        let names = self.best.names(&self.layout);
        let mut alternatives = self.alternatives(&rivals);
        let slow_residual = self.slow_residual();
        let before = rest(self.problem, &self.data, &self.layout, &self.base);
        let after = rest(self.problem, &self.data, &self.layout, &self.best);
        let worst_before = worst(&before);
        let share = if before[worst_before].excess() > 0.0 {
            1.0 - after[worst_before].excess().max(0.0) / before[worst_before].excess()
        } else {
            1.0
        };
        let left = after[worst(&after)].significance();
        let mut remarks: Vec<String> =
            self.problem.runs.iter().flat_map(|r| r.remarks.iter().cloned()).collect();
        let mut direct: Vec<Candidate> = self.digital().into_iter().collect();
        direct.extend(crate::vibration::fast_effects(self));
        let adequacy = self.adequacy(&names, left, share);
        for row in &direct {
            remarks.push(format!(
                "{}: directly visible in the samples: {}",
                row.effect,
                row.parameters
                    .iter()
                    .map(|p| format!("{} = {:.4e} {}", p.name, p.estimate, p.unit))
                    .collect::<Vec<_>>()
                    .join(", ")
            ));
        }
        let contradiction = self.contradiction();
        let rhythm = if direct.is_empty() { self.rhythm() } else { None };
        let verdict = if contradiction.is_some() {
            direct.clear();
            remarks.push(
                "accelerometer and vector sensor contradict the gyro regardless of the torques: check the order, signs and units of the sensors' axes".to_owned(),
            );
            Verdict::Unknown
        } else if !direct.is_empty() {
            if alternatives.is_empty() { Verdict::Named } else { Verdict::Confounded }
        } else if adequacy.unexplained || rhythm.is_some() {
            Verdict::Unknown
        } else if !self.best.members.is_empty() {
            if alternatives.is_empty() { Verdict::Named } else { Verdict::Confounded }
        } else if self.could_have_seen() {
            let strongest = additions.first().map_or(0.0, |h| h.log_evidence - self.base.log_evidence);
            if strongest > FAINT * self.data.temper {
                Verdict::NotEnoughInformation
            } else {
                Verdict::NothingMissing
            }
        } else {
            Verdict::NotEnoughInformation
        };
        if !self.best.members.is_empty() && left > REAL_REST && !adequacy.unexplained {
            remarks.push(format!(
                "{:.0} % of the excess remains unexplained, above the noise",
                100.0 * (1.0 - share)
            ));
        }
        let follower =
            adequacy.follower.filter(|_| adequacy.unexplained || rhythm.is_none()).map(|f| f.unknown);
        let unknown = contradiction.or(follower).or(rhythm).filter(|_| verdict == Verdict::Unknown);
        let mut effects = if verdict == Verdict::Unknown { Vec::new() } else { names };
        let mut kind = self.kind();
        for row in direct {
            if !effects.contains(&row.effect) {
                effects.push(row.effect.clone());
                effects.sort();
            }
            for set in &mut alternatives {
                if !set.contains(&row.effect) {
                    set.push(row.effect.clone());
                    set.sort();
                }
            }
            if effects.len() == 1 {
                kind = crate::candidates::effect(&row.effect).map(|e| e.info().kind.to_string());
            }
            candidates.retain(|c| c.effect != row.effect);
            candidates.insert(0, row);
        }
        alternatives.retain(|set| *set != effects);
        if verdict == Verdict::Unknown {
            kind = None;
        }
        Diagnosis {
            schema: SCHEMA,
            verdict,
            kind,
            confounded_with: if verdict == Verdict::Confounded { alternatives } else { Vec::new() },
            effects,
            unknown,
            slow_residual,
            odd_runs: self.odd_runs(),
            next: self.advice(verdict, &candidates),
            candidates,
            remarks,
        }
    }

    /// Whether effects of ordinary size would have shown.
    fn could_have_seen(&self) -> bool {
        let normal = &self.data.total;
        let (mut seen, mut tested) = (0, 0);
        for candidate in &self.layout.candidates {
            let Some(columns) = candidate.options.first() else { continue };
            if candidate.effect.is_base() {
                continue;
            }
            tested += 1;
            let largest = columns
                .iter()
                .filter_map(|i| {
                    let mut active = self.layout.base.clone();
                    active.push(*i);
                    let fit = Estimate::new(normal, &active, |c| {
                        if c == *i { 1e6 } else { self.layout.base_variance(c) }
                    })?;
                    let stddev2 = fit.covariance()[(active.len() - 1, active.len() - 1)];
                    (stddev2 > 0.0).then(|| 1.0 / stddev2)
                })
                .fold(0.0, f64::max);
            if largest > LEAST_DROP {
                seen += 1;
            }
        }
        tested > 0 && seen * 2 >= tested
    }

    /// What the catalogue says separates what is left.
    fn advice(&self, verdict: Verdict, candidates: &[Candidate]) -> Option<NextManoeuvre> {
        let text = match verdict {
            Verdict::Confounded => {
                let first = candidates.first()?;
                crate::candidates::effect(&first.effect)?.info().separated_by.to_owned()
            }
            Verdict::NotEnoughInformation => {
                "record several minutes with wheels driven by a multisine, single pulses of every jet, a coast-down over 10:1 in yaw rate and free swings to both sides".to_owned()
            }
            Verdict::Unknown => "repeat the run with one actuator at a time, and once at rest".to_owned(),
            _ => return None,
        };
        let odds = candidates.first().map_or(0.0, |c| c.detectability * 0.5);
        Some(NextManoeuvre { manoeuvre: text, expected_log_odds: odds })
    }
}
