//! The channels of a platform: what can be measured of it, one row each.
//!
//! Maps of columns and topics, import, export, reading, writing and analysis of recordings all iterate
//! over these rows. A new quantity is a row in `table.rs` and a field of `whorl_recording::Recording` (with its unit in
//! `units.rs` and an arm of [`Carrier`], if these are new as well).

mod carrier;
mod table;

pub use carrier::{Carrier, blank};
pub use table::{Channel, ChannelInfo, Form, Place};

use whorl_msgs::{MessageType, Topic};

use crate::extra;

/// Names of the axes of the body, and of the world.
pub const AXES: [&str; 3] = ["x", "y", "z"];

impl Channel {
    /// The channel with this key.
    #[must_use]
    pub fn find(key: &str) -> Option<Self> {
        Self::ALL.iter().copied().find(|channel| channel.info().key == key)
    }

    /// How many sensors of it a platform may have, each with its own topic.
    #[must_use]
    pub fn most_sensors(self) -> usize {
        if self.info().form == Form::Directions { extra::MAX_VECTOR_SENSORS } else { 1 }
    }

    /// SI unit of its numbers.
    #[must_use]
    pub fn unit(self) -> &'static str {
        self.info().units.first().map_or("1", |unit| unit.name)
    }

    /// Unit in which it is shown to people, and the factor to it.
    #[must_use]
    pub fn shown_unit(self) -> (&'static str, f64) {
        let info = self.info();
        let shown = info.units.iter().find(|unit| Some(unit.name) == info.shown_unit);
        shown.map_or((self.unit(), 1.0), |unit| (unit.name, 1.0 / unit.factor))
    }

    /// Type of the messages that carry it.
    #[must_use]
    pub fn message_type(self) -> MessageType {
        self.info().carrier.message_type()
    }

    /// Topic that has it in Whorl's own recordings, in the platform's namespace; sensors count from 0.
    #[must_use]
    pub fn topic_name(self, sensor: usize) -> String {
        match self.info().place {
            Place::Topic(topic) => topic.info().name.to_owned(),
            Place::Extra(name) => name.to_owned(),
            Place::Sensor => extra::vector_direction(sensor),
        }
    }

    /// The topic that carries it, if nodes send it; `None` if only recordings have it.
    #[must_use]
    pub fn topic(self, sensor: usize) -> Option<Topic> {
        Topic::find(&self.topic_name(sensor), true)
    }

    /// What a topic of a platform's namespace carries in Whorl's own recordings: channels and sensors, from 0.
    #[must_use]
    pub fn carried_by(name: &str) -> Vec<(Self, usize)> {
        let mut carried = Vec::new();
        for channel in Self::ALL {
            let sensors = 0..channel.most_sensors();
            carried.extend(sensors.filter(|n| channel.topic_name(*n) == name).map(|n| (*channel, n)));
        }
        carried
    }

    /// Name of one of its components: `gyro_x`, `wheel_x_speed`, `bus_voltage`. `wheels` names the platform's
    /// wheels.
    #[must_use]
    pub fn component_name<S: AsRef<str>>(self, index: usize, wheels: &[S]) -> String {
        let info = self.info();
        match info.form {
            Form::Wheels { each } => match wheels.get(index) {
                Some(name) => format!("{}_{each}", name.as_ref()),
                None => format!("wheel_{}_{each}", index + 1),
            },
            Form::Gimbals { each } => format!("gimbal_{}_{each}", index + 1),
            Form::Axes => format!("{}_{}", info.key, AXES.get(index).copied().unwrap_or_default()),
            _ => info.key.to_owned(),
        }
    }
}

impl std::fmt::Display for Channel {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(&self.info().key.replace('_', " "))
    }
}

impl serde::Serialize for Channel {
    fn serialize<S: serde::Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        serializer.serialize_str(self.info().key)
    }
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeSet;

    use super::*;

    #[test]
    fn every_row_is_found_by_its_key_and_its_topic() {
        let mut columns = BTreeSet::new();
        for channel in Channel::ALL {
            let info = channel.info();
            assert_eq!(Channel::find(info.key), Some(*channel));
            assert!(columns.insert(info.column), "{}", info.key);
            for sensor in 0..channel.most_sensors() {
                let name = channel.topic_name(sensor);
                assert!(Channel::carried_by(&name).contains(&(*channel, sensor)), "{name}");
                // Where nodes send it, its messages are of the topic's type.
                let standard = channel.topic(sensor).map(|topic| topic.info().message_type);
                assert!(standard.is_none_or(|standard| standard == channel.message_type()), "{name}");
            }
        }
        assert_eq!(Channel::carried_by("imu/data_raw"), [(Channel::Gyro, 0), (Channel::Accelerometer, 0)]);
        assert_eq!(Channel::carried_by("vector_sensor_3/direction"), [(Channel::Vector, 2)]);
        assert_eq!(Channel::carried_by("attitude/estimate"), []);
    }

    #[test]
    fn numbers_survive_the_messages_that_carry_them() {
        for channel in Channel::ALL.iter().filter(|channel| **channel != Channel::Jets) {
            let numbers: &[f64] = match channel.info().form {
                Form::Scalar => &[24.5],
                Form::Attitude => &[0.5, -0.5, 0.5, 0.5],
                _ => &[0.25, -1.5, 3.0],
            };
            let mut message = blank(channel.message_type(), whorl_msgs::std_msgs::Header::default(), 0);
            let nothing = |numbers: Vec<f64>| numbers.iter().all(|x| x.is_nan());
            assert!(channel.info().carrier.read(&message).is_none_or(nothing), "{channel}");
            channel.info().carrier.write(numbers, &mut message);
            let read = channel.info().carrier.read(&message).unwrap();
            assert_eq!(read.len(), numbers.len(), "{channel}");
            assert!(read.iter().zip(numbers).all(|(a, b)| (a - b).abs() < 1e-12), "{channel}: {read:?}");
        }
    }
}
