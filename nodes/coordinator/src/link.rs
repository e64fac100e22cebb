//! The link to one platform: its latest accepted messages and their ages.

use nalgebra::{UnitQuaternion, Vector3};
use whorl_control::reference::Reference;
use whorl_math::integrate_rate;
use whorl_msgs::whorl::{AttitudeEstimate, AttitudeReference, ClockReply, ControlStatus, ModelFit};
use whorl_node::Timestamp;

use crate::clock::SenderClock;
use crate::parameters::LinkSettings;

/// A message stamped further in the future than this is refused \[s\].
const FUTURE_TOLERANCE_S: f64 = 0.1;

/// Messages that were not used, by reason.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct Dropped {
    /// A number was not finite, or the quaternion not of unit norm.
    pub invalid: u64,
    /// Not newer than the latest one accepted.
    pub out_of_order: u64,
    /// Too old on arrival.
    pub late: u64,
    /// Stamped in the future.
    pub future: u64,
}

#[derive(Debug, Clone, Copy)]
struct Estimate {
    stamp: Timestamp,
    q_world_body: UnitQuaternion<f64>,
    omega_wb_b_rad_s: Vector3<f64>,
    health: u8,
    usable: bool,
}

#[derive(Debug, Clone, Copy)]
struct Status {
    stamp: Timestamp,
    mode: u8,
    reason: u8,
}

/// The link to one platform.
#[derive(Debug, Clone)]
pub(crate) struct PlatformLink {
    name: String,
    clock: SenderClock,
    estimate: Option<Estimate>,
    status: Option<Status>,
    /// What its model monitor says, where it says that the model has stopped being right.
    mismatch: Option<String>,
    /// Its latest reference, when another coordinator sends it.
    reference: Option<(Timestamp, Reference)>,
    latest_sequence: Option<u64>,
    /// Estimates that never arrived, from gaps in their sequence numbers.
    pub lost_estimates: u64,
    pub dropped: Dropped,
}

impl PlatformLink {
    pub fn new(name: &str) -> Self {
        Self {
            name: name.to_owned(),
            clock: SenderClock::default(),
            estimate: None,
            status: None,
            mismatch: None,
            reference: None,
            latest_sequence: None,
            lost_estimates: 0,
            dropped: Dropped::default(),
        }
    }

    /// Takes an estimate; false when it was dropped.
    pub fn take_estimate(
        &mut self,
        now: Timestamp,
        message: &AttitudeEstimate,
        settings: &LinkSettings,
    ) -> bool {
        let stamp = self.clock.to_local(message.header.stamp);
        let omega_wb_b_rad_s = Vector3::from(message.omega_wb_b_rad_s);
        let Some(q_world_body) = message.q_world_body.to_unit().filter(|_| finite(&omega_wb_b_rad_s)) else {
            // An estimator that is initialising may send invalid numbers.
            if message.usable() {
                self.dropped.invalid += 1;
                return false;
            }
            return self.accept(now, stamp, message, UnitQuaternion::identity(), Vector3::zeros(), settings);
        };
        self.accept(now, stamp, message, q_world_body, omega_wb_b_rad_s, settings)
    }

    fn accept(
        &mut self,
        now: Timestamp,
        stamp: Timestamp,
        message: &AttitudeEstimate,
        q_world_body: UnitQuaternion<f64>,
        omega_wb_b_rad_s: Vector3<f64>,
        settings: &LinkSettings,
    ) -> bool {
        if !self.in_time(now, stamp, self.estimate.map(|e| e.stamp), settings.stale_s) {
            return false;
        }
        if let Some(latest) = self.latest_sequence
            && message.sequence > latest
        {
            self.lost_estimates = self.lost_estimates.saturating_add(message.sequence - latest - 1);
        }
        self.latest_sequence = Some(message.sequence);
        let (health, usable) = (message.health, message.usable());
        self.estimate = Some(Estimate { stamp, q_world_body, omega_wb_b_rad_s, health, usable });
        true
    }

    /// The clock of the platform's computer.
    pub fn clock(&self) -> &SenderClock {
        &self.clock
    }

    /// Takes the time of the platform's computer. True when stamps are translated by another amount from now on.
    pub fn take_time(&mut self, now: Timestamp, message: &ClockReply) -> bool {
        self.clock.take(now, message.asked, message.header.stamp)
    }

