//! A platform's measurements from a recording, as its hardware would have sent them.

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
    message.header().map(|header| header.stamp.into())
}
