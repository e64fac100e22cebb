//! The steps of an experiment.

use std::sync::Arc;

use whorl_control::formation::{ReferenceLimits, RelativeAttitudeLaw, YawPitchRoll};
use whorl_msgs::whorl::FormationState;
use whorl_params::{Reader, Value, positive, range};

use super::co_observation::CoObservation;
use super::law::kinds;
use super::{LawSettings, co_observation};

/// A step of the sequence.
#[derive(Debug, Clone, PartialEq)]
pub struct Step {
    /// Its name.
    pub name: String,
    /// What happens.
    pub kind: StepKind,
    /// Length \[s\].
    pub duration_s: f64,
}

/// What happens in a step.
#[derive(Debug, Clone, PartialEq)]
pub enum StepKind {
    /// As a slew, but counted as settling.
    Settle(Slew),
    /// Leaders, or the virtual structure, turn to angles.
    Slew(Slew),
    /// Leaders, or the virtual structure, swing sinusoidally about their current attitude.
    Scan(Scan),
    /// A platform's commanded offset changes.
    Offset {
        /// The platform.
        platform: usize,
        /// To what; angles that are not given stay.
        to: PartialAngles,
    },
    /// A platform's commanded offset swings about its current value.
    OffsetScan(Scan),
    /// The platforms show a pass over a common target.
    CoObserve(Arc<CoObservation>),
    /// Another law takes over and continues to the same goal.
    Law {
        /// Index into [`LawSettings::laws`].
        index: usize,
    },
    /// A platform plays one of its own excitations; if it does not hold its reference, the reference follows the platform.
    Excite(Excite),
    /// Nothing changes.
    Hold,
}

/// A turn to given angles.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Slew {
    /// Which platform; `None`: all that lead, or the virtual structure.
    pub platform: Option<usize>,
    /// To what; angles that are not given stay.
    pub to: PartialAngles,
    /// Rate limit tighter than the platform's \[rad/s\].
    pub rate_max_rad_s: Option<f64>,
    /// Acceleration limit tighter than the platform's \[rad/s^2\].
    pub acceleration_max_rad_s2: Option<f64>,
}

/// One of the platforms' own excitations.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Excite {
    /// Which platform; `None`: all.
    pub platform: Option<usize>,
    /// Its name in the parameters of local control.
    pub excitation: String,
}

impl Excite {
    /// Whether it concerns this platform.
    #[must_use]
    pub fn concerns(&self, platform: usize) -> bool {
        self.platform.is_none_or(|own| own == platform)
    }
}

/// A sinusoid that starts and ends smoothly.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Scan {
    /// Which platform; `None`: all that lead, or the virtual structure.
    pub platform: Option<usize>,
    /// Which angle.
    pub axis: Axis,
    /// Amplitude \[rad\].
    pub amplitude_rad: f64,
    /// Period \[s\].
    pub period_s: f64,
    /// Length of the whole scan, including its smooth start and end \[s\].
    pub duration_s: f64,
}

/// One of the three angles.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Axis {
    /// About the vertical.
    Yaw,
    /// Positive nose down.
    Pitch,
    /// About body x.
    Roll,
}

/// Angles, each of them optional \[rad\].
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct PartialAngles {
    /// Yaw.
    pub yaw_rad: Option<f64>,
    /// Pitch.
    pub pitch_rad: Option<f64>,
    /// Roll.
    pub roll_rad: Option<f64>,
}

impl PartialAngles {
    /// These angles, with missing ones taken from `present`. Yaw counts from `yaw_zero_rad`.
    #[must_use]
    pub fn over(&self, present: &YawPitchRoll, yaw_zero_rad: f64) -> YawPitchRoll {
        YawPitchRoll {
            yaw_rad: self.yaw_rad.map_or(present.yaw_rad, |yaw| yaw + yaw_zero_rad),
            pitch_rad: self.pitch_rad.unwrap_or(present.pitch_rad),
            roll_rad: self.roll_rad.unwrap_or(present.roll_rad),
        }
    }
}

impl Step {
    /// `FormationState::PHASE_*` while it lasts.
    #[must_use]
    pub fn phase(&self) -> u8 {
        match self.kind {
            StepKind::Settle(_) => FormationState::PHASE_SETTLE,
            StepKind::Slew(_)
            | StepKind::Scan(_)
            | StepKind::Offset { .. }
            | StepKind::OffsetScan(_)
            | StepKind::CoObserve(_)
            | StepKind::Excite(_)
            | StepKind::Law { .. } => FormationState::PHASE_MANOEUVRE,
            StepKind::Hold => FormationState::PHASE_HOLD,
        }
    }
}

/// All steps in the order of the file.
pub(super) fn read_all(
    r: &mut Reader<'_>,
    platforms: &[String],
    limits: &[ReferenceLimits],
    law: Option<&LawSettings>,
) -> Vec<Step> {
    let names = r.children("steps");
    if names.is_empty() {
        r.reject("steps", "the experiment has no steps; allowed: at least one, such as `hold: {kind: hold, duration_s: 10.0}`");
    }
    let mut in_force = 0;
    names
        .into_iter()
        .map(|name| {
            r.group(&format!("steps.{name}"), |r| {
                read_step(r, &name, (platforms, limits), law, &mut in_force)
            })
        })
        .collect()
}

/// Names of the laws that steps switch to.
pub(super) fn laws_switched_to(r: &Reader<'_>) -> Vec<String> {
    let name = |step: String| match r.parameters().get(&format!("steps.{step}.law"))?.value.clone() {
        Value::String(name) => Some(name),
        _ => None,
    };
    r.children("steps").into_iter().filter_map(name).collect()
}

