//! Any message, in any order, into any core: nothing panics, and no core's memory grows.
//!
//! Messages come from a seeded generator, not from nodes: half of their fields are what a node would send, the others
//! are the values that arithmetic, arrays and clocks are known to fail at. They go straight into the cores, without the
//! shell's door, which refuses most of them: the cores must not depend on it.

mod generator;
mod readers;

use std::time::Duration;

use generator::Generator;
use proptest::prelude::*;
use whorl_bag::{BagOptions, RawSample, RunDescription, RunWriter};
use whorl_msgs::topics::{Message, MessageType, Route};
use whorl_node::{Event, NodeCore, Outputs, Timestamp};
use whorl_recorder::{RecordedTopic, RecorderCore};

use crate::support::cores::cores;
use crate::support::machine::Load;

const START: Timestamp = Timestamp(1_700_000_000_000_000_000);

/// A core that is given generated messages.
struct Victim {
    core: Box<dyn NodeCore>,
    routes: Vec<Route>,
    now: Timestamp,
    next_timer: Timestamp,
    outputs: Outputs,
}

impl Victim {
    fn new(core: Box<dyn NodeCore>) -> Self {
        let routes = core.subscriptions();
        Self { core, routes, now: START, next_timer: START, outputs: Outputs::default() }
    }

    /// One message, and the timer as often as it is due.
    fn step(&mut self, generator: &mut Generator) {
        self.now = self.now + Duration::from_micros(generator.below(8_000));
        while let Some(period) = self.core.timer_period().filter(|_| self.next_timer <= self.now) {
            self.next_timer = self.next_timer + period;
            self.give(Event::Timer);
        }
        // Any route, and sometimes a message of a type that it does not carry.
        let index = usize::try_from(generator.below(self.routes.len() as u64)).unwrap();
        let route = self.routes[index];
        let ty = if generator.below(50) == 0 {
            MessageType::ALL[usize::try_from(generator.below(MessageType::ALL.len() as u64)).unwrap()]
        } else {
            route.topic.info().message_type
        };
        let message = generator.message(ty, self.now);
        self.give(Event::Message { route, message: &message });
    }

    fn give(&mut self, event: Event<'_>) {
        self.outputs.clear();
        self.core.step(self.now, event, &mut self.outputs);
    }
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 12, failure_persistence: None, ..ProptestConfig::default() })]

    /// Many short lives: what goes wrong while a core is still in one of its early states.
    #[test]
    fn no_sequence_of_messages_makes_a_core_panic(seed in any::<u64>(), length in 1..120_usize) {
        let _share = Load::Computation.take();
        for (_, core) in cores() {
            let (mut victim, mut generator) = (Victim::new(core), Generator::new(seed));
            for _ in 0..length {
                victim.step(&mut generator);
            }
        }
    }

    /// What decodes at all is a message that survives the door; what does not is an error.
    #[test]
    fn no_bytes_make_the_decoder_or_the_door_panic(seed in any::<u64>()) {
        let mut generator = Generator::new(seed);
        for &ty in MessageType::ALL {
            let message = generator.message(ty, START);
            let mut bytes = Vec::new();
            message.encode_into(&mut bytes).unwrap();
            for _ in 0..20 {
                let spoilt = generator.spoil(&bytes);
                if let Ok(mut message) = Message::decode(ty, &spoilt) {
                    let _ = message.check_bounds();
                }
            }
        }
    }
}

/// One long life. The memory that a core holds at the end is what it held after a tenth of it, but for a little.
fn memory_does_not_grow(messages: usize) {
    let _share = Load::Computation.take();
    for (name, core) in cores() {
        let (mut victim, mut generator) = (Victim::new(core), Generator::new(7));
        for _ in 0..messages / 10 {
            victim.step(&mut generator);
        }
        let held = allocation_counter::measure(|| {
            for _ in messages / 10..messages {
                victim.step(&mut generator);
            }
            victim.outputs = Outputs::default();
        });
        // The largest store that may still fill is the coordinator's window of clock exchanges: 3000 of 24 bytes each
        // for two platforms.
        assert!(
            held.bytes_current < 400_000,
            "{name}: {} bytes more after {messages} messages",
            held.bytes_current
        );
    }
}

#[test]
fn the_memory_of_no_core_grows_with_what_it_is_sent() {
    memory_does_not_grow(200_000);
}

#[test]
#[ignore = "slow: a million messages to every core"]
fn the_memory_of_no_core_grows_with_a_million_messages() {
    memory_does_not_grow(1_000_000);
}

#[test]
fn the_recorder_takes_any_bytes() {
    let _share = Load::Computation.take();
    let folder = tempfile::tempdir().unwrap();
    let platforms = ["whorl_1".to_owned(), "whorl_2".to_owned()];
    let description = RunDescription { platforms: platforms.to_vec(), ..RunDescription::default() };
    let run =
        RunWriter::create_in(&folder.path().join("run"), description, START, BagOptions::default()).unwrap();
    let topics = RecordedTopic::all_of(&platforms);
    let count = topics.len();
    let mut core = RecorderCore::new(run, topics.clone()).unwrap();
    let mut generator = Generator::new(11);
    let mut now = START;
    let mut sent = 0;
    for _ in 0..20_000 {
        now = now + Duration::from_micros(generator.below(1000));
        let topic = usize::try_from(generator.below(count as u64 + 1)).unwrap();
        let ty =
            topics.get(topic).and_then(|t| t.route).map_or(MessageType::Imu, |r| r.topic.info().message_type);
        let mut bytes = Vec::new();
        generator.message(ty, now).encode_into(&mut bytes).unwrap();
        let cdr = generator.spoil(&bytes);
        let origin = Some((u128::from(generator.below(4)), generator.number()));
        core.sample(topic, RawSample { log_time: now, publish_time: now, origin, cdr: &cdr });
        sent += 1;
        core.tick(now);
    }
    let status = core.status();
    assert_eq!((status.recorded + status.refused, status.stopped_by), (sent, None));
    let recorded = status.recorded;
    assert!(recorded > 10_000 && status.refused > 0, "{recorded} recorded, {} refused", status.refused);
    assert_eq!(core.finish().finish(now).unwrap().message_count(), recorded);
}
