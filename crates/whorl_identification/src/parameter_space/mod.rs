//! The parameters of a fit: the platform's own and those of effects, and the model at their values.

pub(crate) mod available;
pub(crate) mod ways;

use std::collections::BTreeMap;

use nalgebra::Matrix3;
use whorl_dynamics::effects::{Need, ParameterSpec, Part, Role, catalogue, find};
use whorl_dynamics::{Effect, Gyrostat, MassProperties, ModelPrior, PlatformModel};

use crate::DiagnosisError;
use crate::Settings;
use crate::parameter_space::available::Available;

/// Group of the principal moments of inertia, which are no effect.
pub(crate) const MASS_PROPERTIES: &str = "mass_properties";

/// Values of everything that a fit may change.
#[derive(Debug, Clone, Default, PartialEq)]
pub(crate) struct Point {
    /// Added to the moments of inertia [kg m^2].
    pub moments: [f64; 3],
    /// All values of effects that are not neutral.
    pub effects: BTreeMap<&'static str, Vec<f64>>,
}

/// What a column of the regression changes.
#[derive(Debug, Clone, Copy)]
pub(crate) enum Target {
    /// A principal moment of inertia.
    Moment(usize),
    /// An effect.
    Effect(&'static dyn Effect),
}

/// One parameter that a fit may change, and what is known of it before.
#[derive(Debug, Clone)]
pub(crate) struct Column {
    pub group: &'static str,
    pub name: String,
    pub unit: &'static str,
    /// What it is a parameter of.
    pub part: Part,
    pub target: Target,
    /// Its position in the effect, or the axis of a moment of inertia.
    pub index: usize,
    /// What it does to the signal of its effect: the catalogue's prior of what shapes it holds whatever the size of the effect.
    pub role: Role,
    /// Physical size of one unit.
    pub scale: f64,
    /// Prior standard deviation that it has in the base model, in units; 0 = not part of it.
    pub base_stddev: f64,
    /// Prior standard deviation that the catalogue gives it, in units, not below the base model's.
    pub catalogue_stddev: f64,
    /// Range about the reference value, in units.
    pub range: (f64, f64),
    /// Without it the effect's other columns are another effect.
    pub essential: bool,
}

impl Column {
    /// Whether it is the same parameter as another one.
    pub fn is(&self, other: &Self) -> bool {
        (self.group, self.index) == (other.group, other.index)
    }

    /// Whether so many units are as far as it may go.
    pub fn is_at_bound(&self, units: f64) -> bool {
        units <= self.range.0 + 1e-9 || units >= self.range.1 - 1e-9
    }
}

/// Whether an effect corrects the platform's own parameters, which are in every base model within its prior.
pub(crate) fn is_base(id: &str) -> bool {
    find(id).is_some_and(|effect| effect.is_base())
}

/// The effects that correct the platform's own parameters, in the order of their places in its prior.
fn base_effects(model: &PlatformModel) -> Vec<&'static dyn Effect> {
    let mut effects: Vec<_> = catalogue().iter().copied().filter(|effect| effect.is_base()).collect();
    effects.sort_by_key(|effect| effect.parameters(model).iter().filter_map(|spec| spec.base).min());
    effects
}

/// The given model and prior, as reference of every point.
#[derive(Debug, Clone)]
pub(crate) struct Reference {
    pub model: PlatformModel,
    pub prior: ModelPrior,
    pub settings: Settings,
}

impl Reference {
    /// The given values of an effect: the model's own, else neutral.
    pub fn values(&self, effect: &dyn Effect) -> Vec<f64> {
        let given = self.model.effects.get(effect.info().id);
        effect
            .parameters(&self.model)
            .iter()
            .map(|spec| given.and_then(|g| g.get(&spec.name)).copied().unwrap_or(spec.neutral))
            .collect()
    }

    /// The point at which nothing is changed.
    pub fn point(&self) -> Point {
        let of_model = self.model.effects.keys().filter_map(|id| find(id));
        let effects = of_model.map(|effect| (effect.info().id, self.values(effect))).collect();
        Point { effects, ..Point::default() }
    }

    /// Values of an effect at a point.
    pub fn values_at(&self, point: &Point, effect: &dyn Effect) -> Vec<f64> {
        point.effects.get(effect.info().id).cloned().unwrap_or_else(|| self.values(effect))
    }

    /// The platform at a point.
    pub fn model_at(&self, point: &Point) -> Result<PlatformModel, DiagnosisError> {
        let mut model = self.model.clone();
        let properties = &self.model.mass_properties;
        if point.moments != [0.0; 3] {
            let added = Matrix3::from_diagonal(&nalgebra::Vector3::from(point.moments));
            let inertia = properties.inertia_b_kg_m2() + added;
            model.mass_properties =
                MassProperties::new(inertia, *properties.gravity_offset_b_n_m(), properties.mass_kg())
                    .map_err(|error| whorl_dynamics::EffectError::NotPhysical {
                        effect: MASS_PROPERTIES,
                        reason: error.to_string(),
                    })?;
        }
        for (id, values) in &point.effects {
            let Some(effect) = find(id) else { continue };
            // Ranges grow with the platform, so they are those of the platform that was moved.
            let specs = effect.parameters(&model).into_iter().zip(values);
            let map = specs.map(|(spec, value)| (spec.name, value.max(spec.min).min(spec.max))).collect();
            model.effects.insert((*id).to_owned(), map);
        }
        Ok(model)
    }

