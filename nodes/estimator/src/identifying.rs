//! Online identification of mass properties: the optional topic `parameters/estimate`.
//!
//! The estimate is an output only. It has no effect until a person has checked it and written it into the
//! platform's file.

use std::time::Duration;

use nalgebra::{Unit, UnitQuaternion, Vector3};
use whorl_dynamics::mass_parameters::NAMES;
use whorl_dynamics::{ModelPrior, PlatformModel};
use whorl_estimation::sequential::{JointUpdate, OnlineFilter, SequentialEstimate};
use whorl_msgs::sensor_msgs::JointState;
use whorl_msgs::std_msgs::Header;
use whorl_msgs::whorl::ParameterEstimate;
use whorl_node::Timestamp;
use whorl_params::{PlatformPrior, Reader, range};

/// Settings of the identification.
#[derive(Debug, Clone, PartialEq)]
pub struct Identification {
    model: PlatformModel,
    prior: ModelPrior,
    update: JointUpdate,
    forgetting_per_s: f64,
    rate_hz: f64,
}

impl Identification {
    /// Reads group `identification`; `None` when it is not enabled.
    pub(crate) fn read(
        r: &mut Reader<'_>,
        platform: Option<&(PlatformModel, PlatformPrior)>,
    ) -> Option<Self> {
        let (enabled, update, forgetting_per_s, rate_hz) = r.group("identification", |r| {
            let enabled = r.bool_or(
                "enabled",
                false,
                "estimates mass properties while the platform moves, on parameters/estimate; nothing uses them",
            );
            let update = match r.choice_or(
                "filter",
                "extended",
                &["extended", "iterated", "unscented"],
                "measurement update of the joint filter of motion and mass properties",
            ) {
                "iterated" => JointUpdate::Iterated { iterations: 3 },
                "unscented" => JointUpdate::Unscented,
                _ => JointUpdate::Extended,
            };
            let forgetting = r.f64_or(
                "forgetting_per_s",
                1.0,
                range(0.5..=1.0),
                "forgetting factor over one second; 1: never. No standard deviation grows beyond its prior",
            );
            let rate_hz = r.f64_or("rate_hz", 1.0, range(0.01..=20.0), "rate of parameters/estimate [Hz]");
            (enabled, update, forgetting, rate_hz)
        });
        let (model, prior) = platform.filter(|_| enabled)?;
        Some(Self { model: model.clone(), prior: prior.prior.clone(), update, forgetting_per_s, rate_hz })
    }
}

/// Identification of one platform.
pub(crate) struct Identifying {
    settings: Identification,
    filter: Option<OnlineFilter>,
    latest: Option<SequentialEstimate>,
    /// Of this sample is [`Self::latest`].
    latest_stamp: Timestamp,
    /// Zero of the filter's time: seconds since 1970 would lose digits.
    origin: Option<Timestamp>,
    next_message: Option<Timestamp>,
    sequence: u64,
}

impl Identifying {
    pub fn new(settings: &Identification) -> Self {
        Self {
            settings: settings.clone(),
            filter: None,
            latest: None,
            latest_stamp: Timestamp(0),
            origin: None,
            next_message: None,
            sequence: 0,
        }
    }

    fn time_s(&mut self, stamp: Timestamp) -> f64 {
        stamp.seconds_since(*self.origin.get_or_insert(stamp))
    }

    /// Starts once there is a usable attitude.
    pub fn begin(&mut self, q_world_body: UnitQuaternion<f64>) {
        let s = &self.settings;
        self.filter.get_or_insert_with(|| {
            OnlineFilter::new(&s.model, &s.prior, s.update, s.forgetting_per_s, q_world_body)
        });
    }

    pub fn on_imu(&mut self, stamp: Timestamp, gyro_b_rad_s: &Vector3<f64>, force_b_m_s2: &Vector3<f64>) {
        let time_s = self.time_s(stamp);
        let found = self.filter.as_mut().and_then(|f| f.on_imu(time_s, gyro_b_rad_s, force_b_m_s2));
        if found.is_some() {
            self.latest = found;
            self.latest_stamp = stamp;
        }
    }

    pub fn on_direction(&mut self, stamp: Timestamp, direction_b: &Vector3<f64>) {
        let time_s = self.time_s(stamp);
        let sensor = self.settings.model.sensors.vector;
        if let (Some(filter), Some(sensor)) = (&mut self.filter, sensor) {
            let reference: Unit<Vector3<f64>> = sensor.reference_direction_world;
            filter.on_direction(time_s, direction_b, &reference);
        }
    }

    pub fn on_wheels(&mut self, wheels: &JointState) {
        let time_s = self.time_s(wheels.header.stamp.into());
        if let Some(filter) = &mut self.filter {
            filter.on_wheels(time_s, &wheels.velocity, &wheels.effort);
        }
    }

    pub fn on_jets(&mut self, on_time_s: &[f64]) {
        if let Some(filter) = &mut self.filter {
            filter.on_jets(on_time_s);
        }
    }

    pub fn on_ballast(&mut self, moment_b_n_m: &Vector3<f64>) {
        if let Some(filter) = &mut self.filter {
            filter.on_ballast(moment_b_n_m);
        }
    }

    /// The message, when it is due and there is a new estimate.
    pub fn message(&mut self, now: Timestamp, platform: &str) -> Option<ParameterEstimate> {
        if self.next_message.is_some_and(|due| now < due) {
            return None;
        }
        let latest = self.latest.take()?;
        self.next_message = Some(now + Duration::from_secs_f64(1.0 / self.settings.rate_hz));
        let message = ParameterEstimate {
            header: Header { stamp: self.latest_stamp.into(), frame_id: format!("{platform}/base_link") },
            sequence: self.sequence,
            name: NAMES.map(str::to_owned).to_vec(),
            value: latest.estimate.iter().copied().collect(),
            stddev: latest.stddev().iter().copied().collect(),
            prior_stddev: latest.prior_stddev.iter().copied().collect(),
        };
        self.sequence += 1;
        Some(message)
    }
}
