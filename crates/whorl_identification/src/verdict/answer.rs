//! From the sets that were fitted to the answer: a function of their posterior and of what remains.

use whorl_dynamics::effects::find;
use whorl_recording::Recording;

use crate::parameter_space::Target;
use crate::selection::unlisted::{Unlisted, laws_beside};
use crate::selection::{Beside, Evaluated, Selection, is_excluded};
use crate::signals::lines::Lines;
use crate::signals::observed::{Applied, Observed, held_out_remains, observed};
use crate::signals::{gimbals, pulses, remains_of};
use crate::verdict::diagnosis::{
    BackgroundTorque, Candidate, Explanation, FittedSet, NextManoeuvre, SCHEMA, SlowResidual, Unknown,
    Verdict,
};
use crate::verdict::noise::{noise_of, noise_remarks};
use crate::verdict::posterior::{Posterior, fitted_set};
use crate::verdict::rows::rows;
use crate::verdict::{digits, missing_channels};
use crate::{Diagnosis, DiagnosisError, Options, Settings};

/// Deviations, over those of a certain line, from which a periodicity that no effect explains is one: beside no effect, and beside some, whose
/// formulas leave lines.
const PERIODIC: [f64; 2] = [1.5, 2.0];

/// Share of the evidence of an effect above which its residual is another law, over that which its own formula may leave: twice its error.
const OF_OTHER_LAW: f64 = 4.0;

/// A set, the runs as it leaves them, and what is periodic in that.
#[derive(Clone, Copy)]
struct Left<'s, 'a> {
    set: &'s Evaluated,
    observed: &'s [Observed<'a>],
    lines: &'s Lines,
}

/// The answer of a selection; `given`: training and held-out runs as they were recorded, with readings that pile up at a limit.
pub(crate) fn answer(
    selection: &Selection<'_>,
    given: (&[Recording], &[Recording]),
    options: &Options,
) -> Result<Diagnosis, DiagnosisError> {
    let runs = &selection.runs;
    let (reference, settings) = (runs.reference, &runs.reference.settings);
    let base = Left { set: selection.base(), observed: &selection.observed, lines: &selection.lines };
    let set = selection.most_probable().unwrap_or(base.set);
    let (of_best, its_lines);
    let best = if set.names().is_empty() {
        Left { set, ..base }
    } else {
        of_best = observed(runs, set)?;
        its_lines = Lines::of(&of_best, &set.model(reference)?, &selection.seen.turning, settings);
        Left { set, observed: &of_best, lines: &its_lines }
    };
    let applied_n_m = Applied::of(base.observed, &reference.model, settings.at_work_s).body_n_m();
    let beside = selection.beside(best.set, options)?;
    let excluded = |id: &str| is_excluded(options, id) || reference.model.effects.contains_key(id);
    let direct: Vec<Candidate> = digits::row(given.0, given.1, &reference.model, excluded)
        .into_iter()
        .chain(gimbals::row(best.observed, &reference.model, settings.certain_stddevs, excluded))
        .chain(selection.seen.rows.iter().cloned())
        .collect();
    let posterior = posterior(selection, best, base, applied_n_m)?;
    let (noise, contradiction) = noise_of(runs, best.set)?;
    let mut remarks: Vec<String> =
        runs.training.iter().flat_map(|run| missing_channels(run, &reference.model)).collect();
    remarks.extend(noise_remarks(&noise, settings));
    let would_have_shown = could_have_seen(beside.as_ref(), settings);
    let mut verdict = posterior.verdict(would_have_shown);
    remarks.extend(direct.iter().map(|row| {
        let values = row.parameters.iter().map(|p| format!("{} = {:.4e} {}", p.name, p.estimate, p.unit));
        format!("{}: directly visible in the samples: {}", row.effect, values.collect::<Vec<_>>().join(", "))
    }));
    let mut unknown =
        posterior.likely().find_map(|set| set.unmodelled.clone()).filter(|_| posterior.unknown > 0.5);
    // Readings that pile up at a limit contradict the others by themselves.
    if let Some(contradiction) = contradiction.filter(|_| direct.is_empty()) {
        remarks.push(
            "accelerometer and vector sensor contradict the gyro regardless of the torques: check the order, signs and units of the sensors' axes".to_owned(),
        );
        (verdict, unknown) = (Verdict::Unknown, Some(contradiction));
    }
    let mut sets = named_sets(&posterior, verdict, unknown.is_some());
    let mut explanations: Vec<Explanation> = posterior.likely().map(explanation).collect();
    let share_left = share_left(runs.training, given.0);
    let are_chosen = !direct.is_empty() && share_left < settings.least_within_range;
    if are_chosen {
        remarks.push(format!(
            "{:.0} % of the gyro's readings are at the end of its range: those that are left were chosen by their values, and nothing is named by them.",
            100.0 * (1.0 - share_left)
        ));
        explanations.iter_mut().for_each(|explanation| explanation.effects.clear());
    }
    // What the samples show directly is there, whatever else may be.
    let states_names = matches!(verdict, Verdict::Named | Verdict::Confounded);
    if are_chosen || !direct.is_empty() && !states_names {
        (verdict, sets) = (Verdict::Named, vec![Vec::new()]);
    }
    let mut candidates = rows(selection, best.set, beside.as_ref());
    for row in &direct {
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
        let others: std::collections::BTreeSet<&String> = others.filter(|id| !effects.contains(id)).collect();
        row.indistinguishable_from = others.into_iter().cloned().collect();
    }
    let fits = [base.set, best.set].into_iter().map(|set| Ok((set.owned_names(), set.fit(reference)?)));
    let fits = fits.collect::<Result<_, DiagnosisError>>()?;
    let mut diagnosis = Diagnosis {
        schema: SCHEMA,
        kind: effects.first().and_then(|id| find(id)).map(|effect| effect.info().kind.to_string()),
        confounded_with: sets.into_iter().skip(1).collect(),
        effects,
        explanations,
        background: background(best.set),
        slow_residual: slow_residual(selection, best)?,
        noise,
        unknown,
        next: advice(verdict, &candidates),
        verdict,
        would_have_shown,
        candidates,
        remarks,
        fitted: posterior.sets,
        fits,
    };
    if let Some(remark) = pulses::pulses(best.observed, &reference.model, settings) {
        return Ok(diagnosis.withheld(remark));
    }
    if let Some((what, first)) = implausible_inertia(selection, best.set).zip(runs.training.first()) {
        let other = DiagnosisError::OtherPlatform { run: first.name.clone(), what };
        // A missing effect that nothing explains may bias the model as much.
        if diagnosis.verdict != Verdict::Unknown {
            return Err(other);
        }
        diagnosis.remarks.push(other.to_string());
    }
    Ok(diagnosis)
}

