//! What is left of object storage in a program that was built without it.

use std::path::Path;

use crate::{ObjectError, parts};

/// A place in object storage; there is none without the feature `s3`.
#[derive(Debug, Clone)]
// Not an enum itself: what calls it would be warned of what it never reaches.
pub struct Place(Nowhere);

#[derive(Debug, Clone)]
enum Nowhere {}

impl Place {
    /// Refuses.
    ///
    /// # Errors
    /// Always: with the way to build it, or what is wrong with the address.
    pub fn open(path: &Path) -> Result<Self, ObjectError> {
        let address = path.to_string_lossy();
        parts(&address)?;
        Err(ObjectError::NotBuilt(address.into_owned()))
    }

    /// Its address.
    #[must_use]
    pub fn address(&self) -> &str {
        match self.0 {}
    }

    /// A place below this one.
    #[must_use]
    pub fn below(&self, _: &str) -> Self {
        match self.0 {}
    }

    /// The content of an object.
    ///
    /// # Errors
    /// Never called.
    pub fn get(&self, _: &str) -> Result<Option<Vec<u8>>, ObjectError> {
        match self.0 {}
    }

    /// The contents of objects.
    ///
    /// # Errors
    /// Never called.
    pub fn get_all(&self, _: &[String]) -> Result<Vec<Option<Vec<u8>>>, ObjectError> {
        match self.0 {}
    }

    /// Writes an object.
    ///
    /// # Errors
    /// Never called.
    pub fn put(&self, _: &str, _: Vec<u8>) -> Result<(), ObjectError> {
        match self.0 {}
    }

    /// Writes an object unless there is one.
    ///
    /// # Errors
    /// Never called.
    pub fn put_new(&self, _: &str, _: Vec<u8>) -> Result<bool, ObjectError> {
        match self.0 {}
    }

    /// Names of all objects.
    ///
    /// # Errors
    /// Never called.
    pub fn names(&self) -> Result<Vec<String>, ObjectError> {
        match self.0 {}
    }

    /// Copies what is here into a folder.
    ///
    /// # Errors
    /// Never called.
    pub fn fetch(&self, _: &Path) -> Result<usize, ObjectError> {
        match self.0 {}
    }

    /// Copies a folder here.
    ///
    /// # Errors
    /// Never called.
    pub fn publish(&self, _: &Path) -> Result<usize, ObjectError> {
        match self.0 {}
    }
}
