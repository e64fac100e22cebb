//! Tests of the coordinator with ideal platforms: they are where their reference says.

mod earlier;
mod exciting;
mod experiments;
mod faults;
mod laws;
mod messages;
mod random;
mod sequence;

use std::collections::BTreeMap;

use nalgebra::{UnitQuaternion, Vector3};
use whorl_control::formation::YawPitchRoll;
use whorl_control::reference::Reference;
use whorl_math::attitude_error;
use whorl_msgs::topics::{Message, PlatformId, Route, Service, Topic};
use whorl_msgs::whorl::{
    AttitudeEstimate, AttitudeReference, ControlStatus, Excitation, FormationCommand, FormationState,
};
use whorl_node::{Event, NodeCore, Outputs, Response, Timestamp};
use whorl_params::ParameterTree;

use super::CoordinatorCore;
use crate::parameters::{self, Parameters};

const FORMATION: &str = "/**:\n  ros__parameters:\n    formation: {platforms: [whorl_1, whorl_2]}\n";

const START_YAW_RAD: f64 = 0.3;

const PAIR: &str = "
/coordinator:
  ros__parameters:
    experiment: {name: pair}
    limits:
      whorl_2: {tilt_kind: pitch, tilt_max_deg: 30.0}
    law:
      members:
        whorl_2: {offset: {yaw_deg: 20.0}}
    steps:
      settle: {kind: settle, duration_s: 12.0}
      slew: {kind: slew, duration_s: 15.0, yaw_deg: 10.0, pitch_deg: 1.0}
      hold: {kind: hold, duration_s: 5.0}
";

/// Parameters of `experiment` on top of the formation; the errors' text when they are refused.
fn read(experiment: &str) -> Result<Parameters, String> {
    let tree = ParameterTree::from_texts(&[("common.yaml", FORMATION), ("test.yaml", experiment)], &[])
        .map_err(|e| e.to_string())?;
    whorl_params::try_read(&tree.for_node("/coordinator"), parameters::read)
        .map(|(parameters, _)| parameters)
        .map_err(|e| e.to_string())
}

/// An ideal platform.
#[derive(Debug, Clone)]
struct Platform {
    q_world_body: UnitQuaternion<f64>,
    omega_wb_b_rad_s: Vector3<f64>,
    reference: Option<(Timestamp, Reference)>,
    authority_until: Timestamp,
    /// Neither sends nor receives.
    cut: bool,
    /// Sends, but does not receive.
    deaf: bool,
    /// Reports safe mode and stays where it is.
    safe: bool,
    /// Until when it plays an excitation, and the yaw rate that it then has [rad/s].
    excited_until: Timestamp,
    excited_rad_s: f64,
    silent_control: bool,
    health: u8,
    sequence: u64,
}

/// The coordinator with its platforms, and everything that it sent.
struct Laboratory {
    core: CoordinatorCore,
    now: Timestamp,
    platforms: Vec<Platform>,
    outputs: Outputs,
    references: Vec<Vec<AttitudeReference>>,
    states: Vec<FormationState>,
    commands: Vec<FormationCommand>,
    excitations: Vec<Excitation>,
    log: Vec<String>,
}

impl Laboratory {
    fn new(experiment: &str) -> Self {
        Self::with(read(experiment).unwrap())
    }

    fn with(parameters: Parameters) -> Self {
        let count = parameters.platforms.len();
        let platform = |i: usize| Platform {
            q_world_body: YawPitchRoll {
                yaw_rad: START_YAW_RAD + 0.1 * i as f64,
                pitch_rad: 0.01,
                roll_rad: 0.02,
            }
            .attitude(),
            omega_wb_b_rad_s: Vector3::zeros(),
            reference: None,
            authority_until: Timestamp(0),
            cut: false,
            deaf: false,
            safe: false,
            excited_until: Timestamp(0),
            excited_rad_s: 0.1,
            silent_control: false,
            health: AttitudeEstimate::HEALTH_OK,
            sequence: 0,
        };
        Self {
            core: CoordinatorCore::new(parameters).unwrap(),
            now: Timestamp::from_seconds(1000.0),
            platforms: (0..count).map(platform).collect(),
            outputs: Outputs::default(),
            references: vec![Vec::new(); count],
            states: Vec::new(),
            commands: Vec::new(),
            excitations: Vec::new(),
            log: Vec::new(),
        }
    }

