//! Real hardware: the platform's devices behind the interface that simulated hardware has.

use std::sync::Arc;
use std::time::{Duration, Instant};

use nalgebra::Vector3;
use whorl_devices::logical::LogicalImu;
use whorl_devices::{Command, DeviceList, Devices, Joint, Measured, Reading, Role, State};
use whorl_dynamics::PlatformModel;
use whorl_dynamics::actuators::Kind;
use whorl_math::CELSIUS_ZERO_K;
use whorl_msgs::geometry_msgs::Vector3Stamped;
use whorl_msgs::sensor_msgs::{FluidPressure, Imu, JointState, Temperature};
use whorl_msgs::std_msgs::Header;
use whorl_msgs::topics::{Message, Topic};
use whorl_msgs::whorl::ThrusterState;
use whorl_node::Timestamp;

use crate::gate::Action;
use crate::hardware::{Hardware, Status};
use crate::messages::{battery, imu_message, joint_names};
use crate::prearm::{PreArm, Supplies};
use crate::{Parameters, StartedDevices};

/// A speed older than this is none.
const STALE: Duration = Duration::from_millis(100);
/// The same of a current from the power bus.
const STALE_SUPPLY: Duration = Duration::from_secs(1);

/// A platform of devices.
pub struct DeviceHardware {
    model: PlatformModel,
    list: DeviceList,
    /// Where several devices make it together.
    imu: Option<LogicalImu>,
    devices: Devices,
    states: Vec<State>,
    refused: Vec<u64>,
    joints: Vec<Joints>,
    valves: Vec<Valve>,
    sequence: u64,
    /// What to tell in the log.
    news: Vec<(bool, String)>,
    /// Where the devices are, for the status.
    place: String,
    prearm: PreArm,
    supplies: Supplies,
    /// Drawn from the power bus \[A\], and when that was.
    bus_current: Option<(f64, Instant)>,
    is_stopped: bool,
    told_of_masses: bool,
    /// The node's time, and the instant of it: devices count in instants.
    began: (Timestamp, Instant),
}

/// Moving parts of one kind of actuator.
struct Joints {
    kind: Kind,
    topic: Topic,
    names: Vec<String>,
    /// Of each, and when.
    latest: Vec<Option<(Joint, Instant)>>,
}

/// What the valve's board has confirmed.
#[derive(Debug, Clone, Copy, Default)]
struct Valve {
    open_since: Option<Instant>,
    closed_total_s: f64,
    told_s: f64,
}

impl Valve {
    fn switched(&mut self, at: Instant, open: bool) {
        match (open, self.open_since) {
            (true, None) => self.open_since = Some(at),
            (false, Some(since)) => {
                self.closed_total_s += at.saturating_duration_since(since).as_secs_f64();
                self.open_since = None;
            }
            _ => {}
        }
    }

    /// On-time since the last call, and in all. Edges are told a little late; what was counted is not taken back.
    fn on_time_s(&mut self, now: Instant) -> (f64, f64) {
        let open = self.open_since.map_or(0.0, |since| now.saturating_duration_since(since).as_secs_f64());
        let before = self.told_s;
        self.told_s = before.max(self.closed_total_s + open);
        (self.told_s - before, self.told_s)
    }
}

impl DeviceHardware {
    /// Drives these devices, which have been started.
    #[must_use]
    pub fn new(parameters: &Parameters, started: StartedDevices, place: String) -> Self {
        let (model, list) = (&parameters.model, parameters.devices.clone());
        let StartedDevices { devices, began } = started;
        let joints = joint_names(&model.actuators).into_iter().map(|(kind, topic, names)| {
            let latest = vec![None; names.len()];
            Joints { kind, topic, names, latest }
        });
        Self {
            states: vec![State::Connecting; list.devices.len()],
            refused: vec![0; list.devices.len()],
            joints: joints.collect(),
            valves: vec![Valve::default(); model.jets().len()],
            model: model.clone(),
            imu: list.imu.clone().map(LogicalImu::new),
            list,
            devices,
            sequence: 0,
            news: Vec::new(),
            place,
            prearm: PreArm::default(),
            supplies: parameters.supplies,
            bus_current: None,
            is_stopped: false,
            told_of_masses: false,
            began,
        }
    }

