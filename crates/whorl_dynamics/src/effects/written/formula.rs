//! One equation on its own, without parameters: a quantity that is computed of others.

use super::expression::compile;
use super::program::Program;
use super::{Axes, DefinitionError, Dimension, check};
use crate::Environment;

/// A compiled equation over named quantities.
#[derive(Debug, Clone)]
pub struct Formula {
    program: Program,
    dimension: Dimension,
    is_vector: bool,
    axes: Axes,
}

impl Formula {
    /// Compiles an equation, with the grammar of effects.
    ///
    /// # Errors
    /// What is wrong with it, and what is allowed.
    pub fn new(text: &str) -> Result<Self, DefinitionError> {
        let compiled = compile(text, &[], false).map_err(|e| check::located("equation", text, &e))?;
        Ok(Self {
            dimension: compiled.dimension.unwrap_or_default(),
            is_vector: compiled.vector.is_some(),
            axes: compiled.vector.flatten().unwrap_or(Axes::Body),
            program: compiled.program,
        })
    }

    /// Its dimension.
    #[must_use]
    pub fn dimension(&self) -> Dimension {
        self.dimension
    }

    /// Its value where it is a number, else its first component.
    #[must_use]
    pub fn number(&self, environment: &Environment<'_>) -> f64 {
        self.program.evaluate(&[], environment, &[], 0)[0]
    }

    /// Its value in body axes where it is a vector; `None` for a number.
    #[must_use]
    pub fn vector_b(&self, environment: &Environment<'_>) -> Option<nalgebra::Vector3<f64>> {
        let given = nalgebra::Vector3::from(self.program.evaluate(&[], environment, &[], 0));
        let turned = if self.axes == Axes::World { environment.to_body(&given) } else { given };
        self.is_vector.then_some(turned)
    }
}
