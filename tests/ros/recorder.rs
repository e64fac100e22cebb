//! Fault rows of the recorder: kill -9, and a full disk. Written data stays readable; other nodes are not affected.

use std::path::{Path, PathBuf};
use std::process::Command;
use std::time::Duration;

use rustix::process::Signal;
use whorl_bag::{RunDirectory, RunState};
use whorl_msgs::diagnostic_msgs::{DiagnosticArray, DiagnosticStatus};
use whorl_msgs::sensor_msgs::Imu;
use whorl_msgs::topics::Topic;
use whorl_msgs::whorl::ControlStatus;
use whorl_node::Timestamp;

use crate::support::formation::{Formation, STARTUP};
use crate::support::watch::route;
use crate::support::{is_root, skipped, wait_for};

fn record_into(formation: &mut Formation, run: &Path) {
    formation.start_with("/recorder", &[format!("run_directory:={}", run.display())]);
}

/// Number of messages that can be read, decoded, and the time of the last one.
fn read(run: &Path) -> (usize, Timestamp) {
    let bag = RunDirectory::open(run).unwrap().bag().unwrap();
    let (mut count, mut last) = (0, Timestamp::default());
    for message in bag.messages() {
        let message = message.unwrap();
        message.decode().unwrap_or_else(|e| panic!("{}: {e}", message.topic.name));
        count += 1;
        last = last.max(message.log_time);
    }
    (count, last)
}

/// Bytes of the bag's first file so far.
fn size(run: &Path) -> u64 {
    std::fs::metadata(run.join("bag/bag_0.mcap")).map_or(0, |file| file.len())
}

/// How much a killed one may lose is asserted in virtual time (`crates/whorl_bag`, `nodes/recorder`).
#[test]
fn a_killed_recorder_leaves_a_readable_bag_and_a_stopped_one_a_complete_run() {
    let (mut formation, watch) = Formation::holding_alone(&[]);
    let killed_run = formation.folder().join("killed");
    record_into(&mut formation, &killed_run);
    wait_for("the bag to grow", STARTUP, || (size(&killed_run) > 300_000).then_some(()));
    formation.kill("/recorder");
    // 300 kB of messages of at most 600 bytes.
    let (count, _) = read(&killed_run);
    assert!(count > 500, "{count} messages");

    let run = formation.folder().join("stopped");
    record_into(&mut formation, &run);
    wait_for("the bag to grow", STARTUP, || (size(&run) > 300_000).then_some(()));
    let begun = whorl_ros::wall_clock();
    // What was on the network before the recorder was told to end is in the recording.
    watch.wait_next::<Imu>("a later measurement", route(0, Topic::ImuRaw), STARTUP, |m| {
        Timestamp::from(m.header.stamp) > begun
    });
    wait_for("the bag to grow", STARTUP, || (size(&run) > 600_000).then_some(()));
    formation.stop();
    let directory = RunDirectory::open(&run).unwrap();
    let manifest = directory.manifest().unwrap();
    assert_eq!(manifest.state, RunState::Complete);
    let (count, last) = read(&run);
    assert_eq!(manifest.message_count(), count as u64);
    assert!(last > begun, "the recording ended early");
    let imu = manifest.topic("/whorl_1/imu/data_raw").unwrap();
    assert!(imu.count > 100, "{} IMU messages", imu.count);
    assert!(directory.parameter_files().len() >= 3, "parameter files are missing");
}

