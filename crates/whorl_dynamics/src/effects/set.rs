//! The effects that a platform has, with their values.

use std::collections::BTreeMap;
use std::fmt::Write as _;
use std::ops::Range;

use nalgebra::{Matrix3, Vector3};
use whorl_math::words::ranked;

use super::{Effect, EffectError, Role, ThrustLag, Touching, TrueImu, catalogue, find};
use crate::{Environment, PlatformModel};

/// Hidden states the integrator holds.
pub const MAX_HIDDEN_STATES: usize = 16;

/// One effect with its values.
#[derive(Debug, Clone)]
pub struct ActiveEffect {
    effect: &'static dyn Effect,
    values: Vec<f64>,
    hidden: Range<usize>,
}

impl ActiveEffect {
    /// The effect.
    #[must_use]
    pub fn effect(&self) -> &'static dyn Effect {
        self.effect
    }

    /// Its values, in the order of [`Effect::parameters`].
    #[must_use]
    pub fn values(&self) -> &[f64] {
        &self.values
    }

    /// Where its hidden states are among those of the set.
    #[must_use]
    pub fn hidden_range(&self) -> Range<usize> {
        self.hidden.clone()
    }

    fn hidden<'h>(&self, hidden: &'h [f64]) -> &'h [f64] {
        hidden.get(self.hidden.clone()).unwrap_or(&[])
    }
}

/// A checked set of effects. Empty by default: the base model.
#[derive(Debug, Clone, Default)]
pub struct EffectSet {
    active: Vec<ActiveEffect>,
    /// Those of them that do something while the platform moves.
    acting: Vec<usize>,
    hidden_states: usize,
}

impl EffectSet {
    /// Reads effect id -> parameter -> value. Parameters that are left out keep their neutral value.
    ///
    /// # Errors
    /// Unknown effect or parameter (with the nearest valid names), value out of its range, too
    /// many hidden states.
    pub fn from_map(
        map: &BTreeMap<String, BTreeMap<String, f64>>,
        model: &PlatformModel,
    ) -> Result<Self, EffectError> {
        let mut set = Self::default();
        for (id, given) in map {
            let effect = find(id).ok_or_else(|| EffectError::UnknownEffect {
                name: id.clone(),
                nearest: ranked(id, catalogue().iter().map(|e| e.info().id), 3),
            })?;
            let specs = effect.parameters(model);
            let mut values: Vec<f64> = specs.iter().map(|spec| spec.neutral).collect();
            for (name, &value) in given {
                let found = specs.iter().zip(&mut values).find(|(spec, _)| spec.name == *name);
                let Some((spec, slot)) = found else {
                    return Err(EffectError::UnknownParameter {
                        effect: effect.info().id,
                        name: name.clone(),
                        nearest: ranked(name, specs.iter().map(|s| s.name.as_str()), 4),
                    });
                };
                if !(value >= spec.min && value <= spec.max) {
                    return Err(EffectError::OutOfRange {
                        effect: effect.info().id,
                        name: name.clone(),
                        value,
                        unit: spec.unit,
                        min: spec.min,
                        max: spec.max,
                    });
                }
                *slot = value;
            }
            set.push(effect, values, model);
        }
        if set.hidden_states > MAX_HIDDEN_STATES {
            return Err(EffectError::TooManyHiddenStates {
                needed: set.hidden_states,
                available: MAX_HIDDEN_STATES,
            });
        }
        Ok(set)
    }

    /// Effects with the values of all their parameters, in the order of [`Effect::parameters`]. Ranges are not
    /// checked: a fit may look beyond them.
    #[must_use]
    pub fn with_values(
        effects: impl IntoIterator<Item = (&'static dyn Effect, Vec<f64>)>,
        model: &PlatformModel,
    ) -> Self {
        let mut set = Self::default();
        for (effect, values) in effects {
            set.push(effect, values, model);
        }
        set
    }

    fn push(&mut self, effect: &'static dyn Effect, values: Vec<f64>, model: &PlatformModel) {
        let first = self.hidden_states;
        self.hidden_states += effect.hidden_states(model);
        let is_neutral = || {
            let specs = effect.parameters(model);
            specs.len() == values.len() && specs.iter().zip(&values).all(|(spec, x)| *x == spec.neutral)
        };
        let has_states = self.hidden_states > first;
        if has_states || !(effect.is_correction() || is_neutral()) {
            self.acting.push(self.active.len());
        }
        self.active.push(ActiveEffect { effect, values, hidden: first..self.hidden_states });
    }

    /// The effects in it.
    pub fn iter(&self) -> impl Iterator<Item = &ActiveEffect> {
        self.active.iter()
    }

    /// Those that do something while the platform moves: neither corrections of its constants, nor neutral.
    fn acting(&self) -> impl Iterator<Item = &ActiveEffect> {
        self.acting.iter().filter_map(|i| self.active.get(*i))
    }

    /// Whether any does something while the platform moves.
    #[must_use]
    pub fn any_acts(&self) -> bool {
        !self.acting.is_empty()
    }

    /// True for the base model.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.active.is_empty()
    }

