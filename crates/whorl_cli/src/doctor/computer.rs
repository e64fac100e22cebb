//! Programs, disk, memory, heat, and how punctually the computer wakes a process.

use std::path::Path;
use std::time::{Duration, Instant};

use whorl_node::Node;

use super::Check;
use super::machine::Machine;
use crate::run::Folders;

/// Free space: below the first nothing can be recorded for long, below the second not all day \[bytes\].
const DISK_WRONG: u64 = 1 << 30;
const DISK_WARNING: u64 = 10 << 30;
/// Memory for a platform's nodes \[kB\].
const MEMORY_KB: f64 = 500e3;
/// Processors of most computers slow down at 80 to 100 degrees Celsius.
const HOT_C: f64 = 80.0;
/// Lateness of a wake-up that a loop of 100 Hz does not notice, and that it cannot live with \[s\].
const LATE_WARNING_S: f64 = 1e-3;
const LATE_WRONG_S: f64 = 1e-2;
const WAKE_UPS: usize = 500;

/// All of it.
pub(super) fn all(machine: &Machine, folders: &Folders) -> Vec<Check> {
    let mut checks = vec![programs(), disk(&folders.recordings())];
    checks.push(memory(&machine.text("/proc/meminfo").unwrap_or_default()));
    checks.push(temperature(machine));
    checks.push(governor(machine));
    checks.push(wake_ups());
    checks.extend(load(machine));
    checks.push(limits(&machine.text("/proc/self/limits").unwrap_or_default()));
    checks
}

/// Programs of the nodes stand beside this one, and are of the same build.
fn programs() -> Check {
    const NAME: &str = "programs";
    let version = env!("CARGO_PKG_VERSION");
    let folder = std::env::current_exe().ok().and_then(|path| path.parent().map(Path::to_owned));
    let Some(folder) = folder else {
        return Check::unknown(NAME, "this program does not know where it is", "start it by its path");
    };
    let modified = |name: &str| folder.join(name).metadata().and_then(|data| data.modified()).ok();
    let nodes: Vec<&str> =
        Node::ALL.iter().filter(|node| node.info().is_program).map(|node| node.name()).collect();
    let missing: Vec<&str> = nodes.iter().copied().filter(|name| modified(name).is_none()).collect();
    let place = folder.display();
    if !missing.is_empty() {
        let found = format!("{} missing in {place}", missing.join(", "));
        return Check::wrong(NAME, found, "cargo build --release --workspace, or install the whole package");
    }
    // A day apart is another build.
    let own = modified("whorl");
    let far = |name: &&str| {
        own.zip(modified(name)).is_some_and(|(a, b)| {
            a.duration_since(b).or_else(|_| b.duration_since(a)).is_ok_and(|d| d.as_secs() > 86_400)
        })
    };
    let old: Vec<&str> = nodes.iter().copied().filter(far).collect();
    if old.is_empty() {
        return Check::good(NAME, format!("whorl {version}, {} nodes in {place}", nodes.len()));
    }
    let found = format!("{} of another day than whorl in {place}", old.join(", "));
    Check::warning(NAME, found, "cargo build --release --workspace: all programs are of one version")
}

/// Space and permission where runs are recorded.
pub(super) fn disk(folder: &Path) -> Check {
    const NAME: &str = "disk";
    // The folder itself is made when it is needed.
    let Some(there) = folder.ancestors().find(|path| path.is_dir()) else {
        return Check::wrong(NAME, format!("{} is not there", folder.display()), "make it");
    };
    if rustix::fs::access(there, rustix::fs::Access::WRITE_OK).is_err() {
        let found = format!("{} cannot be written", there.display());
        return Check::wrong(
            NAME,
            found,
            format!("chown $USER {}, or --root a folder of your own", there.display()),
        );
    }
    let Ok(data) = rustix::fs::statvfs(there) else {
        return Check::unknown(NAME, format!("{} cannot be asked", there.display()), "df -h");
    };
    let free = data.f_bavail.saturating_mul(data.f_frsize);
    // Two platforms' topics are about 60 MB an hour.
    let place = there.canonicalize().unwrap_or_else(|_| there.to_owned());
    let found = format!("{:.1} GB free in {}", free as f64 / 1e9, place.display());
    let remedy = "whorl runs shows what there is; move recordings elsewhere";
    match free {
        free if free < DISK_WRONG => Check::wrong(NAME, found, remedy),
        free if free < DISK_WARNING => Check::warning(NAME, found, remedy),
        _ => Check::good(NAME, found),
    }
}

/// From `/proc/meminfo`.
pub(super) fn memory(text: &str) -> Check {
    const NAME: &str = "memory";
    let line = text.lines().find_map(|line| line.strip_prefix("MemAvailable:"));
    let kb = line.and_then(|rest| rest.trim().strip_suffix("kB")?.trim().parse::<f64>().ok());
    let remedy = "end what is not needed on this computer";
    match kb {
        None => Check::unknown(NAME, "the kernel does not say", remedy),
        Some(kb) if kb < MEMORY_KB => {
            Check::warning(NAME, format!("{:.0} MB available; a platform's nodes need 500", kb / 1e3), remedy)
        }
        Some(kb) => Check::good(NAME, format!("{:.1} GB available", kb / 1e6)),
    }
}