/// `in_force`: index of the law at this point of the sequence.
fn read_step(
    r: &mut Reader<'_>,
    name: &str,
    (platforms, limits): (&[String], &[ReferenceLimits]),
    settings: Option<&LawSettings>,
    in_force: &mut usize,
) -> Step {
    let law = settings.and_then(|s| s.laws.get(*in_force)).map(Box::as_ref);
    let kind = r.choice(
        "kind",
        &["settle", "slew", "scan", "offset", "offset_scan", "co_observe", "law", "excite", "hold"],
        "what happens in the step",
    );
    let duration_s = r.f64("duration_s", positive(), "how long the step lasts [s]");
    let kind = match kind {
        "settle" => StepKind::Settle(read_slew(r, platforms, law)),
        "slew" => StepKind::Slew(read_slew(r, platforms, law)),
        "scan" => {
            let platform = read_leading_platform(r, platforms, law);
            StepKind::Scan(read_scan(r, duration_s, platform))
        }
        "offset" => {
            let platform = read_offset_platform(r, platforms, law);
            StepKind::Offset { platform, to: read_partial(r) }
        }
        "offset_scan" => {
            let platform = read_offset_platform(r, platforms, law);
            StepKind::OffsetScan(read_scan(r, duration_s, Some(platform)))
        }
        "co_observe" => match co_observation::read(r, duration_s, platforms, limits) {
            Some(pass) => StepKind::CoObserve(Arc::new(pass)),
            None => StepKind::Hold,
        },
        "law" => {
            let name = r.choice("law", &kinds(), "the law that takes over");
            let found = settings.and_then(|s| s.laws.iter().position(|l| l.name() == name));
            *in_force = found.unwrap_or(*in_force);
            StepKind::Law { index: *in_force }
        }
        "excite" => StepKind::Excite(Excite {
            platform: r
                .optional_string("platform", "the platform that plays it; left out: all")
                .and_then(|name| find(r, &name, platforms)),
            excitation: r.string(
                "excitation",
                "which of the platform's own excitations, by its name in local_control's `excitations`",
            ),
        }),
        _ => StepKind::Hold,
    };
    Step { name: name.to_owned(), kind, duration_s }
}

fn read_slew(r: &mut Reader<'_>, platforms: &[String], law: Option<&dyn RelativeAttitudeLaw>) -> Slew {
    Slew {
        platform: read_leading_platform(r, platforms, law),
        to: read_partial(r),
        rate_max_rad_s: r
            .optional_f64("rate_max_deg_s", positive(), "rate limit, if tighter than the platform's [deg/s]")
            .map(f64::to_radians),
        acceleration_max_rad_s2: r
            .optional_f64(
                "acceleration_max_deg_s2",
                positive(),
                "acceleration limit, if tighter than the platform's [deg/s^2]",
            )
            .map(f64::to_radians),
    }
}

fn read_scan(r: &mut Reader<'_>, duration_s: f64, platform: Option<usize>) -> Scan {
    let axis = match r.choice("axis", &["yaw", "pitch", "roll"], "which angle swings") {
        "pitch" => Axis::Pitch,
        "roll" => Axis::Roll,
        _ => Axis::Yaw,
    };
    let amplitude_rad =
        r.f64("amplitude_deg", range(0.0..=170.0), "amplitude of the swing [deg]").to_radians();
    let period_s = r.f64("period_s", range(1.0..), "period of the swing [s]");
    if period_s > duration_s {
        r.reject("period_s", format!("longer than the step; allowed: up to its duration of {duration_s} s"));
    }
    Scan { platform, axis, amplitude_rad, period_s, duration_s }
}

fn read_offset_platform(
    r: &mut Reader<'_>,
    platforms: &[String],
    law: Option<&dyn RelativeAttitudeLaw>,
) -> usize {
    let name = r.string("platform", "whose offset changes");
    let index = find(r, &name, platforms).unwrap_or_default();
    if law.is_some_and(|law| law.leads(index)) && platforms.contains(&name) {
        r.reject("platform", format!("`{name}` leads: it has no offset; move it with a slew"));
    }
    index
}

fn read_leading_platform(
    r: &mut Reader<'_>,
    platforms: &[String],
    law: Option<&dyn RelativeAttitudeLaw>,
) -> Option<usize> {
    let name = r.optional_string(
        "platform",
        "the leader that moves; left out: all leaders, or the virtual structure",
    )?;
    let index = find(r, &name, platforms)?;
    if law.is_some_and(|law| !law.leads(index)) {
        r.reject("platform", format!("`{name}` does not lead: change its offset, or leave this key out"));
    }
    Some(index)
}

fn find(r: &mut Reader<'_>, name: &str, platforms: &[String]) -> Option<usize> {
    let found = platforms.iter().position(|platform| platform == name);
    if found.is_none() && !name.is_empty() {
        r.reject("platform", format!("`{name}` is no platform; allowed: {}", platforms.join(", ")));
    }
    found
}

fn read_partial(r: &mut Reader<'_>) -> PartialAngles {
    let mut angle = |key, doc| r.optional_f64(key, range(-180.0..=180.0), doc).map(f64::to_radians);
    PartialAngles {
        yaw_rad: angle("yaw_deg", "yaw to turn to; left out: as it is [deg]"),
        pitch_rad: angle("pitch_deg", "pitch to turn to, positive nose down; left out: as it is [deg]"),
        roll_rad: angle("roll_deg", "roll to turn to; left out: as it is [deg]"),
    }
}
