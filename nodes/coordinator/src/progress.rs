//! How far an experiment has come: what a coordinator that is started again in the middle of it needs to go on.
//!
//! The core gives it as text ([`crate::CoordinatorCore::progress`]), and whoever runs the core keeps it where it outlives the process. It says
//! nothing about where the platforms are: they come to rest while nobody commands them, and the next coordinator takes each
//! reference up where its platform is.

use std::fmt::Write as _;
use std::hash::{DefaultHasher, Hash, Hasher};

use nalgebra::{Quaternion, UnitQuaternion};
use thiserror::Error;

use crate::parameters::Parameters;

/// How far an experiment has come.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Progress {
    /// [`fingerprint`] of the experiment.
    pub fingerprint: u64,
    /// Attitude at which each platform's reference started: angles of the steps count from there.
    pub starts: Vec<UnitQuaternion<f64>>,
    /// Index of the step; their number when the last one is over.
    pub step: usize,
    /// Since it began \[s\].
    pub step_elapsed_s: f64,
    /// Since the start \[s\].
    pub run_elapsed_s: f64,
    /// For how long of that the sequence waited \[s\].
    pub paused_s: f64,
    /// Why a person holds it.
    pub held: Option<String>,
    /// Why it was aborted.
    pub aborted: Option<String>,
}

/// What was kept is not the progress of this experiment.
#[derive(Debug, Error, PartialEq, Eq)]
pub(crate) enum ProgressError {
    #[error("it was another experiment, or another version of this one")]
    OtherExperiment,
    #[error("what was kept of it cannot be read ({0})")]
    Unreadable(&'static str),
}

/// Longest text that is read: some lines for each of a hundred platforms.
const LONGEST: usize = 1 << 14;
/// Longest reason that is kept.
const LONGEST_REASON: usize = 500;

/// Differs where platforms, law or steps do. It is compared by the same program only: it may change with the version.
pub(crate) fn fingerprint(parameters: &Parameters) -> u64 {
    let Parameters { platforms, experiment, law, steps, .. } = parameters;
    let mut hasher = DefaultHasher::new();
    format!("{platforms:?} {experiment:?} {law:?} {steps:?}").hash(&mut hasher);
    hasher.finish()
}

impl Progress {
    /// A line for each field: its name, then its value.
    pub fn to_text(&self) -> String {
        let mut text = format!(
            "fingerprint {}\nstep {}\nstep_elapsed_s {}\nrun_elapsed_s {}\npaused_s {}\n",
            self.fingerprint, self.step, self.step_elapsed_s, self.run_elapsed_s, self.paused_s
        );
        // Writing to a String cannot fail.
        for q in &self.starts {
            let _ = writeln!(text, "start {} {} {} {}", q.w, q.i, q.j, q.k);
        }
        for (name, reason) in [("held", &self.held), ("aborted", &self.aborted)] {
            if let Some(reason) = reason {
                let reason: String =
                    reason.chars().filter(|c| !c.is_control()).take(LONGEST_REASON).collect();
                let _ = writeln!(text, "{name} {reason}");
            }
        }
        // What was cut off has no end.
        text.push_str("end\n");
        text
    }

    /// What [`Self::to_text`] wrote, if it is of this experiment.
    pub fn from_text(text: &str, parameters: &Parameters) -> Result<Self, ProgressError> {
        use ProgressError::Unreadable;
        if text.len() > LONGEST || !text.ends_with("\nend\n") {
            return Err(Unreadable("it has no end"));
        }
        let lines = || text.lines().filter_map(|line| line.split_once(' '));
        let value = |name: &str| lines().find(|(key, _)| *key == name).map(|(_, value)| value);
        let number =
            |name: &'static str| value(name).and_then(|text| text.parse().ok()).ok_or(Unreadable(name));
        let seconds = |name: &'static str| {
            let read = value(name).and_then(|text| text.parse::<f64>().ok());
            read.filter(|s| s.is_finite() && *s >= 0.0).ok_or(Unreadable(name))
        };
        let fingerprint = number("fingerprint")?;
        if fingerprint != self::fingerprint(parameters) {
            return Err(ProgressError::OtherExperiment);
        }
        let starts: Option<Vec<_>> =
            lines().filter(|(key, _)| *key == "start").map(|(_, q)| attitude(q)).collect();
        let starts =
            starts.filter(|all| all.len() == parameters.platforms.len()).ok_or(Unreadable("start"))?;
        let step = usize::try_from(number("step")?).map_err(|_| Unreadable("step"))?;
        if step > parameters.steps.len() {
            return Err(Unreadable("step"));
        }
        let step_elapsed_s = seconds("step_elapsed_s")?;
        if parameters.steps.get(step).is_some_and(|step| step_elapsed_s > step.duration_s) {
            return Err(Unreadable("step_elapsed_s"));
        }
        Ok(Self {
            fingerprint,
            starts,
            step,
            step_elapsed_s,
            run_elapsed_s: seconds("run_elapsed_s")?,
            paused_s: seconds("paused_s")?,
            held: value("held").map(str::to_owned),
            aborted: value("aborted").map(str::to_owned),
        })
    }
}

/// Of "w x y z".
fn attitude(text: &str) -> Option<UnitQuaternion<f64>> {
    let numbers: Vec<f64> = text.split(' ').map(str::parse).collect::<Result<_, _>>().ok()?;
    let [w, x, y, z] = numbers.try_into().ok()?;
    // Numbers are written with all their digits.
    let q = Quaternion::new(w, x, y, z);
    ((q.norm() - 1.0).abs() < 1e-6).then(|| UnitQuaternion::new_normalize(q))
}

/// What a coordinator that was started again knows of the one before.
#[derive(Debug)]
pub(crate) enum Earlier {
    /// What was kept, and how long ago \[s\], before the first tick.
    Kept(String, f64),
    /// It goes on with this.
    GoesOn(Box<Progress>, whorl_node::Timestamp),
}
