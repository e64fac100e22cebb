//! The directions in which a platform's model can be wrong, and the ways in which effects take them.

use std::collections::BTreeMap;

use nalgebra::Matrix3;
use whorl_dynamics::effects::{self, Clues, Effect, Grouping, Need, ParameterSpec, Part, Role, catalogue};
use whorl_dynamics::{Gyrostat, GyrostatError, MassProperties, ModelPrior, PlatformModel};
use whorl_prediction::Perturbed;

/// Ways of entering with more directions would fit anything.
pub(crate) const MOST_DIRECTIONS: usize = 4;
/// How far a platform is moved along a direction, in units: its torque is linear over that.
const STEP: f64 = 1e-3;
/// A moment of inertia is at least this share of the model's, and at most so many times it: as for the diagnosis.
const MOMENTS: (f64, f64) = (0.2, 11.0);
/// The moments of inertia are no effect.
const MASS_PROPERTIES: &str = "mass_properties";
/// How platforms of this kind move at most [rad/s], \[rad\].
const LARGEST: f64 = 0.1;

/// A direction. Of a constant of the platform a unit is the deviation of the model's prior, of all else that of the catalogue's.
#[derive(Debug, Clone)]
pub(crate) struct Direction {
    pub effect: &'static str,
    pub parameter: String,
    /// Unit of the parameter, "1" for none.
    pub unit: &'static str,
    /// Value of the parameter from which the direction starts, and its change per unit.
    pub origin: f64,
    pub scale: f64,
    /// Standard deviation that the catalogue gives it, and what a rig can have of it, in units.
    pub stddev: f64,
    pub range: (f64, f64),
    pub perturbed: Perturbed,
}

/// All directions that gyro and wheel speeds of a free platform can show.
#[derive(Debug, Clone)]
pub(crate) struct Directions {
    pub gyrostat: Gyrostat,
    /// Constants of the platform first.
    pub all: Vec<Direction>,
    pub constants: usize,
    /// Effects, each with the directions that it takes together in one of its ways.
    pub ways: Vec<(&'static str, Vec<usize>)>,
}

impl Directions {
    /// Of a platform. Effects with hidden states are left out: what they do depends on a past that nobody has measured.
    pub fn of(model: &PlatformModel, prior: &ModelPrior, bin_s: f64) -> Result<Self, GyrostatError> {
        let gyrostat = Gyrostat::new(model)?;
        let mut found = Self { gyrostat, all: Vec::new(), constants: 0, ways: Vec::new() };
        found.add_moments(model, prior);
        let can_show = |effect: &&dyn Effect| shows(*effect, model);
        let in_model = |effect: &&dyn Effect| model.effects.contains_key(effect.info().id);
        let constant = |effect: &&dyn Effect| effect.is_base() || in_model(effect);
        for effect in catalogue().iter().copied().filter(can_show).filter(constant) {
            for (i, spec) in effect.parameters(model).iter().enumerate().filter(|(_, spec)| !spec.known) {
                let stddev = prior.of_parameter(model, effect, spec);
                if stddev > 0.0 {
                    found.add_parameter(model, effect, i, spec, stddev);
                }
            }
        }
        found.constants = found.all.len();
        let clues =
            Clues { bin_s, largest_rate_rad_s: LARGEST, largest_tilt_rad: LARGEST, ..Clues::default() };
        for effect in catalogue().iter().copied().filter(can_show) {
            if effect.is_base() || !in_model(&effect) {
                found.add_ways(model, effect, &clues);
            }
        }
        Ok(found)
    }

    fn add_moments(&mut self, model: &PlatformModel, prior: &ModelPrior) {
        let of = &model.mass_properties;
        let inertia = of.inertia_b_kg_m2();
        for (i, name) in ["ixx_kg_m2", "iyy_kg_m2", "izz_kg_m2"].into_iter().enumerate() {
            let (origin, scale) = (inertia[(i, i)], prior.inertia_b_kg_m2[(i, i)]);
            let moved = |units: f64| {
                let mut added = Matrix3::zeros();
                added[(i, i)] = units * scale;
                let moved = MassProperties::new(inertia + added, *of.gravity_offset_b_n_m(), of.mass_kg());
                Some(PlatformModel { mass_properties: moved.ok()?, ..model.clone() })
            };
            let range = ((MOMENTS.0 - 1.0) * origin / scale, (MOMENTS.1 - 1.0) * origin / scale);
            let named = (MASS_PROPERTIES, name.to_owned(), "kg m^2");
            if scale > 0.0 {
                self.add(named, (origin, scale), 1.0, range, &moved);
            }
        }
    }

