//! A limit on a process's memory.
//!
//! RustDDS 0.15 allocates without bound when a datagram claims a range of 2^40 samples (docs/upstream/rustdds.md):
//! about a gigabyte a second, until the machine has none left and the kernel ends whatever it likes. With a limit, the
//! process that was hit ends at once, and is started again by whoever supervises it.

use rustix::mm::{MlockAllFlags, mlockall};
use rustix::process::{Resource, Rlimit, getrlimit, setrlimit};

/// What a node may allocate beyond what it holds before it joins the network [MiB]. Its connection takes some tens, mostly
/// stacks of threads, and grows by a few.
const HEADROOM_MIB: u64 = 256;
/// Sets another headroom [MiB]; 0: no limit.
const VARIABLE: &str = "WHORL_MEMORY_HEADROOM_MIB";

/// Set to 1 by `--realtime`: memory stays in RAM.
const LOCK: &str = "WHORL_LOCK_MEMORY";

/// Keeps the memory of this process in RAM, where that is asked for: a page that has to be read from disk is late by
/// milliseconds. What is reserved and never used takes none.
pub fn lock_memory() {
    if std::env::var(LOCK).is_ok_and(|wanted| wanted == "1")
        && let Err(error) = mlockall(MlockAllFlags::CURRENT | MlockAllFlags::FUTURE | MlockAllFlags::ONFAULT)
    {
        tracing::warn!("memory is not kept in RAM: {error}");
    }
}

/// Limits the memory of this process to what it holds now and some headroom. Without `/proc`, or when the operating system
/// refuses, nothing is limited, and the log says so.
pub fn limit_memory() {
    let headroom_mib = match std::env::var(VARIABLE) {
        Err(_) => HEADROOM_MIB,
        Ok(text) => text.parse().unwrap_or_else(|_| {
            tracing::warn!(
                "{VARIABLE} is '{text}'; allowed: a number of MiB, 0 for no limit. {HEADROOM_MIB} is used"
            );
            HEADROOM_MIB
        }),
    };
    if headroom_mib == 0 {
        return;
    }
    let status = std::fs::read_to_string("/proc/self/status").unwrap_or_default();
    let Some(held) = data_bytes(&status) else {
        tracing::warn!("memory is not limited: /proc/self/status does not say what is held");
        return;
    };
    let wanted = held.saturating_add(headroom_mib.saturating_mul(1 << 20));
    let maximum = getrlimit(Resource::Data).maximum;
    let limit = Rlimit { current: Some(maximum.map_or(wanted, |maximum| maximum.min(wanted))), maximum };
    if let Err(error) = setrlimit(Resource::Data, limit) {
        tracing::warn!("memory is not limited: {error}");
    }
}

/// `VmData`, which is what the limit counts: everything that can be written and is not shared, in bytes.
fn data_bytes(status: &str) -> Option<u64> {
    let line = status.lines().find_map(|line| line.strip_prefix("VmData:"))?;
    let kibibytes: u64 = line.trim().strip_suffix("kB")?.trim().parse().ok()?;
    kibibytes.checked_mul(1024)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_the_kernel_says_is_read() {
        let status = "Name:\tdriver\nVmPeak:\t  100 kB\nVmData:\t   81920 kB\nVmStk:\t     132 kB\n";
        assert_eq!(data_bytes(status), Some(80 << 20));
        assert_eq!(data_bytes("Name:\tdriver\n"), None);
        assert_eq!(data_bytes("VmData:\t many kB\n"), None);
    }
}
