//! What operators do to numbers and vectors with units and axes.

use super::{At, Axes, Dimension, Form, Parser, Refusal, Step, Typed};

impl Parser<'_> {
    pub(super) fn scalar(&self, of: &Typed, role: &str) -> Result<At, Refusal> {
        match of.form {
            Form::Scalar(at) => Ok(at),
            Form::Vector(..) => {
                let words = self.words(of);
                Err(self.refuse(
                    of.from,
                    format!(
                        "{words} is a vector; {role} is a number (a component {words}.z, or norm({words})?)"
                    ),
                ))
            }
        }
    }

    pub(super) fn vector(&self, of: &Typed, function: &str) -> Result<([At; 3], Option<Axes>), Refusal> {
        match of.form {
            Form::Vector(at, axes) => Ok((at, axes)),
            Form::Scalar(_) => {
                Err(self.refuse(of.from, format!("{} is a number; {function} is of vectors", self.words(of))))
            }
        }
    }

    pub(super) fn is_plain(&self, of: &Typed, role: &str) -> Result<(), Refusal> {
        match of.dimension {
            None | Some(Dimension::NONE) => Ok(()),
            Some(dimension) => Err(self.refuse(
                of.from,
                format!("{} has the unit {dimension}; {role} has none. Divide it by a size, as in x / 0.1 [{dimension}]", self.words(of)),
            )),
        }
    }

    /// The common dimension of what came before and of this.
    pub(super) fn same(&self, before: Option<Dimension>, of: &Typed) -> Result<Option<Dimension>, Refusal> {
        match (before, of.dimension) {
            (Some(a), Some(b)) if a != b => Err(self.refuse(
                of.from,
                format!(
                    "{} has the unit {b}, what stands before it {a}: they cannot be added or compared",
                    self.words(of)
                ),
            )),
            (a, b) => Ok(a.or(b)),
        }
    }

    pub(super) fn joint(&self, a: Option<Axes>, b: Option<Axes>, at: usize) -> Result<Option<Axes>, Refusal> {
        match (a, b) {
            (Some(a), Some(b)) if a != b => Err(self.refuse(
                at,
                "a vector in body axes meets one in world axes; turn one of them with world(v) or body(v)",
            )),
            (a, b) => Ok(a.or(b)),
        }
    }

    pub(super) fn added(&mut self, left: Typed, right: &Typed, adds: bool) -> Result<Typed, Refusal> {
        let dimension = self.same(left.dimension, right)?;
        let step = |a, b| if adds { Step::Sum(a, b) } else { Step::Difference(a, b) };
        let form = match (left.form, right.form) {
            (Form::Scalar(a), Form::Scalar(b)) => Form::Scalar(self.step(step(a, b))?),
            (Form::Vector(a, of_a), Form::Vector(b, of_b)) => {
                let axes = self.joint(of_a, of_b, right.from)?;
                Form::Vector(self.each(a, b, step)?, axes)
            }
            _ => {
                return Err(self.refuse(
                    right.from,
                    format!(
                        "a vector and a number cannot be added: {} and {}",
                        self.words(&left),
                        self.words(right)
                    ),
                ));
            }
        };
        Ok(Typed { form, dimension, from: left.from, to: right.to })
    }

    pub(super) fn each(
        &mut self,
        a: [At; 3],
        b: [At; 3],
        step: impl Fn(At, At) -> Step,
    ) -> Result<[At; 3], Refusal> {
        let mut at = [0; 3];
        for (slot, (a, b)) in at.iter_mut().zip(a.into_iter().zip(b)) {
            *slot = self.step(step(a, b))?;
        }
        Ok(at)
    }

    pub(super) fn multiplied(&mut self, left: Typed, right: &Typed) -> Result<Typed, Refusal> {
        let dimension = left.dimension.zip(right.dimension).map(|(a, b)| a * b);
        let form = match (left.form, right.form) {
            (Form::Scalar(a), Form::Scalar(b)) => Form::Scalar(self.step(Step::Product(a, b))?),
            (Form::Scalar(a), Form::Vector(b, axes)) | (Form::Vector(b, axes), Form::Scalar(a)) => {
                Form::Vector(self.each([a; 3], b, Step::Product)?, axes)
            }
            (Form::Vector(..), Form::Vector(..)) => {
                return Err(
                    self.refuse(right.from, "two vectors side by side: write dot(v, w) or cross(v, w)")
                );
            }
        };
        Ok(Typed { form, dimension, from: left.from, to: right.to })
    }

    pub(super) fn divided(&mut self, left: Typed, right: &Typed) -> Result<Typed, Refusal> {
        let below = self.scalar(right, "a divisor")?;
        let dimension = left.dimension.zip(right.dimension).map(|(a, b)| a / b);
        if right.dimension.is_none() {
            return Err(self.refuse(right.from, "division by zero"));
        }
        let form = match left.form {
            Form::Scalar(a) => Form::Scalar(self.step(Step::Quotient(a, below))?),
            Form::Vector(a, axes) => Form::Vector(self.each(a, [below; 3], Step::Quotient)?, axes),
        };
        Ok(Typed { form, dimension, from: left.from, to: right.to })
    }

    pub(super) fn dot(&mut self, a: [At; 3], b: [At; 3]) -> Result<At, Refusal> {
        let [x, y, z] = self.each(a, b, Step::Product)?;
        let xy = self.step(Step::Sum(x, y))?;
        self.step(Step::Sum(xy, z))
    }
}
