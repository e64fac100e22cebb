//! Tests of writing, reading, recovering and runs together.

mod bombs;
mod disk_full;
mod foreign;
mod memory;
mod round_trip;
mod run;
mod truncated;

use std::path::Path;

use whorl_msgs::Message;
use whorl_msgs::whorl::AttitudeEstimate;
use whorl_node::Timestamp;

use crate::{BagOptions, BagWriter, Sample, TopicHandle};

/// Nanoseconds of `index` hundredths of a second after an arbitrary present-day instant.
pub(crate) fn time(index: u64) -> Timestamp {
    Timestamp(1_790_000_000_000_000_000 + index as i64 * 10_000_000)
}

/// An estimate that differs from every other one.
pub(crate) fn estimate(sequence: u64) -> Message {
    let mut message = AttitudeEstimate { sequence, ..AttitudeEstimate::default() };
    message.header.stamp = time(sequence).into();
    message.omega_wb_b_rad_s.x = (sequence as f64).sin();
    message.covariance[35] = f64::NAN;
    message.into()
}

pub(crate) fn encoded(message: &Message) -> Vec<u8> {
    let mut bytes = Vec::new();
    message.encode_into(&mut bytes).unwrap();
    bytes
}

pub(crate) fn sample(sequence: u64, cdr: &[u8]) -> Sample<'_> {
    Sample { log_time: time(sequence), publish_time: time(sequence), sequence, cdr }
}

/// A bag with `count` estimates, one each hundredth of a second, that is not finished.
pub(crate) fn unfinished(directory: &Path, options: BagOptions, count: u64) -> (BagWriter, TopicHandle) {
    let mut writer = BagWriter::create(directory, options).unwrap();
    let topic =
        writer.add_topic("/whorl_1/attitude/estimate", "whorl_msgs/msg/AttitudeEstimate", "").unwrap();
    for sequence in 0..count {
        writer.write(topic, sample(sequence, &encoded(&estimate(sequence)))).unwrap();
    }
    (writer, topic)
}