    /// One parameter of an effect; where it is.
    fn add_parameter(
        &mut self,
        model: &PlatformModel,
        effect: &'static dyn Effect,
        index: usize,
        spec: &ParameterSpec,
        scale: f64,
    ) -> Option<usize> {
        let id = effect.info().id;
        let known = self.all.iter().position(|d| d.effect == id && d.parameter == spec.name);
        if known.is_some() {
            return known;
        }
        let values = given(model, effect);
        let origin = values.get(index).copied()?;
        let moved = |units: f64| {
            let mut values = values.clone();
            *values.get_mut(index)? += units * scale;
            Some(with(model, effect, &values))
        };
        let range = if spec.period.is_some() {
            (f64::NEG_INFINITY, f64::INFINITY)
        } else {
            ((spec.min - origin) / scale, (spec.max - origin) / scale)
        };
        let stddev = (spec.prior_stddev / scale).max(1.0);
        self.add((id, spec.name.clone(), spec.unit), (origin, scale), stddev, range, &moved)
    }

    /// A direction, if a body can go along it and it shows.
    fn add(
        &mut self,
        (effect, parameter, unit): (&'static str, String, &'static str),
        (origin, scale): (f64, f64),
        stddev: f64,
        range: (f64, f64),
        moved: &dyn Fn(f64) -> Option<PlatformModel>,
    ) -> Option<usize> {
        let inside = [STEP, -STEP].into_iter().filter(|units| (range.0..=range.1).contains(units));
        let perturbed =
            |units: f64| Perturbed::new(Gyrostat::new(&moved(units)?).ok()?, units, &self.gyrostat);
        let perturbed = inside.filter_map(perturbed).next()?;
        self.all.push(Direction { effect, parameter, unit, origin, scale, stddev, range, perturbed });
        Some(self.all.len() - 1)
    }

    /// The ways in which an effect that is absent may begin: as it says, or every wheel or jet as a whole, all of them, and what
    /// they have in common: one thing breaks at a time.
    fn add_ways(&mut self, model: &PlatformModel, effect: &'static dyn Effect, clues: &Clues<'_>) {
        let id = effect.info().id;
        let specs = effect.parameters(model);
        if let Some(starts) = effect.starts(model, clues) {
            for start in starts.into_iter().filter(|start| start.len() <= MOST_DIRECTIONS) {
                let own = start.iter().map(|direction| self.add_start(model, effect, &specs, direction));
                if let Some(way) = own.collect::<Option<Vec<_>>>().filter(|way| !way.is_empty()) {
                    self.ways.push((id, way));
                }
            }
            return;
        }
        let mut parts: BTreeMap<Part, Vec<usize>> = BTreeMap::new();
        let fitted = specs.iter().enumerate().filter(|(_, spec)| !spec.known && spec.role == Role::Amplitude);
        fitted.for_each(|(i, spec)| parts.entry(spec.part).or_default().push(i));
        let common = parts.remove(&Part::Platform);
        let of_parts: Vec<Vec<usize>> = parts.into_values().collect();
        let mut ways: Vec<Vec<usize>> = common.into_iter().collect();
        if of_parts.len() > 1 {
            ways.push(of_parts.concat());
        }
        if effect.grouping() != Grouping::All {
            ways.extend(of_parts);
        }
        for way in ways.into_iter().filter(|way| way.len() <= MOST_DIRECTIONS) {
            let mut add = |i: &usize| {
                let spec = specs.get(*i)?;
                let stddev = self.constant_stddev(id, &spec.name).unwrap_or(spec.prior_stddev);
                self.add_parameter(model, effect, *i, spec, stddev)
            };
            // A parameter along which no body can go takes no part.
            let own: Vec<usize> = way.iter().filter_map(&mut add).collect();
            if !own.is_empty() && !self.ways.contains(&(id, own.clone())) {
                self.ways.push((id, own));
            }
        }
    }

    fn constant_stddev(&self, id: &str, parameter: &str) -> Option<f64> {
        let constants = self.all.iter().take(self.constants);
        constants.into_iter().find(|d| d.effect == id && d.parameter == parameter).map(|d| d.scale)
    }

