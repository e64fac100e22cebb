//! The parameters of a fit: the platform's own and those of effects, and the model at their values.

pub(crate) mod available;
pub(crate) mod ways;

use std::collections::BTreeMap;
use std::ops::Deref;

use whorl_dynamics::effects::{BasePrior, Need, ParameterSpec, Role, catalogue, find};
use whorl_dynamics::{Effect, EffectError, Gyrostat, MassProperties, ModelPrior, PlatformModel};

use crate::parameter_space::available::Available;
use crate::{DiagnosisError, Settings};

/// Group of the principal moments of inertia, which are no effect.
pub(crate) const MASS_PROPERTIES: &str = "mass_properties";

/// Values of everything that a fit may change: all of effects that are not neutral, and the moments of inertia [kg m^2] under
/// [`MASS_PROPERTIES`].
pub(crate) type Point = BTreeMap<&'static str, Vec<f64>>;

/// One parameter that a fit may change, and what is known of it before. It is counted in units, from the given model.
#[derive(Debug, Clone)]
pub(crate) struct Column {
    /// Id of its effect.
    pub group: &'static str,
    /// `None`: it is a moment of inertia.
    pub effect: Option<&'static dyn Effect>,
    /// Its position in the effect, or the axis of a moment of inertia.
    pub index: usize,
    pub spec: ParameterSpec,
    /// Value in the given model, and its prior standard deviation as part of that, in its own unit; 0 = none.
    pub given: f64,
    pub given_stddev: f64,
    /// Physical size of one unit.
    pub scale: f64,
    /// Prior standard deviation that the catalogue gives it, not below the one that it has in a base model, which is 1.
    pub catalogue_stddev: f64,
    pub range: (f64, f64),
}

impl Deref for Column {
    type Target = ParameterSpec;

    fn deref(&self) -> &ParameterSpec {
        &self.spec
    }
}

impl Column {
    /// Of a parameter with this value and prior standard deviation in the given model; `margin`: by which that is widened.
    fn new(
        effect: Option<&'static dyn Effect>,
        (index, spec): (usize, ParameterSpec),
        (given, given_stddev): (f64, f64),
        margin: f64,
    ) -> Self {
        let stddev = given_stddev * margin;
        let scale = if stddev > 0.0 { stddev } else { spec.prior_stddev };
        // What may be anywhere in its range is not near its usual value: a uniform variable's deviation.
        let is_anywhere = spec.role == Role::FloatingShape && (spec.max - spec.min).is_finite();
        let anywhere = if is_anywhere { (spec.max - spec.min) / 12f64.sqrt() } else { 0.0 };
        Self {
            group: effect.map_or(MASS_PROPERTIES, |effect| effect.info().id),
            effect,
            index,
            given,
            given_stddev,
            scale,
            catalogue_stddev: (spec.prior_stddev.max(anywhere) / scale).max(1.0),
            range: ((spec.min - given) / scale, (spec.max - given) / scale),
            spec,
        }
    }

    pub fn is(&self, other: &Self) -> bool {
        (self.group, self.index) == (other.group, other.index)
    }

    /// How far a point is from the given model.
    pub fn units_at(&self, point: &Point) -> f64 {
        (self.value_at(point) - self.given) / self.scale
    }

    /// Its value at a point, in its own unit.
    pub fn value_at(&self, point: &Point) -> f64 {
        let values = point.get(self.group);
        values.and_then(|values| values.get(self.index)).copied().unwrap_or(self.given)
    }
}

/// The given model, from which all is counted.
#[derive(Clone)]
pub(crate) struct Reference {
    pub model: PlatformModel,
    pub prior: ModelPrior,
    pub settings: Settings,
}

impl Reference {
    /// Whether an effect has states of its own, with which a fit takes ten times as long.
    pub fn is_hidden(&self, id: &str) -> bool {
        find(id).is_some_and(|effect| effect.hidden_states(&self.model) > 0)
    }

