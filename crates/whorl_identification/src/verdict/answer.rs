//! From the sets that were fitted to the answer: a function of their posterior and of what remains.

use std::collections::BTreeSet;

use whorl_dynamics::effects::find;
use whorl_recording::Recording;

use crate::selection::unlisted::Left;
use crate::selection::{Evaluated, Selection, is_given};
use crate::signals::lines::Lines;
use crate::signals::observed::{Applied, held_out_remains, observed};
use crate::signals::remains_of;
use crate::verdict::diagnosis::{
    BackgroundTorque, Candidate, Explanation, FittedSet, NextManoeuvre, SlowResidual, Verdict,
};
use crate::verdict::noise::{noise_of, noise_remarks};
use crate::verdict::posterior::Posterior;
use crate::verdict::rows::rows;
use crate::verdict::{digits, missing_channels};
use crate::{Diagnosis, DiagnosisError, Options, Outcome};

/// The answer of a selection; `given`: training and held-out runs as they were recorded, with readings that pile up at a limit.
pub(crate) fn answer(
    selection: &Selection<'_>,
    given: (&[Recording], &[Recording]),
    options: &Options,
) -> Outcome<Diagnosis> {
    let runs = &selection.runs;
    let (reference, settings) = (runs.reference, &runs.reference.settings);
    let base = Left { set: selection.base(), observed: &selection.observed, lines: &selection.lines };
    let set = selection.most_probable();
    let (of_best, its_lines);
    let best = if set.names().is_empty() {
        Left { set, ..base }
    } else {
        of_best = observed(runs, set)?;
        its_lines = Lines::of(&of_best, &set.model(reference)?, &selection.seen.turning, settings);
        Left { set, observed: &of_best, lines: &its_lines }
    };
    let beside = selection.beside.as_ref().filter(|beside| beside.set.names() == set.names());
    let of_digits = digits::row(given, &reference.model, |id| is_given(runs, options, id));
    let direct: Vec<Candidate> = of_digits.into_iter().chain(selection.seen.rows.iter().cloned()).collect();
    let (noise, contradiction) = noise_of(runs, set)?;
    let mut remarks: Vec<String> =
        runs.training.iter().flat_map(|run| missing_channels(run, &reference.model)).collect();
    remarks.extend(noise_remarks(&noise, settings));
    let applied_n_m = Applied::of(base.observed, &reference.model, settings.at_work_s).body_n_m();
    let posterior = Posterior::of(selection, [best, base], applied_n_m)?;
    // Half of the effects that were tested, at their ordinary size.
    let would_have_shown = beside.is_some_and(|beside| {
        let shows = |id: &&str| beside.detectability(beside.normal(), id) > settings.clear_misfit;
        let (tested, seen) = (beside.tested().count(), beside.tested().filter(shows).count());
        tested > 0 && seen * 2 >= tested
    });
    let mut verdict = posterior.verdict(would_have_shown);
    let mut unknown =
        posterior.likely().find_map(|set| set.unmodelled.clone()).filter(|_| posterior.unknown > 0.5);
    // Readings that pile up at a limit contradict the others by themselves.
    if let Some(contradiction) = contradiction.filter(|_| direct.is_empty()) {
        remarks.push(
            "accelerometer and vector sensor contradict the gyro regardless of the torques: check the order, signs and units of the sensors' axes".to_owned(),
        );
        (verdict, unknown) = (Verdict::Unknown, Some(contradiction));
    }
    let mut sets = posterior.named(verdict, unknown.is_some());
    let explanation = |set: &FittedSet| {
        let (effects, with_unknown) = (set.effects.clone(), set.unmodelled.is_some());
        Explanation { effects, with_unknown, probability: set.probability }
    };
    let mut explanations: Vec<Explanation> = posterior.likely().map(explanation).collect();
    let [left, all] = [runs.training, given.0]
        .map(|runs| runs.iter().map(|run| run.gyro_b_rad_s.len()).sum::<usize>() as f64);
    let share_left = if all > 0.0 { left / all } else { 1.0 };
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
    let mut candidates = rows(selection, set, beside);
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
        let others: BTreeSet<&String> = others.filter(|id| !effects.contains(id)).collect();
        row.indistinguishable_from = others.into_iter().cloned().collect();
    }
    let fits = [base.set, set].into_iter().map(|set| Ok((set.owned_names(), set.fit(reference)?)));
    let mut diagnosis = Diagnosis {
        fits: fits.collect::<Result<_, DiagnosisError>>()?,
        kind: effects.first().and_then(|id| find(id)).map(|effect| effect.info().kind.to_string()),
        confounded_with: sets.into_iter().skip(1).collect(),
        effects,
        explanations,
        background: background(set),
        slow_residual: slow_residual(selection, best)?,
        noise,
        unknown,
        next: advice(verdict, &candidates),
        verdict,
        would_have_shown,
        candidates,
        remarks,
        fitted: posterior.sets,
        ..Diagnosis::not_enough_information()
    };
    if let Some((what, first)) = implausible_inertia(selection, set).zip(runs.training.first()) {
        let other = DiagnosisError::OtherPlatform { run: first.name.clone(), what };
        // A missing effect that nothing explains may bias the model as much.
        if diagnosis.verdict != Verdict::Unknown {
            return Err(other);
        }
        diagnosis.remarks.push(other.to_string());
    }
    Ok(diagnosis)
}

fn background(set: &Evaluated) -> BackgroundTorque {
    let size = |of: &whorl_prediction::RandomTorque| of.stddev_b_n_m.iter().map(|x| x * x).sum::<f64>();
    let all = set.fitted.followed.iter().flat_map(|run| &run.noise.disturbance.body);
    let strongest = all.max_by(|a, b| size(a).total_cmp(&size(b)));
    let correlation_s = strongest.map_or(0.0, |of| of.correlation_s);
    BackgroundTorque { stddev_n_m: set.torque_n_m(), correlation_s }
}

/// What the platform's own parameters alone and the best set leave.
fn slow_residual(selection: &Selection<'_>, best: Left<'_, '_>) -> Outcome<SlowResidual> {
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
        let axis = column.index;
        let given = inertia.diagonal().get(axis).copied().filter(|_| column.effect.is_none())?;
        let stddev = reference.prior.inertia_b_kg_m2[(axis, axis)].max(settings.least_inertia_share * given);
        let (moved, name) = (units * column.scale, ["xx", "yy", "zz"][axis]);
        (moved.abs() > settings.other_platform_stddevs * stddev).then(|| {
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
        Verdict::Confounded => find(&candidates.first()?.effect)?.info().separated_by,
        Verdict::NotEnoughInformation => {
            "record several minutes with wheels driven by a multisine, single pulses of every jet, a coast-down over 10:1 in yaw rate and free swings to both sides"
        }
        Verdict::Unknown => "repeat the run with one actuator at a time, and once at rest",
        _ => return None,
    };
    let expected_log_odds = candidates.first().map_or(0.0, |c| c.detectability * 0.5);
    Some(NextManoeuvre { manoeuvre: text.to_owned(), expected_log_odds })
}

/// Adds up explanations that hold the same, most probable first.
pub(super) fn merge(explanations: &mut Vec<Explanation>) {
    for one in std::mem::take(explanations) {
        let is_same =
            |of: &&mut Explanation| (&of.effects, of.with_unknown) == (&one.effects, one.with_unknown);
        match explanations.iter_mut().find(is_same) {
            Some(same) => same.probability += one.probability,
            None => explanations.push(one),
        }
    }
    explanations.sort_by(|a, b| b.probability.total_cmp(&a.probability));
}