    /// Number of hidden states of all its effects.
    #[must_use]
    pub fn hidden_states(&self) -> usize {
        self.hidden_states
    }

    /// The platform with every constant that an effect corrects. The map of effects in the result
    /// is empty, so that they cannot be applied twice.
    ///
    /// # Errors
    /// When no such platform can exist.
    pub fn adjusted(&self, model: &PlatformModel) -> Result<PlatformModel, EffectError> {
        let mut adjusted = model.clone();
        adjusted.effects.clear();
        for active in &self.active {
            active.effect.adjust(&active.values, &mut adjusted)?;
        }
        Ok(adjusted)
    }

    /// Sum of [`Effect::torque_b_n_m`].
    #[must_use]
    pub fn torque_b_n_m(&self, environment: &Environment<'_>, hidden: &[f64]) -> Vector3<f64> {
        let torque = |a: &ActiveEffect| a.effect.torque_b_n_m(&a.values, environment, a.hidden(hidden));
        self.acting().map(torque).sum()
    }

    /// Whether any effect is a contact.
    #[must_use]
    pub fn has_contact(&self) -> bool {
        self.contact_tilt_rad().is_some()
    }

    /// Least tilt at which one touches \[rad\]; `None`: none is a contact.
    #[must_use]
    pub fn contact_tilt_rad(&self) -> Option<f64> {
        self.acting().filter_map(|a| a.effect.contact_tilt_rad(&a.values)).min_by(f64::total_cmp)
    }

    /// Torque of the contacts, body axes [N m]; zero: none touches.
    #[must_use]
    pub fn contact_torque_b_n_m(&self, environment: &Environment<'_>) -> Vector3<f64> {
        let environment = Environment { touching: Touching::AsItIs, ..*environment };
        let contacts = self.acting().filter(|a| a.effect.contact_tilt_rad(&a.values).is_some());
        contacts.map(|a| a.effect.torque_b_n_m(&a.values, &environment, &[])).sum()
    }

    /// Sum of [`Effect::reaction_inertia_b_kg_m2`].
    #[must_use]
    pub fn reaction_inertia_b_kg_m2(&self, model: &PlatformModel) -> Matrix3<f64> {
        self.acting().map(|a| a.effect.reaction_inertia_b_kg_m2(&a.values, model)).sum()
    }

    /// [`Effect::add_wheel_torque_n_m`] of every effect.
    pub fn add_wheel_torque_n_m(&self, environment: &Environment<'_>, torque_n_m: &mut [f64]) {
        for a in self.acting() {
            a.effect.add_wheel_torque_n_m(&a.values, environment, torque_n_m);
        }
    }

    /// Sum of [`Effect::gas_rate_kg_s`].
    #[must_use]
    pub fn gas_rate_kg_s(&self, environment: &Environment<'_>) -> f64 {
        self.acting().map(|a| a.effect.gas_rate_kg_s(&a.values, environment)).sum()
    }

    /// Sums of [`Effect::valve_delay_s`].
    #[must_use]
    pub fn valve_delay_s(&self, environment: &Environment<'_>) -> (f64, f64) {
        self.acting().map(|a| a.effect.valve_delay_s(&a.values, environment)).fold(
            (0.0, 0.0),
            |(opening, closing), (more_opening, more_closing)| {
                (opening + more_opening, closing + more_closing)
            },
        )
    }

