//! What nodes of other people have in common, as they look from their topics.

use whorl_msgs::builtin_interfaces::Time;
use whorl_msgs::std_msgs::Header;
use whorl_msgs::topics::{Message, MessageType};
use whorl_node::Timestamp;

use crate::emulation::{Emulator, TopicEmulator, World};

/// A motor's or valve's node switches off so long after the last message \[ns\]; assumed.
pub(super) const WATCHDOG_NS: i64 = 200_000_000;

pub(super) fn header(at_ns: i64) -> Header {
    Header { stamp: Time::from(Timestamp(at_ns)), frame_id: "emulated".to_owned() }
}

/// What is published at a fixed rate.
pub(super) struct Publisher<F> {
    pub(super) period_ns: i64,
    pub(super) next_ns: Option<i64>,
    pub(super) sample: F,
}

impl<F: FnMut(i64, &mut World) -> Option<Message> + Send> TopicEmulator for Publisher<F> {
    fn message(&mut self, _: i64, _: &Message, _: &mut World) {}

    fn due_ns(&self) -> Option<i64> {
        Some(self.next_ns.unwrap_or(i64::MIN))
    }

    fn act(&mut self, now_ns: i64, world: &mut World) -> Option<(i64, Message)> {
        // Begins when it is first asked.
        let at_ns = self.next_ns.unwrap_or(now_ns);
        self.next_ns = Some(at_ns + self.period_ns);
        world.advance_to(at_ns);
        Some((at_ns, (self.sample)(at_ns, world)?))
    }
}

pub(super) fn publisher(
    topic: &str,
    message_type: MessageType,
    rate_hz: f64,
    sample: impl FnMut(i64, &mut World) -> Option<Message> + Send + 'static,
) -> Emulator {
    let device = Publisher { period_ns: (1e9 / rate_hz) as i64, next_ns: None, sample };
    Emulator::Topics { read: None, write: Some((topic.to_owned(), message_type)), device: Box::new(device) }
}