    /// The given values of an effect: the model's own, else neutral.
    pub fn values(&self, effect: &dyn Effect) -> Vec<f64> {
        let given = self.model.effects.get(effect.info().id);
        let value =
            |spec: ParameterSpec| given.and_then(|g| g.get(&spec.name)).copied().unwrap_or(spec.neutral);
        effect.parameters(&self.model).into_iter().map(value).collect()
    }

    /// The point at which nothing is changed.
    pub fn point(&self) -> Point {
        let of_model = self.model.effects.keys().filter_map(|id| find(id));
        of_model.map(|effect| (effect.info().id, self.values(effect))).collect()
    }

    pub fn model_at(&self, point: &Point) -> Result<PlatformModel, DiagnosisError> {
        let mut model = self.model.clone();
        let properties = &self.model.mass_properties;
        if let Some(moments) = point.get(MASS_PROPERTIES) {
            let mut inertia = *properties.inertia_b_kg_m2();
            moments.iter().enumerate().for_each(|(i, moment)| inertia[(i, i)] = *moment);
            model.mass_properties =
                MassProperties::new(inertia, *properties.gravity_offset_b_n_m(), properties.mass_kg())
                    .map_err(|error| EffectError::NotPhysical {
                        effect: MASS_PROPERTIES,
                        reason: error.to_string(),
                    })?;
        }
        for (id, values) in point {
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

    /// Columns of the base model: moments of inertia, gravity offset, and what the prior leaves open of wheels, jets and effects that the model has.
    /// Clamped, only what turns the wheels can be fitted.
    pub fn base_columns(&self, available: &Available) -> Vec<Column> {
        let has_body = available.has(Need::FreeBody);
        let names = ["ixx_kg_m2", "iyy_kg_m2", "izz_kg_m2"].into_iter().enumerate();
        let moments = names.filter(|_| has_body).map(|(i, name)| {
            let (given, stddev) =
                (self.model.mass_properties.inertia_b_kg_m2()[(i, i)], self.prior.inertia_b_kg_m2[(i, i)]);
            let spec = ParameterSpec::new(name, "kg m^2", (0.2 * given, 11.0 * given), stddev, "")
                .base(BasePrior::Inertia(i, i));
            Column::new(None, (i, spec), (given, stddev), self.settings.prior_margin)
        });
        let mut columns: Vec<Column> = moments.filter(|column| column.given_stddev > 0.0).collect();
        let own = catalogue().iter().copied().filter(|of| of.is_base() && available.can_test(*of));
        let mut own: Vec<&'static dyn Effect> = own.collect();
        // In the order of their places in the prior.
        own.sort_by_key(|effect| effect.parameters(&self.model).iter().filter_map(|spec| spec.base).min());
        let adopted = self.model.effects.keys().filter(|_| has_body).filter_map(|id| find(id));
        let effects = own.into_iter().chain(adopted.filter(|effect| !effect.is_base()));
        columns.extend(effects.flat_map(|effect| self.parameter_columns(effect)));
        columns
    }

    /// One column for each parameter of an effect that may be fitted.
    pub fn parameter_columns(&self, effect: &'static dyn Effect) -> Vec<Column> {
        let specs = effect.parameters(&self.model).into_iter().zip(self.values(effect)).enumerate();
        let column = |(index, (spec, given)): (usize, (ParameterSpec, f64))| {
            let stddev = self.prior.of_parameter(&self.model, effect, &spec);
            Column::new(Some(effect), (index, spec), (given, stddev), self.settings.prior_margin)
        };
        specs.filter(|(_, (spec, _))| !spec.known).map(column).collect()
    }

    pub fn moved(&self, point: &Point, column: &Column, units: f64) -> Point {
        let mut moved = point.clone();
        let inertia = self.model.mass_properties.inertia_b_kg_m2();
        let given =
            || column.effect.map_or_else(|| inertia.diagonal().as_slice().to_vec(), |of| self.values(of));
        let values = moved.entry(column.group).or_insert_with(given);
        if let Some(value) = values.get_mut(column.index) {
            *value = column.spec.limited(*value + units * column.scale);
        }
        moved
    }
}
