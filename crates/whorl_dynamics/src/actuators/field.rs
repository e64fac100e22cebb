//! One entry of an actuator in parameter files.

use nalgebra::{Unit, Vector3};

/// Where an entry's value is kept.
#[derive(Debug)]
pub enum Slot<'a> {
    /// A number.
    Number(&'a mut f64),
    /// Three numbers along the body axes.
    Vector(&'a mut Vector3<f64>),
    /// A direction in body axes, of length 1.
    Direction(&'a mut Unit<Vector3<f64>>),
}

/// Numbers that an entry may have; all finite.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Allowed {
    /// Every number.
    Any,
    /// Above zero.
    Positive,
    /// Zero or above.
    NonNegative,
    /// From the first to the second.
    Between(f64, f64),
}

/// One entry of an actuator in parameter files: its key, what it means, which values it may have, and where the
/// value is kept.
#[derive(Debug)]
pub struct Field<'a> {
    /// Key below the actuator's own.
    pub key: &'static str,
    /// What it is, without the unit.
    pub doc: &'static str,
    /// Unit, "1" for none.
    pub unit: &'static str,
    /// Which values it may have.
    pub allowed: Allowed,
    /// Default of a number that is left out; `None`: it must be given.
    pub default: Option<f64>,
    /// Whether all members of the group may share one value, given once among the group's defaults.
    pub shared: bool,
    /// The value.
    pub slot: Slot<'a>,
}

impl<'a> Field<'a> {
    /// A number that must be given.
    pub fn number(
        key: &'static str,
        doc: &'static str,
        unit: &'static str,
        allowed: Allowed,
        value: &'a mut f64,
    ) -> Self {
        Self { key, doc, unit, allowed, default: None, shared: false, slot: Slot::Number(value) }
    }

    /// Three numbers that must be given.
    pub fn vector(
        key: &'static str,
        doc: &'static str,
        unit: &'static str,
        value: &'a mut Vector3<f64>,
    ) -> Self {
        let slot = Slot::Vector(value);
        Self { key, doc, unit, allowed: Allowed::Any, default: None, shared: false, slot }
    }

    /// A direction that must be given.
    pub fn direction(key: &'static str, doc: &'static str, value: &'a mut Unit<Vector3<f64>>) -> Self {
        let slot = Slot::Direction(value);
        Self { key, doc, unit: "1", allowed: Allowed::Any, default: None, shared: false, slot }
    }

    /// The same, `default` when it is left out.
    #[must_use]
    pub fn or(self, default: f64) -> Self {
        Self { default: Some(default), ..self }
    }

    /// The same; the members of the group may share one value.
    #[must_use]
    pub fn shared(self) -> Self {
        Self { shared: true, ..self }
    }

    /// What it is, with its unit.
    #[must_use]
    pub fn description(&self) -> String {
        if self.unit == "1" { self.doc.to_owned() } else { format!("{} [{}]", self.doc, self.unit) }
    }
}
