//! From the sets that were fitted to the answer: a function of their posterior and of what remains.

use whorl_dynamics::effects::find;
use whorl_recording::Recording;

use crate::parameter_space::Target;
use crate::selection::prior::of_other_law;
use crate::selection::unlisted::{Unlisted, laws_beside};
use crate::selection::{Beside, Evaluated, Selection, is_excluded};
use crate::signals::lines::Lines;
use crate::signals::observed::{Applied, Observed, observed, remains};
use crate::signals::remains_of;
use crate::signals::{gimbals, pulses};
use crate::verdict::diagnosis::{
    BackgroundTorque, Candidate, Explanation, NextManoeuvre, SCHEMA, SlowResidual, Unknown, Verdict,
};
use crate::verdict::digits::digits_row;
use crate::verdict::missing_channels;
use crate::verdict::posterior::{Posterior, Weighted};
use crate::verdict::rows::rows;
use crate::verdict::runs::{contradiction, noise_remarks, noise_scales, odd_runs};
use crate::verdict::trace::{traced, unmodelled};
use crate::{Diagnosis, DiagnosisError, Options, Settings};

/// Deviations, over those of a certain line, from which a periodicity that no effect explains is one: beside no effect, and beside some, whose
/// formulas leave lines.
const PERIODIC: [f64; 2] = [1.5, 2.0];

/// The best set, and the runs as it leaves them.
struct Best<'s, 'a> {
    set: &'s Evaluated,
    /// `None`: it is that of no effects.
    observed: Option<(Vec<Observed<'a>>, Lines)>,
}

impl<'s, 'a> Best<'s, 'a> {
    fn of(selection: &'s Selection<'a>) -> Result<Self, DiagnosisError> {
        let set = selection.most_probable().unwrap_or(selection.base());
        if set.names().is_empty() {
            return Ok(Self { set, observed: None });
        }
        let observed = observed(&selection.runs, set)?;
        let reference = selection.runs.reference;
        let model = set.refit(reference).model_at(&set.fitted.at);
        let model = model.as_ref().unwrap_or(&reference.model);
        let lines = Lines::of(&observed, model, &selection.seen.turning, &reference.settings);
        Ok(Self { set, observed: Some((observed, lines)) })
    }

