//! A recording as CSV files.

use std::collections::BTreeSet;
use std::io::{BufWriter, Write};
use std::path::{Path, PathBuf};
use std::sync::Arc;

use whorl_files::NewFile;

use super::error::CsvError;
use super::flatten::{Layout, Leaf, Path as LeafPath};
use crate::{BagError, BagReader, BagTopic, RecordedMessage};

/// A file that [`export_csv`] wrote, or a topic that it left out.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct ExportedTopic {
    /// The topic.
    pub topic: String,
    /// Its file; `None` when its type has no definition, so that its messages cannot be taken apart.
    pub file: Option<PathBuf>,
    /// Lines without the header.
    pub rows: u64,
}

/// Writes one CSV file per topic into a directory (created if need be): `log_time [s]`, counted from the
/// bag's first message, then every field of the message with its unit. Elements of lists have columns of
/// their own (`velocity.0`), as many as the longest list has; what a message does not have stays empty.
/// Times are seconds with nine decimals.
///
/// # Errors
/// When the bag cannot be read or a file not be written.
pub fn export_csv(bag: &BagReader, directory: &Path) -> Result<Vec<ExportedTopic>, CsvError> {
    std::fs::create_dir_all(directory).map_err(CsvError::io("create", directory))?;
    let mut names = BTreeSet::new();
    let each = bag.topics().iter().map(|topic| {
        let file = directory.join(format!("{}.csv", own_name(&topic.name, &mut names)));
        export_topic(bag, topic, file)
    });
    each.collect()
}

/// Longest name without its ending; file systems take 255 bytes.
const LONGEST_NAME: usize = 200;

/// The name of a topic's file, which no other topic of the bag has: `/a/b` and `a_b` would both be `a_b`, where letters are not
/// told from capitals so would `/A/b`, and what strangers write may be longer than any file's name.
fn own_name(topic: &str, taken: &mut BTreeSet<String>) -> String {
    let is_plain = |c: char| c.is_ascii_alphanumeric() || "-_.".contains(c);
    let mut plain: String = topic
        .trim_start_matches('/')
        .chars()
        .map(|c| if is_plain(c) { c } else { '_' })
        .take(LONGEST_NAME)
        .collect();
    if plain.is_empty() || plain.starts_with('.') {
        plain.insert(0, '_');
    }
    let mut name = plain.clone();
    let mut number = 2;
    while !taken.insert(name.to_ascii_lowercase()) {
        name = format!("{plain}_{number}");
        number += 1;
    }
    name
}

fn export_topic(bag: &BagReader, topic: &Arc<BagTopic>, file: PathBuf) -> Result<ExportedTopic, CsvError> {
    let mut exported = ExportedTopic { topic: topic.name.clone(), file: None, rows: 0 };
    let Some(layout) = Layout::of(&topic.type_name) else { return Ok(exported) };
    // First which columns there are: lists differ in length.
    let mut columns = BTreeSet::new();
    for message in bag.messages_of(&[&topic.name]) {
        let message = message?;
        visit(&layout, &message, &mut |path, _| {
            if !columns.contains(path) {
                columns.insert(path.to_vec());
            }
        })?;
    }
    let columns: Vec<(LeafPath, bool)> = columns
        .into_iter()
        .map(|path| {
            let time = layout.is_time(&path);
            (path, time)
        })
        .collect();
    let output = NewFile::create(&file).map_err(CsvError::io("create", &file))?;
    let mut output = Output { path: file, writer: BufWriter::new(output), text: String::new() };
    output.text.push_str("log_time [s]");
    for (path, _) in &columns {
        output.cell(|text| text.push_str(&layout.heading(path)));
    }
    output.line()?;
    let start_ns = bag.bounds().map_or(0, |(first, _)| first.0);
    for message in bag.messages_of(&[&topic.name]) {
        let message = message?;
        write_time(&mut output.text, message.log_time.0.saturating_sub(start_ns));
        // Leaves come in the order of the columns.
        let mut next = 0;
        visit(&layout, &message, &mut |path, leaf| {
            while let Some((column, time)) = columns.get(next) {
                next += 1;
                if column == path {
                    output.cell(|text| write_leaf(text, leaf, *time));
                    break;
                }
                output.cell(|_| {});
            }
        })?;
        for _ in next..columns.len() {
            output.cell(|_| {});
        }
        output.line()?;
        exported.rows += 1;
    }
    let Output { path, writer, .. } = output;
    let finished = writer.into_inner().map_err(std::io::IntoInnerError::into_error).and_then(NewFile::finish);
    finished.map_err(CsvError::io("write", &path))?;
    exported.file = Some(path);
    Ok(exported)
}

fn visit<'a>(
    layout: &Layout,
    message: &'a RecordedMessage,
    visitor: &mut impl FnMut(&[u32], Leaf<'a>),
) -> Result<(), CsvError> {
    layout.visit(&message.cdr, visitor).map_err(|source| {
        CsvError::Bag(BagError::Decode {
            topic: message.topic.name.clone(),
            log_time_ns: message.log_time.0,
            source,
        })
    })
}

