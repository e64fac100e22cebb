//! The directions in which a platform's model can be wrong, and the ways in which effects take them.

use std::collections::BTreeMap;

use nalgebra::{Matrix3, Vector3};
use whorl_dynamics::effects::{Clues, Effect, Grouping, Need, ParameterSpec, Part, Role, catalogue};
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
/// What no direction is kept from.
const ANY: (f64, f64) = (f64::NEG_INFINITY, f64::INFINITY);
/// Usual size of an unmodelled torque, over the background.
const UNMODELLED: f64 = 10.0;
/// The name of a torque that no effect of the catalogue explains.
const UNKNOWN_TORQUE: &str = "unknown_torque";

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
    /// The platform further along it.
    pub moved: Perturbed,
}

/// All directions that gyro and wheel speeds of a free platform can show.
#[derive(Debug, Clone)]
pub(crate) struct Directions {
    pub gyrostat: Gyrostat,
    /// Constants of the platform first.
    pub all: Vec<Direction>,
    pub constants: usize,
    /// Effects, each with the directions that it takes together in one of its ways. A torque that none of them explains is the last.
    pub ways: Vec<(&'static str, Vec<usize>)>,
}

impl Directions {
    /// Of a platform, with this background torque [N m]. Effects with hidden states are left out: what they do depends on a past that nobody has
    /// measured; and so are those whose search needs a shape to start from (a frequency, a power, an angle).
    pub fn of(model: &PlatformModel, prior: &ModelPrior, background_n_m: f64) -> Result<Self, GyrostatError> {
        let gyrostat = Gyrostat::new(model)?;
        let mut found = Self { gyrostat, all: Vec::new(), constants: 0, ways: Vec::new() };
        found.add_moments(model, prior);
        let in_model = |effect: &dyn Effect| model.effects.contains_key(effect.info().id);
        let effects: Vec<Of<'_>> = catalogue().iter().filter_map(|effect| Of::new(model, *effect)).collect();
        for of in effects.iter().filter(|of| of.effect.is_base() || in_model(of.effect)) {
            for (i, spec) in of.specs.iter().enumerate().filter(|(_, spec)| !spec.known) {
                let stddev = prior.of_parameter(model, of.effect, spec);
                if stddev > 0.0 {
                    found.add_parameter(of, i, stddev);
                }
            }
        }
        found.constants = found.all.len();
        for of in effects.iter().filter(|of| of.effect.is_base() || !in_model(of.effect)) {
            found.add_ways(of);
        }
        let first = found.all.len();
        let scale = UNMODELLED * background_n_m;
        for (axis, name) in ["torque_x", "torque_y", "torque_z"].into_iter().enumerate() {
            let moved = Perturbed::pushed(&found.gyrostat, Vector3::ith(axis, scale));
            let (effect, parameter, origin) = (UNKNOWN_TORQUE, name.to_owned(), 0.0);
            let torque =
                Direction { effect, parameter, unit: "N m", origin, scale, stddev: 1.0, range: ANY, moved };
            found.all.push(torque);
        }
        found.ways.push((UNKNOWN_TORQUE, (first..first + 3).collect()));
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

    /// One parameter of an effect by itself; where it is.
    fn add_parameter(&mut self, of: &Of<'_>, index: usize, scale: f64) -> Option<usize> {
        let (spec, origin) = (of.specs.get(index)?, *of.given.get(index)?);
        let id = of.effect.info().id;
        let known = self.all.iter().position(|d| d.effect == id && d.parameter == spec.name);
        known.or_else(|| {
            let range = ((spec.min - origin) / scale, (spec.max - origin) / scale);
            let moved = |units: f64| {
                let mut values = of.given.clone();
                *values.get_mut(index)? = spec.limited(origin + units * scale);
                let named = of.specs.iter().zip(values).map(|(spec, value)| (spec.name.clone(), value));
                let mut moved = of.model.clone();
                moved.effects.insert(id.to_owned(), named.collect());
                Some(moved)
            };
            let stddev = (spec.prior_stddev / scale).max(1.0);
            self.add((id, spec.name.clone(), spec.unit), (origin, scale), stddev, range, &moved)
        })
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
        let moved = inside.filter_map(perturbed).next()?;
        self.all.push(Direction { effect, parameter, unit, origin, scale, stddev, range, moved });
        Some(self.all.len() - 1)
    }

    /// The ways in which an effect may begin: what wheels or jets have in common, and every wheel or jet as a whole: one thing breaks at a time.
    fn add_ways(&mut self, of: &Of<'_>) {
        let mut ways: BTreeMap<Part, Vec<usize>> = BTreeMap::new();
        let fitted =
            of.specs.iter().enumerate().filter(|(_, spec)| !spec.known && spec.role == Role::Amplitude);
        fitted.for_each(|(i, spec)| ways.entry(spec.part).or_default().push(i));
        if of.effect.grouping() == Grouping::All {
            ways.retain(|part, _| *part == Part::Platform);
        }
        for way in ways.into_values().filter(|way| way.len() <= MOST_DIRECTIONS) {
            let add = |i: &usize| self.add_parameter(of, *i, of.specs.get(*i)?.prior_stddev);
            // A parameter along which no body can go takes no part.
            let own: Vec<usize> = way.iter().filter_map(add).collect();
            if !own.is_empty() {
                self.ways.push((of.effect.info().id, own));
            }
        }
    }
}

/// An effect of a platform.
struct Of<'a> {
    model: &'a PlatformModel,
    effect: &'static dyn Effect,
    specs: Vec<ParameterSpec>,
    /// Values: the model's own, else neutral.
    given: Vec<f64>,
}

impl<'a> Of<'a> {
    /// `None` where gyro and wheels with known torques cannot show it on a free platform.
    fn new(model: &'a PlatformModel, effect: &'static dyn Effect) -> Option<Self> {
        let has = |need: &Need| match need {
            Need::FreeBody | Need::UnclippedGyro => true,
            Need::Jets => !model.jets().is_empty(),
            Need::Wheels | Need::WheelCommands => !model.wheels().is_empty(),
            _ => false,
        };
        let shows = effect.evidence().iter().any(|needs| needs.iter().all(has));
        let (own, specs) = (model.effects.get(effect.info().id), effect.parameters(model));
        let value =
            |spec: &ParameterSpec| own.and_then(|own| own.get(&spec.name)).copied().unwrap_or(spec.neutral);
        let given = specs.iter().map(value).collect();
        let is_simple = effect.hidden_states(model) == 0 && effect.starts(model, &Clues::default()).is_none();
        (shows && is_simple).then_some(Self { model, effect, specs, given })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn found() -> (PlatformModel, Directions) {
        let model = PlatformModel::whorl_1_reference();
        let found = Directions::of(&model, &ModelPrior::typical(&model), 1e-3).unwrap();
        (model, found)
    }

    fn moved(direction: &Direction) -> &Gyrostat {
        direction.moved.gyrostat()
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
        let (before, after) = (model.jets()[2].thrust_n, moved(third).model().jets()[2].thrust_n);
        assert!((after / before - 1.0 - third.scale * STEP).abs() < 1e-12);
        let moment = &found.all[place(MASS_PROPERTIES, "izz_kg_m2")];
        let inertia = moved(moment).model().mass_properties.inertia_b_kg_m2()[(2, 2)];
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
        assert_eq!(names("wheel_windage").len(), model.wheels().len());
        let strength = names("thruster_strength");
        assert_eq!(strength[0], ["all"]);
        assert_eq!(strength.len(), 1 + model.jets().len());
        assert!(names("thruster_misalignment").iter().all(|way| way.len() == 2));
        // What needs an accelerometer, hidden states or the timing of valves, or a shape to start from is left out.
        for id in ["accel_bias", "slosh", "thruster_delay", "winding_cable"] {
            assert!(names(id).is_empty(), "{id}");
        }
    }
}