    /// The instant of this time of the node, which runs with the monotonic clock.
    fn instant(&self, now: Timestamp) -> Instant {
        let (began, instant) = self.began;
        instant + Duration::try_from_secs_f64(now.seconds_since(began)).unwrap_or_default()
    }

    /// What is wrong with which device, a sentence each.
    fn troubles(&self) -> Vec<String> {
        let stop = self.is_stopped.then(|| "the emergency stop is pressed: release it".to_owned());
        let devices = self.list.devices.iter().zip(&self.states);
        devices
            .filter_map(|(named, state)| match state {
                State::Ready => None,
                State::Fault(reason) => Some(format!("device {} reports: {reason}", named.name)),
                State::Lost(reason) => Some(format!("device {} is lost: {reason}", named.name)),
                State::Connecting => Some(format!("device {} has not answered yet", named.name)),
            })
            .chain(stop)
            .collect()
    }

    fn name(&self, device: usize) -> &str {
        self.list.devices.get(device).map_or("?", |named| named.name.as_str())
    }

    fn state_changed(&mut self, device: usize, state: State) {
        let name = self.name(device);
        let was_lost = matches!(self.states.get(device), Some(State::Lost(_)));
        let news = match &state {
            State::Ready if was_lost => (false, format!("device {name} is back")),
            State::Ready => (false, format!("device {name} answers")),
            State::Fault(reason) => (true, format!("device {name} reports: {reason}")),
            State::Lost(reason) => (true, format!("device {name} is lost: {reason}; trying again")),
            State::Connecting => (false, format!("device {name} is being connected")),
        };
        self.news.push(news);
        if let Some(slot) = self.states.get_mut(device) {
            *slot = state;
        }
    }

    /// Whether the device that gives this is lost.
    fn is_lost(&self, role: Role) -> bool {
        let mut devices = self.list.devices.iter().zip(&self.states);
        devices.any(|(named, state)| !is_usable(state) && named.device.roles().contains(&role))
    }

    /// What a device measured, or what the logical sensor makes of it.
    fn of_logical(&mut self, device: usize, at: Instant, measured: Measured) -> Option<(Instant, Measured)> {
        let Some(imu) = self.imu.as_mut().filter(|imu| imu.has(device)) else { return Some((at, measured)) };
        let sample = match &measured {
            Measured::Imu { rate_b_rad_s, specific_force_b_m_s2 } => {
                imu.sampled(device, at, rate_b_rad_s.as_slice(), specific_force_b_m_s2.as_slice())
            }
            Measured::Axes { rate_rad_s, specific_force_m_s2 } => {
                imu.sampled(device, at, rate_rad_s, specific_force_m_s2)
            }
            // All of them are at the same place: the temperature of one.
            Measured::Temperature(_) => {
                let usable = |device: usize| self.states.get(device).is_some_and(is_usable);
                let first = imu.setup().members.iter().map(|member| member.device).find(|d| usable(*d));
                return (first == Some(device)).then_some((at, measured));
            }
            _ => return Some((at, measured)),
        };
        self.news.extend(imu.take_news());
        sample.map(|sample| {
            let (rate_b_rad_s, specific_force_b_m_s2) = (sample.rate_b_rad_s, sample.specific_force_b_m_s2);
            (sample.at, Measured::Imu { rate_b_rad_s, specific_force_b_m_s2 })
        })
    }

    fn joints_measured(
        &mut self,
        header: &Header,
        at: Instant,
        kind: Kind,
        motors: &[Joint],
    ) -> Option<(Topic, Message)> {
        let joints = self.joints.iter_mut().find(|joints| joints.kind == kind)?;
        for joint in motors {
            if let Some(slot) = joints.latest.get_mut(joint.index) {
                *slot = Some((*joint, at));
            }
        }
        let fresh = |slot: &Option<(Joint, Instant)>| {
            slot.filter(|(_, when)| at.saturating_duration_since(*when) < STALE).map(|(joint, _)| joint)
        };
        let all: Vec<Joint> = joints.latest.iter().map(fresh).collect::<Option<_>>()?;
        let angles: Option<Vec<f64>> = all.iter().map(|joint| joint.angle_rad).collect();
        let state = JointState {
            header: header.clone(),
            name: joints.names.clone(),
            position: angles.unwrap_or_default(),
            velocity: all.iter().map(|joint| joint.speed_rad_s).collect(),
            effort: all.iter().map(|joint| joint.torque_n_m).collect(),
        };
        Some((joints.topic, state.into()))
    }

