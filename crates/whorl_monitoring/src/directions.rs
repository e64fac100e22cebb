//! The directions in which a platform's model can be wrong, and the ways in which effects take them.

use std::collections::BTreeMap;

use nalgebra::Vector3;
use whorl_dynamics::effects::{Clues, Effect, Grouping, Need, ParameterSpec, Part, Role, catalogue};
use whorl_dynamics::{Gyrostat, GyrostatError, MassProperties, ModelPrior, PlatformModel};
use whorl_prediction::Perturbed;

/// Ways of entering with more directions would fit anything.
pub(crate) const MOST_DIRECTIONS: usize = 4;
/// How far a platform is moved along a direction, in units: its torque is linear over that.
pub(crate) const STEP: f64 = 1e-3;
/// A moment of inertia is at least this share of the model's, and at most so many times it: as for the diagnosis. It is no effect.
const MOMENTS: (f64, f64) = (0.2, 11.0);
pub(crate) const MASS_PROPERTIES: &str = "mass_properties";
/// A torque that no effect of the catalogue explains; its usual size, over the background.
const UNKNOWN_TORQUE: &str = "unknown_torque";
const UNMODELLED: f64 = 10.0;

/// A direction. Of a constant of the platform a unit is the deviation of the model's prior, of all else that of the catalogue's.
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
pub(crate) struct Directions {
    pub gyrostat: Gyrostat,
    /// Constants of the platform first.
    pub all: Vec<Direction>,
    pub constants: usize,
    /// Effects, each with the directions that it takes together in one of its ways.
    pub ways: Vec<(&'static str, Vec<usize>)>,
}

impl Directions {
    pub fn of(model: &PlatformModel, prior: &ModelPrior, background_n_m: f64) -> Result<Self, GyrostatError> {
        let gyrostat = Gyrostat::new(model)?;
        // Each with the part that it takes in an effect that may begin.
        let (mut constants, mut others) = (Vec::new(), Vec::new());
        let mass = &model.mass_properties;
        for (i, name) in ["ixx_kg_m2", "iyy_kg_m2", "izz_kg_m2"].into_iter().enumerate() {
            let (origin, scale) = (mass.inertia_b_kg_m2()[(i, i)], prior.inertia_b_kg_m2[(i, i)]);
            let at = |moment: f64| {
                let mut inertia = *mass.inertia_b_kg_m2();
                inertia[(i, i)] = moment;
                let moved = MassProperties::new(inertia, *mass.gravity_offset_b_n_m(), mass.mass_kg());
                Some(PlatformModel { mass_properties: moved.ok()?, ..model.clone() })
            };
            let (named, range) =
                ((MASS_PROPERTIES, name, "kg m^2"), (MOMENTS.0 * origin, MOMENTS.1 * origin));
            let found = || direction(&gyrostat, named, (origin, scale, scale), range, &at);
            constants.extend((scale > 0.0).then(found).flatten().map(|direction| (direction, None)));
        }
        for effect in catalogue().iter().filter(|effect| shows(model, **effect)) {
            let (id, specs) = (effect.info().id, effect.parameters(model));
            let own = model.effects.get(id);
            let value = |of: &ParameterSpec| *own.and_then(|own| own.get(&of.name)).unwrap_or(&of.neutral);
            let given = BTreeMap::from_iter(specs.iter().map(|spec| (spec.name.clone(), value(spec))));
            // What wheels or jets have in common, or a wheel or jet as a whole: one thing breaks at a time.
            let begins = |spec: &ParameterSpec| {
                let is_new = effect.is_base() || own.is_none();
                let is_one = effect.grouping() != Grouping::All || spec.part == Part::Platform;
                is_new && is_one && !spec.known && spec.role == Role::Amplitude
            };
            for spec in specs.iter().filter(|spec| !spec.known) {
                let together = specs.iter().filter(|other| begins(other) && other.part == spec.part).count();
                let part = Some(spec.part).filter(|_| begins(spec) && together <= MOST_DIRECTIONS);
                let is_own = effect.is_base() || own.is_some();
                let of_prior = if is_own { prior.of_parameter(model, *effect, spec) } else { 0.0 };
                let (scale, to) = match (of_prior > 0.0, part) {
                    (true, _) => (of_prior, &mut constants),
                    (false, Some(_)) => (spec.prior_stddev, &mut others),
                    (false, None) => continue,
                };
                let at = |value: f64| {
                    let (mut moved, mut values) = (model.clone(), given.clone());
                    values.insert(spec.name.clone(), spec.limited(value));
                    moved.effects.insert(id.to_owned(), values);
                    Some(moved)
                };
                let (sizes, named) = ((value(spec), scale, spec.prior_stddev), (id, &*spec.name, spec.unit));
                let found = direction(&gyrostat, named, sizes, (spec.min, spec.max), &at);
                to.extend(found.map(|direction| (direction, part)));
            }
        }
        let scale = UNMODELLED * background_n_m;
        for (axis, name) in ["torque_x", "torque_y", "torque_z"].into_iter().enumerate() {
            let moved = Perturbed::pushed(&gyrostat, Vector3::ith(axis, scale));
            let (effect, parameter, unit, origin) = (UNKNOWN_TORQUE, name.to_owned(), "N m", 0.0);
            let range = (f64::NEG_INFINITY, f64::INFINITY);
            let torque = Direction { effect, parameter, unit, origin, scale, stddev: 1.0, range, moved };
            others.push((torque, Some(Part::Platform)));
        }
        let count = constants.len();
        let mut ways: BTreeMap<(&str, Part), Vec<usize>> = BTreeMap::new();
        for (k, (direction, part)) in constants.iter().chain(&others).enumerate() {
            part.iter().for_each(|part| ways.entry((direction.effect, *part)).or_default().push(k));
        }
        let all = constants.into_iter().chain(others).map(|(direction, _)| direction).collect();
        let ways = ways.into_iter().map(|((effect, _), way)| (effect, way)).collect();
        Ok(Self { gyrostat, all, constants: count, ways })
    }
}

/// Whether gyro and wheels with known torques show an effect on a free platform. Those with hidden states are left out: what they do
/// depends on a past that nobody has measured; and so are those whose search needs a shape to start from (a frequency, a power, an angle).
fn shows(model: &PlatformModel, effect: &dyn Effect) -> bool {
    let has = |need: &Need| match need {
        Need::FreeBody | Need::UnclippedGyro => true,
        Need::Jets => !model.jets().is_empty(),
        Need::Wheels | Need::WheelCommands => !model.wheels().is_empty(),
        _ => false,
    };
    effect.evidence().iter().any(|needs| needs.iter().all(has))
        && effect.hidden_states(model) == 0
        && effect.starts(model, &Clues::default()).is_none()
}

/// A direction, if a body can go along it and it shows; of the parameter its origin, change per unit, deviation and range, and the platform with it.
fn direction(
    gyrostat: &Gyrostat,
    (effect, parameter, unit): (&'static str, &str, &'static str),
    (origin, scale, stddev): (f64, f64, f64),
    (min, max): (f64, f64),
    at: &dyn Fn(f64) -> Option<PlatformModel>,
) -> Option<Direction> {
    let range = ((min - origin) / scale, (max - origin) / scale);
    let inside = [STEP, -STEP].into_iter().filter(|units| (range.0..=range.1).contains(units));
    let perturbed =
        |units: f64| Perturbed::new(Gyrostat::new(&at(origin + units * scale)?).ok()?, units, gyrostat);
    let moved = inside.filter_map(perturbed).next()?;
    let (parameter, stddev) = (parameter.to_owned(), (stddev / scale).max(1.0));
    Some(Direction { effect, parameter, unit, origin, scale, stddev, range, moved })
}
