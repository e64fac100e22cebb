//! Origin of a value, and errors in it.

use std::fmt;
use std::sync::Arc;

use whorl_math::words::shortened;

/// Characters of a key or value that are shown: no right one is longer.
const LONGEST: usize = 200;
/// Characters of what is wrong and allowed: the longest lists of what is allowed have some thousand.
const LONGEST_PROBLEM: usize = 4000;

/// Errors that are shown.
const MOST: usize = 50;

/// Where a parameter's value was given.
#[derive(Debug, Clone, PartialEq, Eq, Hash)]
pub enum Origin {
    /// A line of a parameter file; lines count from 1.
    File {
        /// The file's name as it was given.
        file: Arc<str>,
        /// Line, from 1; 0 = the file as a whole.
        line: usize,
    },
    /// `-p key:=value` on the command line.
    CommandLine,
    /// `ros2 param set` while the node runs.
    RunTime,
    /// Nowhere: the value is missing from this node's parameters.
    Node {
        /// Fully qualified node name.
        node: Arc<str>,
    },
}

impl fmt::Display for Origin {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::File { file, line: 0 } => write!(f, "{file}"),
            Self::File { file, line } => write!(f, "{file}:{line}"),
            Self::CommandLine => write!(f, "command line (-p)"),
            Self::RunTime => write!(f, "parameter set at run time"),
            Self::Node { node } => write!(f, "{node}"),
        }
    }
}

/// One thing wrong with the parameters. Prints as
/// `file:line: key = value: problem and what is allowed`.
#[derive(Debug, Clone, PartialEq, Eq, Hash, thiserror::Error)]
pub struct ParameterError {
    /// Where.
    pub origin: Origin,
    /// The full key with dots, when the error concerns one.
    pub key: Option<String>,
    /// The refused value as it was written, when there is one.
    pub value: Option<String>,
    /// What is wrong and what is allowed.
    pub problem: String,
}

impl ParameterError {
    pub(crate) fn new(origin: Origin, problem: impl Into<String>) -> Self {
        Self { origin, key: None, value: None, problem: problem.into() }
    }

    pub(crate) fn with_key(mut self, key: impl Into<String>) -> Self {
        self.key = Some(key.into());
        self
    }

    pub(crate) fn with_value(mut self, value: impl Into<String>) -> Self {
        self.value = Some(value.into());
        self
    }
}

impl fmt::Display for ParameterError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}: ", self.origin)?;
        let key = self.key.as_deref().map(|key| shortened(key, LONGEST));
        let value = self.value.as_deref().map(|value| shortened(value, LONGEST));
        match (key, value) {
            (Some(key), Some(value)) => write!(f, "{key} = {value}: ")?,
            (Some(key), None) => write!(f, "{key}: ")?,
            (None, Some(value)) => write!(f, "{value}: ")?,
            (None, None) => {}
        }
        write!(f, "{}", shortened(&self.problem, LONGEST_PROBLEM))
    }
}

/// All errors that were found, in the order they were met; prints one per line.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct ParameterErrors(Vec<ParameterError>);

impl ParameterErrors {
    /// `Ok` when the list is empty. Identical errors are kept once.
    pub fn check(errors: Vec<ParameterError>) -> Result<(), Self> {
        if errors.is_empty() {
            return Ok(());
        }
        let mut seen = std::collections::HashSet::new();
        Err(Self(errors.into_iter().filter(|error| seen.insert(error.clone())).collect()))
    }

    /// The errors.
    pub fn iter(&self) -> impl Iterator<Item = &ParameterError> {
        self.0.iter()
    }

    /// How many.
    #[must_use]
    pub fn len(&self) -> usize {
        self.0.len()
    }

    /// Always false for a value returned by this crate.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.0.is_empty()
    }
}

impl From<ParameterError> for ParameterErrors {
    fn from(error: ParameterError) -> Self {
        Self(vec![error])
    }
}

impl fmt::Display for ParameterErrors {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        for (index, error) in self.0.iter().take(MOST).enumerate() {
            if index > 0 {
                writeln!(f)?;
            }
            write!(f, "{error}")?;
        }
        match self.0.len().saturating_sub(MOST) {
            0 => Ok(()),
            more => write!(f, "\nand {more} more errors"),
        }
    }
}

impl std::error::Error for ParameterErrors {}
