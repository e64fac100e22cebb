//! A ROS domain on this machine: which experiment uses it, and which of our processes run in it.

use std::fs::{DirBuilder, File, OpenOptions, TryLockError};
use std::io::{ErrorKind, Write as _};
use std::os::unix::fs::{DirBuilderExt as _, MetadataExt as _};
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

use rustix::fs::{Mode, OFlags};
use rustix::io::FdFlags;
use rustix::process::{Pid, Signal, geteuid, getuid, kill_process, test_kill_process};
use whorl_files::write_file;
use whorl_node::Node;

use crate::error::LaunchError;

/// Time for processes to end after they were asked to.
const NODES_END: Duration = Duration::from_secs(3);
/// The same for the recorder, which closes its files.
const RECORDER_ENDS: Duration = Duration::from_secs(5);
/// The same for a supervisor, which stops its processes one group after the other.
const SUPERVISOR_ENDS: Duration = Duration::from_secs(10);

/// Ending of the files of pages and screens.
const SCREEN: &str = "screen";

/// Held by whoever emulates a platform's devices.
const EMULATORS_LOCK: &str = "lock";

/// A ROS domain on this machine.
#[derive(Debug, Clone)]
pub struct Domain {
    id: u16,
    /// One file for each process of this user: nobody else may write there.
    folder: PathBuf,
    /// Locked by the process that runs nodes in this domain; shared by all users.
    lock: PathBuf,
}

/// The right to run nodes in a domain. Nodes inherit it: should this process die, the domain stays in use as long as one of
/// them lives. Dropped, it is given back, whoever else may have inherited it.
#[derive(Debug)]
pub struct Lease {
    locks: Vec<File>,
}

impl Drop for Lease {
    fn drop(&mut self) {
        for lock in &self.locks {
            // What cannot be unlocked is unlocked when the last process that inherited it ends.
            let _ = lock.unlock();
        }
    }
}

impl Domain {
    /// The domain of this number.
    #[must_use]
    pub fn new(id: u16) -> Self {
        let runtime =
            std::env::var_os("XDG_RUNTIME_DIR").map_or_else(|| PathBuf::from("/tmp"), PathBuf::from);
        let user = getuid().as_raw();
        Self::at(id, runtime.join(format!("whorl-{user}-domain-{id}")), &std::env::temp_dir())
    }

    pub(crate) fn at(id: u16, folder: PathBuf, locks: &Path) -> Self {
        Self { id, folder, lock: locks.join(format!("whorl-domain-{id}.lock")) }
    }

    /// File in which a coordinator keeps how far its experiment has come.
    pub(crate) fn progress(&self, label: &str) -> PathBuf {
        self.folder.join(format!("{label}.progress"))
    }

    /// Folder for the logs of nodes started by hand.
    #[must_use]
    pub fn logs(&self) -> PathBuf {
        self.folder.join("logs")
    }

    /// Takes the domain exclusively for an experiment.
    ///
    /// # Errors
    /// [`LaunchError::DomainTaken`].
    pub fn take(&self) -> Result<Lease, LaunchError> {
        self.create_folder()?;
        Ok(Lease { locks: vec![self.lock(&self.lock, File::try_lock, "another experiment or other nodes")?] })
    }

    /// Takes one part of the domain (a platform's nodes, the coordinator, the recorder), which may run once. Other
    /// parts may be taken, but no experiment may run.
    ///
    /// # Errors
    /// [`LaunchError::DomainTaken`].
    pub fn share(&self, piece: &str) -> Result<Lease, LaunchError> {
        self.create_folder()?;
        let own = self.folder.join(format!("{piece}.lock"));
        let shared = self.lock(&self.lock, File::try_lock_shared, "an experiment")?;
        let own = self.lock(&own, File::try_lock, &format!("another {piece}"))?;
        Ok(Lease { locks: vec![shared, own] })
    }

    /// Folder of a platform's emulated devices, which belongs to the caller while the lease lives. It may be taken while an
    /// experiment runs.
    ///
    /// # Errors
    /// Somebody emulates this platform already.
    pub fn take_emulation(&self, platform: &str) -> Result<(PathBuf, File), LaunchError> {
        self.create_folder()?;
        let root = self.emulation(platform);
        std::fs::create_dir_all(&root).map_err(LaunchError::io("cannot create", &root))?;
        let path = root.join(EMULATORS_LOCK);
        let file = File::create(&path).map_err(LaunchError::io("cannot create", &path))?;
        match file.try_lock() {
            Ok(()) => Ok((root, file)),
            Err(TryLockError::WouldBlock) => Err(LaunchError::DomainTaken {
                domain: self.id,
                by: format!("other emulators of {platform}"),
            }),
            Err(TryLockError::Error(error)) => Err(LaunchError::io("cannot lock", &path)(error)),
        }
    }

