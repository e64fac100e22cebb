//! One inertial sensor of several devices: a triad of single axes, and redundant sensors whose members vote.
//!
//! The group `logical.imu` of a platform's list names the devices. Every device measures angular rate, specific force, or
//! both, along one axis or more; together they must span all directions, and what is measured more than once is checked
//! ([`vote`]). A member that falls silent, repeats itself or is outvoted is left out and named, and the platform goes on.

mod imu;
pub mod vote;

pub use imu::{LogicalImu, Sample};

use crate::device::{InertialAxes, NamedDevice};
use std::time::Duration;

use whorl_dynamics::PlatformModel;
use whorl_params::{Reader, positive};

/// A device that is part of the sensor.
#[derive(Debug, Clone, PartialEq)]
pub struct Member {
    /// Index in the list of devices.
    pub device: usize,
    /// Its name there.
    pub name: String,
    /// Along what it measures.
    pub axes: InertialAxes,
}

/// The sensor, as a platform's list has it.
#[derive(Debug, Clone, PartialEq)]
pub struct ImuSetup {
    /// Its devices; the first that works sets the pace.
    pub members: Vec<Member>,
    /// A member is outvoted from this difference on [rad/s].
    pub disagreement_rad_s: f64,
    /// The same for specific force [m/s^2].
    pub disagreement_m_s2: f64,
    /// Between samples of a device.
    pub period: Duration,
}

impl ImuSetup {
    /// Whether the devices for which `works` is true measure along all directions.
    #[must_use]
    pub fn is_complete(&self, works: impl Fn(usize) -> bool) -> bool {
        let working = || self.members.iter().filter(|member| works(member.device));
        vote::spans(working().flat_map(|member| &member.axes.rate_b))
            && vote::spans(working().flat_map(|member| &member.axes.force_b))
    }
}

/// Reads `logical.imu`; says what is wrong with it.
pub(crate) fn read(r: &mut Reader<'_>, devices: &[NamedDevice], model: &PlatformModel) -> Option<ImuSetup> {
    if !r.has("logical") {
        return None;
    }
    r.group("logical", |r| r.group("imu", |r| read_imu(r, devices, model)))
}

fn read_imu(r: &mut Reader<'_>, devices: &[NamedDevice], model: &PlatformModel) -> Option<ImuSetup> {
    let before = r.error_count();
    let names = r.string_array(
        "of",
        "devices that together are the inertial sensor; the first that works sets the pace",
    );
    let gyro = model.sensors.gyro.errors.noise_stddev.max();
    let accelerometer = model.sensors.accelerometer.errors.noise_stddev.max();
    // Ten standard deviations of a sample's noise, and what a turn-on bias may differ by.
    let default = |noise: f64, least: f64| (10.0 * noise).max(least);
    let disagreement_rad_s = r.f64_or(
        "disagreement_rad_s",
        default(gyro, 0.02),
        positive(),
        "a member whose angular rate differs from the others' by more is left out [rad/s]",
    );
    let disagreement_m_s2 = r.f64_or(
        "disagreement_m_s2",
        default(accelerometer, 0.2),
        positive(),
        "a member whose specific force differs from the others' by more is left out [m/s^2]",
    );
    let mut members: Vec<Member> = Vec::new();
    for name in &names {
        let found = devices.iter().enumerate().find(|(_, named)| named.name == *name);
        let Some((device, named)) = found else {
            let listed: Vec<&str> = devices.iter().map(|named| named.name.as_str()).collect();
            r.reject("of", format!("there is no device {name}; allowed: {}", listed.join(", ")));
            continue;
        };
        let axes = named.device.inertial_axes();
        if axes.is_empty() {
            r.reject("of", format!("device {name} measures neither angular rate nor specific force"));
        } else if members.iter().any(|member| member.device == device) {
            r.reject("of", format!("device {name} is named twice; allowed: each once"));
        } else {
            members.push(Member { device, name: name.clone(), axes });
        }
    }
    let period = Duration::from_secs_f64(1.0 / model.sensors.rate_hz);
    let setup = ImuSetup { members, disagreement_rad_s, disagreement_m_s2, period };
    if r.error_count() == before && !setup.is_complete(|_| true) {
        let spans = vote::spans(setup.members.iter().flat_map(|member| &member.axes.rate_b));
        let what = if spans { "specific force" } else { "angular rate" };
        r.reject("of", format!("these devices do not measure {what} along every direction; allowed: at least three axes that are not in one plane"));
    }
    (r.error_count() == before).then_some(setup)
}
