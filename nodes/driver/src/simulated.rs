//! Simulated hardware: the truth plant behind the interface of real hardware.

use std::time::Duration;

use nalgebra::{UnitQuaternion, Vector3};
use whorl_dynamics::actuators::Kind;
use whorl_dynamics::{InitialState, JetFailure, Plant, PlantError, PlatformModel};
use whorl_math::CELSIUS_ZERO_K;
use whorl_msgs::geometry_msgs::Vector3Stamped;
use whorl_msgs::sensor_msgs::{BatteryState, FluidPressure, Imu, JointState, Temperature};
use whorl_msgs::std_msgs::Header;
use whorl_msgs::topics::{Message, Topic};
use whorl_msgs::whorl::{AttitudeEstimate, ThrusterState};
use whorl_node::Timestamp;

use crate::faults::{Fault, FaultKind, spoil_imu};
use crate::gate::Action;
use crate::hardware::{Hardware, Status};
use crate::messages::{battery, imu_message, joint_names, truth_message};

/// Rates of the slow channels \[Hz\].
const BUS_RATE_HZ: f64 = 10.0;
const TEMPERATURE_RATE_HZ: f64 = 1.0;

/// Where a simulated platform starts.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Start {
    /// Attitude.
    pub q_world_body: UnitQuaternion<f64>,
    /// Body rate seen from the world, body axes [rad/s].
    pub omega_wb_b_rad_s: Vector3<f64>,
    /// Wheel speeds [rad/s]; empty: all stopped.
    pub wheel_speed_rad_s: Vec<f64>,
}

/// A simulated platform.
pub struct SimulatedHardware {
    model: PlatformModel,
    start: Start,
    seed: u64,
    faults: Vec<Fault>,
    /// Of the valve board.
    watchdog: Option<Duration>,
    /// Created at the first call, which gives the start time.
    running: Option<Running>,
    /// Of each kind of actuator that has motors: the topic of its joint states, and the joints' names.
    joint_names: Vec<(Kind, Topic, Vec<String>)>,
}

struct Running {
    plant: Plant,
    began: Timestamp,
    diverged: Option<PlantError>,
    due: Due,
    sequence: u64,
    truth_sequence: u64,
    driven_s: Vec<f64>,
    valve_closes: Vec<Timestamp>,
    /// When the valve board saw the driver last; `None`: its watchdog has acted, or it has not seen it yet.
    heartbeat: Option<Timestamp>,
    /// A fault of a jet is, or was, in force.
    jets_failed: bool,
    last_good_rate: Option<Vector3<f64>>,
}

/// When each slower channel is next measured.
struct Due {
    vector: Timestamp,
    bus: Timestamp,
    temperature: Timestamp,
}

impl SimulatedHardware {
    /// Simulates `model`, which is the truth, from `start`.
    ///
    /// # Errors
    /// When the platform cannot be simulated.
    pub fn new(
        model: PlatformModel,
        start: Start,
        seed: u64,
        faults: Vec<Fault>,
    ) -> Result<Self, PlantError> {
        // The plant is created at the first call, which gives the start time; one is created here
        // too, so that an invalid platform is refused at once.
        Plant::new(&model, &start.at(Timestamp(0)), seed)?;
        let joint_names = joint_names(&model.actuators);
        Ok(Self { model, start, seed, faults, watchdog: None, running: None, joint_names })
    }

    /// Gives the valve board a watchdog: it switches everything off this long after the last heartbeat \[s\]. Zero: none.
    #[must_use]
    pub fn with_watchdog(mut self, watchdog_s: f64) -> Self {
        self.watchdog = (watchdog_s > 0.0).then(|| Duration::from_secs_f64(watchdog_s));
        self
    }

    fn running(&mut self, now: Timestamp) -> Option<&mut Running> {
        if self.running.is_none() {
            // `new` has created a plant of the same model: this cannot fail.
            let plant = Plant::new(&self.model, &self.start.at(now), self.seed).ok()?;
            self.running = Some(Running {
                plant,
                began: now,
                diverged: None,
                due: Due { vector: now, bus: now, temperature: now },
                sequence: 0,
                truth_sequence: 0,
                driven_s: vec![0.0; self.model.jets().len()],
                valve_closes: vec![now; self.model.jets().len()],
                heartbeat: None,
                jets_failed: false,
                last_good_rate: None,
            });
        }
        self.running.as_mut()
    }
}

impl Start {
    /// As a plant takes it, at this time.
    #[must_use]
    pub fn at(&self, now: Timestamp) -> InitialState {
        InitialState {
            time_ns: now.0,
            q_world_body: self.q_world_body,
            omega_wb_b_rad_s: self.omega_wb_b_rad_s,
            wheel_speed_rad_s: self.wheel_speed_rad_s.clone(),
        }
    }
}

