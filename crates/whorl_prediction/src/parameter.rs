//! What is known of a parameter before it is fitted.

/// A parameter of a family of models, counted in a unit of its own from where nothing is known better.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Parameter {
    /// What is known before: its standard deviation about zero; infinite: nothing.
    pub stddev: f64,
    /// Smallest and largest value.
    pub range: (f64, f64),
}
