//! The estimator's state machine: samples in, estimates out.

use std::time::Duration;

use whorl_estimation::{Estimator, EstimatorError, FilterEvent, ImuSample, Rejection, SampleOutcome};
use whorl_msgs::diagnostic_msgs::{DiagnosticArray, DiagnosticStatus, KeyValue};
use whorl_msgs::geometry_msgs::{Transform, TransformStamped};
use whorl_msgs::sensor_msgs::JointState;
use whorl_msgs::std_msgs::Header;
use whorl_msgs::tf2_msgs::TFMessage;
use whorl_msgs::topics::{Message, Route, Topic};
use whorl_msgs::whorl::{AttitudeEstimate, ThrusterState};
use whorl_node::{Configurable, Event, LogLevel, NodeCore, Outputs, Repeats, Timestamp};

use crate::Parameters;
use crate::identifying::Identifying;
use crate::stored::Stored;

/// How often staleness is checked when no IMU sample arrives.
const WATCH_PERIOD: Duration = Duration::from_millis(50);
const DIAGNOSTICS_PERIOD: Duration = Duration::from_secs(1);
/// A measurement stamped further ahead of this computer's clock is refused \[s\]: the filter would take every later one for
/// an old one.
const AHEAD_S: f64 = 1.0;

/// The estimator of one platform.
pub struct EstimatorCore {
    parameters: Parameters,
    filter: Estimator,
    identifying: Option<Identifying>,
    stored: Stored,
    thrusters_before: Option<Timestamp>,
    ahead: u64,
    ahead_lines: Repeats,
    sequence: u64,
    last_published: Option<Timestamp>,
    next_tf: Option<Timestamp>,
    next_diagnostics: Option<Timestamp>,
    last_health: u8,
}

impl EstimatorCore {
    /// An estimator before its first sample.
    ///
    /// # Errors
    /// The first parameter that the filter refuses.
    pub fn new(parameters: Parameters) -> Result<Self, EstimatorError> {
        Ok(Self {
            filter: Estimator::new(parameters.kind, parameters.filter, parameters.body)?,
            identifying: parameters.identification.as_ref().map(Identifying::new),
            stored: Stored::new(&parameters.actuators),
            thrusters_before: None,
            ahead: 0,
            ahead_lines: Repeats::default(),
            parameters,
            sequence: 0,
            last_published: None,
            next_tf: None,
            next_diagnostics: None,
            last_health: AttitudeEstimate::HEALTH_INITIALISING,
        })
    }

    fn route(&self, topic: Topic) -> Route {
        Route::platform(self.parameters.platform, topic)
    }

    fn publish(&mut self, now: Timestamp, outputs: &mut Outputs) {
        let estimate = self.filter.estimate(now.0);
        let stamp = Timestamp(estimate.stamp_ns);
        let mut covariance = [0.0; 36];
        // nalgebra stores columns; the message has rows. The matrix is symmetric, and symmetrised.
        covariance.copy_from_slice(estimate.covariance.as_slice());
        let message = AttitudeEstimate {
            header: Header { stamp: stamp.into(), frame_id: "world".to_owned() },
            sequence: self.sequence,
            q_world_body: estimate.q_world_body.into(),
            omega_wb_b_rad_s: estimate.omega_wb_b_rad_s.into(),
            gyro_bias_b_rad_s: estimate.gyro_bias_b_rad_s.into(),
            covariance,
            nis: estimate.nis.unwrap_or(f64::NAN),
            nis_dof: estimate.nis_dof,
            health: estimate.health as u8,
            flags: estimate.flags.0,
            rejected_samples: estimate.rejected_samples,
        };
        self.sequence += 1;
        self.last_published = Some(now);
        if message.health != self.last_health {
            let level = if message.usable() { LogLevel::Info } else { LogLevel::Warn };
            outputs
                .log(level, format!("{}: estimate is {}", self.parameters.name, health_name(message.health)));
            self.last_health = message.health;
        }
        let usable = message.usable();
        let rotation = message.q_world_body;
        outputs.publish(self.route(Topic::AttitudeEstimate), message);
        self.publish_tf(now, stamp, usable.then_some(rotation), outputs);
        if let Some(identifying) = &mut self.identifying {
            if usable {
                identifying.begin(estimate.q_world_body);
            }
            if let Some(message) = identifying.message(now, &self.parameters.name) {
                outputs.publish(self.route(Topic::ParameterEstimate), message);
            }
        }
    }

