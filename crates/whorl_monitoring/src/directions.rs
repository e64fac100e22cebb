//! The directions in which a platform's model can be wrong, and the ways in which effects take them.

use std::collections::BTreeMap;

use nalgebra::{Matrix3, Vector3};
use whorl_dynamics::effects::{self, Clues, Effect, Grouping, Need, ParameterSpec, Part, Role, catalogue};
use whorl_dynamics::gyrostat::MAX_WHEELS;
use whorl_dynamics::{Gyrostat, GyrostatError, MassProperties, ModelPrior, PlatformModel};
use whorl_prediction::{Difference, InState, Perturbed};

use crate::Settings;

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
pub const UNKNOWN_TORQUE: &str = "unknown_torque";
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
    does: Does,
}

/// What a platform further along a direction does otherwise.
#[derive(Debug, Clone)]
enum Does {
    As(Box<Perturbed>),
    /// A torque on the body, body axes [N m].
    Push(Vector3<f64>),
}

impl Direction {
    /// In a state, per unit.
    pub fn in_state(&self, state: &InState<'_>) -> Difference {
        match &self.does {
            Does::As(perturbed) => perturbed.in_state(state),
            Does::Push(torque_b_n_m) => Difference::Torque(*torque_b_n_m, [0.0; MAX_WHEELS]),
        }
    }
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
    /// Of a platform. Effects with hidden states are left out: what they do depends on a past that nobody has measured.
    pub fn of(model: &PlatformModel, prior: &ModelPrior, settings: &Settings) -> Result<Self, GyrostatError> {
        let gyrostat = Gyrostat::new(model)?;
        let mut found = Self { gyrostat, all: Vec::new(), constants: 0, ways: Vec::new() };
        found.add_moments(model, prior);
        let can_show = |effect: &&dyn Effect| shows(*effect, model);
        let in_model = |effect: &&dyn Effect| model.effects.contains_key(effect.info().id);
        let constant = |effect: &&dyn Effect| effect.is_base() || in_model(effect);
        for effect in catalogue().iter().copied().filter(can_show).filter(constant) {
            let of = Of::new(model, effect);
            for (i, spec) in of.specs.iter().enumerate().filter(|(_, spec)| !spec.known) {
                let stddev = prior.of_parameter(model, effect, spec);
                if stddev > 0.0 {
                    found.add_parameter(&of, i, stddev);
                }
            }
        }
        found.constants = found.all.len();
        let clues = Clues {
            bin_s: settings.bin_s,
            largest_rate_rad_s: LARGEST,
            largest_tilt_rad: LARGEST,
            ..Clues::default()
        };
        for effect in catalogue().iter().copied().filter(can_show) {
            if effect.is_base() || !in_model(&effect) {
                found.add_ways(&Of::new(model, effect), &clues);
            }
        }
        let first = found.all.len();
        let scale = UNMODELLED * settings.background_torque_n_m;
        found.all.extend(["torque_x", "torque_y", "torque_z"].into_iter().enumerate().map(|(axis, name)| {
            Direction {
                effect: UNKNOWN_TORQUE,
                parameter: name.to_owned(),
                unit: "N m",
                origin: 0.0,
                scale,
                stddev: 1.0,
                range: ANY,
                does: Does::Push(Vector3::ith(axis, scale)),
            }
        }));
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
        let is_it = |d: &Direction| d.effect == of.effect.info().id && d.parameter == spec.name;
        self.all.iter().position(is_it).or_else(|| {
            let (name, moves) = (spec.name.clone(), vec![(index, scale)]);
            let alone = effects::Direction { name, origin: of.given.clone(), moves, squared: false };
            self.add_along(of, &alone, origin, (spec.prior_stddev / scale).max(1.0))
        })
    }

    /// What moves together from a place; the value there that is named, and the deviation that the catalogue gives it, in units.
    fn add_along(
        &mut self,
        of: &Of<'_>,
        direction: &effects::Direction,
        origin: f64,
        stddev: f64,
    ) -> Option<usize> {
        let (first, scale) = *direction.moves.first().filter(|(_, by)| *by != 0.0)?;
        let mut range = ANY;
        for (index, by) in &direction.moves {
            let (spec, from) = (of.specs.get(*index)?, direction.origin.get(*index)?);
            if spec.period.is_none() {
                let (a, b) = ((spec.min - from) / by, (spec.max - from) / by);
                range = (range.0.max(a.min(b)), range.1.min(a.max(b)));
            }
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
            let named = of.specs.iter().zip(&values);
            let named = named.map(|(spec, value)| (spec.name.clone(), spec.limited(*value)));
            let mut moved = of.model.clone();
            moved.effects.insert(of.effect.info().id.to_owned(), named.collect());
            Some(moved)
        };
        let named = (of.effect.info().id, direction.name.clone(), of.specs.get(first)?.unit);
        self.add(named, (origin, scale), stddev, range, &moved)
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
        let does = Does::As(Box::new(inside.filter_map(perturbed).next()?));
        self.all.push(Direction { effect, parameter, unit, origin, scale, stddev, range, does });
        Some(self.all.len() - 1)
    }

    /// The ways in which an effect that is absent may begin: as it says, or every wheel or jet as a whole, all of them, and what
    /// they have in common: one thing breaks at a time.
    fn add_ways(&mut self, of: &Of<'_>, clues: &Clues<'_>) {
        let (id, specs) = (of.effect.info().id, &of.specs);
        if let Some(starts) = of.effect.starts(of.model, clues) {
            for start in starts.into_iter().filter(|start| start.len() <= MOST_DIRECTIONS) {
                let own = start.iter().map(|direction| self.add_along(of, direction, 0.0, 1.0));
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
        if of.effect.grouping() != Grouping::All {
            ways.extend(of_parts);
        }
        for way in ways.into_iter().filter(|way| way.len() <= MOST_DIRECTIONS) {
            let add = |i: &usize| self.add_parameter(of, *i, specs.get(*i)?.prior_stddev);
            // A parameter along which no body can go takes no part.
            let own: Vec<usize> = way.iter().filter_map(add).collect();
            if !own.is_empty() && !self.ways.contains(&(id, own.clone())) {
                self.ways.push((id, own));
            }
        }
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

/// An effect of a platform.
struct Of<'a> {
    model: &'a PlatformModel,
    effect: &'static dyn Effect,
    specs: Vec<ParameterSpec>,
    /// Values: the model's own, else neutral.
    given: Vec<f64>,
}

impl<'a> Of<'a> {
    fn new(model: &'a PlatformModel, effect: &'static dyn Effect) -> Self {
        let (own, specs) = (model.effects.get(effect.info().id), effect.parameters(model));
        let value =
            |spec: &ParameterSpec| own.and_then(|own| own.get(&spec.name)).copied().unwrap_or(spec.neutral);
        Self { model, effect, given: specs.iter().map(value).collect(), specs }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn found() -> (PlatformModel, Directions) {
        let model = PlatformModel::whorl_1_reference();
        let found = Directions::of(&model, &ModelPrior::typical(&model), &Settings::of(&model)).unwrap();
        (model, found)
    }

    fn moved(direction: &Direction) -> &Gyrostat {
        let Does::As(perturbed) = &direction.does else { panic!("{direction:?}") };
        perturbed.gyrostat()
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
