//! Devices that have a ROS 2 driver of their own: any inertial sensor, magnetometer, motion capture, motors and valves with
//! standard messages.
//!
//! Each device joins the ROS domain as a participant of its own, hears its topic whether its driver is reliable or best
//! effort, and takes the first publisher that it hears until that one falls silent. Where traffic is secured, they refuse to work: these
//! topics are in no keystore.

mod direction;
mod emulator;
mod imu;
mod motors;
mod stamps;
#[cfg(test)]
mod tests;
mod valves;

use std::time::{Duration, Instant};

use nalgebra::{UnitQuaternion, Vector3};
use whorl_math::rad_from_deg;
use whorl_msgs::topics::{Message, MessageType};
use whorl_node::{ForeignTopic, ForeignTopics};
use whorl_params::{Reader, range};

use crate::DeviceError;
use crate::mailbox::Mailbox;
use crate::place::Place;
use crate::reading::{Reporter, State};
use stamps::Stamps;

pub use direction::{MAGNETOMETER, POSE};
pub use imu::IMU;
pub use motors::MOTORS;
pub use valves::VALVES;

/// A topic that is silent for so long is joined anew: the network may have changed.
const ANEW: Duration = Duration::from_secs(30);
/// Between looks at who is on the network.
const LOOK: Duration = Duration::from_millis(500);

/// The name of a topic, of which nothing is wrong or something is noted.
fn read_topic(r: &mut Reader<'_>, key: &str, doc: &str) -> String {
    let before = r.error_count();
    let name = r.string(key, doc);
    let part = |part: &str| {
        part.starts_with(|c: char| c.is_ascii_alphabetic() || c == '_')
            && part.chars().all(|c| c.is_ascii_alphanumeric() || c == '_')
    };
    let parts = name.strip_prefix('/').map(|rest| rest.split('/').all(part));
    if parts != Some(true) && r.error_count() == before {
        r.reject(key, format!("{name:?} is no full name of a topic; allowed: such as /imu/data"));
    }
    name
}

/// `mounting_deg`: rotates a vector from the sensor's axes to the body's.
fn read_mounting(r: &mut Reader<'_>, whose: &str) -> UnitQuaternion<f64> {
    let doc = format!("roll, pitch, yaw of {whose} in the body's axes (x forward, y left, z up) [deg]");
    let angles = r.vector3_or("mounting_deg", Vector3::zeros(), range(-180.0..=180.0), &doc);
    let [roll, pitch, yaw] = [angles.x, angles.y, angles.z].map(rad_from_deg);
    UnitQuaternion::from_euler_angles(roll, pitch, yaw)
}

fn topic(place: &Place, name: &str, message_type: MessageType) -> ForeignTopic {
    ForeignTopic { name: place.topic(name), message_type }
}

fn join(
    place: &Place,
    reads: &[ForeignTopic],
    writes: &[ForeignTopic],
) -> Result<Box<dyn ForeignTopics>, DeviceError> {
    let network = place.network()?;
    if network.is_secured()? {
        let text =
            "traffic is secured (ROS_SECURITY_ENABLE), and topics of other nodes' drivers are in no keystore";
        return Err(DeviceError::Refused(text.to_owned()));
    }
    Ok(network.join(reads, writes)?)
}

/// What is told of a device, each state once.
struct Told<'a> {
    reporter: &'a Reporter,
    state: Option<State>,
}

impl Told<'_> {
    fn tell(&mut self, state: State) {
        if self.state.as_ref() != Some(&state) {
            self.state = Some(state.clone());
            self.reporter.state(state);
        }
    }
}

/// A topic with measurements: takes one publisher, decodes, and tells when nothing comes.
struct Heard<'a> {
    told: Told<'a>,
    message_type: MessageType,
    stamps: Stamps,
    /// Longest silence.
    silent: Duration,
    latest: Instant,
    looked: Instant,
    publisher: Option<[u8; 16]>,
}

impl<'a> Heard<'a> {
    fn new(reporter: &'a Reporter, message_type: MessageType, stamps: Stamps, silent: Duration) -> Self {
        let told = Told { reporter, state: None };
        let now = Instant::now();
        Self { told, message_type, stamps, silent, latest: now, looked: now, publisher: None }
    }

    /// When [`Self::look`] must be called.
    fn until(&self) -> Instant {
        (self.latest + self.silent).max(self.looked + LOOK)
    }

    /// Takes what has come; `each` gets message and instant of its sample, and says why it cannot be used.
    fn take(
        &mut self,
        listener: &mut dyn ForeignTopics,
        mut each: impl FnMut(Instant, Message) -> Result<(), String>,
    ) -> Result<(), DeviceError> {
        let arrival = Instant::now();
        let mut refused = 0;
        let mut refusal = None;
        let (mut heard, mut latest, mut publisher) = (false, self.latest, self.publisher);
        let (stamps, message_type) = (&mut self.stamps, self.message_type);
        listener.take(&mut |_, sample| {
            // Who came first is obeyed until it falls silent.
            if *publisher.get_or_insert(sample.writer) != sample.writer {
                refused += 1;
                return;
            }
            let taken = Message::decode(message_type, sample.bytes)
                .map_err(|error| error.to_string())
                .and_then(|mut message| {
                    message.check_bounds().map_err(|error| error.to_string())?;
                    let stamp = message.header().map(|header| header.stamp);
                    let at =
                        stamps.instant(stamp.unwrap_or_default().into(), arrival, sample.receive_time)?;
                    each(at, message)
                });
            match taken {
                Ok(()) => (heard, latest) = (true, arrival),
                Err(reason) => {
                    refused += 1;
                    refusal = Some(reason);
                }
            }
        })?;
        (self.latest, self.publisher) = (latest, publisher);
        self.told.reporter.refused(refused);
        if heard {
            self.told.tell(State::Ready);
        } else if let Some(reason) = refusal.filter(|_| arrival >= self.latest + self.silent) {
            self.told.tell(State::Lost(format!("its messages are refused: {reason}")));
            self.looked = arrival;
        }
        Ok(())
    }

    /// Tells why nothing comes, when nothing comes.
    fn look(&mut self, listener: &dyn ForeignTopics) -> Result<(), DeviceError> {
        let now = Instant::now();
        if now < self.until() {
            return Ok(());
        }
        self.looked = now;
        self.publisher = None;
        self.told.tell(State::Lost(listener.why_silent(0)));
        if now > self.latest + ANEW || !listener.is_alive() {
            return Err(DeviceError::Silent(self.silent.as_secs_f64()));
        }
        Ok(())
    }
}

/// Serves a sensor with one topic.
fn serve_sensor(
    place: &Place,
    topic: ForeignTopic,
    stamps: Stamps,
    silent: Duration,
    mailbox: &Mailbox,
    reporter: &Reporter,
    mut each: impl FnMut(Instant, Message) -> Result<(), String>,
) -> Result<(), DeviceError> {
    let mut listener = join(place, std::slice::from_ref(&topic), &[])?;
    let mut heard = Heard::new(reporter, topic.message_type, stamps, silent);
    loop {
        let woken = mailbox.wait(Some(listener.fd()), heard.until());
        while mailbox.take().is_some() {}
        if mailbox.is_closed() {
            return Ok(());
        }
        if woken.device {
            heard.take(listener.as_mut(), &mut each)?;
        }
        heard.look(listener.as_ref())?;
    }
}