    /// Product of [`Effect::thrust_factor`].
    #[must_use]
    pub fn thrust_factor(&self, environment: &Environment<'_>) -> f64 {
        self.acting().map(|a| a.effect.thrust_factor(&a.values, environment)).product()
    }

    /// The longest [`Effect::thrust_lag`].
    #[must_use]
    pub fn thrust_lag(&self) -> ThrustLag {
        self.acting().map(|a| a.effect.thrust_lag(&a.values)).fold(ThrustLag::default(), |a, b| ThrustLag {
            rise_s: a.rise_s.max(b.rise_s),
            tail_s: a.tail_s.max(b.tail_s),
            tail_exponent: a.tail_exponent.max(b.tail_exponent),
        })
    }

    /// [`Effect::hidden_derivative`] of every effect.
    pub fn hidden_derivative(&self, environment: &Environment<'_>, hidden: &[f64], derivative: &mut [f64]) {
        for a in self.acting().filter(|a| !a.hidden.is_empty()) {
            if let Some(slots) = derivative.get_mut(a.hidden.clone()) {
                a.effect.hidden_derivative(&a.values, environment, a.hidden(hidden), slots);
            }
        }
    }

    /// [`Effect::hidden_start_stddev`] of every effect.
    #[must_use]
    pub fn hidden_start_stddev(&self, model: &PlatformModel, torque_n_m: f64) -> Vec<f64> {
        let mut stddev = vec![0.0; self.hidden_states];
        for a in self.acting().filter(|a| !a.hidden.is_empty()) {
            if let Some(slots) = stddev.get_mut(a.hidden.clone()) {
                a.effect.hidden_start_stddev(&a.values, model, torque_n_m, slots);
            }
        }
        stddev
    }

    /// [`Effect::hidden_noise`] of every effect.
    pub fn hidden_noise(&self, intensity: &mut [f64]) {
        for a in self.acting().filter(|a| !a.hidden.is_empty()) {
            if let Some(slots) = intensity.get_mut(a.hidden.clone()) {
                a.effect.hidden_noise(&a.values, slots);
            }
        }
    }

    /// [`Effect::torque_walk_b_n_m_sqrt_s`] of all effects, independent of each other.
    #[must_use]
    pub fn torque_walk_b_n_m_sqrt_s(&self) -> Vector3<f64> {
        let squares = self.acting().map(|a| a.effect.torque_walk_b_n_m_sqrt_s(&a.values).map(|x| x * x));
        squares.sum::<Vector3<f64>>().map(f64::sqrt)
    }

    /// [`Effect::measure_imu`] of every effect, in the order of their ids.
    pub fn measure_imu(&self, environment: &Environment<'_>, imu: &mut TrueImu) {
        for a in self.acting() {
            a.effect.measure_imu(&a.values, environment, imu);
        }
    }
}

/// The whole catalogue as text: id, what it is, equation, parameters with unit, range and prior.
#[must_use]
pub fn describe_catalogue(model: &PlatformModel) -> String {
    catalogue().iter().map(|effect| describe(*effect, model)).collect::<Vec<_>>().join("\n")
}

/// One effect as text.
#[must_use]
pub fn describe(effect: &dyn Effect, model: &PlatformModel) -> String {
    let info = effect.info();
    // Writing to a String cannot fail.
    let mut text = String::new();
    let _ = writeln!(text, "{} ({}): {}", info.id, info.kind, info.title);
    let _ = writeln!(text, "  {}", info.explanation);
    let _ = writeln!(text, "  equation: {}", info.equation);
    let _ = writeln!(text, "  source: {}", info.source);
    if !info.confusable_with.is_empty() {
        let _ = writeln!(text, "  easily confused with: {}", info.confusable_with.join(", "));
    }
    if !info.separated_by.is_empty() {
        let _ = writeln!(text, "  told apart by: {}", info.separated_by);
    }
    for spec in effect.parameters(model) {
        let role = match spec.role {
            _ if spec.known => "known",
            Role::Amplitude => "fitted",
            Role::Shape | Role::FloatingShape => "fitted, shape",
        };
        let _ = writeln!(
            text,
            "  - {} [{}] {} .. {}, default {}, prior sigma {} ({role}): {}",
            spec.name, spec.unit, spec.min, spec.max, spec.neutral, spec.prior_stddev, spec.doc
        );
    }
    text
}
