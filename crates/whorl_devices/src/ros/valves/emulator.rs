//! A node of valves as it looks from its topic.

use whorl_msgs::topics::{Message, MessageType};

use super::RosValves;
use crate::emulation::{Emulator, TopicEmulator, World};
use crate::ros::emulator::WATCHDOG_NS;

/// A node of valves.
struct Node {
    valves: RosValves,
    closes_ns: Option<i64>,
}

impl Node {
    fn switch(&self, at_ns: i64, data: &[u8], world: &mut World) {
        world.advance_to(at_ns);
        for (place, element) in self.valves.elements.iter().enumerate() {
            let open = data.get(place).is_some_and(|value| *value != 0);
            world.set_valve(world.jet_on_wire(element.jet), open, at_ns);
        }
    }
}

pub(super) fn valves(valves: &RosValves) -> Emulator {
    Emulator::Topics {
        read: Some((valves.command.clone(), MessageType::UInt8MultiArray)),
        write: None,
        device: Box::new(Node { valves: valves.clone(), closes_ns: None }),
    }
}

impl TopicEmulator for Node {
    fn message(&mut self, at_ns: i64, message: &Message, world: &mut World) {
        let Message::UInt8MultiArray(command) = message else { return };
        self.closes_ns = Some(at_ns + WATCHDOG_NS);
        self.switch(at_ns, &command.data, world);
    }

    fn due_ns(&self) -> Option<i64> {
        self.closes_ns
    }

    fn act(&mut self, now_ns: i64, world: &mut World) -> Option<(i64, Message)> {
        if self.closes_ns.is_some_and(|at| at <= now_ns) {
            self.closes_ns = None;
            self.switch(now_ns, &[], world);
        }
        None
    }
}