    fn publish_tf(
        &mut self,
        now: Timestamp,
        stamp: Timestamp,
        rotation: Option<whorl_msgs::geometry_msgs::Quaternion>,
        outputs: &mut Outputs,
    ) {
        let Some(rotation) = rotation.filter(|_| self.parameters.tf_rate_hz > 0.0) else { return };
        if self.next_tf.is_some_and(|due| now < due) {
            return;
        }
        self.next_tf = Some(now + Duration::from_secs_f64(1.0 / self.parameters.tf_rate_hz));
        let transform = TransformStamped {
            header: Header { stamp: stamp.into(), frame_id: "world".to_owned() },
            child_frame_id: format!("{}/base_link", self.parameters.name),
            transform: Transform { translation: self.parameters.tf_position_w_m.into(), rotation },
        };
        outputs.publish(Route::shared(Topic::Tf), TFMessage { transforms: vec![transform] });
    }

    /// Whether a measurement is stamped so far in the future that it must not be used.
    fn is_ahead(&mut self, now: Timestamp, route: Route, message: &Message, outputs: &mut Outputs) -> bool {
        let ahead_s = message.header().map_or(0.0, |header| Timestamp::from(header.stamp).seconds_since(now));
        if ahead_s <= AHEAD_S {
            return false;
        }
        self.ahead += 1;
        let text = || {
            let (name, topic) = (&self.parameters.name, route.topic.info().name);
            format!("{name}: {topic} refused: stamped {ahead_s:.1} s ahead of this computer's clock")
        };
        if let Some(text) = self.ahead_lines.admit(now, text) {
            outputs.log(LogLevel::Warn, text);
        }
        true
    }

    /// Speeds and torques of wheels, or states of other joints, as momentum and its rate in body axes.
    fn joints_arrived(&mut self, topic: Topic, state: &JointState) {
        if let Some(identifying) = self.identifying.as_mut().filter(|_| topic == Topic::WheelState) {
            identifying.on_wheels(state);
        }
        if let Some((momentum, rate)) = self.stored.arrived(&self.parameters.actuators, topic, state) {
            self.filter.on_wheels(Timestamp::from(state.header.stamp).0, momentum, rate);
        }
    }

    /// Valve times as an angular impulse.
    fn thrusters_arrived(&mut self, thrusters: &ThrusterState) {
        let torques = &self.parameters.jet_torque_b_n_m;
        let stamp = Timestamp::from(thrusters.header.stamp);
        let next = self.thrusters_before.is_none_or(|before| stamp > before);
        if thrusters.on_time_s.len() != torques.len() || !next {
            return;
        }
        self.thrusters_before = Some(stamp);
        if let Some(identifying) = &mut self.identifying {
            identifying.on_jets(&thrusters.on_time_s);
        }
        let impulse = torques.iter().zip(&thrusters.on_time_s).map(|(torque, time_s)| torque * *time_s).sum();
        self.filter.on_jets(&impulse);
    }

    fn note(&self, event: Option<FilterEvent>, outputs: &mut Outputs) {
        let Some(event) = event else { return };
        let (level, text) = match event {
            FilterEvent::StartedWithVector => {
                (LogLevel::Info, "attitude found from gravity and the vector sensor")
            }
            FilterEvent::StartedWithoutVector => {
                (LogLevel::Warn, "attitude found from gravity alone: the heading is assumed")
            }
            FilterEvent::RestartedAfterGap => {
                (LogLevel::Warn, "attitude restarted after a gap in the IMU data")
            }
            FilterEvent::RestartedAfterOutliers => {
                (LogLevel::Warn, "attitude restarted: the accelerometer kept disagreeing with it")
            }
            FilterEvent::RestartedAfterClockStep => {
                (LogLevel::Warn, "attitude restarted after a step of the clock")
            }
            FilterEvent::RestartedAfterDivergence => {
                (LogLevel::Error, "attitude restarted: the filter diverged")
            }
            FilterEvent::HeadingForgotten => {
                (LogLevel::Warn, "heading restarted: the vector sensor kept disagreeing with it")
            }
            FilterEvent::VectorContradicted => (
                LogLevel::Error,
                "the vector sensor turns against the gyro and is used no more: the heading is not known",
            ),
            FilterEvent::AccelerometerContradicted => (
                LogLevel::Error,
                "the accelerometer turns against the gyro and is used no more: the inclination is not known",
            ),
        };
        let axes = match event {
            FilterEvent::VectorContradicted => self.filter.contradictions().last(),
            FilterEvent::AccelerometerContradicted => self.filter.contradictions().first(),
            _ => None,
        };
        let axes =
            axes.and_then(Option::as_ref).map(|found| format!(" ({found}, or the gyro's axes are wrong)"));
        outputs.log(level, format!("{}: {text}{}", self.parameters.name, axes.unwrap_or_default()));
    }

