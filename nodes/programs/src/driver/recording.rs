//! Reads the recording of a replaying driver.

use std::path::Path;

use anyhow::{Context, bail};
use whorl_bag::{CsvMap, CsvRecording, Measurement};
use whorl_driver::replay::RecordedMeasurement;
use whorl_node::Timestamp;

/// All measurements of `platform` in a run directory, a bag or, with `channels`, a CSV file.
pub fn read(
    source: &str,
    channels: Option<&str>,
    platform: &str,
) -> anyhow::Result<Vec<RecordedMeasurement>> {
    let path = Path::new(source);
    let csv = [".csv", ".csv.gz"].iter().any(|ending| source.to_ascii_lowercase().ends_with(ending));
    match (csv, channels) {
        (false, _) => whorl_bag::measurements(path, platform)?.map(|m| Ok(recorded(m?))).collect(),
        (true, Some(channels)) => {
            let map =
                CsvMap::load(Path::new(channels)).with_context(|| format!("replay.channels {channels}"))?;
            let import = CsvRecording::open(path, &map)?;
            import.samples(platform, Timestamp(0))?.map(|m| Ok(recorded(m?))).collect()
        }
        (true, None) => bail!(
            "replay.source {source} is a CSV file: replay.channels must name the file that says which column is which"
        ),
    }
}

fn recorded(measurement: Measurement) -> RecordedMeasurement {
    RecordedMeasurement { stamp: measurement.stamp, topic: measurement.topic, message: measurement.message }
}