    /// Takes a status; false when it was dropped.
    pub fn take_status(&mut self, now: Timestamp, message: &ControlStatus, settings: &LinkSettings) -> bool {
        let stamp = self.clock.to_local(message.header.stamp);
        if message.mode > ControlStatus::MODE_EXCITE {
            self.dropped.invalid += 1;
            return false;
        }
        // Its stamp is that of the estimate acted on: the same estimate may be acted on twice.
        let latest = self.status.map(|s| Timestamp(s.stamp.0.saturating_sub(1)));
        if !self.in_time(now, stamp, latest, settings.status_stale_s) {
            return false;
        }
        self.status = Some(Status { stamp, mode: message.mode, reason: message.reason });
        true
    }

    /// Takes what its model monitor says.
    pub fn take_fit(&mut self, message: &ModelFit) {
        let broken = message.state == ModelFit::STATE_MISMATCH;
        self.mismatch = broken.then(|| format!("{}: {}", self.name, message.in_words()));
    }

    /// Why the platform's model is not right, in words.
    pub fn mismatch(&self) -> Option<&str> {
        self.mismatch.as_deref()
    }

    /// Takes a reference that another coordinator gives the platform; false when it was dropped.
    pub fn take_reference(
        &mut self,
        now: Timestamp,
        message: &AttitudeReference,
        settings: &LinkSettings,
    ) -> bool {
        let stamp = self.clock.to_local(message.header.stamp);
        let reference = message.q_world_reference.to_unit().map(|q| Reference {
            q_world_reference: q,
            omega_wr_r_rad_s: message.omega_wr_r_rad_s.into(),
            omega_dot_wr_r_rad_s2: message.omega_dot_wr_r_rad_s2.into(),
        });
        let Some(reference) = reference.filter(Reference::is_finite) else {
            self.dropped.invalid += 1;
            return false;
        };
        if !self.in_time(now, stamp, self.reference.map(|(latest, _)| latest), settings.stale_s) {
            return false;
        }
        self.reference = Some((stamp, reference));
        true
    }

    /// The reference that another coordinator gives the platform, extrapolated to now; `None` unless fresh.
    pub fn reference(&self, now: Timestamp, settings: &LinkSettings) -> Option<Reference> {
        let (stamp, reference) = self.reference.as_ref()?;
        let age_s = now.seconds_since(*stamp);
        (age_s <= settings.stale_s).then(|| reference.extrapolated(age_s.max(0.0)))
    }

    fn in_time(&mut self, now: Timestamp, stamp: Timestamp, latest: Option<Timestamp>, stale_s: f64) -> bool {
        let age_s = now.seconds_since(stamp);
        let counter = if age_s < -FUTURE_TOLERANCE_S {
            &mut self.dropped.future
        } else if age_s > stale_s {
            &mut self.dropped.late
        } else if latest.is_some_and(|latest| stamp <= latest) {
            &mut self.dropped.out_of_order
        } else {
            return true;
        };
        *counter += 1;
        false
    }

    pub fn name(&self) -> &str {
        &self.name
    }

    /// Age of the latest estimate \[s\]; infinite when there is none.
    pub fn age_s(&self, now: Timestamp) -> f64 {
        self.estimate.map_or(f64::INFINITY, |e| now.seconds_since(e.stamp).max(0.0))
    }

    pub fn health(&self) -> u8 {
        self.estimate.map_or(AttitudeEstimate::HEALTH_INITIALISING, |e| e.health)
    }

    pub fn fresh(&self, now: Timestamp, settings: &LinkSettings) -> bool {
        self.age_s(now) <= settings.stale_s
    }

    /// Attitude and rate now, extrapolated from the latest estimate; `None` unless fresh and healthy.
    pub fn motion(
        &self,
        now: Timestamp,
        settings: &LinkSettings,
    ) -> Option<(UnitQuaternion<f64>, Vector3<f64>)> {
        let estimate = self.estimate.filter(|e| e.usable && self.fresh(now, settings))?;
        let q = integrate_rate(&estimate.q_world_body, &estimate.omega_wb_b_rad_s, self.age_s(now));
        Some((q, estimate.omega_wb_b_rad_s))
    }

    fn status_fresh(&self, now: Timestamp, settings: &LinkSettings) -> Option<Status> {
        self.status.filter(|s| now.seconds_since(s.stamp) <= settings.status_stale_s)
    }