    /// Folder of a platform's emulated devices, if somebody emulates it now.
    #[must_use]
    pub fn emulated(&self, platform: &str) -> Option<PathBuf> {
        self.check_folder().ok()?;
        let root = self.emulation(platform);
        let lock = File::open(root.join(EMULATORS_LOCK)).ok()?;
        matches!(lock.try_lock_shared(), Err(TryLockError::WouldBlock)).then_some(root)
    }

    fn emulation(&self, platform: &str) -> PathBuf {
        self.folder.join("emulators").join(platform)
    }

    fn lock(
        &self,
        path: &Path,
        lock: impl Fn(&File) -> Result<(), TryLockError>,
        by: &str,
    ) -> Result<File, LaunchError> {
        let file = open_lock(path).map_err(LaunchError::io("cannot open", path))?;
        match lock(&file) {
            Ok(()) => {
                rustix::io::fcntl_setfd(&file, FdFlags::empty())
                    .map_err(|error| LaunchError::io("cannot keep", path)(error.into()))?;
                Ok(file)
            }
            Err(TryLockError::WouldBlock) => {
                let labels: Vec<String> =
                    self.nodes().into_iter().chain(self.supervisors()).map(|process| process.label).collect();
                let known =
                    if labels.is_empty() { String::new() } else { format!(" ({})", labels.join(", ")) };
                Err(LaunchError::DomainTaken { domain: self.id, by: format!("{by}{known}") })
            }
            Err(TryLockError::Error(error)) => Err(LaunchError::io("cannot lock", path)(error)),
        }
    }

    /// Makes the folder for this user alone, or finds it: where the temporary directory holds it, anybody may have been first.
    pub(crate) fn create_folder(&self) -> Result<(), LaunchError> {
        if let Some(parent) = self.folder.parent() {
            std::fs::create_dir_all(parent).map_err(LaunchError::io("cannot create", parent))?;
        }
        match DirBuilder::new().mode(0o700).create(&self.folder) {
            Ok(()) => Ok(()),
            Err(error) if error.kind() == ErrorKind::AlreadyExists => self.check_folder(),
            Err(error) => Err(LaunchError::io("cannot create", &self.folder)(error)),
        }
    }

    /// Fails unless the folder is there, is no link, belongs to this user, and nobody else may write to it.
    fn check_folder(&self) -> Result<(), LaunchError> {
        let found =
            std::fs::symlink_metadata(&self.folder).map_err(LaunchError::io("cannot read", &self.folder))?;
        let why = if !found.is_dir() {
            "is no folder".to_owned()
        } else if found.uid() != geteuid().as_raw() {
            format!("belongs to the user with the number {}", found.uid())
        } else if found.mode() & 0o022 != 0 {
            "may be written to by other users".to_owned()
        } else {
            return Ok(());
        };
        Err(LaunchError::ForeignFolder { path: self.folder.clone(), why })
    }

    /// Remembers a node, for [`Self::stop`].
    pub(crate) fn remember(&self, label: &str, pid: u32) {
        self.write(&format!("{label}.pid"), pid);
    }

    /// Remembers that this process watches others, for [`Self::stop`].
    pub fn remember_supervisor(&self, label: &str) {
        self.write(&format!("{label}.supervisor"), std::process::id());
    }

    /// Remembers a process that shows a person what nodes do, for [`Self::stop`].
    pub fn remember_screen(&self, label: &str, pid: u32) {
        self.write(&format!("{label}.{SCREEN}"), pid);
    }

    /// Forgets one.
    pub fn forget_screen(&self, label: &str) {
        let _ = std::fs::remove_file(self.folder.join(format!("{label}.{SCREEN}")));
    }

    /// Remembers this process, which is about to become a node.
    pub fn remember_self(&self, label: &str) {
        self.remember(label, std::process::id());
    }

    /// A file that cannot be written only makes [`Self::stop`] miss the process.
    fn write(&self, name: &str, pid: u32) {
        if self.create_folder().is_ok() {
            let _ = write_file(&self.folder.join(name), format!("{pid}\n"));
        }
    }

    pub(crate) fn forget(&self, label: &str) {
        let _ = std::fs::remove_file(self.folder.join(format!("{label}.pid")));
        let _ = std::fs::remove_file(self.progress(label));
    }

    /// Forgets a supervisor, and the folder once nothing is in it.
    pub fn forget_supervisor(&self, label: &str) {
        let _ = std::fs::remove_file(self.folder.join(format!("{label}.supervisor")));
        let _ = std::fs::remove_dir(&self.folder);
    }

