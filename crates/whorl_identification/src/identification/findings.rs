//! What a user must know of a result, in sentences.

use whorl_validation::Comparison;

use super::Determined;
use crate::fitting::refit::FittedParameter;
use whorl_dynamics::mass_parameters::{MASS_PARAMETERS, MassVector, NAMES};
use whorl_recording::Finding;

/// Prediction errors that are so many times what the model says are no consequence of its noise.
const UNEXPLAINED: f64 = 3.0;
/// From here on it is said.
const WORTH_SAYING: f64 = 1.2;

/// Of the recordings with what was identified; each is the run of this name, or a piece of it.
pub(super) fn of_fit(
    after: &[Comparison],
    of_run: &[String],
    is_explained: bool,
    stands: bool,
) -> Vec<Finding> {
    let unexplained = after.iter().filter(|run| run.unexplained.is_some());
    let mut findings: Vec<Finding> = unexplained
        .map(|run| {
            Finding::warning(format!(
                "{}: a torque remains that the model does not have: {}. `whorl diagnose` looks for what it is.",
                run.run, run.unexplained
            ))
        })
        .collect();
    if !is_explained {
        findings.push(Finding::warning(
            "A random torque remains beside these values. While what it is is missing, the platform's constants are biased by it: they keep the uncertainty that they had.".to_owned(),
        ));
    }
    if !stands {
        findings.push(Finding::warning(
            "The fit has not converged: another run of it from these values may find likelier ones."
                .to_owned(),
        ));
    }
    // What a recording lacks, all its pieces lack.
    let remarks = after
        .iter()
        .zip(of_run)
        .flat_map(|(run, name)| run.remarks.iter().map(move |text| format!("{name}: {text}")));
    for remark in remarks.map(Finding::warning) {
        if !findings.contains(&remark) {
            findings.push(remark);
        }
    }
    findings
}

/// Of the prediction errors before and after.
pub(super) fn of_errors((before, after): (Option<f64>, Option<f64>)) -> Option<Finding> {
    let (before, after) = (before?, after?);
    if after > UNEXPLAINED {
        return Some(Finding::fatal(format!(
            "The model does not explain the measurements: its predictions err {after:.1} times what it says of them. A sign, an axis, a unit or the noise in the model is wrong, or an effect is missing; look with `whorl diagnose` before using these numbers."
        )));
    }
    (after > WORTH_SAYING && after > before).then(|| {
        Finding::warning(format!(
            "The readings are likelier with these values, and yet predictions ahead are worse: they err {after:.2} times what the model says of them, {before:.2} times before. An effect is missing; look with `whorl diagnose`."
        ))
    })
}

/// Of parameters that stay at an end of their range.
pub(super) fn of_ends<'a>(parameters: impl Iterator<Item = &'a FittedParameter>) -> Option<Finding> {
    let at_ends: Vec<String> =
        parameters.filter(|p| p.at_bound).map(|p| format!("{} {}", p.group, p.name)).collect();
    (!at_ends.is_empty())
        .then(|| Finding::warning(format!("At an end of what is plausible: {}.", at_ends.join(", "))))
}

/// Of what the motion excited.
pub(super) fn of_excitation(
    determined: &[Determined; MASS_PARAMETERS],
    prior: &MassVector,
    stddev: &MassVector,
) -> Vec<Finding> {
    // What is known exactly needs no data.
    let open = |i: usize| prior[i] > 0.0;
    let with = |which: Determined| -> Vec<String> {
        let all = determined.iter().enumerate().filter(|(i, d)| **d == which && open(*i));
        all.map(|(i, _)| format!("{} (uncertainty {:.2} of before)", NAMES[i], stddev[i] / prior[i]))
            .collect()
    };
    let (no, hardly) = (with(Determined::No), with(Determined::Hardly));
    let mut findings = Vec::new();
    if no.len() == (0..MASS_PARAMETERS).filter(|i| open(*i)).count() {
        findings.push(Finding::fatal(
            "Nothing was excited: these data say nothing about the mass properties; all values are the prior's."
                .to_owned(),
        ));
        return findings;
    }
    if !no.is_empty() {
        let weak = |i: usize| determined[i] == Determined::No && open(i);
        findings.push(Finding::warning(format!(
            "Not excited, values are the prior's: {}. {}",
            no.join(", "),
            advice(&weak)
        )));
    }
    if !hardly.is_empty() {
        findings.push(Finding::warning(format!("Hardly excited: {}.", hardly.join(", "))));
    }
    findings
}

/// What motion would excite what was not.
fn advice(weak: &dyn Fn(usize) -> bool) -> &'static str {
    if weak(5) || weak(2) || weak(4) {
        "Add motion about z: yaw back and forth with the z wheel, quickly."
    } else if weak(0) || weak(1) || weak(3) {
        "Add motion about x and y: swing in roll and pitch, each with its wheel."
    } else {
        "Hold several tilts in different directions, or let the platform swing freely."
    }
}

/// A result far from the prior is possible, but worth a note.
pub(super) fn of_prior(
    moved: &MassVector,
    prior: &MassVector,
    determined: &[Determined; MASS_PARAMETERS],
) -> Option<Finding> {
    let far: Vec<String> = (0..MASS_PARAMETERS)
        .filter(|i| determined[*i] == Determined::Yes)
        .map(|i| (i, moved[i] / prior[i]))
        .filter(|(_, misses)| misses.abs() > 4.0)
        .map(|(i, misses)| format!("{} by {:.1}", NAMES[i], misses.abs()))
        .collect();
    (!far.is_empty()).then(|| {
        Finding::warning(format!(
            "Far from what was known before, in its standard deviations: {}. Either the drawing is wrong, or an actuator's sign or strength is.",
            far.join(", ")
        ))
    })
}
