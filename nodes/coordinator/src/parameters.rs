//! Parameters of the coordinator, experiment included: the single definition of their names, ranges
//! and docs. `docs/experiments.md` is the user's guide to them.

mod co_observation;
mod experiment;
mod law;
mod limits;
mod refusals;
mod step;

pub use co_observation::CoObservation;
pub use experiment::{AtEnd, ExperimentSettings, TARGETS, YawZero};
pub use law::LawSettings;
pub use step::{Axis, Excite, PartialAngles, Scan, Slew, Step, StepKind};

use whorl_control::formation::{self, ReferenceLimits, RegisteredLaw};
use whorl_params::{LAW_ON_PLATFORMS, Reader, positive, range};

/// Everything a coordinator is built with.
#[derive(Debug, Clone, PartialEq)]
pub struct Parameters {
    /// Names of the platforms, in the order of `PlatformId`.
    pub platforms: Vec<String>,
    /// Role of this coordinator.
    pub role: Role,
    /// Name, start and end of the experiment.
    pub experiment: ExperimentSettings,
    /// The relative-attitude law and its initial offsets.
    pub law: LawSettings,
    /// The sequence; at least one step.
    pub steps: Vec<Step>,
    /// Per platform: limits of its reference.
    pub limits: Vec<ReferenceLimits>,
    /// Natural frequency with which every reference follows the law's demand \[rad/s\].
    pub bandwidth_rad_s: f64,
    /// Links and their ages.
    pub link: LinkSettings,
    /// Waiting for the platforms.
    pub waiting: WaitingSettings,
    /// What happens when a platform does not follow.
    pub faults: FaultSettings,
    /// How long a reference may be extrapolated \[s\].
    pub reference_validity_s: f64,
    /// How long a command gives authority \[s\].
    pub command_validity_s: f64,
}

impl Parameters {
    /// Whether this coordinator gives the platform its references.
    #[must_use]
    pub fn commands(&self, platform: usize) -> bool {
        match self.role {
            Role::Formation => true,
            Role::Platform(own) => own == platform,
            Role::Observer => false,
        }
    }

    /// Its name without the leading slash: the sender in clock requests and replies.
    #[must_use]
    pub fn name(&self) -> String {
        let own = if let Role::Platform(own) = self.role { self.platforms.get(own) } else { None };
        own.map_or_else(|| "coordinator".to_owned(), |platform| format!("{platform}/coordinator"))
    }

    /// Whether this coordinator needs the platform's messages.
    #[must_use]
    pub fn hears(&self, platform: usize) -> bool {
        match (self.role, self.law.first()) {
            (Role::Platform(own), Some(law)) => own == platform || law.hears(own, platform),
            _ => true,
        }
    }
}

/// Role of a coordinator.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Role {
    /// Coordinates the whole formation.
    Formation,
    /// Coordinates one platform, in that platform's namespace.
    Platform(usize),
    /// Observes: each platform has its own coordinator, this one publishes the formation's state.
    Observer,
}

/// Links and their ages.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct LinkSettings {
    /// Age beyond which an estimate is stale \[s\].
    pub stale_s: f64,
    /// Age beyond which a control status is stale \[s\].
    pub status_stale_s: f64,
    /// Whether the sequence waits while a platform that does not lead is stale.
    pub leader_waits: bool,
    /// If a platform returns further than this from its reference, the reference restarts from its attitude \[rad\].
    pub rejoin_error_rad: f64,
    /// A link that stays stale for longer ends the experiment \[s\].
    pub timeout_s: f64,
}

/// Waiting for the platforms.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct WaitingSettings {
    /// All platforms must be ready for this long \[s\].
    pub healthy_for_s: f64,
    /// The same where traffic is secured \[s\].
    pub healthy_for_secured_s: f64,
    /// Gives up after this long \[s\]; infinite when it is 0 in the file.
    pub timeout_s: f64,
}

impl WaitingSettings {
    /// All platforms must be ready for this long \[s\].
    #[must_use]
    pub fn healthy_for_s(&self, secured: bool) -> f64 {
        if secured { self.healthy_for_secured_s.max(self.healthy_for_s) } else { self.healthy_for_s }
    }
}

/// What happens when a platform does not follow its reference.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct FaultSettings {
    /// Whether the sequence waits for a non-leading platform that does not follow its reference.
    pub wait_for_followers: bool,
    /// Not following for less than this is not a fault \[s\].
    pub grace_s: f64,
    /// A fault that lasts longer ends the experiment \[s\].
    pub timeout_s: f64,
    /// How long an abort is published before the node exits \[s\].
    pub abort_for_s: f64,
}

