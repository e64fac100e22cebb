//! What a new model is worth in control: one simulated experiment, with the old and with the new model in the controller.

use std::path::Path;

use anyhow::{Context as _, bail};
use serde::Serialize;
use whorl_bag::RunDirectory;
use whorl_dynamics::PlatformModel;
use whorl_explain::propose::{Manoeuvre, family};
use whorl_math::deg_from_rad;
use whorl_msgs::topics::Message;
use whorl_recording::{KnownPlatform, read_model};

use crate::model_file::text_before;
use crate::next::common_file;
use crate::rehearsal::Stage;

/// The manoeuvre of closed loop that turns about all axes.
const USUAL: &str = "swings";
/// Of what the actuators can do, so that the error is that of the model and not theirs.
const GENTLE: f64 = 0.75;

/// Pointing errors of a simulated experiment. The simulated platform is the new model, noise and all; the controller feeds forward what its
/// own model says: first the old one, then the new one.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Pointing {
    /// The platform's name, and what it does, in words.
    pub manoeuvre: String,
    /// RMS angle between attitude and reference with the old model \[rad\].
    pub before_rad: f64,
    /// With the new one \[rad\].
    pub after_rad: f64,
}

impl Pointing {
    /// Simulates with the model as it was before the last step of a file, and as the file has it now.
    ///
    /// # Errors
    /// When the platform has nothing to point with, or nothing says how its nodes are set.
    pub fn simulated(before: &KnownPlatform, file: &Path) -> anyhow::Result<Self> {
        let after = &read_model(file, Some(&before.platform))?;
        let manoeuvre = usual(&after.model).context("it has no wheels or jets to turn with")?;
        let common = common_file(before, file.parent())
            .context("no common.yaml beside its file says how its nodes are set")?;
        let text = manoeuvre.yaml(USUAL, &after.platform, &[]);
        let step = after.history.last().map_or(0, |step| step.number);
        let (_, text_before) = text_before(file, step)?;
        let error = |known: &KnownPlatform, own: &str| -> anyhow::Result<f64> {
            let stage = Stage::new(known, own, &common, &after.model)?;
            pointing_rms_rad(&stage.simulated(USUAL, &text)?)
        };
        Ok(Self {
            manoeuvre: format!("{} {}", after.platform, manoeuvre.words),
            before_rad: error(before, &text_before)?,
            after_rad: error(after, &whorl_files::read_text(file)?)?,
        })
    }

    /// One sentence.
    #[must_use]
    pub fn in_words(&self) -> String {
        format!(
            "Simulated ({}), with the new model as the truth: pointing error {:.4} deg RMS with the old model in the controller, {:.4} deg with \
             the new one.",
            self.manoeuvre,
            deg_from_rad(self.before_rad),
            deg_from_rad(self.after_rad)
        )
    }
}

/// A manoeuvre in closed loop for the actuators that there are.
fn usual(model: &PlatformModel) -> Option<Manoeuvre> {
    let is_closed = |m: &Manoeuvre| m.excitations.is_empty();
    let (mut named, others): (Vec<_>, Vec<_>) =
        family(model, GENTLE).into_iter().filter(is_closed).partition(|m| m.name == USUAL);
    named.pop().or_else(|| others.into_iter().next())
}

/// RMS angle between attitude and reference over a whole run \[rad\], by the controller.
///
/// # Errors
/// When the run cannot be read, or no controller ran.
pub fn pointing_rms_rad(run: &Path) -> anyhow::Result<f64> {
    let (mut sum, mut count) = (0.0, 0);
    for message in RunDirectory::open(run)?.bag()?.messages() {
        let message = message?;
        if !message.topic.name.ends_with("/control/status") {
            continue;
        }
        if let Ok(Message::ControlStatus(status)) = message.decode() {
            let error = status.attitude_error_b_rad;
            let squared = error.x * error.x + error.y * error.y + error.z * error.z;
            // Without a reference there is no error.
            if squared.is_finite() {
                (sum, count) = (sum + squared, count + 1);
            }
        }
    }
    if count == 0 {
        bail!("{} has no attitude errors", run.display());
    }
    Ok((sum / f64::from(count)).sqrt())
}
