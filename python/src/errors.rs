//! Errors as exceptions, with the words of the command line where it has no options in them.

use std::fmt::Display;

use pyo3::PyErr;
use pyo3::create_exception;
use pyo3::exceptions::PyValueError;

create_exception!(
    whorl,
    WhorlError,
    PyValueError,
    "What is wrong, where, and what is allowed: the words of the `whorl` command."
);

/// An error of a library, with its causes, each once.
pub fn error(error: impl Into<anyhow::Error>) -> PyErr {
    refused(whorl_commands::in_words(&error.into()))
}

/// What is not allowed, in words.
pub fn refused(text: impl Display) -> PyErr {
    WhorlError::new_err(whorl_commands::of_arguments(&text.to_string()))
}
