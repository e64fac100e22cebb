//! A run in memory, sorted by platform and topic.

use std::collections::BTreeMap;

use whorl_msgs::diagnostic_msgs::DiagnosticArray;
use whorl_msgs::geometry_msgs::Vector3Stamped;
use whorl_msgs::sensor_msgs::{BatteryState, FluidPressure, Imu, JointState, Temperature};
use whorl_msgs::topics::{Message, Topic};
use whorl_msgs::whorl::{
    ActuatorCommand, AttitudeEstimate, AttitudeReference, ClockRequest, ControlStatus, FormationCommand,
    FormationState, ModelFit, ParameterEstimate, ThrusterState,
};

/// A message and when it was recorded, seconds since the first message of the run.
#[derive(Debug, Clone, PartialEq)]
pub struct Recorded<T> {
    /// Recorder's clock \[s\].
    pub log_time_s: f64,
    /// The message's own stamp on the same time line \[s\], corrected for the measured offset of the platform's clock.
    pub stamp_s: f64,
    /// The message.
    pub message: T,
}

/// Everything one platform published or was sent.
#[derive(Debug, Clone, Default)]
pub struct PlatformData {
    /// Gyro and accelerometer.
    pub imu: Vec<Recorded<Imu>>,
    /// Vector sensor.
    pub vector: Vec<Recorded<Vector3Stamped>>,
    /// Wheel speeds and torques.
    pub wheels: Vec<Recorded<JointState>>,
    /// Angles, rates and torques of gimbals.
    pub gimbals: Vec<Recorded<JointState>>,
    /// Valves.
    pub thrusters: Vec<Recorded<ThrusterState>>,
    /// Bus voltage.
    pub battery: Vec<Recorded<BatteryState>>,
    /// Tank pressure.
    pub tank_pressure: Vec<Recorded<FluidPressure>>,
    /// Temperature.
    pub temperature: Vec<Recorded<Temperature>>,
    /// Actuator commands.
    pub command: Vec<Recorded<ActuatorCommand>>,
    /// Estimates.
    pub estimate: Vec<Recorded<AttitudeEstimate>>,
    /// Mass properties estimated while the platform moved.
    pub parameters: Vec<Recorded<ParameterEstimate>>,
    /// References.
    pub reference: Vec<Recorded<AttitudeReference>>,
    /// Controller status.
    pub control: Vec<Recorded<ControlStatus>>,
    /// Whether it moved as its model says.
    pub fit: Vec<Recorded<ModelFit>>,
    /// Truth of simulated hardware or of a recording that contains it.
    pub truth: Vec<Recorded<AttitudeEstimate>>,
}

/// A recorded run.
#[derive(Debug, Clone, Default)]
pub struct RunData {
    /// By platform name.
    pub platforms: BTreeMap<String, PlatformData>,
    /// Formation state.
    pub formation: Vec<Recorded<FormationState>>,
    /// Authority heartbeat.
    pub authority: Vec<Recorded<FormationCommand>>,
    /// Clock offsets of the platforms as measured by the formation's coordinator.
    pub clocks: Vec<Recorded<ClockRequest>>,
    /// Diagnostics of all nodes.
    pub diagnostics: Vec<Recorded<DiagnosticArray>>,
    /// Time between the first and the last message \[s\].
    pub duration_s: f64,
    /// Messages on topics that the report does not use.
    pub other_messages: u64,
    first_log_time_ns: Option<i64>,
    /// Offset of each platform's clock ahead of the coordinator's, as last applied \[s\].
    clock_ahead_s: BTreeMap<String, f64>,
}

impl RunData {
    /// Adds a message that was recorded on the full topic name at `log_time_ns`. Messages are
    /// expected in order of log time.
    pub fn add(&mut self, topic_name: &str, log_time_ns: i64, message: Message) {
        let first = *self.first_log_time_ns.get_or_insert(log_time_ns);
        let log_time_s = seconds(log_time_ns - first);
        self.duration_s = self.duration_s.max(log_time_s);
        let name = topic_name.trim_start_matches('/');
        if let Some(topic) = Topic::find(name, false) {
            return self.add_shared(topic, log_time_s, first, message);
        }
        let found = name.split_once('/').and_then(|(p, rest)| Topic::find(rest, true).map(|t| (p, t)));
        let Some((platform, topic)) = found else {
            self.other_messages += 1;
            return;
        };
        if !self.platforms.contains_key(platform) {
            self.platforms.insert(platform.to_owned(), PlatformData::default());
        }
        let ahead_s = self.clock_ahead_s.get(platform).copied().unwrap_or(0.0);
        let Some(data) = self.platforms.get_mut(platform) else { return };
        macro_rules! keep {
            ($($topic:ident $variant:ident $field:ident;)+) => {
                match (topic, message) {
                    $((Topic::$topic, Message::$variant(message)) => data.$field.push(Recorded {
                        log_time_s,
                        stamp_s: stamp_s(message.header.stamp, first).map_or(log_time_s, |s| s - ahead_s),
                        message,
                    }),)+
                    _ => self.other_messages += 1,
                }
            };
        }
        keep! {
            ImuRaw Imu imu;
            VectorDirection Vector3Stamped vector;
            WheelState JointState wheels;
            GimbalState JointState gimbals;
            ThrusterState ThrusterState thrusters;
            Battery BatteryState battery;
            TankPressure FluidPressure tank_pressure;
            Temperature Temperature temperature;
            ActuatorCommand ActuatorCommand command;
            AttitudeEstimate AttitudeEstimate estimate;
            ParameterEstimate ParameterEstimate parameters;
            AttitudeReference AttitudeReference reference;
            ControlStatus ControlStatus control;
            ModelFit ModelFit fit;
            TruthState AttitudeEstimate truth;
        }
    }

    fn add_shared(&mut self, topic: Topic, log_time_s: f64, first: i64, message: Message) {
        match (topic, message) {
            (Topic::FormationState, Message::FormationState(message)) => {
                let stamp_s = stamp_s(message.header.stamp, first).unwrap_or(log_time_s);
                self.formation.push(Recorded { log_time_s, stamp_s, message });
            }
            (Topic::FormationCommand, Message::FormationCommand(message)) => {
                let stamp_s = stamp_s(message.header.stamp, first).unwrap_or(log_time_s);
                self.authority.push(Recorded { log_time_s, stamp_s, message });
            }
            // The platforms' own coordinators publish offsets too, relative to their own clocks.
            (Topic::FormationClock, Message::ClockRequest(message))
                if message.header.frame_id == "coordinator" =>
            {
                let stamp_s = stamp_s(message.header.stamp, first).unwrap_or(log_time_s);
                for (platform, ahead_s) in message.platforms.iter().zip(&message.applied_s) {
                    self.clock_ahead_s.insert(platform.clone(), *ahead_s);
                }
                self.clocks.push(Recorded { log_time_s, stamp_s, message });
            }
            (Topic::Diagnostics, Message::DiagnosticArray(message)) => {
                let stamp_s = stamp_s(message.header.stamp, first).unwrap_or(log_time_s);
                self.diagnostics.push(Recorded { log_time_s, stamp_s, message });
            }
            _ => self.other_messages += 1,
        }
    }
}

fn seconds(ns: i64) -> f64 {
    ns as f64 * 1e-9
}

/// `None` for the zero stamp of a message that derives from no measurement.
fn stamp_s(stamp: whorl_msgs::builtin_interfaces::Time, first_ns: i64) -> Option<f64> {
    let ns = i64::from(stamp.sec) * 1_000_000_000 + i64::from(stamp.nanosec);
    (ns != 0).then(|| seconds(ns - first_ns))
}
