//! Options of a diagnosis, and how far it is.

use whorl_dynamics::PlatformModel;

use crate::Settings;

/// Options of a diagnosis; [`Options::default`] suits most cases.
#[derive(Debug, Clone, PartialEq)]
pub struct Options {
    /// Effects to exclude, by their ids.
    pub exclude: Vec<String>,
    /// 1: everything on one thread; more: on those of the computer. Results do not depend on it.
    pub threads: usize,
    /// Largest number of effects that are named together.
    pub largest_set: usize,
    /// The model with those low-passes that the samples show to delay: [`crate::Diagnosis::delaying`]. `None`: it is found, which takes as long as a fit.
    pub delaying: Option<PlatformModel>,
    /// Numbers that the verdict depends on; there is rarely a reason to change one.
    pub settings: Settings,
}

impl Default for Options {
    fn default() -> Self {
        let settings = Settings::default();
        Self { exclude: Vec::new(), threads: 2, largest_set: 3, delaying: None, settings }
    }
}

/// Progress of a diagnosis.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Progress {
    /// Share done, 0 to 1.
    pub share: f64,
    /// The current step.
    pub doing: &'static str,
}
