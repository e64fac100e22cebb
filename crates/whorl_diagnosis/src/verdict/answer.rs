//! From the search's result to the answer.

use std::collections::BTreeMap;

use whorl_dynamics::effects::find;
use whorl_math::statistics::median;
use whorl_recording::{Channel, Component, Recording};

use crate::diagnosis::{BackgroundTorque, Candidate, Explanation, NoiseScale, SlowResidual, Unknown};
use crate::evidence::problem::{Dataset, Problem};
use crate::evidence::regression::BLOCKS_PER_RUN;
use crate::explanations::hypothesis::Hypothesis;
use crate::explanations::vibration::fast_effects;
use crate::search::Search;
use crate::search::prior::{log_prior, of_other_law};
use crate::search::residual::{momentum_rms, residual_powers, worst};
use crate::search::score::Converged;
use crate::search::step::point_of;
use crate::search::unmodelled::Unmodelled;
use crate::verdict::posterior::{Posterior, Weighted};
use crate::{Diagnosis, DiagnosisError, NextManoeuvre, SCHEMA, Verdict};

impl Search<'_> {
    /// The slow residual before and after.
    pub(crate) fn slow_residual(&self) -> SlowResidual {
        let rms = |problem: &Problem, data: &Dataset, hypothesis: &Hypothesis| {
            momentum_rms(&residual_powers(problem, data, &self.design, hypothesis))
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

    /// Admissible sets, each with its weight.
    fn evaluated_sets(&self) -> Vec<Weighted> {
        let weighted = |set: &Converged| Weighted {
            effects: set.names.clone(),
            unknown: self.large_background(set),
            is_law: false,
            log_posterior: set.log_posterior(),
            probability: 0.0,
        };
        self.admissible().map(weighted).collect()
    }

    /// A slow random torque that is more than background: what the samples show beside a set, or bins where they were not asked.
    pub(crate) fn large_background(&self, set: &Converged) -> Option<Unknown> {
        let of_bins = || self.problem.background(set.score.nuisance).stddev_n_m;
        let stddev_n_m = set.judged.as_ref().map_or_else(of_bins, |judged| judged.fit.torque_n_m());
        self.problem.is_large_torque(stddev_n_m).then(|| Unknown::torque_in_time(stddev_n_m))
    }

    /// The posterior given the data: over sets of the catalogue's effects, and where something is left, unmodelled laws
    /// beside the best of them and alone.
    fn posterior(&mut self, left: f64, training: &[Recording]) -> Result<Posterior, DiagnosisError> {
        let options = self.options;
        let settings = &options.settings;
        // A likeliest relative error of the formulas above this calls for a comparison with unmodelled laws.
        let rough = 0.5 * settings.model_discrepancies.last().copied().unwrap_or(0.0);
        let mut all = Vec::new();
        let score = self.score(&self.best);
        let periodicity = self.periodicity();
        let best = self.fitted(&self.best).map(Converged::log_posterior);
        if let (Some((unknown, log_evidence)), Some(best)) = (periodicity.clone(), best) {
            all.push(Weighted {
                effects: self.best.names(&self.design),
                unknown: Some(unknown),
                is_law: true,
                log_posterior: best + settings.unmodelled.ln() + log_evidence,
                probability: 0.0,
            });
        }
        let is_clean = score.is_some_and(|s| s.nuisance.torque == 0 && s.relative_error < rough)
            && left < settings.noticed_stddevs
            && periodicity.is_none()
            // Errors of sensors may come and go too fast to leave a slow residual.
            && !self.best.terms.is_empty()
            // A line may be that of a torque of another kind, although nothing slow is left.
            && !self.best.names(&self.design).iter().any(|id| find(id).is_some_and(|e| e.periodicity().is_some()));
        if !is_clean {
            self.lines = crate::explanations::spectrum::lines(self.place(), &self.best);
            let mut anchors = vec![self.best.clone()];
            // And alone, if something is left beside it: then the best set may only look like what is missing.
            if !self.best.terms.is_empty() {
                anchors.push(self.base.clone());
            }
            for anchor in &anchors {
                let Some(at) = self.fitted(anchor).cloned() else { continue };
                let laws = self.laws_beside(&at, training)?;
                let gains =
                    |law: &Unmodelled| law.log_evidence - at.score.log_evidence > -settings.doubt_nats;
                let leaves_nothing = !laws.iter().any(gains);
                let explained = at.score.log_evidence
                    - self.score(&self.base).map_or(f64::INFINITY, |base| base.log_evidence);
                // The residual of a set is taken for another law only where it exceeds the leakage of the set's own formulas.
                let least_n_m = settings.background_share * self.problem.torques.body_n_m;
                let is_apart = |law: &Unmodelled| {
                    let is_large = law.unknown.unit != "N m" || law.unknown.size > least_n_m;
                    let gain = law.log_evidence - at.score.log_evidence;
                    at.names.is_empty() || (is_large && gain > of_other_law(settings) * explained)
                };
                all.extend(laws.into_iter().filter(is_apart).map(|law| Weighted {
                    log_posterior: law.log_evidence + log_prior(&law.beside, settings),
                    effects: law.beside,
                    unknown: Some(law.unknown),
                    is_law: true,
                    probability: 0.0,
                }));
                if leaves_nothing {
                    break;
                }
            }
        }
        all.extend(self.evaluated_sets());
        Ok(Posterior::new(all, settings))
    }

    /// Noise of each channel of each run over what the model states. Innovations smaller than the measured noise do not lower it.
    fn noise_scales(&self) -> Vec<NoiseScale> {
        let mut scales = Vec::new();
        for ((run, whitened), ar_models) in
            self.problem.runs.iter().zip(&self.data.whitened).zip(&self.data.ar_models)
        {
            let mut channels: BTreeMap<Component, Vec<f64>> = BTreeMap::new();
            let mut components: Vec<Component> = whitened.reading.clone();
            components.sort_unstable();
            components.dedup();
            for (component, ar_model) in components.iter().zip(ar_models) {
                let ratio = match component.channel {
                    Channel::Gyro => run.noise.gyro_ratio,
                    Channel::Accelerometer => run.noise.accel_ratio,
                    Channel::WheelSpeed => run.noise.wheel_ratio,
                    _ => 1.0,
                };
                let whole = Component::new(component.channel, component.sensor(), 0);
                channels.entry(whole).or_default().push(ratio * ar_model.power.max(1.0).sqrt());
            }
            scales.extend(channels.into_iter().map(|(component, list)| NoiseScale {
                run: run.name.clone(),
                channel: component.channel.info().key.to_owned(),
                scale: list.iter().sum::<f64>() / list.len().max(1) as f64,
            }));
        }
        scales
    }

    /// Runs that disagree with the others: a fit to the others does not predict them, or they need a noise far from what
    /// is stated and from what the others need.
    fn odd_runs(&self, noise: &[NoiseScale]) -> Vec<String> {
        let settings = &self.options.settings;
        let runs = self.problem.runs.len();
        if runs < 3 {
            return Vec::new();
        }
        let mut odd = Vec::new();
        let mut total = crate::evidence::regression::Normal::zeros(self.design.columns.len());
        self.data.blocks.iter().for_each(|block| total.add(block, 1.0));
        for (r, run) in self.problem.runs.iter().enumerate() {
            // Fitted without the run, does the model predict it as well as a fit that has seen it?
            let blocks = &self.data.blocks[r * BLOCKS_PER_RUN..(r + 1) * BLOCKS_PER_RUN];
            let mut others = total.clone();
            let mut own = crate::evidence::regression::Normal::zeros(self.design.columns.len());
            for block in blocks {
                others.add(block, -1.0);
                own.add(block, 1.0);
            }
            let fits = [&total, &others, &own].map(|data| self.best.refitted(&self.design, data));
            let [Some(of_all), Some(of_others), Some(of_own)] = &fits else { continue };
            let parameters = of_all.estimate.active.len() as f64;
            // What is known from the others counts as far as it is known.
            let disagreement = of_others.estimate.drop + of_own.estimate.drop - of_all.estimate.drop;
            let of_noise = noise
                .iter()
                .filter(|n| n.run == run.name)
                .map(|n| {
                    let others = noise.iter().filter(|o| o.channel == n.channel && o.run != n.run);
                    let usual = median(others.map(|o| o.scale.ln())).max(0.0);
                    (n.scale.ln() - usual) / settings.noise_factor.ln()
                })
                .fold(0.0, f64::max);
            if disagreement > 2.0 * (parameters + settings.clear_misfit)
                || of_noise > settings.noticed_stddevs
            {
                odd.push((disagreement.max(of_noise), run.name.clone()));
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
    pub(crate) fn answer(&mut self, training: &[Recording]) -> Result<Diagnosis, DiagnosisError> {
        let mut candidates = self.rows();
        let slow_residual = self.slow_residual();
        let before = residual_powers(self.problem, &self.data, &self.design, &self.base);
        let after = residual_powers(self.problem, &self.data, &self.design, &self.best);
        let worst_before = worst(&before);
        let share = if before[worst_before].excess() > 0.0 {
            1.0 - after[worst_before].excess().max(0.0) / before[worst_before].excess()
        } else {
            1.0
        };
        let left = after[worst(&after)].significance();
        let noise = self.noise_scales();
        let odd_runs = self.odd_runs(&noise);
        let mut remarks: Vec<String> =
            self.problem.runs.iter().flat_map(|r| r.remarks.iter().cloned()).collect();
        let mut direct: Vec<Candidate> = self.digital().into_iter().chain(self.gimbal_drag()).collect();
        let at = point_of(self.problem, &self.design, &self.point, &self.best);
        let seen = fast_effects(self.place(), &at, &self.options.exclude);
        self.turning = seen.turning;
        direct.extend(seen.rows);
        let contradiction = self.contradiction();
        let posterior = self.posterior(left, training)?;
        let fitted = self.traced(&posterior);
        let mut verdict = posterior.verdict(self.could_have_seen());
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
        let unknown = if contradiction.is_some() {
            direct.clear();
            remarks.push(
                "accelerometer and vector sensor contradict the gyro regardless of the torques: check the order, signs and units of the sensors' axes".to_owned(),
            );
            verdict = Verdict::Unknown;
            contradiction
        } else {
            posterior.all.iter().find_map(|w| w.unknown.clone()).filter(|_| verdict == Verdict::Unknown)
        };
        let contenders = posterior.contenders();
        if !direct.is_empty() && matches!(verdict, Verdict::NothingMissing | Verdict::NotEnoughInformation) {
            verdict = Verdict::Named;
        }
        let states_names = matches!(verdict, Verdict::Named | Verdict::Confounded);
        let named = states_names && posterior.nothing < 0.5;
        let mut sets: Vec<Vec<String>> = if named { contenders } else { Vec::new() };
        if verdict == Verdict::Named {
            sets.truncate(1);
        }
        if sets.is_empty() && states_names {
            sets.push(Vec::new());
        }
        let mut explanations: Vec<Explanation> = posterior.all.iter().map(Explanation::of).collect();
        for row in direct.iter().filter(|_| states_names) {
            for set in sets.iter_mut().chain(explanations.iter_mut().map(|e| &mut e.effects)) {
                if !set.contains(&row.effect) {
                    set.push(row.effect.clone());
                    set.sort();
                }
            }
            candidates.retain(|c| c.effect != row.effect);
            candidates.insert(0, row.clone());
        }
        merge(&mut explanations);
        let effects = sets.first().cloned().unwrap_or_default();
        for row in candidates.iter_mut().filter(|row| effects.contains(&row.effect)) {
            // What takes its place in another set that is left.
            let others = sets.iter().skip(1).filter(|set| !set.contains(&row.effect)).flatten();
            let mut list: Vec<String> = others.filter(|id| !effects.contains(id)).cloned().collect();
            list.sort();
            list.dedup();
            row.indistinguishable_from = list;
        }
        if left > self.options.settings.real_rest_stddevs && verdict == Verdict::Named {
            remarks.push(format!(
                "{:.0} % of the excess remains unexplained, above the noise",
                100.0 * (1.0 - share)
            ));
        }
        let kind = match effects.as_slice() {
            [one] => crate::explanations::candidates::effect(one).map(|e| e.info().kind.to_string()),
            [] => None,
            _ => self.kind(),
        };
        let score = self.score(&self.best);
        let background = score.map(|s| self.problem.background(s.nuisance)).unwrap_or_default();
        Ok(Diagnosis {
            schema: SCHEMA,
            verdict,
            kind,
            confounded_with: sets.into_iter().skip(1).collect(),
            effects,
            explanations,
            background: BackgroundTorque {
                stddev_n_m: background.stddev_n_m,
                correlation_s: background.correlation_s,
            },
            formula_error: score.map_or(0.0, |s| s.relative_error),
            noise,
            unknown,
            slow_residual,
            odd_runs,
            next: self.advice(verdict, &candidates),
            candidates,
            remarks,
            fitted,
            fits: BTreeMap::new(),
        })
    }

    /// Whether effects of ordinary size would have shown.
    fn could_have_seen(&self) -> bool {
        let normal = &self.data.total;
        let (mut seen, mut tested) = (0, 0);
        for candidate in &self.design.candidates {
            let Some(columns) = candidate.options.first() else { continue };
            if candidate.effect.is_base() {
                continue;
            }
            tested += 1;
            let largest =
                columns.iter().filter_map(|i| self.design.detectability(normal, *i)).fold(0.0, f64::max);
            if largest > self.options.settings.clear_misfit {
                seen += 1;
            }
        }
        tested > 0 && seen * 2 >= tested
    }

    /// Advice of the catalogue on how to separate the remaining explanations.
    fn advice(&self, verdict: Verdict, candidates: &[Candidate]) -> Option<NextManoeuvre> {
        let text = match verdict {
            Verdict::Confounded => {
                let first = candidates.first()?;
                crate::explanations::candidates::effect(&first.effect)?.info().separated_by.to_owned()
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

impl Explanation {
    fn of(weighted: &Weighted) -> Self {
        Self {
            effects: weighted.effects.clone(),
            with_unknown: weighted.unknown.is_some(),
            probability: weighted.probability,
        }
    }
}

/// Adds up explanations that hold the same, most probable first.
fn merge(explanations: &mut Vec<Explanation>) {
    let mut merged: Vec<Explanation> = Vec::new();
    for one in explanations.drain(..) {
        match merged.iter_mut().find(|m| m.effects == one.effects && m.with_unknown == one.with_unknown) {
            Some(same) => same.probability += one.probability,
            None => merged.push(one),
        }
    }
    merged.sort_by(|a, b| b.probability.total_cmp(&a.probability));
    *explanations = merged;
}
