//! What commands say: words for people, or one JSON value for programs. All of it goes through here: names and cells of files, and
//! texts of anybody on the network, are in it, and a terminal obeys some characters.

use std::borrow::Cow;
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
    let _ = writeln!(std::io::stderr(), "{}", printable(&text.to_string()));
}

/// A text in which every character that steers a terminal, or reverses what is read, is written as JSON writes it: `\u001b`. Ends of
/// lines and tabs stay.
pub fn printable(text: &str) -> Cow<'_, str> {
    if !text.contains(steers) {
        return Cow::Borrowed(text);
    }
    let mut plain = String::with_capacity(text.len() + 16);
    for c in text.chars() {
        if steers(c) {
            plain.push_str(&format!("\\u{:04x}", u32::from(c)));
        } else {
            plain.push(c);
        }
    }
    Cow::Owned(plain)
}

fn steers(c: char) -> bool {
    let is_direction =
        matches!(c, '\u{61c}' | '\u{200e}' | '\u{200f}' | '\u{202a}'..='\u{202e}' | '\u{2066}'..='\u{2069}');
    c.is_control() && !matches!(c, '\n' | '\t')
        || is_direction
        || matches!(c, '\u{2028}' | '\u{2029}' | '\u{feff}')
}

/// Steers the terminal: what others wrote must be [`printable`] in it.
pub fn draw(view: &str) {
    if !IS_FOR_JSON.load(Ordering::Relaxed) {
        put_bytes(view.as_bytes());
    }
}

/// Asks a person on the standard error.
pub fn ask(question: &str) -> std::io::Result<()> {
    let mut terminal = std::io::stderr().lock();
    terminal.write_all(printable(question).as_bytes()).and_then(|()| terminal.flush())
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
    put_bytes(printable(&text.to_string()).as_bytes());
}

fn put_bytes(bytes: &[u8]) {
    let mut out = std::io::stdout().lock();
    match out.write_all(bytes).and_then(|()| out.flush()) {
        Ok(()) => {}
        Err(error) if error.kind() == ErrorKind::BrokenPipe => IS_CLOSED.store(true, Ordering::Relaxed),
        Err(error) => {
            let _ = FAILED.set(format!("cannot write to the standard output: {error}"));
        }
    }
}

/// A path in an answer for programs: JSON is UTF-8, and names of files need not be.
pub fn shown(path: &Path) -> String {
    path.display().to_string()
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
        whorl_files::append_line(path, &text).with_context(|| format!("cannot write {}", path.display()))
    }

    /// Whether the answer for programs takes the standard output.
    pub fn takes_standard_output(&self) -> bool {
        self.to.as_deref().is_some_and(is_standard_output)
    }
}

fn is_standard_output(path: &Path) -> bool {
    path.as_os_str() == STANDARD_OUTPUT
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_steers_a_terminal_is_written_out_and_words_stay_as_they_are() {
        assert!(matches!(printable("\u{c5}ngstr\u{f6}m\t1 \u{2013} 2\nx \u{1f4a5}"), Cow::Borrowed(_)));
        // Clipboard, title, screen, colour; the same with one character; a carriage return that writes over; a reversal.
        let hostile = "\x1b]52;c;cHduZWQ=\x07\x1b]0;T\x07\x1b[2J\x1b[31m\u{9b}2J\r\x08\x7f\u{202e}\u{2028}\0";
        let plain = printable(hostile);
        assert!(plain.starts_with("\\u001b]52;c;cHduZWQ=\\u0007\\u001b]0;T"), "{plain}");
        assert!(plain.ends_with("\\u009b2J\\u000d\\u0008\\u007f\\u202e\\u2028\\u0000"), "{plain}");
        assert!(plain.chars().all(|c| c.is_ascii() && !c.is_control()), "{plain}");
        // In a JSON text it is the same text as before.
        let json = serde_json::to_string(hostile).unwrap();
        assert_eq!(serde_json::from_str::<String>(&printable(&json)).unwrap(), hostile);
    }
}