    fn thrusters(&mut self, header: &Header, now: Instant) -> ThrusterState {
        let on_times: Vec<(f64, f64)> = self.valves.iter_mut().map(|valve| valve.on_time_s(now)).collect();
        let (on_time_s, total_on_time_s) = on_times.into_iter().unzip();
        let sequence = self.sequence;
        self.sequence += 1;
        let health = (0..self.valves.len()).map(|jet| {
            if self.is_lost(Role::Jet(jet)) { ThrusterState::HEALTH_FAILED } else { ThrusterState::HEALTH_OK }
        });
        ThrusterState {
            header: header.clone(),
            sequence,
            valve_open: self.valves.iter().map(|valve| valve.open_since.is_some()).collect(),
            on_time_s,
            total_on_time_s,
            health: health.collect(),
        }
    }
}

fn is_usable(state: &State) -> bool {
    matches!(state, State::Ready | State::Fault(_))
}

impl Hardware for DeviceHardware {
    fn advance_to(&mut self, _now: Timestamp) {}

    fn heartbeat(&mut self, _now: Timestamp) {
        self.devices.command(&Command::Alive);
    }

    fn apply(&mut self, now: Timestamp, action: &Action) {
        let command = match action {
            Action::Motors(kind, values) => Command::Motors(*kind, Arc::from(values.as_slice())),
            Action::Pulses(on_time_s) => Command::Pulses(self.instant(now), Arc::from(on_time_s.as_slice())),
            Action::AllOff => Command::AllOff,
        };
        self.devices.command(&command);
    }

    fn measurements(&mut self, now: Timestamp, frame_id: &str, out: &mut Vec<(Topic, Message)>) {
        let instant = self.instant(now);
        let header = |at: Instant| Header {
            stamp: (now - instant.saturating_duration_since(at)).into(),
            frame_id: frame_id.to_owned(),
        };
        let sensors = self.model.sensors;
        while let Some(reading) = self.devices.next_reading() {
            let (device, at, measured) = match reading {
                Reading::Measured { device, at, measured } => (device, at, measured),
                Reading::State { device, state } => {
                    self.state_changed(device, state);
                    continue;
                }
                Reading::Refused { device, count } => {
                    self.refused.get_mut(device).into_iter().for_each(|total| *total += count);
                    continue;
                }
            };
            let Some((at, measured)) = self.of_logical(device, at, measured) else { continue };
            let header = header(at);
            match measured {
                // Parts of a logical sensor, which has taken them.
                Measured::Axes { .. } => {}
                Measured::Imu { rate_b_rad_s, specific_force_b_m_s2 } => {
                    self.prearm.sampled(at, rate_b_rad_s, specific_force_b_m_s2);
                    let state = self.thrusters(&Header { stamp: now.into(), ..header.clone() }, instant);
                    out.push((Topic::ThrusterState, state.into()));
                    let message: Imu = imu_message(&header, &sensors, rate_b_rad_s, specific_force_b_m_s2);
                    out.push((Topic::ImuRaw, message.into()));
                }
                Measured::Direction(direction_b) => {
                    let message = Vector3Stamped { header, vector: direction_b.into() };
                    out.push((Topic::VectorDirection, message.into()));
                }
                Measured::Motors { kind, motors } => {
                    out.extend(self.joints_measured(&header, at, kind, &motors))
                }
                Measured::Valves(switched) => {
                    for (jet, open) in switched {
                        self.valves.get_mut(jet).into_iter().for_each(|valve| valve.switched(at, open));
                    }
                }
                Measured::EmergencyStop(is_pressed) => {
                    if std::mem::replace(&mut self.is_stopped, is_pressed) != is_pressed {
                        let text = if is_pressed { "pressed" } else { "released" };
                        self.news.push((is_pressed, format!("the emergency stop is {text}")));
                    }
                }
                Measured::BusVoltage(volt) => {
                    self.prearm.bus_voltage(volt);
                    let mut message = battery(&header, volt, self.model.bus.initial_v);
                    let fresh =
                        |(_, when): &(f64, Instant)| at.saturating_duration_since(*when) < STALE_SUPPLY;
                    if let Some((amp, _)) = self.bus_current.filter(fresh) {
                        // The message's sign: negative when discharging.
                        message.current = -amp as f32;
                    }
                    out.push((Topic::Battery, message.into()));
                }
                Measured::BusCurrent(amp) => self.bus_current = Some((amp, at)),
                Measured::TankPressure(fluid_pressure) => {
                    self.prearm.tank_pressure(fluid_pressure);
                    let variance = sensors.tank_pressure.noise_stddev.powi(2);
                    out.push((
                        Topic::TankPressure,
                        FluidPressure { header, fluid_pressure, variance }.into(),
                    ));
                }
                Measured::Temperature(kelvin) => {
                    let variance = sensors.temperature.noise_stddev.powi(2);
                    let temperature = kelvin - CELSIUS_ZERO_K;
                    out.push((Topic::Temperature, Temperature { header, temperature, variance }.into()));
                }
            }
        }
    }

