//! A recording as CSV files.

use std::collections::BTreeSet;
use std::fs::File;
use std::io::{BufWriter, Write};
use std::path::{Path, PathBuf};
use std::sync::Arc;

use super::CsvError;
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
    bag.topics().iter().map(|topic| export_topic(bag, topic, directory)).collect()
}

fn export_topic(bag: &BagReader, topic: &Arc<BagTopic>, directory: &Path) -> Result<ExportedTopic, CsvError> {
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
    let file = directory.join(format!("{}.csv", topic.name.trim_start_matches('/').replace('/', "_")));
    let output = File::create(&file).map_err(CsvError::io("create", &file))?;
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
    output.writer.flush().map_err(CsvError::io("write", &output.path))?;
    exported.file = Some(output.path);
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
    writer: BufWriter<File>,
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
