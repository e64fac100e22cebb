//! A disk that is full.

use std::io;
use std::path::PathBuf;
use std::sync::{Arc, Mutex};

use super::{encoded, estimate, sample};
use crate::storage::Storage;
use crate::writer::Core;
use crate::{BagError, BagOptions, BagReader};

/// A disk of a certain size.
#[derive(Clone)]
struct SmallDisk {
    bytes: Arc<Mutex<Vec<u8>>>,
    room: Arc<Mutex<usize>>,
}

impl Storage for SmallDisk {
    fn append(&mut self, bytes: &[u8]) -> io::Result<()> {
        let mut file = self.bytes.lock().unwrap();
        let fits = bytes.len().min(self.room.lock().unwrap().saturating_sub(file.len()));
        // As a file system does: what fits is written before the error.
        file.extend_from_slice(&bytes[..fits]);
        if fits < bytes.len() { Err(io::ErrorKind::StorageFull.into()) } else { Ok(()) }
    }

    fn truncate(&mut self, length: u64) -> io::Result<()> {
        self.bytes.lock().unwrap().truncate(length as usize);
        Ok(())
    }
}

fn fill(room: usize) -> (SmallDisk, Core<SmallDisk>, u64) {
    let disk = SmallDisk { bytes: Arc::default(), room: Arc::new(Mutex::new(room)) };
    let options = BagOptions { max_chunk_bytes: 5_000, ..BagOptions::default() };
    let mut core = Core::new(disk.clone(), PathBuf::from("bag_0.mcap"), options).unwrap();
    let topic = core.add_topic("/whorl_1/attitude/estimate", "whorl_msgs/msg/AttitudeEstimate", "").unwrap();
    let mut accepted = 0;
    loop {
        match core.write(topic, sample(accepted, &encoded(&estimate(accepted)))) {
            Ok(()) => accepted += 1,
            Err(BagError::DiskFull { bytes_kept, .. }) => {
                assert_eq!(bytes_kept, disk.bytes.lock().unwrap().len() as u64);
                // The message that did not fit was taken, too: it is in the chunk in memory.
                accepted += 1;
                break;
            }
            Err(error) => panic!("{error}"),
        }
    }
    assert!(matches!(core.write(topic, sample(accepted, &[])), Err(BagError::Stopped { .. })));
    (disk, core, accepted)
}

fn read(disk: &SmallDisk) -> (u64, bool) {
    let directory = tempfile::tempdir().unwrap();
    let path = directory.path().join("x.mcap");
    std::fs::write(&path, &*disk.bytes.lock().unwrap()).unwrap();
    let reader = BagReader::open(&path).unwrap();
    let count = reader.messages().map(Result::unwrap).count() as u64;
    assert_eq!(count, reader.message_count());
    (count, reader.integrity().complete)
}

#[test]
fn what_was_written_stays_readable() {
    let (disk, mut core, accepted) = fill(60_000);
    let (count, complete) = read(&disk);
    assert!(!complete && count > 50 && accepted - count < 15, "{count} of {accepted}");
    // No room for the index either: the file stays as it was.
    assert!(matches!(core.close(), Err(BagError::DiskFull { .. })));
    assert_eq!(read(&disk), (count, false));
}

#[test]
fn with_the_space_set_aside_nothing_is_lost() {
    let (disk, mut core, accepted) = fill(60_000);
    *disk.room.lock().unwrap() += 1 << 20;
    core.close().unwrap();
    assert_eq!(read(&disk), (accepted, true));
}