    fn diagnostics(&mut self, now: Timestamp, outputs: &mut Outputs) {
        if self.next_diagnostics.is_some_and(|due| now < due) {
            return;
        }
        self.next_diagnostics = Some(now + DIAGNOSTICS_PERIOD);
        let estimate = self.filter.estimate(now.0);
        let sensors = ["gyro", "accelerometer", "vector sensor"];
        let mut values: Vec<KeyValue> = sensors
            .iter()
            .zip(self.filter.rejections())
            .map(|(sensor, counts)| KeyValue {
                key: format!("{sensor} samples rejected"),
                value: counts.total().to_string(),
            })
            .collect();
        values.push(KeyValue {
            key: "gyro samples at the end of its range".to_owned(),
            value: self.filter.clipping().count().to_string(),
        });
        for (sensor, found) in ["accelerometer", "vector sensor"].iter().zip(self.filter.contradictions()) {
            if let Some(found) = found {
                values.push(KeyValue {
                    key: format!("{sensor} is not used: it turns against the gyro"),
                    value: found.to_string(),
                });
            }
        }
        values.push(KeyValue { key: "samples ahead of the clock".to_owned(), value: self.ahead.to_string() });
        let runs = self.filter.chosen_filter_runs();
        values.push(KeyValue {
            key: "filter".to_owned(),
            value: if runs {
                self.parameters.kind.name
            } else {
                "attitude_bias, until the chosen one can start"
            }
            .to_owned(),
        });
        let sigma_deg = |i: usize| estimate.covariance[(i, i)].sqrt().to_degrees();
        values.push(KeyValue {
            key: "attitude uncertainty, body axes [deg]".to_owned(),
            value: format!("{:.4} {:.4} {:.4}", sigma_deg(0), sigma_deg(1), sigma_deg(2)),
        });
        let health = estimate.health as u8;
        let status = DiagnosticStatus {
            level: match health {
                AttitudeEstimate::HEALTH_OK => DiagnosticStatus::OK,
                AttitudeEstimate::HEALTH_UNHEALTHY => DiagnosticStatus::ERROR,
                _ => DiagnosticStatus::WARN,
            },
            name: format!("{}: estimator", self.parameters.name),
            message: format!("estimate is {}{}", health_name(health), flag_names(estimate.flags.0)),
            hardware_id: self.parameters.name.clone(),
            values,
        };
        let header = Header { stamp: now.into(), frame_id: String::new() };
        outputs.publish(Route::shared(Topic::Diagnostics), DiagnosticArray { header, status: vec![status] });
    }
}

impl NodeCore for EstimatorCore {
    fn subscriptions(&self) -> Vec<Route> {
        let mut topics = vec![Topic::ImuRaw, Topic::VectorDirection];
        if self.parameters.kind.needs_body || self.identifying.is_some() {
            topics.extend(self.stored.topics().chain([Topic::ThrusterState]));
        }
        if self.identifying.is_some() {
            topics.push(Topic::BallastMoment);
        }
        topics.into_iter().map(|topic| self.route(topic)).collect()
    }

    fn publications(&self) -> Vec<Route> {
        let mut routes = vec![
            self.route(Topic::AttitudeEstimate),
            Route::shared(Topic::Tf),
            Route::shared(Topic::Diagnostics),
        ];
        if self.identifying.is_some() {
            routes.push(self.route(Topic::ParameterEstimate));
        }
        routes
    }

    fn timer_period(&self) -> Option<Duration> {
        Some(WATCH_PERIOD)
    }