/// The hottest zone.
pub(super) fn temperature(machine: &Machine) -> Check {
    const NAME: &str = "temperature";
    let zones =
        machine.names("/sys/class/thermal").into_iter().filter(|name| name.starts_with("thermal_zone"));
    let read = zones.filter_map(|zone| {
        let milli = machine.number(&format!("/sys/class/thermal/{zone}/temp"))?;
        let kind = machine.text(&format!("/sys/class/thermal/{zone}/type")).unwrap_or(zone);
        Some((milli * 1e-3, kind))
    });
    match read.max_by(|a, b| a.0.total_cmp(&b.0)) {
        None => Check::unknown(
            NAME,
            "this computer has no sensor that the kernel knows",
            "a thermometer on its heat sink",
        ),
        Some((celsius, kind)) if celsius >= HOT_C => {
            let found = format!("{celsius:.0} deg C ({kind}): the processor slows down");
            Check::warning(NAME, found, "a heat sink, a fan, or less load; a platform has no wind")
        }
        Some((celsius, kind)) => Check::good(NAME, format!("{celsius:.0} deg C ({kind})")),
    }
}

/// Whether processors save power.
pub(super) fn governor(machine: &Machine) -> Check {
    const NAME: &str = "processor speed";
    let processors = machine.names("/sys/devices/system/cpu").into_iter();
    let governors = processors
        .filter_map(|name| machine.text(&format!("/sys/devices/system/cpu/{name}/cpufreq/scaling_governor")));
    let saving: Vec<String> = governors.filter(|governor| governor != "performance").collect();
    match saving.first() {
        None => Check::good(NAME, "not scaled down"),
        Some(governor) => Check::warning(
            NAME,
            format!("{} processors have the governor {governor}: wake-ups are later", saving.len()),
            "cpupower frequency-set -g performance",
        ),
    }
}

/// Sleeps of a millisecond, and how late they end.
fn wake_ups() -> Check {
    let sleep = Duration::from_millis(1);
    let mut late: Vec<f64> = (0..WAKE_UPS)
        .map(|_| {
            let due = Instant::now() + sleep;
            std::thread::sleep(sleep);
            due.elapsed().as_secs_f64()
        })
        .collect();
    late.sort_by(f64::total_cmp);
    let at = |share: f64| late.get((WAKE_UPS as f64 * share) as usize).copied().unwrap_or(0.0);
    judged_wake_ups(at(0.99), late.last().copied().unwrap_or(0.0))
}

/// From the 99th percentile and the largest lateness \[s\].
pub(super) fn judged_wake_ups(p99_s: f64, worst_s: f64) -> Check {
    const NAME: &str = "wake-ups";
    let found = format!("99 % end less than {:.2} ms late, the worst {:.2} ms", p99_s * 1e3, worst_s * 1e3);
    let remedy = "end other programs; a kernel with PREEMPT_RT, and the governor performance, make it better";
    if p99_s > LATE_WRONG_S {
        Check::wrong(NAME, found, remedy)
    } else if p99_s > LATE_WARNING_S || worst_s > LATE_WRONG_S {
        Check::warning(NAME, found, remedy)
    } else {
        Check::good(NAME, found)
    }
}

/// The load of the last minute for each processor.
pub(super) fn load(machine: &Machine) -> Option<Check> {
    const NAME: &str = "load";
    let load: f64 = machine.text("/proc/loadavg")?.split_whitespace().next()?.parse().ok()?;
    let processors = std::thread::available_parallelism().map_or(1.0, |count| count.get() as f64);
    let found = format!("{load:.1} processes want {processors:.0} processors");
    Some(if load > processors * 0.75 {
        Check::warning(NAME, found, "top shows which; builds and browsers belong on another computer")
    } else {
        Check::good(NAME, found)
    })
}

/// From `/proc/self/limits`.
pub(super) fn limits(text: &str) -> Check {
    const NAME: &str = "real-time limits";
    let soft = |name: &str| {
        let line = text.lines().find_map(|line| line.strip_prefix(name))?;
        line.split_whitespace().next().map(str::to_owned)
    };
    let priority = soft("Max realtime priority");
    match priority.as_deref() {
        None => Check::unknown(NAME, "the kernel does not say", "ulimit -r"),
        Some("0") => Check::warning(
            NAME,
            "no real-time priority for this user: valves are switched as late as the wake-ups above",
            "in /etc/security/limits.d/whorl.conf: `@dialout - rtprio 80` and `@dialout - memlock unlimited`; log in \
             again, and start with --realtime",
        ),
        Some(priority) => Check::good(NAME, format!("priorities up to {priority}")),
    }
}