impl Hardware for SimulatedHardware {
    fn advance_to(&mut self, now: Timestamp) {
        let (faults, watchdog) = (std::mem::take(&mut self.faults), self.watchdog);
        if let Some(running) = self.running(now) {
            running.fail_jets(now, &faults);
        }
        self.faults = faults;
        let Some(running) = self.running(now) else { return };
        let barks = running.heartbeat.zip(watchdog).map(|(last, after)| last + after);
        if let Some(at) = barks.filter(|at| *at <= now) {
            running.heartbeat = None;
            running.advance_to(at);
            running.switch_off(at);
        }
        running.advance_to(now);
    }

    fn heartbeat(&mut self, now: Timestamp) {
        if let Some(running) = self.running(now) {
            running.heartbeat = Some(now);
        }
    }

    fn apply(&mut self, now: Timestamp, action: &Action) {
        // A simulation that has stopped carries nothing out; its valves would only collect pulses.
        if self.running(now).is_none_or(|running| running.diverged.is_some()) {
            return;
        }
        let Self { model, running: Some(running), .. } = self else { return };
        // The gate has checked sizes and numbers; pulses too short for a valve are skipped.
        match action {
            Action::Motors(kind, command) => {
                let _ = running.plant.command_motors(*kind, command);
            }
            Action::Pulses(on_time_s) => {
                // A slot replaces the rest of the previous one; a valve that is commanded again stays open.
                if running.valve_closes.iter().any(|closes| *closes > now) {
                    running.plant.close_all_valves(now.0);
                    running.valve_closes.fill(now);
                }
                for (jet, (on_time_s, valve)) in on_time_s.iter().zip(model.jets()).enumerate() {
                    let made = *on_time_s > 0.0
                        && *on_time_s >= valve.min_on_time_s
                        && running.plant.command_jet_pulse(jet, now.0, *on_time_s).is_ok();
                    if let Some(closes) = running.valve_closes.get_mut(jet).filter(|_| made) {
                        *closes = now + Duration::from_secs_f64(*on_time_s);
                    }
                }
            }
            Action::AllOff => running.switch_off(now),
        }
    }

    fn move_ballast(&mut self, now: Timestamp, moment_b_n_m: Vector3<f64>) {
        if let Some(running) = self.running(now) {
            running.plant.move_ballast(moment_b_n_m);
        }
    }

    fn measurements(&mut self, now: Timestamp, frame_id: &str, out: &mut Vec<(Topic, Message)>) {
        let vector_period = self.model.sensors.vector.map(|v| Duration::from_secs_f64(1.0 / v.rate_hz));
        let initial_v = self.model.bus.initial_v;
        if self.running(now).is_none_or(|running| running.diverged.is_some()) {
            return;
        }
        let Self { model, faults, joint_names, running: Some(running), .. } = self else { return };
        let sensors = &model.sensors;
        let elapsed_s = now.seconds_since(running.began);
        let active = || faults.iter().filter(|f| f.active(elapsed_s)).map(|f| f.kind);
        let header = Header { stamp: now.into(), frame_id: frame_id.to_owned() };

        let mut imu = running.imu(&header, sensors);
        if spoil_imu(&mut imu, &mut running.last_good_rate, active()) {
            out.push((Topic::ImuRaw, imu.into()));
        }
        for (kind, topic, name) in joint_names {
            out.push((*topic, running.joints(*kind, &header, name.clone()).into()));
        }
        out.push((Topic::ThrusterState, running.thrusters(now, &header).into()));
        if due(&mut running.due.vector, now, vector_period) {
            let sample = running.plant.sample_vector();
            if let Some(sample) = sample.filter(|_| !active().any(|f| f == FaultKind::VectorSilent)) {
                let broken = active().any(|f| f == FaultKind::VectorNan);
                let direction = sample.direction.into_inner();
                let vector = if broken { direction * f64::NAN } else { direction }.into();
                out.push((Topic::VectorDirection, Vector3Stamped { header: header.clone(), vector }.into()));
            }
        }
        if due(&mut running.due.bus, now, Some(Duration::from_secs_f64(1.0 / BUS_RATE_HZ))) {
            out.push((Topic::Battery, running.battery(&header, initial_v).into()));
            out.push((
                Topic::TankPressure,
                running.pressure(&header, sensors.tank_pressure.noise_stddev).into(),
            ));
        }
        if due(&mut running.due.temperature, now, Some(Duration::from_secs_f64(1.0 / TEMPERATURE_RATE_HZ))) {
            // `sensor_msgs/Temperature` is in Celsius.
            let temperature = running.plant.sample_temperature_k() - CELSIUS_ZERO_K;
            let variance = sensors.temperature.noise_stddev.powi(2);
            out.push((Topic::Temperature, Temperature { header, temperature, variance }.into()));
        }
        out.push((Topic::TruthState, running.truth(now).into()));
    }