    fn step(&mut self, now: Timestamp, event: Event<'_>, outputs: &mut Outputs) {
        if let Event::Message { route, message } = &event
            && self.is_ahead(now, *route, message, outputs)
        {
            return;
        }
        match event {
            Event::Message { message: Message::Imu(imu), .. } => {
                let calibration = &self.parameters.calibration;
                let sample = ImuSample {
                    stamp_ns: Timestamp::from(imu.header.stamp).0,
                    gyro_rad_s: calibration.rate_b_rad_s(&imu.angular_velocity.into()),
                    specific_force_m_s2: calibration.specific_force_b_m_s2(&imu.linear_acceleration.into()),
                };
                let outcome = self.filter.on_imu(&sample);
                let used = outcome.gyro == SampleOutcome::Used && outcome.accelerometer.rejection().is_none();
                if let Some(identifying) = self.identifying.as_mut().filter(|_| used) {
                    let stamp = Timestamp(sample.stamp_ns);
                    identifying.on_imu(stamp, &sample.gyro_rad_s, &sample.specific_force_m_s2);
                }
                self.note(outcome.event, outputs);
                // A sample without new information must not make an estimate look fresh.
                let stale = [Rejection::DuplicateStamp, Rejection::OutOfOrder];
                if !matches!(outcome.gyro, SampleOutcome::Rejected(r) if stale.contains(&r)) {
                    self.publish(now, outputs);
                }
            }
            Event::Message { route, message: Message::Vector3Stamped(moment) }
                if route.topic == Topic::BallastMoment =>
            {
                if let Some(identifying) = &mut self.identifying {
                    identifying.on_ballast(&moment.vector.into());
                }
            }
            Event::Message { message: Message::Vector3Stamped(vector), .. } => {
                let stamp_ns = Timestamp::from(vector.header.stamp).0;
                let direction_b = self.parameters.calibration.direction_b(&vector.vector.into());
                let (outcome, event) = self.filter.on_vector(stamp_ns, &direction_b);
                if let Some(identifying) = self.identifying.as_mut().filter(|_| outcome.rejection().is_none())
                {
                    identifying.on_direction(Timestamp(stamp_ns), &direction_b);
                }
                self.note(event, outputs);
            }
            Event::Message { route, message: Message::JointState(state) } => {
                self.joints_arrived(route.topic, state);
            }
            Event::Message { message: Message::ThrusterState(thrusters), .. } => {
                self.thrusters_arrived(thrusters);
            }
            Event::Timer => {
                if self.last_published.is_none_or(|last| now >= last + WATCH_PERIOD) {
                    self.publish(now, outputs);
                }
                self.diagnostics(now, outputs);
            }
            Event::Message { .. }
            | Event::Request { .. }
            | Event::Woken
            | Event::Interruption
            | Event::Shutdown => {}
        }
    }
}

impl Configurable for EstimatorCore {
    type Parameters = Parameters;

    fn reconfigure(&mut self, parameters: &Parameters) -> Result<(), String> {
        if (parameters.platform, &parameters.name) != (self.parameters.platform, &self.parameters.name) {
            return Err("the platform cannot be changed while the estimator runs".to_owned());
        }
        let same = (parameters.filter, parameters.kind, parameters.body)
            == (self.parameters.filter, self.parameters.kind, self.parameters.body);
        if !same {
            let estimate = self.filter.estimate(0);
            let (kind, body) = (parameters.kind, parameters.body);
            // A filter with an attitude continues from it; one without starts again.
            self.filter = if self.last_health == AttitudeEstimate::HEALTH_INITIALISING {
                Estimator::new(kind, parameters.filter, body)
            } else {
                Estimator::with_attitude(
                    kind,
                    parameters.filter,
                    body,
                    estimate.stamp_ns,
                    estimate.q_world_body,
                    estimate.gyro_bias_b_rad_s,
                    &estimate.covariance,
                )
            }
            .map_err(|e| e.to_string())?;
        }
        if parameters.identification != self.parameters.identification {
            self.identifying = parameters.identification.as_ref().map(Identifying::new);
        }
        if parameters.actuators != self.parameters.actuators {
            self.stored = Stored::new(&parameters.actuators);
        }
        self.parameters = parameters.clone();
        Ok(())
    }
}

fn health_name(health: u8) -> &'static str {
    match health {
        AttitudeEstimate::HEALTH_INITIALISING => "initialising",
        AttitudeEstimate::HEALTH_OK => "ok",
        AttitudeEstimate::HEALTH_DEGRADED => "degraded",
        _ => "unhealthy",
    }
}

fn flag_names(flags: u32) -> String {
    let names = [
        (AttitudeEstimate::FLAG_GYRO_REJECTED, "gyro rejected"),
        (AttitudeEstimate::FLAG_ACCELEROMETER_REJECTED, "accelerometer rejected"),
        (AttitudeEstimate::FLAG_VECTOR_REJECTED, "vector sensor rejected"),
        (AttitudeEstimate::FLAG_VECTOR_STALE, "vector sensor stale"),
        (AttitudeEstimate::FLAG_IMU_STALE, "IMU stale"),
        (AttitudeEstimate::FLAG_INCONSISTENT, "inconsistent"),
    ];
    names.iter().filter(|(flag, _)| flags & flag != 0).map(|(_, name)| format!(", {name}")).collect()
}
