//! Files that somebody else may have prepared: a run directory out of an archive, a folder that others may write to.
//!
//! - [`open_file`] and [`read_text`] read only files, and only so much of them.
//! - [`write_file`] and [`NewFile`] write every file of a run, and every page, table and answer: beside its place under a name
//!   that nobody else has, then renamed. A link that stands in its place is replaced, not followed; a reader sees the old or
//!   the new file; a write that fails leaves the old one.
//! - [`append_line`] adds to a file, if it is one.

mod read;
mod write;

pub use read::{LARGEST_TEXT, open_file, read_text};
pub use write::{NewFile, append_line, write_file};
