//! Solenoid valves behind a node of the laboratory's own: `std_msgs/UInt8MultiArray`, an element for each valve, 1 is open.
//!
//! There is no message of ROS 2 that says that a valve was switched: what was sent counts as done, and the device answers as long as
//! a node subscribes. All valves are sent at every edge of a pulse, and every 50 ms, so that the node can close them when it does
//! not hear of us.

mod emulator;

use std::time::{Duration, Instant};

use whorl_dynamics::PlatformModel;
use whorl_msgs::std_msgs::UInt8MultiArray;
use whorl_msgs::topics::MessageType;
use whorl_node::ForeignTopics;
use whorl_params::Reader;

use super::{LOOK, Told, join, read_topic, topic};
use crate::DeviceError;
use crate::device::{Address, Device, DeviceKind, Role, UsedTopic};
use crate::emulation::Emulator;
use crate::mailbox::Mailbox;
use crate::place::Place;
use crate::reading::{Measured, Reporter, State};
use crate::schedule::Schedule;
use crate::valves::{self, Outlet, REFRESH};

/// Its row in the table.
pub const VALVES: DeviceKind = DeviceKind {
    name: "ros_valves",
    what: "solenoid valves behind a ROS 2 node: std_msgs/UInt8MultiArray",
    read,
};

/// A network without subscribers for so long is joined anew.
const ANEW: Duration = super::ANEW;

/// The valves of one node.
#[derive(Debug, Clone)]
pub(super) struct RosValves {
    pub(super) command: String,
    /// Of the message, from 0 on.
    pub(super) elements: Vec<Outlet>,
}

fn read(r: &mut Reader<'_>, model: &PlatformModel) -> Option<Box<dyn Device>> {
    let before = r.error_count();
    let command = read_topic(r, "command", "topic of the valves' node, std_msgs/UInt8MultiArray: 1 is open");
    let elements = valves::read(r, model, "elements", 255, "place of the valve in the message, from 0");
    let in_order = (0..).zip(&elements).all(|(place, element)| place == element.output);
    if (elements.is_empty() || !in_order) && r.error_count() == before {
        r.reject("kind", "allowed: elements.<jet> from 0 without gaps, one for each valve of the message");
    }
    (r.error_count() == before).then(|| Box::new(RosValves { command, elements }) as Box<dyn Device>)
}

impl Device for RosValves {
    fn addresses(&self) -> Vec<Address> {
        vec![Address(self.command.clone())]
    }

    fn topics(&self) -> Vec<UsedTopic> {
        vec![UsedTopic { name: self.command.clone(), is_read: false }]
    }

    fn roles(&self) -> Vec<Role> {
        self.elements.iter().map(|element| Role::Jet(element.jet)).collect()
    }

    fn serve(&self, place: &Place, mailbox: &Mailbox, reporter: &Reporter) -> Result<(), DeviceError> {
        let topic = topic(place, &self.command, MessageType::UInt8MultiArray);
        let mut listener = join(place, &[], &[topic])?;
        let mut told = Told { reporter, state: None };
        let mut schedule = valves::schedule(&self.elements);
        let began = Instant::now();
        let (mut heard, mut look, mut refresh) = (began, began, began);
        loop {
            let until = schedule.next_edge().map_or(refresh, |edge| edge.min(refresh)).min(look);
            mailbox.wait(None, until);
            schedule.obey(mailbox);
            if mailbox.is_closed() {
                schedule.close();
                schedule.advance(Instant::now());
                return send(listener.as_mut(), &mut schedule, reporter);
            }
            let now = Instant::now();
            if now >= look {
                look = now + LOOK;
                if listener.is_heard(0) {
                    heard = now;
                    told.tell(State::Ready);
                } else {
                    schedule.close();
                    told.tell(State::Lost(listener.why_unheard(0)));
                    if now > heard + ANEW || !listener.is_alive() {
                        return Err(DeviceError::Silent(ANEW.as_secs_f64()));
                    }
                }
            }
            if schedule.advance(now) || now >= refresh {
                refresh = now + REFRESH;
                send(listener.as_mut(), &mut schedule, reporter)?;
            }
        }
    }

    fn emulator(&self, _: &PlatformModel) -> Emulator {
        emulator::valves(self)
    }
}

/// Makes the valves what they should be, and tells which of them were switched.
fn send(
    listener: &mut dyn ForeignTopics,
    schedule: &mut Schedule,
    reporter: &Reporter,
) -> Result<(), DeviceError> {
    let data = schedule.wanted().iter().map(|open| u8::from(*open)).collect();
    listener.publish(0, &UInt8MultiArray { data, ..UInt8MultiArray::default() }.into())?;
    let switched = schedule.written();
    if !switched.is_empty() {
        reporter.measured(Instant::now(), Measured::Valves(switched));
    }
    Ok(())
}
