//! A platform in a loop with the core: truth plant, an estimator that knows the truth up to noise, a
//! coordinator of a few lines and a driver of a few lines.

use std::path::{Path, PathBuf};
use std::sync::Arc;

use nalgebra::{UnitQuaternion, Vector3};
use rand_distr::{Distribution, StandardNormal};
use rand_pcg::Pcg64;
use whorl_control::Reference;
use whorl_dynamics::{InitialState, Plant, PlatformModel};
use whorl_math::quaternion_exp;
use whorl_msgs::sensor_msgs::{BatteryState, Imu, JointState};
use whorl_msgs::std_msgs::Header;
use whorl_msgs::topics::{Message, PlatformId, Route, Topic};
use whorl_msgs::whorl::{
    ActuatorCommand, AttitudeEstimate, AttitudeReference, ControlStatus, FormationCommand, ThrusterState,
};
use whorl_node::{Event, NodeCore, Outputs, Timestamp};
use whorl_params::{Override, ParameterTree, standard_layers, try_read};

use crate::{LocalControlCore, Parameters, parameters};

pub const PERIOD_NS: i64 = 10_000_000;

/// The parameter files of the repository with `-p` arguments on top.
pub fn tree(arguments: &[&str]) -> ParameterTree {
    let directory = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../params");
    let files: Vec<PathBuf> = standard_layers(&directory, &["whorl_1", "whorl_2"], None);
    let overrides: Vec<Override> = arguments.iter().map(|text| Override::parse(text).unwrap()).collect();
    ParameterTree::load(&files, &overrides).unwrap()
}

pub fn parameters(platform: &str, arguments: &[&str]) -> Parameters {
    let node = tree(arguments).for_node(&format!("/{platform}/local_control"));
    try_read(&node, parameters::read).unwrap_or_else(|errors| panic!("{errors}")).0
}

/// The truth of a simulation: the model with its truth on top.
pub fn truth(platform: &str) -> PlatformModel {
    let node = tree(&[]).for_node(&format!("/{platform}/driver"));
    let mut reader = whorl_params::Reader::new(&node);
    whorl_params::truth_model(&mut reader).unwrap()
}

/// What one run keeps, step by step.
#[derive(Debug, Clone)]
pub struct Step {
    pub time_s: f64,
    pub q_world_body: UnitQuaternion<f64>,
    pub omega_wb_b_rad_s: Vector3<f64>,
    pub wheel_speed_rad_s: Vec<f64>,
}

pub struct Rig {
    pub core: LocalControlCore,
    pub plant: Plant,
    pub now: Timestamp,
    /// Estimates are sent.
    pub estimator_on: bool,
    pub estimate_health: u8,
    pub imu_on: bool,
    /// The bus voltage is measured.
    pub battery_on: bool,
    /// The gyro repeats its last sample.
    pub imu_frozen: bool,
    /// `None`: no heartbeat.
    pub heartbeat: Option<u8>,
    /// Reference at a time since the start [s]; `None`: none is sent.
    pub reference: Option<Box<dyn Fn(f64) -> Reference>>,
    pub jet_failed: Vec<bool>,
    /// Standard deviation of the estimate: attitude [rad], rate [rad/s].
    pub noise: (f64, f64),
    pub commands: Vec<ActuatorCommand>,
    pub statuses: Vec<ControlStatus>,
    pub messages: Vec<(Route, Message)>,
    pub log: Vec<String>,
    random: Pcg64,
    attitude_noise_rad: Vector3<f64>,
    sequence: u64,
    fired_slot: Option<u64>,
    last_imu: Option<Imu>,
    commanded_at: Timestamp,
}

impl Rig {
    pub fn new(parameters: Parameters, truth: &PlatformModel, start: InitialState) -> Self {
        let jets = truth.jets().len();
        Self {
            core: LocalControlCore::new(parameters).unwrap(),
            plant: Plant::new(truth, &start, 7).unwrap(),
            now: Timestamp(0),
            estimator_on: true,
            estimate_health: AttitudeEstimate::HEALTH_OK,
            imu_on: true,
            battery_on: true,
            imu_frozen: false,
            heartbeat: Some(FormationCommand::COMMAND_TRACK),
            reference: None,
            jet_failed: vec![false; jets],
            noise: (0.0, 0.0),
            commands: Vec::new(),
            statuses: Vec::new(),
            messages: Vec::new(),
            log: Vec::new(),
            random: Pcg64::new(1, 2),
            attitude_noise_rad: Vector3::zeros(),
            sequence: 0,
            fired_slot: None,
            last_imu: None,
            commanded_at: Timestamp(0),
        }
    }

