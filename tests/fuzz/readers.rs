//! Real files and messages, spoilt, into everything that reads such: the targets of `fuzz/`, as plain tests.

// The paths in it are those of a crate beside this one.
#[path = "../../fuzz/readers.rs"]
mod targets;

use std::path::{Path, PathBuf};

use whorl_bag::{BagOptions, RunDescription, RunWriter};
use whorl_msgs::{Message, MessageType, PlatformId, Route, Topic};
use whorl_node::Timestamp;

use super::START;
use super::generator::Generator;
use crate::support::machine::Load;
use targets::{MAP, READERS};

/// What a reader may hold at once, whatever lengths and counts a file of a few kilobytes claims [bytes].
const MOST_BYTES: u64 = 200_000_000;
/// The library that reads MCAP sets aside what a text claims to need, which it counts with 32 bits, before it finds that there
/// is less; what is never written takes no memory.
const MOST_CLAIMED_BYTES: u64 = MOST_BYTES + (1 << 32);

/// Words at which readers of texts change their mind.
const WORDS: [&[u8]; 16] = [
    b"1e999",
    b"-1",
    b"18446744073709551616",
    b".nan",
    b"nan",
    b"",
    b"[",
    b"}",
    b": ",
    b"\n",
    b"\n  - ",
    b"&a *a",
    b"!!binary",
    b"\"",
    b"\xff\xfe",
    b"\0",
];

fn parameters() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../params")
}

/// Files with this ending, below a folder.
fn files(folder: &Path, ending: &str, found: &mut Vec<Vec<u8>>) {
    for entry in std::fs::read_dir(folder).unwrap() {
        let path = entry.unwrap().path();
        if path.is_dir() {
            files(&path, ending, found);
        } else if path.extension().is_some_and(|e| e == ending) {
            found.push(std::fs::read(path).unwrap());
        }
    }
}

/// A short run as it is recorded: its manifest and its bag.
fn run(generator: &mut Generator) -> (Vec<u8>, Vec<u8>) {
    let folder = tempfile::tempdir().unwrap();
    let description = RunDescription { platforms: vec!["whorl_1".to_owned()], ..RunDescription::default() };
    let run = folder.path().join("run");
    let mut writer = RunWriter::create_in(&run, description, START, BagOptions::default()).unwrap();
    for k in 0..40 {
        for topic in [Topic::ImuRaw, Topic::WheelState, Topic::VectorDirection] {
            let message = generator.message(topic.info().message_type, START);
            let route = Route::platform(PlatformId(0), topic);
            writer.write_message(route, Timestamp(START.0 + k * 10_000_000), &message).unwrap();
        }
    }
    writer.finish(START).unwrap();
    let mut bags = Vec::new();
    files(&run, "mcap", &mut bags);
    (std::fs::read(run.join(whorl_bag::MANIFEST_FILE)).unwrap(), bags.remove(0))
}

/// What real ones look like.
fn seeds(target: &str, generator: &mut Generator) -> Vec<Vec<u8>> {
    match target {
        "cdr" => (0_u8..)
            .zip(MessageType::ALL)
            .map(|(number, ty)| {
                let mut bytes = Vec::new();
                generator.message(*ty, START).encode_into(&mut bytes).unwrap();
                [vec![number], bytes].concat()
            })
            .collect(),
        "mcap" => vec![run(generator).1],
        "manifest" => vec![run(generator).0],
        "map" => vec![MAP.as_bytes().to_vec()],
        "csv" => {
            let columns =
                "t,x,y,z,a,b,c,u,v,w,n1,n2,n3,j1,j2,j3,j4,j5,j6,j7,j8,j9,j10,j11,j12,volt,qw,qx,qy,qz";
            let line = |k: i32| {
                let jets = ",0.5".repeat(12);
                format!("{},0.{k},1,2,0.01,0.0{k},1,0,0,1,100,{k},0{jets},16.{k},1,0,0,0\n", 10 * k)
            };
            let lines: String = (0..60).map(line).collect();
            vec![format!("{columns}\n{lines}").into_bytes(), format!("{columns}\r\n{}", line(1)).into_bytes()]
        }
        _ => {
            let mut found = Vec::new();
            files(&parameters(), "yaml", &mut found);
            found
        }
    }
}