/// Reads all parameters. `None` after errors that leave nothing to build; the reader holds the errors.
pub fn read(r: &mut Reader<'_>) -> Option<Parameters> {
    let platforms = whorl_params::formation(r).platforms;
    let experiment = r.fixed(|r| r.group("experiment", experiment::read));
    let limits = r.group("limits", |r| limits::read(r, &platforms));
    let others = step::laws_switched_to(r);
    let law = r.fixed(|r| r.group("law", |r| law::read(r, &platforms, &limits, &others)));
    let role = r.fixed(|r| read_role(r, &platforms, law.as_ref()));
    let steps = r.fixed(|r| step::read_all(r, &platforms, &limits, law.as_ref()));
    let bandwidth_rad_s = r.f64_or(
        "bandwidth_rad_s",
        2.0,
        range(0.05..=5.0),
        "natural frequency of a reference towards what the law demands; lower passes less of the \
         leader's estimation noise to its followers [rad/s]",
    );
    let link = r.group("link", read_link);
    let waiting = r.group("waiting", read_waiting);
    let faults = r.group("faults", read_faults);
    let reference_validity_s = r.f64_or(
        "reference_validity_s",
        0.3,
        range(0.04..=2.0),
        "how long a platform may extrapolate a reference before it brakes to rest [s]",
    );
    let command_validity_s = r.f64_or(
        "command_validity_s",
        0.4,
        range(0.3..=0.5),
        "how long a command gives a platform authority over its actuators; sent every 0.05 s [s]",
    );
    if platforms.is_empty() || steps.is_empty() || limits.len() != platforms.len() {
        return None;
    }
    Some(Parameters {
        platforms,
        role,
        experiment,
        law: law?,
        steps,
        limits,
        bandwidth_rad_s,
        link,
        waiting,
        faults,
        reference_validity_s,
        command_validity_s,
    })
}

fn read_role(r: &mut Reader<'_>, platforms: &[String], law: Option<&LawSettings>) -> Role {
    let on_platforms =
        law.and_then(|law| formation::find(law.name())).is_some_and(RegisteredLaw::runs_on_platforms)
            && r.bool_or(
                LAW_ON_PLATFORMS,
                false,
                "each platform runs the law itself, in a coordinator of its own; this one then only observes",
            );
    let node = r.parameters().node().to_owned();
    let own =
        node.rsplit_once('/').and_then(|(space, _)| platforms.iter().position(|p| space == format!("/{p}")));
    match own {
        Some(platform) => {
            if !on_platforms {
                let runs = formation::catalogue().iter().filter(|law| law.runs_on_platforms());
                let allowed = runs.map(RegisteredLaw::kind).collect::<Vec<_>>().join(", ");
                r.reject(
                    "law.kind",
                    format!("a coordinator in a platform's namespace serves that platform alone; allowed: {allowed}, with law.on_platforms"),
                );
            }
            Role::Platform(platform)
        }
        None if on_platforms => Role::Observer,
        None => Role::Formation,
    }
}

fn read_link(r: &mut Reader<'_>) -> LinkSettings {
    LinkSettings {
        stale_s: r.f64_or(
            "stale_s",
            0.3,
            range(0.05..=5.0),
            "age beyond which a platform's estimate is stale [s]",
        ),
        status_stale_s: r.f64_or(
            "status_stale_s",
            1.0,
            range(0.1..=10.0),
            "age beyond which a platform's control status is stale [s]",
        ),
        leader_waits: r.bool_or(
            "leader_waits",
            true,
            "whether the sequence waits while a follower's link is stale; for a leader's it always does",
        ),
        rejoin_error_rad: r
            .f64_or(
                "rejoin_error_deg",
                2.0,
                range(0.1..=180.0),
                "a platform that returns further than this from its reference starts anew from where it is \
                 [deg]",
            )
            .to_radians(),
        timeout_s: r.f64_or(
            "timeout_s",
            300.0,
            positive(),
            "the experiment ends when a link stays stale for longer [s]",
        ),
    }
}

fn read_waiting(r: &mut Reader<'_>) -> WaitingSettings {
    let timeout_s = r.f64_or(
        "timeout_s",
        60.0,
        range(0.0..),
        "gives up when not all platforms are ready after this time; 0: never [s]",
    );
    WaitingSettings {
        healthy_for_s: r.f64_or(
            "healthy_for_s",
            1.0,
            range(0.0..=60.0),
            "all platforms must be ready for this long before the start [s]",
        ),
        // Measured: two platforms on two busy cores exchanged keys for up to 3 s after the coordinator had found all well.
        healthy_for_secured_s: r.f64_or(
            "healthy_for_secured_s",
            5.0,
            range(0.0..=60.0),
            "the same where traffic is secured: keys are still being exchanged when the first messages arrive [s]",
        ),
        timeout_s: if timeout_s > 0.0 { timeout_s } else { f64::INFINITY },
    }
}

fn read_faults(r: &mut Reader<'_>) -> FaultSettings {
    FaultSettings {
        wait_for_followers: r.bool_or(
            "wait_for_followers",
            true,
            "whether the sequence waits for a platform that does not lead and does not follow its reference; \
             false: it goes on without it",
        ),
        grace_s: r.f64_or(
            "grace_s",
            1.0,
            range(0.1..=30.0),
            "not following the reference for less than this is not a fault [s]",
        ),
        timeout_s: r.f64_or(
            "timeout_s",
            20.0,
            positive(),
            "the sequence waits this long for a platform that does not follow, then aborts [s]",
        ),
        abort_for_s: r.f64_or(
            "abort_for_s",
            10.0,
            range(0.5..=600.0),
            "how long an abort is sent before the coordinator exits [s]",
        ),
    }
}