struct Output {
    path: PathBuf,
    writer: BufWriter<NewFile>,
    text: String,
}

impl Output {
    fn cell(&mut self, write: impl FnOnce(&mut String)) {
        self.text.push(',');
        write(&mut self.text);
    }

    fn line(&mut self) -> Result<(), CsvError> {
        self.text.push('\n');
        self.writer.write_all(self.text.as_bytes()).map_err(CsvError::io("write", &self.path))?;
        self.text.clear();
        Ok(())
    }
}

fn write_leaf(text: &mut String, leaf: Leaf<'_>, time: bool) {
    use std::fmt::Write as _;
    // Writing to a String cannot fail.
    let _ = match leaf {
        Leaf::Bool(value) => write!(text, "{}", u8::from(value)),
        Leaf::Signed(ns) if time => {
            write_time(text, ns);
            Ok(())
        }
        Leaf::Signed(value) => write!(text, "{value}"),
        Leaf::Unsigned(value) => write!(text, "{value}"),
        Leaf::Single(value) => write!(text, "{value:?}"),
        Leaf::Double(value) => write!(text, "{value:?}"),
        Leaf::Text(value) => {
            let value = String::from_utf8_lossy(value);
            if value.contains([',', '"', '\n', '\r']) {
                write!(text, "\"{}\"", value.replace('"', "\"\""))
            } else {
                write!(text, "{value}")
            }
        }
    };
}

/// Seconds with every nanosecond.
fn write_time(text: &mut String, ns: i64) {
    use std::fmt::Write as _;
    let sign = if ns < 0 { "-" } else { "" };
    let ns = ns.unsigned_abs();
    let _ = write!(text, "{sign}{}.{:09}", ns / 1_000_000_000, ns % 1_000_000_000);
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{BagOptions, RunDescription, RunDirectory, RunWriter};
    use whorl_msgs::diagnostic_msgs::{DiagnosticArray, DiagnosticStatus};
    use whorl_msgs::sensor_msgs::JointState;
    use whorl_msgs::{PlatformId, Route, Topic};
    use whorl_node::Timestamp;

    #[test]
    fn lists_of_different_length_share_columns_and_texts_are_quoted() {
        let directory = tempfile::tempdir().unwrap();
        let description = RunDescription { platforms: vec!["a".into()], ..RunDescription::default() };
        let mut run =
            RunWriter::create(directory.path(), description, Timestamp(0), BagOptions::default()).unwrap();
        let path = run.path().to_owned();
        for (i, velocity) in [vec![0.1], vec![0.2, f64::NAN], vec![]].into_iter().enumerate() {
            let state = JointState { velocity, effort: vec![i as f64], ..JointState::default() };
            let route = Route::platform(PlatformId(0), Topic::WheelState);
            run.write_message(route, Timestamp(7_000_000_001 + i as i64), &state.into()).unwrap();
        }
        let status = DiagnosticStatus { message: "a, \"b\"".into(), ..DiagnosticStatus::default() };
        let array = DiagnosticArray { status: vec![status], ..DiagnosticArray::default() };
        run.write_message(Route::shared(Topic::Diagnostics), Timestamp(6_000_000_000), &array.into())
            .unwrap();
        run.add_topic("/other", "x_msgs/msg/Y", "", None).unwrap();
        run.finish(Timestamp(0)).unwrap();
        let bag = RunDirectory::open(&path).unwrap().bag().unwrap();
        let out = directory.path().join("csv");
        let exported = export_csv(&bag, &out).unwrap();
        assert_eq!(exported.iter().map(|e| e.rows).collect::<Vec<_>>(), [3, 1, 0]);
        assert_eq!(exported[2].file, None);
        assert_eq!(
            std::fs::read_to_string(out.join("a_wheels_state.csv")).unwrap(),
            "log_time [s],header.stamp [s],header.frame_id,velocity.0 [rad/s],velocity.1 [rad/s],effort.0 [N m]\n\
             1.000000001,0.000000000,,0.1,,0.0\n\
             1.000000002,0.000000000,,0.2,NaN,1.0\n\
             1.000000003,0.000000000,,,,2.0\n"
        );
        let text = std::fs::read_to_string(out.join("diagnostics.csv")).unwrap();
        assert_eq!(text.lines().nth(1).unwrap(), "0.000000000,0.000000000,,0,,\"a, \"\"b\"\"\",");
    }

    #[test]
    fn every_topic_has_a_file_of_its_own_whatever_it_is_called() {
        let mut taken = BTreeSet::new();
        let long = format!("/{}", "x".repeat(300));
        let topics = ["/a/b", "a_b", "/A/b", &long, &long, "", "/../../e", "..", "/nl\nx"];
        let names: Vec<String> = topics.iter().map(|topic| own_name(topic, &mut taken)).collect();
        let cut = "x".repeat(LONGEST_NAME);
        let expected = ["a_b", "a_b_2", "A_b_3", &cut, &format!("{cut}_2"), "_", "_.._.._e", "_..", "nl_x"];
        assert_eq!(names, expected);
        assert!(names.iter().all(|name| name.len() < 250 && !name.contains('/')));
    }
}