    fn left(&'s self, selection: &'s Selection<'a>) -> (&'s [Observed<'a>], &'s Lines) {
        match &self.observed {
            Some((observed, lines)) => (observed, lines),
            None => (&selection.observed, &selection.lines),
        }
    }
}

/// The answer of a selection; `given`: training and held-out runs as they were recorded, with readings that pile up at a limit.
pub(crate) fn answer(
    selection: &Selection<'_>,
    given: (&[Recording], &[Recording]),
    options: &Options,
) -> Result<Diagnosis, DiagnosisError> {
    let runs = &selection.runs;
    let (reference, settings) = (runs.reference, &runs.reference.settings);
    let best = Best::of(selection)?;
    let (left, lines) = best.left(selection);
    let applied_n_m = Applied::of(&selection.observed, &reference.model, settings.at_work_s).body_n_m();
    let beside = selection.beside(best.set, options)?;
    let excluded = |id: &str| is_excluded(options, id) || reference.model.effects.contains_key(id);
    let direct: Vec<Candidate> = digits_row(given.0, given.1, &reference.model, excluded)
        .into_iter()
        .chain(gimbals::row(left, &reference.model, settings.certain_stddevs, excluded))
        .chain(selection.seen.rows.iter().cloned())
        .collect();
    let laws = laws(selection, best.set, left, lines)?;
    let posterior = posterior(selection, best.set, &laws, lines, applied_n_m);
    let noise = noise_scales(runs, best.set)?;
    let mut remarks: Vec<String> =
        runs.training.iter().flat_map(|run| missing_channels(run, &reference.model)).collect();
    remarks.extend(noise_remarks(&noise, settings));
    let would_have_shown = could_have_seen(beside.as_ref(), settings);
    let mut verdict = posterior.verdict(would_have_shown);
    remarks.extend(direct.iter().map(|row| {
        let values = row.parameters.iter().map(|p| format!("{} = {:.4e} {}", p.name, p.estimate, p.unit));
        format!("{}: directly visible in the samples: {}", row.effect, values.collect::<Vec<_>>().join(", "))
    }));
    // Readings that pile up at a limit contradict the others by themselves.
    let contradicting = if direct.is_empty() { contradiction(runs, best.set) } else { None };
    let unknown = if contradicting.is_some() {
        remarks.push(
            "accelerometer and vector sensor contradict the gyro regardless of the torques: check the order, signs and units of the sensors' axes".to_owned(),
        );
        verdict = Verdict::Unknown;
        contradicting
    } else {
        posterior.all.iter().find_map(|w| w.unknown.clone()).filter(|_| posterior.unknown > 0.5)
    };
    let mut sets = named_sets(&posterior, verdict, unknown.is_some());
    // What the samples show directly is there, whatever else may be.
    if !direct.is_empty() && !matches!(verdict, Verdict::Named | Verdict::Confounded) {
        verdict = Verdict::Named;
        sets = vec![Vec::new()];
    }
    let mut explanations: Vec<Explanation> = posterior.all.iter().map(explanation).collect();
    if !direct.is_empty() && share_left(runs.training, given.0) < settings.least_within_range {
        remarks.push(format!(
            "{:.0} % of the gyro's readings are at the end of its range: those that are left were chosen by their values, and nothing is named by them.",
            100.0 * (1.0 - share_left(runs.training, given.0))
        ));
        verdict = Verdict::Named;
        sets = vec![Vec::new()];
        explanations.iter_mut().for_each(|explanation| explanation.effects.clear());
    }
    let states_names = matches!(verdict, Verdict::Named | Verdict::Confounded);
    let mut candidates = rows(selection, best.set, beside.as_ref());
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
    let fits = [selection.base(), best.set].into_iter().map(|set| {
        let names: Vec<String> = set.names().iter().map(|id| (*id).to_owned()).collect();
        Ok((names, set.fit(reference)?))
    });
    let fits = fits.collect::<Result<_, DiagnosisError>>()?;
    let by_run = beside.as_ref().map_or(&[][..], Beside::by_run);
    let diagnosis = Diagnosis {
        schema: SCHEMA,
        kind: kind_of(&effects),
        confounded_with: sets.into_iter().skip(1).collect(),
        effects,
        explanations,
        background: background(best.set),
        slow_residual: slow_residual(selection, best.set, left)?,
        odd_runs: odd_runs(runs, best.set, by_run, &noise),
        noise,
        unknown,
        next: advice(verdict, &candidates),
        verdict,
        would_have_shown,
        candidates,
        remarks,
        fitted: traced(selection, &posterior, applied_n_m),
        fits,
    };
    if let Some(remark) = pulses::pulses(left, &reference.model, settings) {
        return Ok(diagnosis.withheld(remark));
    }
    match implausible_inertia(selection, best.set).zip(runs.training.first()) {
        None => Ok(diagnosis),
        Some((what, first)) => {
            let other = DiagnosisError::OtherPlatform { run: first.name.clone(), what };
            // A missing effect that nothing explains may bias the model as much.
            if diagnosis.verdict != Verdict::Unknown {
                return Err(other);
            }
            let mut diagnosis = diagnosis;
            diagnosis.remarks.push(other.to_string());
            Ok(diagnosis)
        }
    }
}

/// Share of the gyro's readings that can be used.
fn share_left(usable: &[Recording], given: &[Recording]) -> f64 {
    let count = |runs: &[Recording]| runs.iter().map(|run| run.gyro_b_rad_s.len()).sum::<usize>() as f64;
    if count(given) > 0.0 { count(usable) / count(given) } else { 1.0 }
}

/// Laws beside the best set, and beside no effects: the best set may only look like what is missing. None where a set leaves nothing: what
/// is not there follows no law.
fn laws<'s>(
    selection: &'s Selection<'_>,
    best: &'s Evaluated,
    left: &[Observed<'_>],
    lines: &Lines,
) -> Result<Vec<(&'s Evaluated, Vec<Unlisted>)>, DiagnosisError> {
    let noticed = selection.runs.reference.settings.noticed_stddevs;
    let base = selection.base();
    let mut asked = vec![(best, left, lines)];
    if !best.names().is_empty() {
        asked.push((base, &selection.observed[..], &selection.lines));
    }
    asked.retain(|(_, left, _)| remains_of(left).significance() > noticed);
    let beside = |(set, left, lines): (&'s Evaluated, &[Observed<'_>], &Lines)| {
        Ok((set, laws_beside(&selection.runs, set, left, lines)?))
    };
    asked.into_iter().map(beside).collect()
}

/// The posterior given the data: over sets of the catalogue's effects, and unlisted laws beside the best of them and alone.
fn posterior(
    selection: &Selection<'_>,
    best: &Evaluated,
    laws: &[(&Evaluated, Vec<Unlisted>)],
    lines: &Lines,
    applied_n_m: f64,
) -> Posterior {
    let settings = &selection.runs.reference.settings;
    let names = |set: &Evaluated| set.names().iter().map(|id| (*id).to_owned()).collect::<Vec<String>>();
    let mut all: Vec<Weighted> = Vec::new();
    // A law must explain more than the shape errors of the set's own formulas leave.
    let explained = best.log_evidence - selection.base().log_evidence;
    for (set, list) in laws {
        let of_set = selection.log_posterior(set);
        let is_apart = |law: &&Unlisted| {
            let is_large =
                law.unknown.unit != "N m" || law.unknown.size > settings.background_share * applied_n_m;
            set.names().is_empty() || (is_large && law.gain > of_other_law(settings) * explained)
        };
        all.extend(list.iter().filter(is_apart).map(|law| Weighted {
            effects: names(set),
            unknown: Some(law.unknown.clone()),
            is_law: true,
            log_posterior: of_set + law.gain,
            probability: 0.0,
        }));
    }
    if let Some((unknown, log_evidence)) = periodicity(selection, best, lines) {
        all.push(Weighted {
            effects: names(best),
            unknown: Some(unknown),
            is_law: true,
            log_posterior: selection.log_posterior(best) + settings.unmodelled.ln() + log_evidence,
            probability: 0.0,
        });
    }
    all.extend(selection.evaluated.iter().filter(|set| selection.is_admissible(set)).map(|set| Weighted {
        effects: names(set),
        unknown: unmodelled(set, settings, applied_n_m),
        is_law: false,
        log_posterior: selection.log_posterior(set),
        probability: 0.0,
    }));
    Posterior::new(all, settings)
}

/// A periodicity that no effect explains, and its log evidence: the height of the peak as that of a normal variable, less the number of
/// frequencies at which it might have been.
fn periodicity(selection: &Selection<'_>, best: &Evaluated, lines: &Lines) -> Option<(Unknown, f64)> {
    let least = PERIODIC[usize::from(!best.names().is_empty())];
    if lines.strongest < least * selection.runs.reference.settings.certain_stddevs {
        return None;
    }
    let wheels = selection.runs.reference.model.wheels();
    let (variable, frequency_hz) = match lines.orders.first() {
        Some((wheel, _)) => {
            (format!("{}_angle", wheels.get(*wheel).map_or("wheel", |w| w.name.as_str())), None)
        }
        None => ("time".to_owned(), lines.hz.first().copied()),
    };
    let unknown = Unknown { variable, frequency_hz, ..Unknown::torque_in_time(0.0) };
    Some((unknown, 0.5 * lines.strongest.powi(2) - lines.frequencies.ln()))
}

/// Sets that the answer names, most probable first.
fn named_sets(posterior: &Posterior, verdict: Verdict, with_unknown: bool) -> Vec<Vec<String>> {
    match verdict {
        Verdict::Named if with_unknown => vec![posterior.included()],
        Verdict::Named => posterior.contenders().into_iter().take(1).collect(),
        Verdict::Confounded if posterior.nothing < 0.5 => posterior.contenders(),
        _ => Vec::new(),
    }
}

/// Whether effects of ordinary size would have shown.
fn could_have_seen(beside: Option<&Beside<'_>>, settings: &Settings) -> bool {
    let Some(beside) = beside else { return false };
    let is_other = |id: &&str| find(id).is_some_and(|effect| !effect.is_base());
    let tested: Vec<&str> = beside.effects().filter(is_other).collect();
    let seen = tested.iter().filter(|id| beside.detectability(id) > settings.clear_misfit).count();
    !tested.is_empty() && seen * 2 >= tested.len()
}

fn kind_of(effects: &[String]) -> Option<String> {
    effects.first().and_then(|id| find(id)).map(|effect| effect.info().kind.to_string())
}

fn background(set: &Evaluated) -> BackgroundTorque {
    let size = |of: &whorl_prediction::RandomTorque| of.stddev_b_n_m.iter().map(|x| x * x).sum::<f64>();
    let all = set.fitted.followed.iter().flat_map(|run| &run.noise.disturbance.body);
    let strongest = all.max_by(|a, b| size(a).total_cmp(&size(b)));
    BackgroundTorque {
        stddev_n_m: set.torque_n_m(),
        correlation_s: strongest.map_or(0.0, |of| of.correlation_s),
    }
}

/// What the platform's own parameters alone and the best set leave.
fn slow_residual(
    selection: &Selection<'_>,
    best: &Evaluated,
    left: &[Observed<'_>],
) -> Result<SlowResidual, DiagnosisError> {
    let runs = &selection.runs;
    let held = |set: &Evaluated| -> Result<Option<f64>, DiagnosisError> {
        if runs.held_out.is_empty() {
            return Ok(None);
        }
        Ok(Some(remains(runs, runs.held_out, &set.held_out, set)?.times_the_noise()))
    };
    Ok(SlowResidual {
        before: remains_of(&selection.observed).times_the_noise(),
        after: remains_of(left).times_the_noise(),
        held_out_before: held(selection.base())?,
        held_out_after: held(best)?,
    })
}

/// The moment of inertia that the best explanation has moved to an implausible value, if one is: data of another platform
/// bias the model until some effect is named, and that effect is not what the model lacks.
fn implausible_inertia(selection: &Selection<'_>, best: &Evaluated) -> Option<String> {
    let (reference, settings) = (selection.runs.reference, &selection.runs.reference.settings);
    let inertia = reference.model.mass_properties.inertia_b_kg_m2();
    best.columns.iter().zip(&best.fitted.at).find_map(|(column, units)| {
        let Target::Moment(axis) = column.target else { return None };
        let given = inertia[(axis, axis)];
        let stddev = reference.prior.inertia_b_kg_m2[(axis, axis)].max(settings.least_inertia_share * given);
        let moved = units * column.scale;
        (moved.abs() > settings.other_platform_stddevs * stddev).then(|| {
            let name = ["xx", "yy", "zz"].get(axis).copied().unwrap_or("zz");
            format!(
                "the fit requires a moment of inertia {name} of {:.2} kg m^2, but the model says {given:.2} +- {stddev:.2}",
                given + moved
            )
        })
    })
}

/// Advice of the catalogue on how to separate the remaining explanations.
pub(super) fn advice(verdict: Verdict, candidates: &[Candidate]) -> Option<NextManoeuvre> {
    let text = match verdict {
        Verdict::Confounded => find(&candidates.first()?.effect)?.info().separated_by.to_owned(),
        Verdict::NotEnoughInformation => {
            "record several minutes with wheels driven by a multisine, single pulses of every jet, a coast-down over 10:1 in yaw rate and free swings to both sides".to_owned()
        }
        Verdict::Unknown => "repeat the run with one actuator at a time, and once at rest".to_owned(),
        _ => return None,
    };
    let odds = candidates.first().map_or(0.0, |c| c.detectability * 0.5);
    Some(NextManoeuvre { manoeuvre: text, expected_log_odds: odds })
}

fn explanation(weighted: &Weighted) -> Explanation {
    Explanation {
        effects: weighted.effects.clone(),
        with_unknown: weighted.unknown.is_some(),
        probability: weighted.probability,
    }
}

/// Adds up explanations that hold the same, most probable first.
pub(super) fn merge(explanations: &mut Vec<Explanation>) {
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