    /// Whorl-I at an attitude, at rest, that shall hold it.
    pub fn holding(platform: &str, arguments: &[&str], q: UnitQuaternion<f64>) -> Self {
        let start = InitialState { q_world_body: q, ..InitialState::default() };
        let mut rig = Self::new(parameters(platform, arguments), &truth(platform), start);
        rig.reference = Some(Box::new(move |_| Reference::at_rest(q)));
        rig
    }

    /// The platform's own topic.
    fn own(&self, topic: Topic) -> Route {
        Route::platform(PlatformId(self.core.parameters().platform.0), topic)
    }

    fn header(&self) -> Header {
        Header { stamp: self.now.into(), frame_id: String::new() }
    }

    pub fn send(&mut self, route: Route, message: impl Into<Message>) {
        let message = message.into();
        self.messages.push((route, message.clone()));
        self.event(Event::Message { route, message: &message });
    }

    pub fn event(&mut self, event: Event<'_>) {
        let mut outputs = Outputs::default();
        self.core.step(self.now, event, &mut outputs);
        self.log.extend(outputs.log.into_iter().map(|line| line.text));
        for publication in outputs.messages {
            match Arc::unwrap_or_clone(publication.message) {
                Message::ActuatorCommand(command) => {
                    self.obey(&command);
                    self.commands.push(command);
                }
                Message::ControlStatus(status) => self.statuses.push(status),
                Message::Vector3Stamped(moment) => self.plant.move_ballast(moment.vector.into()),
                _ => {}
            }
        }
    }

    /// What the driver does.
    fn obey(&mut self, command: &ActuatorCommand) {
        self.plant.command_wheels(&command.wheel_torque_n_m).unwrap();
        self.commanded_at = self.now;
        if self.fired_slot.is_none_or(|fired| command.jet_slot > fired) {
            self.fired_slot = Some(command.jet_slot);
            for (jet, on_time_s) in command.jet_on_time_s.iter().enumerate() {
                if *on_time_s > 0.0 {
                    self.plant.command_jet_pulse(jet, self.now.0, *on_time_s).unwrap();
                }
            }
        }
    }

    pub fn imu(&mut self) -> Imu {
        let sample = self.plant.sample_imu();
        Imu {
            header: self.header(),
            angular_velocity: sample.angular_velocity_rad_s.into(),
            linear_acceleration: sample.specific_force_m_s2.into(),
            ..Imu::default()
        }
    }

    fn draw(&mut self) -> Vector3<f64> {
        Vector3::from_fn(|_, _| StandardNormal.sample(&mut self.random))
    }

    pub fn estimate(&mut self) -> AttitudeEstimate {
        let truth = self.plant.truth();
        // A filter's attitude error wanders slowly: correlated over a second.
        let keep = (-0.01_f64).exp();
        let push = self.draw() * (self.noise.0 * (1.0 - keep * keep).sqrt());
        self.attitude_noise_rad = self.attitude_noise_rad * keep + push;
        let rate_noise = self.draw() * self.noise.1;
        AttitudeEstimate {
            header: self.header(),
            sequence: self.sequence,
            q_world_body: (truth.q_world_body * quaternion_exp(&self.attitude_noise_rad)).into(),
            omega_wb_b_rad_s: (truth.omega_wb_b_rad_s + rate_noise).into(),
            gyro_bias_b_rad_s: truth.gyro_bias_rad_s.into(),
            health: self.estimate_health,
            ..AttitudeEstimate::default()
        }
    }

    pub fn reference_message(&self, reference: &Reference) -> AttitudeReference {
        AttitudeReference {
            header: self.header(),
            sequence: self.sequence,
            valid_until: Timestamp(self.now.0 + 200_000_000).into(),
            q_world_reference: reference.q_world_reference.into(),
            omega_wr_r_rad_s: reference.omega_wr_r_rad_s.into(),
            omega_dot_wr_r_rad_s2: reference.omega_dot_wr_r_rad_s2.into(),
            mode: AttitudeReference::MODE_TRACK,
        }
    }

    pub fn command_message(&self, command: u8) -> FormationCommand {
        FormationCommand {
            header: self.header(),
            sequence: self.sequence,
            command,
            valid_until: Timestamp(self.now.0 + 500_000_000).into(),
        }
    }