/// Bytes of a seed, changed in a few places; texts also by words, and by what stands elsewhere in them.
fn spoilt(generator: &mut Generator, seed: &[u8]) -> Vec<u8> {
    let mut bytes = seed.to_vec();
    let place = |generator: &mut Generator, length: usize| {
        usize::try_from(generator.below(length as u64 + 1)).unwrap()
    };
    for _ in 0..=generator.below(3) {
        let at = place(generator, bytes.len());
        match generator.below(4) {
            0 => {
                let word = generator.one_of(&WORDS);
                let end = (at + word.len()).min(bytes.len());
                bytes.splice(at..end, word.iter().copied());
            }
            1 => {
                let (from, to) = (place(generator, seed.len()), place(generator, seed.len()));
                let part = &seed[from.min(to)..from.max(to)];
                bytes.splice(at..at, part[..part.len().min(200)].iter().copied());
            }
            2 => {
                let length = [1, 2, 4, 8][place(generator, 3)];
                let value = generator.one_of(&[0, 1, 0x7f, 0x80, 0xff]);
                bytes.iter_mut().skip(at).take(length).for_each(|byte| *byte = value);
            }
            _ if !bytes.is_empty() => bytes = generator.spoil(&bytes),
            _ => {}
        }
    }
    bytes
}

/// So many spoilt files for each reader, and messages.
fn no_bytes_do_harm(files: usize, messages: usize) {
    let _share = Load::Computation.take();
    for (target, read) in READERS {
        let mut generator = Generator::new(3);
        let seeds = seeds(target, &mut generator);
        // Files of bags, maps and effects are written to disk first.
        let allowed = if target == "mcap" { MOST_CLAIMED_BYTES } else { MOST_BYTES };
        let count = if target == "cdr" { messages } else { files };
        for k in 0..count {
            let seed = &seeds[k % seeds.len()];
            let bytes = if k < seeds.len() { seed.clone() } else { spoilt(&mut generator, seed) };
            let mut outcome = Ok(());
            let most = allocation_counter::measure(|| {
                outcome = std::panic::catch_unwind(|| read(&bytes));
            })
            .bytes_max;
            if outcome.is_err() || most >= allowed {
                let kept = std::env::temp_dir().join(format!("whorl_spoilt.{target}"));
                std::fs::write(&kept, &bytes).unwrap();
                eprintln!("{target}, number {k}: kept as {}", kept.display());
            }
            if let Err(panic) = outcome {
                std::panic::resume_unwind(panic);
            }
            assert!(most < allowed, "{target}, number {k}: {most} bytes for {} read", bytes.len());
        }
    }
}

#[test]
fn no_bytes_make_a_reader_panic_or_grow() {
    no_bytes_do_harm(300, 300);
}

#[test]
#[ignore = "slow: six thousand spoilt files of every kind"]
fn thousands_of_spoilt_files_make_no_reader_panic_or_grow() {
    no_bytes_do_harm(6_000, 100_000);
}

/// The tests would find nothing if spoilt seeds never went further than the first check.
#[test]
fn many_spoilt_messages_are_still_understood() {
    let _share = Load::Computation.take();
    let mut generator = Generator::new(5);
    let seeds = seeds("cdr", &mut generator);
    let understood = (0..1000)
        .filter(|k| {
            let seed = &seeds[k % seeds.len()];
            let bytes = spoilt(&mut generator, seed);
            let ty = MessageType::ALL[usize::from(seed[0]) % MessageType::ALL.len()];
            bytes.get(1..).is_some_and(|bytes| Message::decode(ty, bytes).is_ok())
        })
        .count();
    assert!((100..950).contains(&understood), "{understood} of 1000");
}