    /// The same, if there can be such a platform.
    pub fn possible_model_at(&self, point: &Point) -> Option<PlatformModel> {
        self.model_at(point).ok().filter(|model| Gyrostat::new(model).is_ok())
    }

    /// Columns of the base model: moments of inertia, gravity offset, and what the prior leaves open of
    /// wheels and jets, and of effects that the model has. Clamped, only what turns the wheels can be fitted.
    pub fn base_columns(&self, available: &Available) -> Vec<Column> {
        let mut columns = Vec::new();
        let has_body = available.has(Need::FreeBody);
        if has_body {
            let inertia = self.model.mass_properties.inertia_b_kg_m2();
            for (i, name) in ["ixx_kg_m2", "iyy_kg_m2", "izz_kg_m2"].into_iter().enumerate() {
                let stddev = self.prior.inertia_b_kg_m2[(i, i)] * self.settings.prior_margin;
                if stddev > 0.0 {
                    columns.push(Column {
                        group: MASS_PROPERTIES,
                        name: name.to_owned(),
                        unit: "kg m^2",
                        part: Part::Platform,
                        target: Target::Moment(i),
                        index: i,
                        role: Role::Amplitude,
                        scale: stddev,
                        base_stddev: 1.0,
                        catalogue_stddev: 1.0,
                        range: (-0.8 * inertia[(i, i)] / stddev, 10.0 * inertia[(i, i)] / stddev),
                        essential: false,
                    });
                }
            }
        }
        for effect in base_effects(&self.model) {
            if available.can_test(effect) {
                columns.extend(self.parameter_columns(effect));
            }
        }
        if has_body {
            let adopted = self.model.effects.keys().filter_map(|id| find(id));
            columns.extend(adopted.filter(|e| !e.is_base()).flat_map(|e| self.parameter_columns(e)));
        }
        columns
    }

    /// One column for each parameter of an effect that may be fitted.
    pub fn parameter_columns(&self, effect: &'static dyn Effect) -> Vec<Column> {
        let id = effect.info().id;
        let specs = effect.parameters(&self.model);
        let given = self.values(effect);
        specs
            .iter()
            .enumerate()
            .filter(|(_, spec)| !spec.known)
            .map(|(index, spec)| {
                let stddev = self.prior.of_parameter(&self.model, effect, spec) * self.settings.prior_margin;
                let reference = given.get(index).copied().unwrap_or(spec.neutral);
                let scale = if stddev > 0.0 { stddev } else { spec.prior_stddev };
                Column {
                    group: id,
                    name: spec.name.clone(),
                    unit: spec.unit,
                    part: spec.part,
                    target: Target::Effect(effect),
                    index,
                    role: spec.role,
                    scale,
                    base_stddev: if stddev > 0.0 { 1.0 } else { 0.0 },
                    catalogue_stddev: if stddev > 0.0 { (spec.prior_stddev / scale).max(1.0) } else { 1.0 },
                    range: ((spec.min - reference) / scale, (spec.max - reference) / scale),
                    essential: spec.essential,
                }
            })
            .collect()
    }

    /// The effect of a column, and what it says of the parameter.
    pub fn spec(&self, column: &Column) -> Option<(&'static dyn Effect, ParameterSpec)> {
        let Target::Effect(effect) = column.target else { return None };
        Some((effect, effect.parameters(&self.model).into_iter().nth(column.index)?))
    }

    /// Prior standard deviation of a column's parameter as it was given, in its own unit; 0 = none was.
    pub fn given_stddev(&self, column: &Column) -> f64 {
        match self.spec(column) {
            None => self.prior.inertia_b_kg_m2[(column.index, column.index)],
            Some((effect, spec)) => self.prior.of_parameter(&self.model, effect, &spec),
        }
    }

    /// Value of a column's parameter in the given model, in its own unit.
    pub fn given(&self, column: &Column) -> f64 {
        match column.target {
            Target::Moment(axis) => self.model.mass_properties.inertia_b_kg_m2()[(axis, axis)],
            Target::Effect(effect) => self.values(effect).get(column.index).copied().unwrap_or(0.0),
        }
    }

    /// Its value at a point.
    pub fn value_at(&self, point: &Point, column: &Column) -> f64 {
        match column.target {
            Target::Moment(axis) => self.given(column) + point.moments.get(axis).copied().unwrap_or(0.0),
            Target::Effect(effect) => self.values_at(point, effect).get(column.index).copied().unwrap_or(0.0),
        }
    }

    /// How far a point is from the reference along a column, in its units.
    pub fn distance(&self, point: &Point, column: &Column) -> f64 {
        (self.value_at(point, column) - self.given(column)) / column.scale
    }

    /// The point moved along a column by `units`.
    pub fn moved(&self, point: &Point, column: &Column, units: f64) -> Point {
        let mut moved = point.clone();
        let Some((effect, spec)) = self.spec(column) else {
            moved
                .moments
                .iter_mut()
                .skip(column.index)
                .take(1)
                .for_each(|slot| *slot += units * column.scale);
            return moved;
        };
        let mut values = self.values_at(point, effect);
        if let Some(value) = values.get_mut(column.index) {
            *value = spec.limited(*value + units * column.scale);
        }
        moved.effects.insert(effect.info().id, values);
        moved
    }
}