    /// Stops everything that runs in this domain and was started by this user on this machine, the recorder last.
    /// Returns how many nodes, and how many pages and screens that showed them, those were.
    #[must_use]
    pub fn stop(&self) -> (usize, usize) {
        // Nobody of this user is noted in a folder that another has made.
        if self.check_folder().is_err() {
            return (0, 0);
        }
        let (nodes, screens) = (self.nodes(), self.running(SCREEN, |program| program == "whorl"));
        // Supervisors end their nodes in order, and write the report.
        end(&self.supervisors(), SUPERVISOR_ENDS);
        let (recorders, others): (Vec<_>, Vec<_>) =
            nodes.iter().cloned().partition(|process| process.label == Node::Recorder.name());
        end(&screens, NODES_END);
        end(&others, NODES_END);
        end(&recorders, RECORDER_ENDS);
        let files = std::fs::read_dir(&self.folder).into_iter().flatten().flatten().map(|entry| entry.path());
        for path in files.filter(|path| {
            path.extension()
                .is_some_and(|e| ["pid", "supervisor", "progress", SCREEN].iter().any(|own| e == *own))
        }) {
            let _ = std::fs::remove_file(path);
        }
        let _ = std::fs::remove_dir(&self.folder);
        (nodes.len(), screens.len())
    }

    /// Running nodes.
    fn nodes(&self) -> Vec<Running> {
        let is_node = |program: &str| Node::find(program).is_some_and(|node| node.info().is_program);
        self.running("pid", is_node)
    }

    /// Commands that watch nodes.
    fn supervisors(&self) -> Vec<Running> {
        self.running("supervisor", |program| program == "whorl")
    }

    fn running(&self, extension: &str, is_ours: impl Fn(&str) -> bool) -> Vec<Running> {
        if self.check_folder().is_err() {
            return Vec::new();
        }
        let files = std::fs::read_dir(&self.folder).into_iter().flatten().flatten().map(|entry| entry.path());
        let mut running: Vec<Running> = files
            .filter(|path| path.extension().is_some_and(|e| e == extension))
            .filter_map(|path| {
                let pid: i32 = std::fs::read_to_string(&path).ok()?.trim().parse().ok()?;
                let label = path.file_stem()?.to_string_lossy().into_owned();
                let process = Running { label, pid: Pid::from_raw(pid)? };
                // A process id may have been given to another program since.
                process.program().is_some_and(|program| is_ours(&program)).then_some(process)
            })
            .collect();
        running.sort_by(|a, b| a.label.cmp(&b.label));
        running
    }
}

/// Opens a file that is only locked, and makes it where there is none. It may belong to another user: only the owner may write
/// to it, but all users may lock it. No link is followed, and nothing that is no file is waited for.
fn open_lock(path: &Path) -> std::io::Result<File> {
    let open = || {
        rustix::fs::open(
            path,
            OFlags::RDONLY | OFlags::NOFOLLOW | OFlags::NONBLOCK | OFlags::CLOEXEC,
            Mode::empty(),
        )
    };
    match open() {
        Ok(file) => Ok(file.into()),
        Err(rustix::io::Errno::NOENT) => match OpenOptions::new().create_new(true).write(true).open(path) {
            // Somebody was first.
            Err(error) if error.kind() == ErrorKind::AlreadyExists => Ok(open()?.into()),
            made => made,
        },
        Err(error) => Err(error.into()),
    }
}

#[derive(Debug, Clone)]
struct Running {
    label: String,
    pid: Pid,
}

impl Running {
    fn program(&self) -> Option<String> {
        let path = std::fs::read_link(format!("/proc/{}/exe", self.pid.as_raw_nonzero())).ok()?;
        let name = path.file_name()?.to_string_lossy().into_owned();
        // The program has been rebuilt since.
        Some(name.strip_suffix(" (deleted)").unwrap_or(&name).to_owned())
    }
}

/// Asks processes that are not children of this one to end, and kills the remaining ones after some time.
fn end(processes: &[Running], within: Duration) {
    for process in processes {
        let _ = kill_process(process.pid, Signal::TERM);
    }
    let began = Instant::now();
    let mut left = processes.to_vec();
    while began.elapsed() < within {
        left.retain(|process| test_kill_process(process.pid).is_ok() && process.program().is_some());
        if left.is_empty() {
            return;
        }
        std::thread::sleep(Duration::from_millis(20));
    }
    for process in left {
        // Nobody need listen.
        let _ = writeln!(std::io::stderr(), "warning: {} did not stop, killing it", process.label);
        let _ = kill_process(process.pid, Signal::KILL);
    }
}