#[test]
fn a_recorder_that_was_stopped_and_continued_goes_on_recording() {
    let (mut formation, watch) = Formation::holding_alone(&[]);
    let run = formation.folder().join("run");
    record_into(&mut formation, &run);
    wait_for("the bag to grow", STARTUP, || (size(&run) > 300_000).then_some(()));
    formation.node("/recorder").signal(Signal::STOP);
    watch.during(Duration::from_secs(1));
    formation.node("/recorder").signal(Signal::CONT);
    let continued = whorl_ros::wall_clock();
    let before = size(&run);
    wait_for("the bag to grow again", STARTUP, || (size(&run) > before + 300_000).then_some(()));
    formation.stop();
    let bag = RunDirectory::open(&run).unwrap().bag().unwrap();
    let messages = bag.messages().map(|message| message.unwrap());
    let imu = messages.filter(|m| m.topic.name == "/whorl_1/imu/data_raw" && m.log_time > continued);
    let count = imu.count();
    assert!(count > 100, "{count} IMU messages after the pause");
    let manifest = RunDirectory::open(&run).unwrap().manifest().unwrap().clone();
    assert_eq!(manifest.state, RunState::Complete);
    let notes = &manifest.description.notes;
    assert!(notes.iter().any(|(key, text)| key == "interrupted" && text.contains("continued")), "{notes:?}");
}

#[test]
fn a_run_directory_that_is_deleted_is_told_at_once_and_by_the_exit_status() {
    let (mut formation, watch) = Formation::holding_alone(&[]);
    let run = formation.folder().join("run");
    record_into(&mut formation, &run);
    wait_for("the bag to grow", STARTUP, || (size(&run) > 300_000).then_some(()));
    std::fs::remove_dir_all(&run).unwrap();
    let what = "the recorder to say that its file is gone";
    let said = |m: &DiagnosticArray| {
        m.status.iter().any(|s| {
            s.name.contains("recorder") && s.level == DiagnosticStatus::ERROR && s.message.contains("deleted")
        })
    };
    watch.wait_next::<DiagnosticArray>(what, route(0, Topic::Diagnostics), STARTUP, said);
    let status = formation.node("/recorder").interrupt(STARTUP);
    assert!(!status.success(), "a lost recording ended with {status}");
}

/// A file system of a few megabytes, unmounted on drop.
struct SmallDisk(PathBuf);

impl SmallDisk {
    fn mount(path: &Path, kilobytes: u32) -> Option<Self> {
        std::fs::create_dir(path).ok()?;
        let size = format!("size={kilobytes}k");
        let status =
            Command::new("mount").args(["-t", "tmpfs", "-o", &size, "tmpfs"]).arg(path).status().ok()?;
        status.success().then(|| Self(path.to_owned()))
    }
}

impl Drop for SmallDisk {
    fn drop(&mut self) {
        // Lazily: a process that is being killed may still hold a file.
        let _ = Command::new("umount").arg("-l").arg(&self.0).status();
    }
}

#[test]
fn a_full_disk_stops_the_recording_and_nothing_else() {
    let what = "a recorder on a full disk";
    if !is_root() {
        skipped(what, "mounting a small file system needs root");
        return;
    }
    let disks = tempfile::tempdir().unwrap();
    let Some(disk) = SmallDisk::mount(&disks.path().join("disk"), 2048) else {
        skipped(what, "mount -t tmpfs is not allowed here");
        return;
    };
    let (mut formation, watch) = Formation::holding_alone(&[]);
    let run = disk.0.join("run");
    record_into(&mut formation, &run);
    let diagnostics = route(0, Topic::Diagnostics);
    watch.wait_next::<DiagnosticArray>(
        "the recorder to say that the disk is full",
        diagnostics,
        STARTUP,
        |m| {
            m.status.iter().any(|s| {
                let text = s.message.to_lowercase();
                s.name.contains("recorder")
                    && s.level >= DiagnosticStatus::WARN
                    && (text.contains("full") || text.contains("space"))
            })
        },
    );
    // The others go on.
    watch.wait_next::<ControlStatus>("tracking", route(0, Topic::ControlStatus), STARTUP, |m| {
        m.mode == ControlStatus::MODE_TRACK
    });
    formation.check_alive();
    let (count, _) = read(&run);
    assert!(count > 500, "{count} messages");
    // Told by its exit status, too.
    let status = formation.node("/recorder").interrupt(STARTUP);
    assert!(!status.success(), "an incomplete recording ended with {status}");
    let (count_after, _) = read(&run);
    assert!(count_after >= count, "{count} messages before the end, {count_after} after");
}
