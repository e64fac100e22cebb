//! What to do with a recording next: the command that takes it, or what is missing.

use std::path::Path;

use whorl_bag::CsvMap;
use whorl_dynamics::Freedom;
use whorl_recording::{KnownPlatform, Needs, Recording, check};

use super::lines::{Lines, Origin};
use crate::attitudes::recorded_by;
use crate::estimate::{Chosen, EstimateOptions};

/// The next step with what was written.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Next {
    /// Comparison with the model.
    Compare,
    /// The attitude: what moved the sensor has no model, or lacks what a comparison needs; why.
    Estimate(String),
    /// No command explains it yet; what is missing.
    Missing(String),
}

impl Next {
    /// The arguments of the program that is to be called; `None` where something is missing.
    #[must_use]
    pub fn arguments(&self, file: &Path, map: &Path, rig: &Path) -> Option<Vec<String>> {
        let shown = |path: &Path| path.display().to_string();
        let (command, model) = match self {
            Self::Compare => ("compare", Some(rig)),
            Self::Estimate(_) => ("estimate", None),
            Self::Missing(_) => return None,
        };
        let mut arguments = vec![command.to_owned(), shown(file), "--channels".to_owned(), shown(map)];
        arguments.extend(model.into_iter().flat_map(|rig| ["--model".to_owned(), shown(rig)]));
        Some(arguments)
    }
}

/// The first command that takes the recording: each is asked by what it checks itself. `rig` are the lines of the platform's file.
pub fn next(recording: &Recording, known: &KnownPlatform, map: Option<&Path>, rig: &Lines) -> Next {
    let needs = Needs { shortest_s: 0.0, free: false, accelerometer: false };
    let refusal = check(recording, &known.model, &needs).err().map(|refusal| refusal.to_string());
    // Nothing that anybody said holds or drives it: a hand does.
    let is_guessed = |origin: Origin| origin == Origin::Assumed;
    let in_a_hand = known.model.freedom == Freedom::Free
        && rig.0.iter().any(|line| {
            line.text.starts_with("freedom:")
                && line.source.as_ref().is_some_and(|(origin, _)| is_guessed(*origin))
        });
    let why = match &refusal {
        None if in_a_hand => {
            "the sensor lies on its sides, as nothing on a bearing does, and what a hand turns has no model"
                .to_owned()
        }
        None => return Next::Compare,
        Some(refusal) => refusal.clone(),
    };
    match map {
        Some(map) if has_attitude(recording, map) => Next::Estimate(why),
        _ if refusal.is_none() => Next::Compare,
        _ => Next::Missing(why),
    }
}

/// Whether `whorl estimate` has a filter for it.
fn has_attitude(recording: &Recording, map: &Path) -> bool {
    let takes =
        |map: &CsvMap, path: &Path| Chosen::new(&EstimateOptions::default(), &recorded_by(map, path)).is_ok();
    !recording.gyro_b_rad_s.is_empty() && CsvMap::load(map).is_ok_and(|read| takes(&read, map))
}