    fn set_faults(&mut self, faults: &[Fault]) {
        self.faults = faults.to_vec();
    }

    fn status(&self) -> Status {
        match self.running.as_ref().and_then(|r| r.diverged.as_ref()) {
            Some(error) => Status { warning: true, text: format!("simulated hardware stopped: {error}") },
            None => Status { warning: false, text: "simulated hardware".to_owned() },
        }
    }
}

/// Whether a channel is due; if so, sets when it is due again. A channel that is behind is measured
/// once, not several times.
fn due(next: &mut Timestamp, now: Timestamp, period: Option<Duration>) -> bool {
    let Some(period) = period.filter(|_| *next <= now) else { return false };
    while *next <= now {
        *next = *next + period;
    }
    true
}

impl Running {
    /// Puts the faults of jets into force, and lets those go that are over.
    fn fail_jets(&mut self, now: Timestamp, faults: &[Fault]) {
        let elapsed_s = now.seconds_since(self.began);
        let of_jets = |kind| {
            matches!(
                kind,
                FaultKind::JetStuckClosed { .. } | FaultKind::JetStuckOpen { .. } | FaultKind::JetWeak { .. }
            )
        };
        let active = || faults.iter().filter(|f| f.active(elapsed_s)).map(|f| f.kind);
        let failed = active().any(of_jets);
        if !failed && !self.jets_failed {
            return;
        }
        self.jets_failed = failed;
        for jet in 0..self.driven_s.len() {
            let broken = active().find_map(|kind| match kind {
                FaultKind::JetStuckClosed { jet: j } if j == jet => Some(JetFailure::StuckClosed),
                FaultKind::JetStuckOpen { jet: j } if j == jet => Some(JetFailure::StuckOpen),
                _ => None,
            });
            let failure = broken.unwrap_or(JetFailure::None);
            if self.plant.jet_failure(jet) != failure {
                // The jet exists: fault parameters are checked against the platform.
                let _ = self.plant.set_jet_failure(jet, failure);
            }
            let weak = active().find_map(|kind| match kind {
                FaultKind::JetWeak { jet: j, per_mille } if j == jet => Some(per_mille),
                _ => None,
            });
            self.plant.set_jet_strength(jet, f64::from(weak.unwrap_or(1000)) * 1e-3);
        }
    }

    fn advance_to(&mut self, now: Timestamp) {
        if now.0 > self.plant.now_ns() && self.diverged.is_none() {
            self.diverged = self.plant.advance_to(now.0).err();
        }
    }

    fn switch_off(&mut self, now: Timestamp) {
        self.plant.stop_motors();
        self.plant.close_all_valves(now.0);
        self.valve_closes.fill(now);
    }

    fn imu(&mut self, header: &Header, sensors: &whorl_dynamics::platform::SensorSuite) -> Imu {
        let sample = self.plant.sample_imu();
        imu_message(header, sensors, sample.angular_velocity_rad_s, sample.specific_force_m_s2)
    }

    fn joints(&mut self, kind: Kind, header: &Header, name: Vec<String>) -> JointState {
        let sample = self.plant.sample_joints(kind);
        JointState {
            header: header.clone(),
            name,
            position: sample.position_rad,
            velocity: sample.velocity_rad_s,
            effort: sample.effort_n_m,
        }
    }

    fn thrusters(&mut self, now: Timestamp, header: &Header) -> ThrusterState {
        let jets = self.driven_s.len();
        let total_on_time_s: Vec<f64> = (0..jets).map(|j| self.plant.valve_driven_s(j)).collect();
        let on_time_s =
            total_on_time_s.iter().zip(&self.driven_s).map(|(total, before)| total - before).collect();
        self.driven_s.clone_from(&total_on_time_s);
        let sequence = self.sequence;
        self.sequence += 1;
        let health = (0..jets).map(|j| match self.plant.jet_failure(j) {
            JetFailure::None => ThrusterState::HEALTH_OK,
            _ => ThrusterState::HEALTH_FAILED,
        });
        ThrusterState {
            header: header.clone(),
            sequence,
            valve_open: self.valve_closes.iter().map(|closes| *closes > now).collect(),
            on_time_s,
            total_on_time_s,
            health: health.collect(),
        }
    }

    fn battery(&mut self, header: &Header, initial_v: f64) -> BatteryState {
        battery(header, self.plant.sample_bus_voltage_v(), initial_v)
    }

    fn pressure(&mut self, header: &Header, noise_pa: f64) -> FluidPressure {
        let fluid_pressure = self.plant.sample_tank_pressure_pa();
        FluidPressure { header: header.clone(), fluid_pressure, variance: noise_pa.powi(2) }
    }

    fn truth(&mut self, now: Timestamp) -> AttitudeEstimate {
        let sequence = self.truth_sequence;
        self.truth_sequence += 1;
        truth_message(&self.plant.true_motion(), now, sequence)
    }
}
