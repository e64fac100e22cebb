//! Real-time scheduling of the nodes that a control loop goes through.

use std::io;
use std::process::{Child, Command};

use rustix::process::{Resource, geteuid, getrlimit};
use rustix::thread::{CpuSet, sched_setaffinity};
use thread_priority::{
    Error, RealtimeThreadSchedulePolicy, ThreadPriority, ThreadPriorityValue, ThreadSchedulePolicy,
    set_thread_priority_and_policy, thread_native_id,
};
use whorl_node::Node;

use crate::error::LaunchError;

/// With 1 a node keeps its memory in RAM, so that no page of it is ever waited for.
const LOCK_MEMORY: &str = "WHORL_LOCK_MEMORY";
/// The driver closes the valves when its time is up: nothing of ours goes before it. Interrupts of devices have 50.
const DRIVER: u8 = 49;
const LOOP: u8 = 40;

/// First in, first out (SCHED_FIFO): before every ordinary program, however busy the computer is.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct RealTime {
    cpus: Vec<usize>,
}

impl RealTime {
    /// On these processors; on all, where none is named.
    ///
    /// # Errors
    /// When this user may not, or there is no such processor; said before anything is started.
    pub fn on(cpus: Vec<usize>) -> Result<Self, LaunchError> {
        let real_time = Self { cpus };
        let may_lock = geteuid().is_root() || getrlimit(Resource::Memlock).current.is_none();
        if !may_lock {
            return Err(LaunchError::MemoryLock);
        }
        on_a_thread(|| real_time.take_processors())
            .map_err(|source| LaunchError::Processors { cpus: real_time.cpus.clone(), source })?;
        on_a_thread(|| take_priority(DRIVER)).map_err(LaunchError::RealTime)?;
        Ok(real_time)
    }

    /// Of a node: `None` for those that nobody waits for.
    pub(crate) fn priority(node: Node) -> Option<u8> {
        match node {
            Node::Driver => Some(DRIVER),
            Node::Estimator | Node::LocalControl | Node::Coordinator => Some(LOOP),
            Node::ModelMonitor | Node::Recorder | Node::Simulation => None,
        }
    }

    /// Starts a program with this priority from its first instruction on.
    pub(crate) fn spawn(&self, priority: u8, command: &mut Command) -> io::Result<Child> {
        command.env(LOCK_MEMORY, "1");
        on_a_thread(|| {
            self.take_processors()?;
            take_priority(priority)?;
            command.spawn()
        })
    }

    fn take_processors(&self) -> io::Result<()> {
        if self.cpus.is_empty() {
            return Ok(());
        }
        let mut set = CpuSet::new();
        for cpu in &self.cpus {
            if *cpu >= CpuSet::MAX_CPU {
                return Err(io::ErrorKind::InvalidInput.into());
            }
            set.set(*cpu);
        }
        Ok(sched_setaffinity(None, &set)?)
    }
}

/// A process inherits from the thread that starts it; this one ends, so that nothing has to be put back.
fn on_a_thread<T: Send>(work: impl FnOnce() -> io::Result<T> + Send) -> io::Result<T> {
    std::thread::scope(|scope| scope.spawn(work).join())
        .unwrap_or_else(|_| Err(io::Error::other("a thread ended early")))
}

fn take_priority(priority: u8) -> io::Result<()> {
    let value = ThreadPriorityValue::try_from(priority).map_err(io::Error::other)?;
    let policy = ThreadSchedulePolicy::Realtime(RealtimeThreadSchedulePolicy::Fifo);
    set_thread_priority_and_policy(thread_native_id(), ThreadPriority::Crossplatform(value), policy).map_err(
        |error| match error {
            Error::OS(code) => io::Error::from_raw_os_error(code),
            other => io::Error::other(format!("{other:?}")),
        },
    )
}
