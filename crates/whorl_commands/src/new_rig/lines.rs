//! Lines of the files that are written, each with where its number is from.

use std::fmt::Write as _;

/// Where a line is from.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Origin {
    /// The data show it.
    Measured,
    /// The file says it: a name, a message's type.
    Stated,
    /// Somebody answered a question.
    Answered,
    /// Nobody said it: a mark for whoever reads the file.
    Assumed,
}

impl Origin {
    /// The word at the start of the comment, and in JSON.
    #[must_use]
    pub fn word(self) -> &'static str {
        match self {
            Self::Measured => "measured",
            Self::Stated => "stated",
            Self::Answered => "as you said",
            Self::Assumed => "assumed",
        }
    }
}

/// A value, where it is from, and in which words.
#[derive(Debug, Clone, PartialEq)]
pub struct Sourced<T> {
    /// The value.
    pub value: T,
    /// Where it is from.
    pub origin: Origin,
    /// How, in words; may be empty.
    pub words: String,
}

impl<T> Sourced<T> {
    /// See the fields.
    pub fn new(value: T, origin: Origin, words: impl Into<String>) -> Self {
        Self { value, origin, words: words.into() }
    }

    /// The comment.
    pub fn comment(&self) -> String {
        comment(self.origin, &self.words)
    }
}

fn comment(origin: Origin, words: &str) -> String {
    if words.is_empty() { origin.word().to_owned() } else { format!("{}: {words}", origin.word()) }
}

/// A line of a file.
#[derive(Debug, Clone, PartialEq)]
pub struct Line {
    /// Without its indentation and comment.
    pub text: String,
    /// Steps of indentation.
    pub depth: usize,
    /// Its origin and the words about it; `None` of a line that only opens a group.
    pub source: Option<(Origin, String)>,
}

/// Lines that become a file.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Lines(pub Vec<Line>);

/// Column at which comments begin, where the line is not longer.
const COMMENT_AT: usize = 60;

impl Lines {
    /// Opens a group.
    pub fn open(&mut self, depth: usize, text: impl Into<String>) {
        self.0.push(Line { text: text.into(), depth, source: None });
    }

    /// Adds a line.
    pub fn add(&mut self, depth: usize, text: impl Into<String>, origin: Origin, words: impl Into<String>) {
        self.0.push(Line { text: text.into(), depth, source: Some((origin, words.into())) });
    }

    /// How many lines nobody vouches for.
    #[must_use]
    pub fn assumed(&self) -> usize {
        let is_assumed = |line: &&Line| matches!(line.source, Some((Origin::Assumed, _)));
        self.0.iter().filter(is_assumed).count()
    }

    /// The file, with some comment lines at its top.
    #[must_use]
    pub fn text(&self, top: &[String]) -> String {
        let mut all = String::new();
        for line in top {
            let _ = writeln!(all, "# {line}");
        }
        for line in &self.0 {
            let own = format!("{}{}", "  ".repeat(line.depth), line.text);
            let _ = match &line.source {
                Some((origin, words)) => {
                    writeln!(all, "{own:<COMMENT_AT$}  # {}", comment(*origin, words))
                }
                None => writeln!(all, "{own}"),
            };
        }
        all
    }
}

/// A name in YAML: as it is where it is plain, else in quotes.
#[must_use]
pub fn quoted(name: &str) -> String {
    let bare = name.strip_prefix('-').unwrap_or(name);
    let plain = bare.chars().next().is_some_and(|c| c.is_ascii_alphabetic() || c == '_')
        && bare.chars().all(|c| c.is_ascii_alphanumeric() || c == '_');
    // Words and letters that YAML takes for something else.
    let reserved = ["y", "n", "yes", "no", "on", "off", "true", "false", "null"];
    if plain && !reserved.contains(&bare.to_lowercase().as_str()) {
        return name.to_owned();
    }
    // What JSON writes for a text, YAML reads: ends of lines and all.
    serde_json::Value::from(name).to_string()
}

/// A number as parameter files have floating-point numbers, to three digits.
#[must_use]
pub fn number(x: f64) -> String {
    let rounded: f64 = format!("{x:.2e}").parse().unwrap_or(x);
    if rounded == 0.0 {
        return "0.0".to_owned();
    }
    let text =
        if !(1e-4..1e6).contains(&rounded.abs()) { format!("{rounded:e}") } else { format!("{rounded}") };
    match text.split_once('e') {
        Some((mantissa, power)) if !mantissa.contains('.') => format!("{mantissa}.0e{power}"),
        Some(_) => text,
        None if text.contains('.') => text,
        None => format!("{text}.0"),
    }
}

/// Numbers in brackets; what is nothing beside the largest is zero.
#[must_use]
pub fn list(numbers: &[f64]) -> String {
    let largest = numbers.iter().fold(0.0, |most: f64, x| most.max(x.abs()));
    let numbers: Vec<f64> = numbers.iter().map(|x| if x.abs() < 1e-6 * largest { 0.0 } else { *x }).collect();
    format!("[{}]", numbers.iter().map(|x| number(*x)).collect::<Vec<_>>().join(", "))
}