    fn add_start(
        &mut self,
        model: &PlatformModel,
        effect: &'static dyn Effect,
        specs: &[ParameterSpec],
        direction: &effects::Direction,
    ) -> Option<usize> {
        let (first, by) = *direction.moves.first().filter(|(_, by)| *by != 0.0)?;
        let mut range = (f64::NEG_INFINITY, f64::INFINITY);
        for (index, by) in &direction.moves {
            let (spec, from) = (specs.get(*index)?, direction.origin.get(*index)?);
            let (a, b) = ((spec.min - from) / by, (spec.max - from) / by);
            range = (range.0.max(a.min(b)), range.1.min(a.max(b)));
        }
        if direction.squared {
            range = (0.0, range.1.max(0.0).powi(2));
        }
        let moved = |units: f64| {
            let along = if direction.squared { units.max(0.0).sqrt() } else { units };
            let mut values = direction.origin.clone();
            for (index, by) in &direction.moves {
                *values.get_mut(*index)? += along * by;
            }
            Some(with(model, effect, &values))
        };
        let named = (effect.info().id, direction.name.clone(), specs.get(first)?.unit);
        self.add(named, (0.0, by), 1.0, range, &moved)
    }
}

/// Whether gyro and wheels with known torques can show an effect of a free platform.
fn shows(effect: &dyn Effect, model: &PlatformModel) -> bool {
    let has = |need: &Need| match need {
        Need::FreeBody | Need::UnclippedGyro => true,
        Need::Jets => !model.jets().is_empty(),
        Need::Wheels | Need::WheelCommands => !model.wheels().is_empty(),
        _ => false,
    };
    effect.hidden_states(model) == 0 && effect.evidence().iter().any(|needs| needs.iter().all(has))
}

/// Values of an effect: the model's own, else neutral.
fn given(model: &PlatformModel, effect: &dyn Effect) -> Vec<f64> {
    let own = model.effects.get(effect.info().id);
    let value =
        |spec: &ParameterSpec| own.and_then(|own| own.get(&spec.name)).copied().unwrap_or(spec.neutral);
    effect.parameters(model).iter().map(value).collect()
}

/// A platform with these values of an effect.
fn with(model: &PlatformModel, effect: &dyn Effect, values: &[f64]) -> PlatformModel {
    let mut moved = model.clone();
    let specs = effect.parameters(model);
    let named = specs.iter().zip(values).map(|(spec, value)| (spec.name.clone(), spec.limited(*value)));
    moved.effects.insert(effect.info().id.to_owned(), named.collect());
    moved
}

#[cfg(test)]
mod tests {
    use super::*;

    fn found() -> (PlatformModel, Directions) {
        let model = PlatformModel::whorl_1_reference();
        let found = Directions::of(&model, &ModelPrior::typical(&model), 0.2).unwrap();
        (model, found)
    }

    /// Thrusts and moments of inertia of a moved platform are those written in its direction.
    #[test]
    fn a_direction_moves_the_constant_that_it_names() {
        let (model, found) = found();
        let place = |effect: &str, parameter: &str| {
            found.all.iter().position(|d| d.effect == effect && d.parameter == parameter).unwrap()
        };
        let third = place("thruster_strength", "jet_3");
        assert!(third < found.constants && place("thruster_strength", "all") >= found.constants);
        let third = &found.all[third];
        let (before, after) =
            (model.jets()[2].thrust_n, third.perturbed.gyrostat().model().jets()[2].thrust_n);
        assert!((after / before - 1.0 - third.scale * STEP).abs() < 1e-12);
        let moment = &found.all[place(MASS_PROPERTIES, "izz_kg_m2")];
        let inertia = moment.perturbed.gyrostat().model().mass_properties.inertia_b_kg_m2()[(2, 2)];
        assert!((inertia - moment.origin - moment.scale * STEP).abs() < 1e-9);
    }

    #[test]
    fn an_effect_enters_by_whole_wheels_and_jets() {
        let (model, found) = found();
        let names = |id: &str| -> Vec<Vec<&str>> {
            let ways = found.ways.iter().filter(|(effect, _)| *effect == id);
            ways.map(|(_, way)| way.iter().map(|k| found.all[*k].parameter.as_str()).collect()).collect()
        };
        // Wheel by wheel, never one of the two drags alone; all six at once would fit anything.
        let friction = names("wheel_friction");
        assert_eq!(friction.len(), model.wheels().len());
        for (way, wheel) in friction.iter().zip(model.wheels()) {
            let own = [format!("{}_viscous_n_m_s", wheel.name), format!("{}_coulomb_n_m", wheel.name)];
            assert_eq!(*way, own);
        }
        // One parameter a wheel: all together as well.
        assert_eq!(names("wheel_windage").len(), 1 + model.wheels().len());
        let strength = names("thruster_strength");
        assert_eq!(strength[0], ["all"]);
        assert_eq!(strength.len(), 1 + model.jets().len());
        assert!(names("thruster_misalignment").iter().all(|way| way.len() == 2));
        // What needs an accelerometer, hidden states or the timing of valves is left out.
        for id in ["accel_bias", "slosh", "thruster_delay"] {
            assert!(names(id).is_empty(), "{id}");
        }
    }
}