/// Share of the gyro's readings that can be used.
fn share_left(usable: &[Recording], given: &[Recording]) -> f64 {
    let count = |runs: &[Recording]| runs.iter().map(|run| run.gyro_b_rad_s.len()).sum::<usize>() as f64;
    if count(given) > 0.0 { count(usable) / count(given) } else { 1.0 }
}

/// The posterior given the data: over sets of the catalogue's effects, and unlisted laws beside the best of them and alone: the best set may
/// only look like what is missing. No laws where a set leaves nothing: what is not there follows none.
fn posterior(
    selection: &Selection<'_>,
    best: Left<'_, '_>,
    base: Left<'_, '_>,
    applied_n_m: f64,
) -> Result<Posterior, DiagnosisError> {
    let settings = &selection.runs.reference.settings;
    let law_beside = |set: &Evaluated, unknown: Unknown, gain: f64| {
        let log_prior = selection.log_prior(set);
        let log_posterior = selection.log_posterior(set) + gain;
        FittedSet {
            effects: set.owned_names(),
            unmodelled: Some(unknown),
            log_evidence: log_posterior - log_prior,
            log_prior,
            log_posterior,
            probability: 1.0,
            ..FittedSet::default()
        }
    };
    let mut all: Vec<FittedSet> = Vec::new();
    // A law must explain more than the shape errors of the set's own formulas leave.
    let explained = best.set.log_evidence - base.set.log_evidence;
    let beside_base = (!best.set.names().is_empty()).then_some(base);
    for left in std::iter::once(best).chain(beside_base) {
        if remains_of(left.observed).significance() <= settings.noticed_stddevs {
            continue;
        }
        let is_apart = |law: &Unlisted| {
            let is_large =
                law.unknown.unit != "N m" || law.unknown.size > settings.background_share * applied_n_m;
            left.set.names().is_empty()
                || (is_large && law.gain > OF_OTHER_LAW * settings.misspecification * explained)
        };
        let laws = laws_beside(&selection.runs, left.set, left.observed, left.lines)?;
        let apart = laws.into_iter().filter(is_apart);
        all.extend(apart.map(|law| law_beside(left.set, law.unknown, law.gain)));
    }
    if let Some((unknown, log_evidence)) = periodicity(selection, best) {
        all.push(law_beside(best.set, unknown, settings.unmodelled.ln() + log_evidence));
    }
    all.extend(selection.evaluated.iter().map(|set| fitted_set(selection, set, applied_n_m)));
    Ok(Posterior::new(all, settings))
}

/// A periodicity that no effect explains, and its log evidence: the height of the peak as that of a normal variable, less the number of
/// frequencies at which it might have been.
fn periodicity(selection: &Selection<'_>, best: Left<'_, '_>) -> Option<(Unknown, f64)> {
    let (reference, lines) = (selection.runs.reference, best.lines);
    let least = PERIODIC[usize::from(!best.set.names().is_empty())];
    if lines.strongest < least * reference.settings.certain_stddevs {
        return None;
    }
    let unknown = Unknown { frequency_hz: lines.hz.first().copied(), ..Unknown::torque_in_time(0.0) };
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
fn slow_residual(selection: &Selection<'_>, best: Left<'_, '_>) -> Result<SlowResidual, DiagnosisError> {
    let runs = &selection.runs;
    let held_out = |set: &Evaluated| {
        let found = (!runs.held_out.is_empty()).then(|| held_out_remains(runs, set)).transpose()?;
        Ok::<_, DiagnosisError>(found.map(|remains| remains.times_the_noise()))
    };
    Ok(SlowResidual {
        before: remains_of(&selection.observed).times_the_noise(),
        after: remains_of(best.observed).times_the_noise(),
        held_out_before: held_out(selection.base())?,
        held_out_after: held_out(best.set)?,
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

fn explanation(set: &FittedSet) -> Explanation {
    let (effects, with_unknown) = (set.effects.clone(), set.unmodelled.is_some());
    Explanation { effects, with_unknown, probability: set.probability }
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