    /// One period of 10 ms: platforms move and report, then the timer fires.
    fn step(&mut self) {
        self.now = Timestamp(self.now.0 + 10_000_000);
        for index in 0..self.platforms.len() {
            let now = self.now;
            let platform = &mut self.platforms[index];
            let obeys = now <= platform.authority_until && !platform.safe;
            if obeys && now < platform.excited_until {
                let turn = UnitQuaternion::from_axis_angle(&Vector3::z_axis(), 0.01 * platform.excited_rad_s);
                platform.q_world_body = turn * platform.q_world_body;
                platform.omega_wb_b_rad_s =
                    platform.q_world_body.inverse() * Vector3::z() * platform.excited_rad_s;
            } else if let (true, Some((stamp, reference))) = (obeys, &platform.reference) {
                let at = reference.extrapolated(now.seconds_since(*stamp).min(0.3));
                platform.q_world_body = at.q_world_reference;
                platform.omega_wb_b_rad_s = at.omega_wr_r_rad_s;
            } else {
                platform.omega_wb_b_rad_s = Vector3::zeros();
            }
            if platform.cut {
                continue;
            }
            let estimate = self.estimate(index);
            self.send(index, Topic::AttitudeEstimate, estimate);
            if !self.platforms[index].silent_control {
                let status = self.status(index, obeys);
                self.send(index, Topic::ControlStatus, status);
            }
        }
        self.deliver(Event::Timer);
    }

    fn estimate(&mut self, index: usize) -> AttitudeEstimate {
        let platform = &mut self.platforms[index];
        platform.sequence += 1;
        let mut estimate = AttitudeEstimate {
            sequence: platform.sequence,
            q_world_body: platform.q_world_body.into(),
            omega_wb_b_rad_s: platform.omega_wb_b_rad_s.into(),
            health: platform.health,
            ..AttitudeEstimate::default()
        };
        estimate.header.stamp = self.now.into();
        estimate
    }

    fn status(&self, index: usize, obeys: bool) -> ControlStatus {
        let mode = if self.platforms[index].safe {
            ControlStatus::MODE_SAFE_DAMPING
        } else if obeys && self.now < self.platforms[index].excited_until {
            ControlStatus::MODE_EXCITE
        } else if obeys {
            ControlStatus::MODE_TRACK
        } else {
            ControlStatus::MODE_IDLE
        };
        let mut status = ControlStatus { mode, ..ControlStatus::default() };
        if mode == ControlStatus::MODE_IDLE {
            status.reason = ControlStatus::REASON_NO_AUTHORITY;
        }
        // As local control does: the coordinator itself holds the reference while the experiment waits.
        if self.references[index].last().is_some_and(|r| r.mode == AttitudeReference::MODE_HOLD)
            && mode == ControlStatus::MODE_TRACK
        {
            status.mode = ControlStatus::MODE_HOLD;
            status.reason = ControlStatus::REASON_REFERENCE_STALE;
        }
        status.header.stamp = self.now.into();
        status
    }

    fn send(&mut self, index: usize, topic: Topic, message: impl Into<Message>) {
        let route = Route::platform(PlatformId(index as u16), topic);
        let message = message.into();
        self.deliver(Event::Message { route, message: &message });
    }

    fn deliver(&mut self, event: Event<'_>) {
        self.outputs.clear();
        self.core.step(self.now, event, &mut self.outputs);
        self.log.extend(self.outputs.log.iter().map(|line| line.text.clone()));
        for publication in &self.outputs.messages {
            match (&*publication.message, publication.route.platform) {
                (Message::AttitudeReference(reference), Some(PlatformId(index))) => {
                    let index = usize::from(index);
                    self.references[index].push(reference.clone());
                    let platform = &mut self.platforms[index];
                    if !platform.cut && !platform.deaf {
                        platform.reference = Some((reference.header.stamp.into(), reference_of(reference)));
                    }
                }
                (Message::FormationCommand(command), _) => {
                    for platform in self.platforms.iter_mut().filter(|p| !p.cut && !p.deaf) {
                        let gives = command.command == FormationCommand::COMMAND_TRACK
                            || command.command == FormationCommand::COMMAND_HOLD;
                        platform.authority_until =
                            if gives { command.valid_until.into() } else { Timestamp(0) };
                    }
                    self.commands.push(command.clone());
                }
                (Message::Excitation(excitation), Some(PlatformId(index))) => {
                    self.platforms[usize::from(index)].excited_until = excitation.valid_until.into();
                    self.excitations.push(excitation.clone());
                }
                (Message::FormationState(state), _) => self.states.push(state.clone()),
                _ => {}
            }
        }
    }

