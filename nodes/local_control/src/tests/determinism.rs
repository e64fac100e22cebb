//! A recording replayed through a fresh core gives bit-identical outputs.

use super::rig::*;
use crate::LocalControlCore;
use whorl_msgs::topics::{Message, Route};
use whorl_node::{Event, NodeCore, Outputs, Timestamp};

/// A message with its route, or the timer.
type Recorded = Option<(Route, Message)>;

#[test]
fn the_same_events_give_the_same_bits() {
    for actuators in ["actuators:=both", "actuators:=jets"] {
        let mut rig = Rig::holding("whorl_1", &[actuators], balanced());
        rig.noise = (3e-4, 2e-3);
        rig.run(3.0);
        rig.estimator_on = false;
        rig.run(1.0);
        rig.estimator_on = true;
        rig.run(3.0);
        // The rig's order within a sample: messages as sent, then the timer every second sample.
        let mut events = Vec::new();
        let mut previous = None;
        let stamp_of = |message: &Message| match message {
            Message::JointState(m) => Some(Timestamp::from(m.header.stamp)),
            _ => None,
        };
        let mut now = Timestamp(0);
        for (route, message) in &rig.messages {
            if let Some(stamp) = stamp_of(message) {
                if let Some(before) = previous
                    && (now.0 / PERIOD_NS) % 2 == 0
                {
                    events.push((before, None));
                }
                now = stamp;
                previous = Some(now);
            }
            events.push((now, Some((*route, message.clone()))));
        }
        let replayed = |events: &[(Timestamp, Recorded)]| {
            let mut core = LocalControlCore::new(parameters("whorl_1", &[actuators])).unwrap();
            let mut bytes = Vec::new();
            for (now, event) in events {
                let mut outputs = Outputs::default();
                let event = match event {
                    Some((route, message)) => Event::Message { route: *route, message },
                    None => Event::Timer,
                };
                core.step(*now, event, &mut outputs);
                for publication in outputs.messages {
                    let mut encoded = Vec::new();
                    publication.message.encode_into(&mut encoded).unwrap();
                    bytes.push(encoded);
                }
            }
            bytes
        };
        let first = replayed(&events);
        assert_eq!(first, replayed(&events));
        // And it is the run itself: every command that the rig saw is among them.
        let mut commands = Vec::new();
        for command in &rig.commands {
            let mut encoded = Vec::new();
            Message::from(command.clone()).encode_into(&mut encoded).unwrap();
            commands.push(encoded);
        }
        assert!(commands.len() > 600);
        assert!(commands.iter().all(|command| first.contains(command)));
    }
}
