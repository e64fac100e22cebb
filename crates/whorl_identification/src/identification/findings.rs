//! What a user must know of identified mass properties, in sentences.

use whorl_dynamics::PlatformModel;
use whorl_dynamics::mass_parameters::{MASS_PARAMETERS, NAMES, mass_vector};
use whorl_recording::Finding;
use whorl_validation::Comparison;

use super::{Determined, Identification};

/// Prediction errors that are so many times what the model says are no consequence of its noise.
const UNEXPLAINED: f64 = 3.0;
/// Prior deviations by which a result is far from what was known.
const FAR: f64 = 4.0;

/// Of the recordings with what was identified, whole or in pieces.
pub(super) fn of_fit(after: &[Comparison], is_explained: bool, stands: bool) -> Vec<Finding> {
    let unexplained = after.iter().filter(|run| run.unexplained.is_some()).map(|run| {
        format!(
            "{}: a torque remains that the model does not have: {}. `whorl diagnose` looks for what it is.",
            run.run, run.unexplained
        )
    });
    let mut texts: Vec<String> = unexplained.collect();
    let random = "A random torque remains beside these values. While what it is is missing, the platform's constants are biased by it: they keep the uncertainty that they had.";
    let unfinished = "The fit has not converged: another run of it from these values may find likelier ones.";
    let said = [(!is_explained, random), (!stands, unfinished)].into_iter().filter(|(is, _)| *is);
    texts.extend(said.map(|(_, text)| text.to_owned()));
    for text in after.iter().flat_map(|run| &run.remarks) {
        // What a recording lacks, all its pieces lack.
        if !texts.contains(text) {
            texts.push(text.clone());
        }
    }
    texts.into_iter().map(Finding::warning).collect()
}

/// Of the values, beside those of the given model.
pub(super) fn of_values(found: &Identification, given: &PlatformModel) -> Vec<Finding> {
    let unexplained = found.error_after.filter(|error| *error > UNEXPLAINED).map(|error| {
        Finding::fatal(format!(
            "The model does not explain the measurements: its predictions err {error:.1} times what it says of them. A sign, an axis, a unit or the noise in the model is wrong, or an effect is missing; look with `whorl diagnose` before using these numbers."
        ))
    });
    let (moved, prior) = (found.estimate - mass_vector(&given.mass_properties), &found.prior_stddev);
    let determined = (0..MASS_PARAMETERS).filter(|i| found.determined[*i] == Determined::Yes);
    let far = determined.map(|i| (NAMES[i], (moved[i] / prior[i]).abs())).filter(|(_, by)| *by > FAR);
    let far: Vec<String> = far.map(|(name, by)| format!("{name} by {by:.1}")).collect();
    let far = (!far.is_empty()).then(|| {
        Finding::warning(format!(
            "Far from what was known before, in its standard deviations: {}. Either the drawing is wrong, or an actuator's sign or strength is.",
            far.join(", ")
        ))
    });
    let excitation = found.fit.is_explained.then(|| of_excitation(found)).flatten();
    [unexplained, excitation, far].into_iter().flatten().collect()
}

/// Of what the motion did not excite. What is known exactly needs no data.
fn of_excitation(found: &Identification) -> Option<Finding> {
    let (prior, stddev) = (&found.prior_stddev, found.stddev());
    let is_weak = |i: usize| found.determined[i] == Determined::No && prior[i] > 0.0;
    let weak: Vec<usize> = (0..MASS_PARAMETERS).filter(|i| is_weak(*i)).collect();
    if weak.len() == prior.iter().filter(|stddev| **stddev > 0.0).count() {
        let nothing = "Nothing was excited: these data say nothing about the mass properties; all values are the prior's.";
        return Some(Finding::fatal(nothing.to_owned()));
    }
    let advice = if [2, 4, 5].into_iter().any(is_weak) {
        "Add motion about z: yaw back and forth with the z wheel, quickly."
    } else if [0, 1, 3].into_iter().any(is_weak) {
        "Add motion about x and y: swing in roll and pitch, each with its wheel."
    } else {
        "Hold several tilts in different directions, or let the platform swing freely."
    };
    let said = |i: &usize| format!("{} (uncertainty {:.2} of before)", NAMES[*i], stddev[*i] / prior[*i]);
    let text = weak.iter().map(said).collect::<Vec<_>>().join(", ");
    (!weak.is_empty())
        .then(|| Finding::warning(format!("Not excited, values are the prior's: {text}. {advice}")))
}
