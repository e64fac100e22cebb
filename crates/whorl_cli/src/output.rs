//! What commands say: words for people, or one JSON value for programs.

use std::fmt::{self, Display};
use std::io::{ErrorKind, Write};
use std::path::{Path, PathBuf};
use std::sync::OnceLock;
use std::sync::atomic::{AtomicBool, Ordering};

use anyhow::Context as _;
use clap::ArgMatches;
use serde::Serialize;
use whorl_commands::runs::write;

/// Stands for the standard output in place of a file.
const STANDARD_OUTPUT: &str = "-";

/// Prints a line for people on the standard output; see [`line`].
macro_rules! say {
    () => { $crate::output::line(format_args!("")) };
    ($($text:tt)*) => { $crate::output::line(format_args!($($text)*)) };
}
pub(crate) use say;

/// Whether the standard output is for JSON alone.
static IS_FOR_JSON: AtomicBool = AtomicBool::new(false);
/// Whether nobody reads the standard output any more.
static IS_CLOSED: AtomicBool = AtomicBool::new(false);
/// Why something could not be written there, such as a full disk.
static FAILED: OnceLock<String> = OnceLock::new();

/// From `--json -` on, no command prints anything else on the standard output.
pub fn reserve(matches: &ArgMatches) {
    let mut of = Some(matches);
    while let Some(matches) = of {
        let json = matches.try_get_one::<PathBuf>(JSON).ok().flatten();
        if json.is_some_and(|path| is_standard_output(path)) {
            IS_FOR_JSON.store(true, Ordering::Relaxed);
        }
        of = matches.subcommand().map(|(_, inner)| inner);
    }
}

/// Prints a line for people. A reader that has gone, as `head` has after ten lines, is no reason to end: files are still
/// to be written, and processes to be watched.
pub fn line(text: fmt::Arguments<'_>) {
    if !IS_FOR_JSON.load(Ordering::Relaxed) {
        put(format_args!("{text}\n"));
    }
}

/// Prints to the standard error, likewise.
pub fn tell(text: impl Display) {
    let _ = writeln!(std::io::stderr(), "{text}");
}

/// Prints text that has its own line ends.
pub fn text(text: &str) {
    if !IS_FOR_JSON.load(Ordering::Relaxed) {
        put(format_args!("{text}"));
    }
}

/// Whether nobody reads the standard output any more.
pub fn is_closed() -> bool {
    IS_CLOSED.load(Ordering::Relaxed)
}

/// What the program has to say of its own output at its end: `None`, unless a part of it is lost.
pub fn failure() -> Option<&'static str> {
    FAILED.get().map(String::as_str)
}

fn put(text: fmt::Arguments<'_>) {
    let mut out = std::io::stdout().lock();
    match out.write_fmt(text).and_then(|()| out.flush()) {
        Ok(()) => {}
        Err(error) if error.kind() == ErrorKind::BrokenPipe => IS_CLOSED.store(true, Ordering::Relaxed),
        Err(error) => {
            let _ = FAILED.set(format!("cannot write to the standard output: {error}"));
        }
    }
}

/// Name of the option, by which [`reserve`] finds it.
const JSON: &str = "json";

/// Where the answer goes for programs.
#[derive(Debug, Clone, Default, clap::Args)]
pub struct JsonArgument {
    /// Writes the answer as JSON; -: to the standard output, and nothing else there.
    #[arg(long = JSON, id = JSON, value_name = "FILE")]
    to: Option<PathBuf>,
}

impl JsonArgument {
    /// Writes the value that `answer` returns, if it was asked for.
    pub fn write<T: Serialize>(&self, answer: impl FnOnce() -> anyhow::Result<T>) -> anyhow::Result<()> {
        let Some(path) = &self.to else { return Ok(()) };
        let text = serde_json::to_string_pretty(&answer()?)?;
        if is_standard_output(path) {
            put(format_args!("{text}\n"));
            return Ok(());
        }
        write(path, &text)
    }

    /// Writes one of many values on a line of its own: after those that the file holds.
    pub fn write_line<T: Serialize>(&self, value: impl FnOnce() -> T) -> anyhow::Result<()> {
        let Some(path) = &self.to else { return Ok(()) };
        let text = serde_json::to_string(&value())?;
        if is_standard_output(path) {
            put(format_args!("{text}\n"));
            return Ok(());
        }
        let file = std::fs::OpenOptions::new().create(true).append(true).open(path);
        file.and_then(|mut file| writeln!(file, "{text}"))
            .with_context(|| format!("cannot write {}", path.display()))
    }

    /// Whether the answer for programs takes the standard output.
    pub fn takes_standard_output(&self) -> bool {
        self.to.as_deref().is_some_and(is_standard_output)
    }
}

fn is_standard_output(path: &Path) -> bool {
    path.as_os_str() == STANDARD_OUTPUT
}