    /// No kind of device moves masses yet: said once, so that nobody waits for balance.
    fn move_ballast(&mut self, _now: Timestamp, moment_b_n_m: Vector3<f64>) {
        if moment_b_n_m != Vector3::zeros() && !std::mem::replace(&mut self.told_of_masses, true) {
            let text = "linear mass actuators are to move, but no device of this platform moves them: balance by hand";
            self.news.push((true, text.to_owned()));
        }
    }

    fn not_ready(&self) -> Vec<String> {
        let mut reasons = self.troubles();
        reasons.extend(self.prearm.hindrances(&self.model, &self.supplies));
        reasons
    }

    fn is_stopped(&self) -> bool {
        self.is_stopped
    }

    fn lost_needed(&self) -> Option<String> {
        if let Some(imu) = &self.imu
            && (imu.is_undecided()
                || !imu.setup().is_complete(|device| self.states.get(device).is_some_and(is_usable)))
        {
            return Some("logical.imu".to_owned());
        }
        let devices = self.list.devices.iter().zip(&self.states);
        // Jets whose board is lost are marked as failed, and control does without them; without a member, the logical sensor
        // goes on.
        let needed = |role: &Role| match role {
            Role::Imu => self.imu.is_none(),
            Role::Motor(..) | Role::EmergencyStop => true,
            _ => false,
        };
        devices
            .filter(|(named, state)| !is_usable(state) && named.device.roles().iter().any(needed))
            .map(|(named, _)| named.name.clone())
            .next()
    }

    fn take_news(&mut self) -> Vec<(bool, String)> {
        std::mem::take(&mut self.news)
    }

    fn status(&self) -> Status {
        let wrong = self.troubles();
        let refused: Vec<String> = self
            .refused
            .iter()
            .enumerate()
            .filter(|(_, count)| **count > 0)
            .map(|(device, count)| format!("{}: {count} bytes or answers refused", self.name(device)))
            .collect();
        let warning = !wrong.is_empty();
        let mut text = vec![format!("{} devices{}", self.list.devices.len(), self.place)];
        text.extend(wrong);
        text.extend(refused);
        Status { warning, text: text.join("; ") }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn on_time_is_counted_from_edge_to_edge_and_never_taken_back() {
        let begin = Instant::now();
        let ms = |ms: u64| begin + Duration::from_millis(ms);
        let mut valve = Valve::default();
        valve.switched(ms(3), true);
        let (first, _) = valve.on_time_s(ms(10));
        assert!((first - 0.007).abs() < 1e-9);
        // Told at 20 ms that it was closed at 9 ms: one millisecond too much was counted, and is made up for.
        valve.switched(ms(9), false);
        assert_eq!(valve.on_time_s(ms(20)).0, 0.0);
        valve.switched(ms(25), true);
        let (later, total) = valve.on_time_s(ms(30));
        assert!((later - 0.004).abs() < 1e-9 && (total - 0.011).abs() < 1e-9, "{later}, {total}");
    }
}
