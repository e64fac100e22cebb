//! Keeps how far the experiment has come in a file, for a coordinator that is started again.

use std::path::{Path, PathBuf};
use std::sync::mpsc::{Receiver, SyncSender, sync_channel};
use std::time::Duration;

use whorl_coordinator::{CoordinatorCore, Parameters};
use whorl_node::{Configurable, Event, NodeCore, Outputs, Route, Service, Timestamp};
use whorl_ros::{monotonic, wall_clock};

/// The file; its name is chosen by the launcher (`whorl_launch`), which removes it before an experiment. Without it nothing is kept.
const VARIABLE: &str = "WHORL_PROGRESS_FILE";
/// Largest file that is read.
const LARGEST: u64 = 1 << 16;
/// It is written so often.
const EVERY: Duration = Duration::from_millis(500);
/// Changes when the computer is started, and with it what the monotonic clock counts from.
const BOOT: &str = "/proc/sys/kernel/random/boot_id";

/// A coordinator whose progress is kept.
pub struct Keeping {
    core: CoordinatorCore,
    /// To the thread that writes: a disk that hangs must not keep the coordinator from its platforms.
    writer: Option<SyncSender<String>>,
    next: Timestamp,
    last_phase: u8,
}

impl Keeping {
    /// Goes on with what is in the file, and keeps progress there.
    pub fn of(core: CoordinatorCore) -> Self {
        let last_phase = core.phase();
        let Some(file) = std::env::var_os(VARIABLE).map(PathBuf::from) else {
            return Self { core, writer: None, next: Timestamp::default(), last_phase };
        };
        let core = match read(&file) {
            Some((kept, age_s)) => core.going_on(kept, age_s),
            None => core,
        };
        let (sender, receiver) = sync_channel(1);
        let spawned = std::thread::Builder::new()
            .name("progress".to_owned())
            .spawn(move || write_all(&file, &receiver));
        if let Err(error) = &spawned {
            tracing::warn!("the experiment could not go on after this process: {error}");
        }
        Self { core, writer: spawned.is_ok().then_some(sender), next: Timestamp::default(), last_phase }
    }
}

/// What was kept and how long ago \[s\], infinite where nobody knows; `None` without a file.
fn read(path: &Path) -> Option<(String, f64)> {
    use std::io::Read as _;
    let file = match std::fs::File::open(path) {
        Ok(file) => file,
        Err(error) if error.kind() == std::io::ErrorKind::NotFound => return None,
        // There is something: an experiment had begun.
        Err(_) => return Some((String::new(), f64::INFINITY)),
    };
    let mut text = String::new();
    if file.take(LARGEST).read_to_string(&mut text).is_err() {
        return Some((String::new(), f64::INFINITY));
    }
    let (stamp, kept) = text.split_once('\n').unwrap_or_default();
    let now = Stamp::now();
    let age_s = Stamp::read(stamp).map_or(f64::INFINITY, |then| now.since(&then));
    Some((kept.to_owned(), age_s))
}

fn write_all(path: &Path, texts: &Receiver<String>) {
    let mut well = true;
    for text in texts {
        // Whole or not at all. A loss of power ends the experiment anyway: nothing waits for the disk.
        let text = format!("{}\n{text}", Stamp::now().in_words());
        let written = whorl_files::write_file(path, text);
        if let (true, Err(error)) = (well, &written) {
            tracing::warn!("the experiment could not go on after this process: {}: {error}", path.display());
        }
        well = written.is_ok();
    }
}

/// When something was kept.
struct Stamp {
    boot: String,
    monotonic_s: f64,
    wall_s: f64,
}

impl Stamp {
    fn now() -> Self {
        let boot = std::fs::read_to_string(BOOT).unwrap_or_default().trim().to_owned();
        Self { boot, monotonic_s: monotonic().as_secs_f64(), wall_s: wall_clock().seconds() }
    }

    fn in_words(&self) -> String {
        format!("{} {} {}", self.boot, self.monotonic_s, self.wall_s)
    }

    fn read(text: &str) -> Option<Self> {
        let mut words = text.split(' ');
        let mut word = || words.next();
        let boot = word()?.to_owned();
        Some(Self { boot, monotonic_s: word()?.parse().ok()?, wall_s: word()?.parse().ok()? })
    }

    /// The longer of two: the monotonic clock stands still while a computer sleeps, the time of day may be set back.
    fn since(&self, earlier: &Self) -> f64 {
        let monotonic_s = self.monotonic_s - earlier.monotonic_s;
        let is_same_boot = self.boot == earlier.boot && !self.boot.is_empty() && monotonic_s >= 0.0;
        if is_same_boot { monotonic_s.max(self.wall_s - earlier.wall_s) } else { f64::INFINITY }
    }
}

impl NodeCore for Keeping {
    fn subscriptions(&self) -> Vec<Route> {
        self.core.subscriptions()
    }

    fn publications(&self) -> Vec<Route> {
        self.core.publications()
    }

    fn timer_period(&self) -> Option<Duration> {
        self.core.timer_period()
    }

    fn services(&self) -> &'static [Service] {
        self.core.services()
    }

    fn step(&mut self, now: Timestamp, event: Event<'_>, outputs: &mut Outputs) {
        self.core.step(now, event, outputs);
        let Some(writer) = &self.writer else { return };
        let phase = self.core.phase();
        if (now >= self.next || phase != self.last_phase)
            && let Some(text) = self.core.progress(now)
            // Where the last one is still being written, it is tried again.
            && writer.try_send(text).is_ok()
        {
            self.next = now + EVERY;
            self.last_phase = phase;
        }
    }

    fn finished(&self) -> bool {
        self.core.finished()
    }

    fn failure(&self) -> Option<String> {
        self.core.failure()
    }
}

impl Configurable for Keeping {
    type Parameters = Parameters;

    fn reconfigure(&mut self, parameters: &Parameters) -> Result<(), String> {
        self.core.reconfigure(parameters)
    }
}
