//! What a platform's hardware would have sent, out of a recording.

use std::path::Path;

use whorl_msgs::{Message, Topic};
use whorl_node::Timestamp;

use crate::{BagError, BagReader, RunDirectory};

/// A measurement out of a recording.
#[derive(Debug, Clone, PartialEq)]
pub struct Measurement {
    /// When it was measured: the stamp in its header.
    pub stamp: Timestamp,
    /// The topic it belongs on.
    pub topic: Topic,
    /// The message.
    pub message: Message,
}

/// The measurements of one platform in a run directory or bag, in the order in which they were recorded.
///
/// # Errors
/// As [`RunDirectory::open`] and [`BagReader::open`]. Items have errors for damaged parts of the bag and for
/// messages that do not decode.
pub fn measurements(
    source: &Path,
    platform: &str,
) -> Result<impl Iterator<Item = Result<Measurement, BagError>> + use<>, BagError> {
    let reader: BagReader = RunDirectory::open(source)?.bag()?;
    let names: Vec<String> =
        Topic::FROM_DRIVER.iter().map(|t| format!("/{platform}/{}", t.info().name)).collect();
    Ok(reader.messages_of(&names).filter_map(|recorded| match recorded {
        Ok(recorded) => {
            let topic = recorded.topic.whorl_topic()?.1;
            Some(recorded.decode().map(|message| Measurement {
                stamp: stamp_of(&message).unwrap_or(recorded.log_time),
                topic,
                message,
            }))
        }
        Err(error) => Some(Err(error)),
    }))
}

/// The stamp in a message's header: of the measurement that it is, or that it goes back to. `None` for
/// `/tf`, which has one per frame.
#[must_use]
pub fn stamp_of(message: &Message) -> Option<Timestamp> {
    let header = match message {
        Message::Imu(m) => &m.header,
        Message::Vector3Stamped(m) => &m.header,
        Message::JointState(m) => &m.header,
        Message::ThrusterState(m) => &m.header,
        Message::BatteryState(m) => &m.header,
        Message::FluidPressure(m) => &m.header,
        Message::Temperature(m) => &m.header,
        Message::ActuatorCommand(m) => &m.header,
        Message::AttitudeEstimate(m) => &m.header,
        Message::AttitudeReference(m) => &m.header,
        Message::ControlStatus(m) => &m.header,
        Message::FormationCommand(m) => &m.header,
        Message::Excitation(m) => &m.header,
        Message::ClockRequest(m) => &m.header,
        Message::ClockReply(m) => &m.header,
        Message::FormationState(m) => &m.header,
        Message::ParameterEstimate(m) => &m.header,
        Message::DiagnosticArray(m) => &m.header,
        Message::TFMessage(_) => return None,
    };
    Some(header.stamp.into())
}