    /// One sample of 10 ms: plant, sensors, coordinator, estimate, timer.
    pub fn tick(&mut self) {
        self.now = Timestamp(self.now.0 + PERIOD_NS);
        // The driver's deadman.
        if self.now.seconds_since(self.commanded_at) > 0.1 {
            let wheels = self.core.parameters().model.wheels().len();
            self.plant.command_wheels(&vec![0.0; wheels]).unwrap();
            self.plant.close_all_valves(self.now.0);
        }
        self.plant.advance_to(self.now.0).unwrap();
        self.sequence += 1;

        let velocity = self.plant.sample_wheels().iter().map(|w| w.speed_rad_s).collect();
        let wheels = JointState { header: self.header(), velocity, ..JointState::default() };
        self.send(self.own(Topic::WheelState), wheels);
        let health =
            |failed: &bool| if *failed { ThrusterState::HEALTH_FAILED } else { ThrusterState::HEALTH_OK };
        let health = self.jet_failed.iter().map(health).collect();
        let thrusters = ThrusterState { header: self.header(), health, ..ThrusterState::default() };
        self.send(self.own(Topic::ThrusterState), thrusters);

        if self.battery_on && self.sequence.is_multiple_of(10) {
            let voltage = self.plant.sample_bus_voltage_v() as f32;
            let battery = BatteryState { header: self.header(), voltage, ..BatteryState::default() };
            self.send(self.own(Topic::Battery), battery);
        }
        if self.sequence.is_multiple_of(2)
            && let Some(reference) = &self.reference
        {
            let reference = reference(self.now.seconds());
            self.send(self.own(Topic::AttitudeReference), self.reference_message(&reference));
        }
        if self.sequence.is_multiple_of(5)
            && let Some(command) = self.heartbeat
        {
            self.send(Route::shared(Topic::FormationCommand), self.command_message(command));
        }
        if self.imu_on {
            let imu = match &self.last_imu {
                Some(frozen) if self.imu_frozen => Imu { header: self.header(), ..frozen.clone() },
                _ => self.imu(),
            };
            self.last_imu = Some(imu.clone());
            self.send(self.own(Topic::ImuRaw), imu);
        }
        if self.estimator_on {
            let estimate = self.estimate();
            self.send(self.own(Topic::AttitudeEstimate), estimate);
        }
        if self.sequence.is_multiple_of(2) {
            self.event(Event::Timer);
        }
    }

    /// Runs for a while; what happened, sample by sample.
    pub fn run(&mut self, duration_s: f64) -> Vec<Step> {
        let ticks = (duration_s * 1e9 / PERIOD_NS as f64).round() as usize;
        (0..ticks)
            .map(|_| {
                self.tick();
                let truth = self.plant.truth();
                Step {
                    time_s: self.now.seconds(),
                    q_world_body: truth.q_world_body,
                    omega_wb_b_rad_s: truth.omega_wb_b_rad_s,
                    wheel_speed_rad_s: truth.wheel_speed_rad_s,
                }
            })
            .collect()
    }

    pub fn status(&self) -> &ControlStatus {
        self.statuses.last().expect("a status was published")
    }

    pub fn mode(&self) -> (u8, u8) {
        (self.status().mode, self.status().reason)
    }

    pub fn command(&self) -> &ActuatorCommand {
        self.commands.last().expect("a command was published")
    }

    /// Whether the latest command asks nothing.
    pub fn is_off(&self) -> bool {
        let command = self.command();
        command.wheel_torque_n_m.iter().chain(&command.jet_on_time_s).all(|x| *x == 0.0)
    }

    pub fn rate_rad_s(&self) -> f64 {
        self.plant.truth().omega_wb_b_rad_s.norm()
    }
}

/// Near the balance of Whorl-I (roll 2.0, pitch -0.6 deg), where no torque is needed.
pub fn balanced() -> UnitQuaternion<f64> {
    UnitQuaternion::from_euler_angles(0.035, -0.01, 0.3)
}

pub fn deg(rad: f64) -> f64 {
    rad.to_degrees()
}

/// Root mean square of the pointing error against a constant attitude [deg].
pub fn rms_deg(steps: &[Step], reference: impl Fn(f64) -> UnitQuaternion<f64>) -> f64 {
    let sum: f64 = steps.iter().map(|s| reference(s.time_s).angle_to(&s.q_world_body).powi(2)).sum();
    deg((sum / steps.len() as f64).sqrt())
}
