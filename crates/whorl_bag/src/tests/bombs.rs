//! Small files that would become gigabytes.

use std::io::Write as _;
use std::path::PathBuf;

use allocation_counter::measure;
use mcap::records::op;
use tempfile::TempDir;

use crate::{BagError, BagReader};

fn record(opcode: u8, body: &[u8]) -> Vec<u8> {
    [&[opcode][..], &(body.len() as u64).to_le_bytes(), body].concat()
}

fn text(text: &str) -> Vec<u8> {
    [&(text.len() as u32).to_le_bytes()[..], text.as_bytes()].concat()
}

fn times() -> [u8; 16] {
    [5u64.to_le_bytes(), 5u64.to_le_bytes()].concat().try_into().unwrap()
}

/// A schema, and a channel of it with the number 1.
fn definitions() -> Vec<u8> {
    let schema = [&1u16.to_le_bytes()[..], &text("std_msgs/msg/Empty"), &text("ros2msg"), &text("")].concat();
    let channel =
        [&1u16.to_le_bytes()[..], &1u16.to_le_bytes(), &text("/a"), &text("cdr"), &text("")].concat();
    [record(op::SCHEMA, &schema), record(op::CHANNEL, &channel)].concat()
}

/// A message without data.
fn message() -> Vec<u8> {
    record(op::MESSAGE, &[&1u16.to_le_bytes()[..], &7u32.to_le_bytes(), &times()].concat())
}

fn chunk(compression: &str, says: u64, data: &[u8]) -> Vec<u8> {
    let head = [&times()[..], &says.to_le_bytes(), &0u32.to_le_bytes(), &text(compression)].concat();
    record(op::CHUNK, &[&head[..], &(data.len() as u64).to_le_bytes(), data].concat())
}

fn chunk_index(offset: u64, length: u64, size: u64) -> Vec<u8> {
    let place = [&times()[..], &offset.to_le_bytes(), &length.to_le_bytes()].concat();
    let no_messages = [&0u32.to_le_bytes()[..], &0u64.to_le_bytes()].concat();
    let sizes = [&text("")[..], &size.to_le_bytes(), &size.to_le_bytes()].concat();
    record(op::CHUNK_INDEX, &[place, no_messages, sizes].concat())
}

fn file(parts: &[Vec<u8>], summary: &[Vec<u8>]) -> (TempDir, PathBuf) {
    let head = [mcap::MAGIC, &record(op::HEADER, &[text("ros2"), text("")].concat())].concat();
    let data = [head, parts.concat(), record(op::DATA_END, &[0; 4])].concat();
    let begin = if summary.is_empty() { 0 } else { data.len() as u64 };
    let footer = record(op::FOOTER, &[&begin.to_le_bytes()[..], &[0; 12]].concat());
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("bomb.mcap");
    std::fs::write(&path, [data, summary.concat(), footer, mcap::MAGIC.to_vec()].concat()).unwrap();
    (folder, path)
}

/// A frame of Zstandard with so many blocks of 128 kB of zeros.
fn zeros(blocks: usize) -> Vec<u8> {
    // Magic, descriptor without a size, a window of 1 MB.
    let mut frame = vec![0x28, 0xb5, 0x2f, 0xfd, 0x00, 0x50];
    for block in 1..=blocks {
        let header = u32::from(block == blocks) | 1 << 1 | (128 << 10) << 3;
        frame.extend_from_slice(&header.to_le_bytes()[..3]);
        frame.push(0);
    }
    frame
}

#[test]
fn chunks_that_are_too_large_are_refused_before_they_are_decoded() {
    for (parts, what) in [
        (
            vec![definitions(), chunk("zstd", 1 << 36, &zeros(8))],
            "a chunk has 65536 MB; allowed: up to 128 MB",
        ),
        // Three of 100 MB each, in a file of a few bytes.
        (
            [vec![definitions()], vec![chunk("zstd", 100 << 20, &zeros(800)); 3]].concat(),
            "the content, decoded, has 257 MB; allowed: up to 256 MB",
        ),
    ] {
        let (_folder, path) = file(&parts, &[]);
        let mut error = String::new();
        let taken = measure(|| {
            let refused = BagReader::open(&path).err().unwrap();
            assert!(matches!(refused, BagError::TooLarge { .. }));
            error = refused.to_string();
        });
        assert!(error.contains(what), "{error}");
        // A chunk of zeros, and what it is decoded from.
        assert!(taken.bytes_max < 320 << 20, "{} MB", taken.bytes_max >> 20);
    }
}

#[test]
fn a_chunk_that_holds_more_than_it_says_is_damaged_and_costs_nothing() {
    let mut encoder = lz4::EncoderBuilder::new().build(Vec::new()).unwrap();
    encoder.write_all(&vec![0; 64 << 20]).unwrap();
    let (lz4, finished) = encoder.finish();
    finished.unwrap();
    for (compression, data) in [("zstd", zeros(800)), ("lz4", lz4)] {
        let (_folder, path) = file(&[definitions(), chunk(compression, 100, &data)], &[]);
        let mut damaged = 0;
        let taken = measure(|| damaged = BagReader::open(&path).unwrap().integrity().damaged_chunks);
        assert_eq!(damaged, 1, "{compression}");
        assert!(taken.bytes_max < 32 << 20, "{compression}: {} MB", taken.bytes_max >> 20);
    }
}

#[test]
fn very_many_small_messages_take_no_more_than_their_bytes() {
    let all = message().repeat(1_000_000);
    let mut encoder = lz4::EncoderBuilder::new().build(Vec::new()).unwrap();
    encoder.write_all(&all).unwrap();
    let (data, finished) = encoder.finish();
    finished.unwrap();
    let (_folder, path) = file(&[definitions(), chunk("lz4", all.len() as u64, &data)], &[]);
    let mut count = 0;
    let taken = measure(|| count = BagReader::open(&path).unwrap().message_count());
    assert_eq!(count, 1_000_000);
    assert!(taken.bytes_max < 3 * all.len() as u64, "{} MB", taken.bytes_max >> 20);
}

#[test]
fn an_index_that_names_one_chunk_many_times_is_not_believed() {
    let content = message().repeat(10);
    let parts = [definitions(), chunk("", content.len() as u64, &content)];
    let offset = (mcap::MAGIC.len()
        + record(op::HEADER, &[text("ros2"), text("")].concat()).len()
        + parts[0].len()) as u64;
    let index = chunk_index(offset, parts[1].len() as u64, content.len() as u64);
    let counts = [&10u32.to_le_bytes()[..], &1u16.to_le_bytes(), &10_000u64.to_le_bytes()].concat();
    let numbers = [
        &10_000u64.to_le_bytes()[..],
        &1u16.to_le_bytes(),
        &1u32.to_le_bytes(),
        &[0; 8],
        &1000u32.to_le_bytes(),
    ];
    let statistics = record(op::STATISTICS, &[&numbers.concat()[..], &times(), &counts].concat());
    let summary = [vec![definitions()], vec![index; 1000], vec![statistics]].concat();
    let (_folder, path) = file(&parts, &summary);
    let bag = BagReader::open(&path).unwrap();
    assert_eq!(bag.message_count(), 10);
    assert_eq!(bag.messages().filter(|message| message.is_ok()).count(), 10);
}
