//! What a caller may choose.

/// Choices of a diagnosis; [`Options::default`] is right for most.
#[derive(Debug, Clone, PartialEq)]
pub struct Options {
    /// Effects that are not to be considered, ids of the catalogue.
    pub exclude: Vec<String>,
    /// Threads used; results do not depend on it.
    pub threads: usize,
    /// Most effects that are named together.
    pub largest_set: usize,
}

impl Default for Options {
    fn default() -> Self {
        Self { exclude: Vec::new(), threads: 2, largest_set: 3 }
    }
}

/// How far a diagnosis is.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Progress {
    /// 0 to 1.
    pub share: f64,
    /// What is being done.
    pub doing: &'static str,
}
