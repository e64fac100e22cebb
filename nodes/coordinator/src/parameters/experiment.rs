//! Name, start and end of an experiment.

use whorl_params::{Reader, range};

/// Targets of each platform beside the relative pointing error: key below `experiment.targets`, and what it means.
pub const TARGETS: [(&str, &str); 4] = [
    ("estimator_deg", "estimator error, RMS over the run, that the verdict asks of every platform [deg]"),
    ("gas_g", "gas that no platform may use more of [g]"),
    ("wheel_speed_rad_s", "speed that no wheel may exceed [rad/s]"),
    ("latency_ms", "time from sensor to command, 99th percentile, that the verdict asks for [ms]"),
];

/// Name, start and end of an experiment.
#[derive(Debug, Clone, PartialEq)]
pub struct ExperimentSettings {
    /// Its name.
    pub name: String,
    /// One line on what it shows; may be empty.
    pub description: String,
    /// Relative pointing error in hold, RMS, that the run is judged by \[deg\]; 0: it is not. Read by the report.
    pub target_deg: f64,
    /// Further targets by their key in [`TARGETS`]. Read by the report.
    pub targets: Vec<(&'static str, f64)>,
    /// Whether it starts automatically as soon as all platforms are ready.
    pub auto_start: bool,
    /// Zero of yaw angles.
    pub yaw_zero: YawZero,
    /// What the platforms do after the last step.
    pub at_end: AtEnd,
    /// Whether the experiment holds while a platform does not move as its model says, and for how long at most \[s\].
    pub holds_on_mismatch: Option<f64>,
    /// Whether the coordinator exits after the experiment.
    pub exit_when_finished: bool,
}

/// Zero of the steps' yaw angles.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum YawZero {
    /// The leader's yaw when the experiment starts.
    Start,
    /// East.
    World,
}

/// What the platforms do after the last step.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum AtEnd {
    /// Actuators off.
    Standby,
    /// Hold the last reference as long as the coordinator runs.
    Hold,
}

pub(super) fn read(r: &mut Reader<'_>) -> ExperimentSettings {
    ExperimentSettings {
        name: r.string_or("name", "unnamed", "name of the experiment"),
        description: r.string_or("description", "", "one line on what it shows"),
        target_deg: r.f64_or(
            "target_deg",
            0.0,
            range(0.0..=180.0),
            "relative pointing error in hold, RMS, that the verdict on the run asks for [deg]; 0: none",
        ),
        targets: r.group("targets", |r| {
            let set = |r: &mut Reader<'_>, (key, doc): (&'static str, &'static str)| {
                let value = r.f64_or(key, 0.0, range(0.0..=1e6), &format!("{doc}; 0: none"));
                (value > 0.0).then_some((key, value))
            };
            TARGETS.into_iter().filter_map(|target| set(r, target)).collect()
        }),
        auto_start: r.bool_or(
            "auto_start",
            true,
            "start as soon as all platforms are ready; false: wait for the service /coordinator/start",
        ),
        yaw_zero: match r.choice_or(
            "yaw_from",
            "start",
            &["start", "world"],
            "zero of yaw_deg in the steps: the leader's yaw at the start, or east",
        ) {
            "world" => YawZero::World,
            _ => YawZero::Start,
        },
        at_end: match r.choice_or(
            "at_end",
            "standby",
            &["standby", "hold"],
            "after the last step: actuators off, or hold for as long as the coordinator lives",
        ) {
            "hold" => AtEnd::Hold,
            _ => AtEnd::Standby,
        },
        holds_on_mismatch: {
            let holds = r.choice_or(
                "on_model_mismatch",
                "continue",
                &["continue", "hold"],
                "when a platform's model monitor says that it does not move as its model says: go on, or hold \
                 until the monitor is told to forget it",
            ) == "hold";
            let for_s = r.f64_or(
                "model_hold_s",
                60.0,
                range(1.0..=86_400.0),
                "a hold for a platform that does not move as its model says ends the experiment after this [s]",
            );
            holds.then_some(for_s)
        },
        exit_when_finished: r.bool_or(
            "exit_when_finished",
            true,
            "whether the coordinator exits after the experiment; false: it can be started again",
        ),
    }
}