    /// `ControlStatus::MODE_*` last reported, idle when unknown.
    pub fn control_mode(&self) -> u8 {
        self.status.map_or(ControlStatus::MODE_IDLE, |s| s.mode)
    }

    /// Whether the platform's controller tracks its reference, holds the last one, or plays a requested excitation.
    pub fn following(&self, now: Timestamp, settings: &LinkSettings) -> bool {
        self.status_fresh(now, settings).is_some_and(|s| {
            matches!(
                s.mode,
                ControlStatus::MODE_TRACK | ControlStatus::MODE_HOLD | ControlStatus::MODE_EXCITE
            ) && s.reason != ControlStatus::REASON_EXCITATION_UNKNOWN
        })
    }

    /// Whether the platform's controller says that it hears no authority: while an experiment runs, it is sent all the time,
    /// so it does not arrive. A stale reference says less: while the experiment waits, that is what is sent.
    pub fn deaf(&self, now: Timestamp, settings: &LinkSettings) -> bool {
        self.status_fresh(now, settings).is_some_and(|s| s.reason == ControlStatus::REASON_NO_AUTHORITY)
    }

    /// Whether the platform plays an excitation instead of tracking its reference.
    pub fn excited(&self, now: Timestamp, settings: &LinkSettings) -> bool {
        self.status_fresh(now, settings).is_some_and(|s| {
            s.mode == ControlStatus::MODE_EXCITE || s.reason == ControlStatus::REASON_EXCITATION_LIMIT
        })
    }

    /// Why the estimate cannot be used, in words.
    pub fn estimate_problem(&self, now: Timestamp, settings: &LinkSettings) -> Option<String> {
        let name = &self.name;
        let Some(estimate) = self.estimate else {
            return Some(format!("{name}: no attitude/estimate received (are its driver and estimator up?)"));
        };
        if !self.fresh(now, settings) {
            return Some(format!("{name}: attitude/estimate is {:.1} s old", self.age_s(now)));
        }
        match estimate.health {
            _ if estimate.usable => None,
            AttitudeEstimate::HEALTH_INITIALISING => Some(format!("{name}: estimator is initialising")),
            _ => Some(format!("{name}: estimate is unhealthy")),
        }
    }

    /// Why the controller cannot be commanded, in words.
    pub fn control_problem(&self, now: Timestamp, settings: &LinkSettings) -> Option<String> {
        let name = &self.name;
        match (self.status, self.status_fresh(now, settings)) {
            (None, _) => Some(format!("{name}: no control/status received (is its local_control up?)")),
            (Some(old), None) => {
                Some(format!("{name}: control/status is {:.1} s old", now.seconds_since(old.stamp)))
            }
            (_, Some(_)) => None,
        }
    }

    /// Why the platform does not follow its reference, in words.
    pub fn following_problem(&self, now: Timestamp, settings: &LinkSettings) -> Option<String> {
        if let Some(problem) = self.control_problem(now, settings) {
            return Some(problem);
        }
        let status = self.status.filter(|_| !self.following(now, settings))?;
        let mode = match status.mode {
            ControlStatus::MODE_IDLE => "idle",
            ControlStatus::MODE_HOLD => "holding",
            ControlStatus::MODE_SAFE_DAMPING => "in safe mode (damping)",
            _ => "in safe mode (coasting)",
        };
        Some(format!("{}: control is {mode}{}", self.name, reason_in_words(status.reason)))
    }
}

fn reason_in_words(reason: u8) -> &'static str {
    match reason {
        ControlStatus::REASON_NO_AUTHORITY => ": no authority",
        ControlStatus::REASON_REFERENCE_STALE => ": reference stale",
        ControlStatus::REASON_ESTIMATE_STALE => ": estimate stale",
        ControlStatus::REASON_ESTIMATE_UNHEALTHY => ": estimate unhealthy",
        ControlStatus::REASON_TILT_LIMIT => ": tilt limit",
        ControlStatus::REASON_ABORT => ": abort",
        ControlStatus::REASON_RATE_LIMIT => ": rate limit",
        ControlStatus::REASON_COMMANDS_REFUSED => ": its driver does not carry out the commands",
        ControlStatus::REASON_EXCITATION_UNKNOWN => ": its parameters have no excitation of this name",
        _ => "",
    }
}

fn finite(v: &Vector3<f64>) -> bool {
    v.iter().all(|x| x.is_finite())
}