    fn run(&mut self, seconds: f64) {
        for _ in 0..(seconds / 0.01).round() as u32 {
            self.step();
        }
    }

    fn request(&mut self, service: Service, argument: &str) -> Response {
        self.deliver(Event::Request { service, argument });
        self.outputs.response.clone().unwrap()
    }

    fn relative_yaw_deg(&self) -> f64 {
        let relative = self.platforms[0].q_world_body.inverse() * self.platforms[1].q_world_body;
        YawPitchRoll::of(&relative).yaw_rad.to_degrees()
    }

    /// After `PAIR`: the leader turned by 10 deg from where it started, and leans by 1 deg; the
    /// follower is turned by another 20 deg against it, about the leader's own z axis.
    fn check_end(&self) {
        let leader = YawPitchRoll::of(&self.platforms[0].q_world_body);
        let turned = leader.yaw_rad - START_YAW_RAD;
        assert!((turned - 10.0_f64.to_radians()).abs() < 1e-4, "{leader:?}");
        assert!((leader.pitch_rad - 1.0_f64.to_radians()).abs() < 1e-4, "{leader:?}");
        let relative = self.platforms[0].q_world_body.inverse() * self.platforms[1].q_world_body;
        let wanted = YawPitchRoll { yaw_rad: 20.0_f64.to_radians(), ..YawPitchRoll::default() };
        let error = attitude_error(&wanted.attitude(), &relative).norm();
        assert!(error < 3e-4, "{error}");
    }

    fn state(&self) -> &FormationState {
        self.states.last().unwrap()
    }

    /// Runs until the phase is reached; fails after `at_most` seconds.
    fn run_until(&mut self, phase: u8, at_most: f64) {
        for _ in 0..(at_most / 0.01) as u32 {
            if self.core.phase() == phase {
                return;
            }
            self.step();
        }
        panic!("phase {} instead of {phase} after {at_most} s: {:?}", self.core.phase(), self.log);
    }
}

fn reference_of(message: &AttitudeReference) -> Reference {
    Reference {
        q_world_reference: message.q_world_reference.to_unit().unwrap(),
        omega_wr_r_rad_s: message.omega_wr_r_rad_s.into(),
        omega_dot_wr_r_rad_s2: message.omega_dot_wr_r_rad_s2.into(),
    }
}

/// Largest rate, acceleration and kinematic mismatch in a platform's references.
#[derive(Debug, Default)]
struct Smoothness {
    rate_rad_s: f64,
    acceleration_rad_s2: f64,
    mismatch_rad_s: f64,
}

fn smoothness(references: &[AttitudeReference]) -> Smoothness {
    let mut worst = Smoothness::default();
    for pair in references.windows(2) {
        let dt_s = Timestamp::from(pair[1].header.stamp).seconds_since(Timestamp::from(pair[0].header.stamp));
        let (before, after) = (reference_of(&pair[0]), reference_of(&pair[1]));
        let moved = attitude_error(&before.q_world_reference, &after.q_world_reference) / dt_s;
        let mean = (before.omega_wr_r_rad_s + after.omega_wr_r_rad_s) * 0.5;
        let acceleration = (after.omega_wr_r_rad_s - before.omega_wr_r_rad_s) / dt_s;
        worst.rate_rad_s = worst.rate_rad_s.max(moved.norm());
        worst.acceleration_rad_s2 = worst.acceleration_rad_s2.max(acceleration.norm());
        worst.mismatch_rad_s = worst.mismatch_rad_s.max((moved - mean).norm());
    }
    worst
}

impl Smoothness {
    /// Rate 4 deg/s and acceleration 0.6 deg/s^2 in yaw, pitch and roll, and what they make of body
    /// axes.
    fn check(&self) {
        let (rate, acceleration) = (4.0_f64.to_radians(), 0.6_f64.to_radians());
        assert!(self.rate_rad_s < 1.2 * rate, "{self:?}");
        assert!(self.acceleration_rad_s2 < 1.2 * acceleration + 1.5 * rate * rate, "{self:?}");
        assert!(self.mismatch_rad_s < 1e-5, "{self:?}");
    }
}

/// Counts by key, for messages about rates.
fn rates(stamps: impl Iterator<Item = Timestamp>) -> BTreeMap<i64, u32> {
    let mut counts = BTreeMap::new();
    for stamp in stamps {
        *counts.entry(stamp.0 / 1_000_000_000).or_insert(0) += 1;
    }
    counts
}
