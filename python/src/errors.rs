//! Errors as exceptions, with the words of the command line.

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

/// An error of a library.
pub fn error(error: impl Display) -> PyErr {
    // `{:#}` of an `anyhow::Error` is the whole chain.
    WhorlError::new_err(format!("{error:#}"))
}
