//! The directions in which a platform's model can be wrong, for those who evaluate evidence as data arrive.
//!
//! The columns, their priors and the ways in which effects enter are those of the diagnosis. What a direction changes
//! of a prediction is the difference between the platform moved along it and the platform as it is.

use whorl_dynamics::effects::{Clues, Part, catalogue};
use whorl_dynamics::{Gyrostat, ModelPrior, PlatformModel};

use crate::parameter_space::available::Available;
use crate::parameter_space::ways::{Entry, Ways, whole_parts};
use crate::parameter_space::{Reference, Target};
use crate::{DiagnosisError, Settings};

/// One direction.
#[derive(Debug, Clone)]
pub struct Direction {
    /// The effect, or `mass_properties`.
    pub effect: &'static str,
    /// Its parameter.
    pub parameter: String,
    /// Unit of the parameter, "1" for none.
    pub unit: &'static str,
    /// What it is a parameter of.
    pub part: Part,
    /// Value of the parameter from which the direction starts, in its unit.
    pub origin: f64,
    /// Change of the parameter per unit of the direction, in its unit.
    pub scale: f64,
    /// Prior standard deviation in the base model as it was given, in units; 0 = it is not part of it.
    pub base_stddev: f64,
    /// Prior standard deviation that the catalogue gives it, in units.
    pub catalogue_stddev: f64,
    /// The platform moved along it.
    pub moved: Gyrostat,
    /// By so many units.
    pub units: f64,
}

/// One way in which one effect may be missing: the directions that open together.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Suspect {
    /// The effect.
    pub effect: &'static str,
    /// Indices of its directions.
    pub directions: Vec<usize>,
}

/// All directions of a platform.
#[derive(Debug, Clone)]
pub struct Directions {
    /// The platform as it is.
    pub base: Gyrostat,
    /// All directions; those that nobody can make are left out.
    pub directions: Vec<Direction>,
    /// The ways in which an effect may be missing.
    pub suspects: Vec<Suspect>,
}

/// What is measured while the platform moves, and how it will move.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Measured {
    /// Motor torques of the wheels are known.
    pub wheel_torque: bool,
    /// The platform's temperature.
    pub temperature: bool,
    /// The bus voltage.
    pub voltage: bool,
    /// The time over which readings are averaged \[s\].
    pub bin_s: f64,
    /// Largest rate to expect [rad/s].
    pub largest_rate_rad_s: f64,
    /// Largest tilt to expect \[rad\].
    pub largest_tilt_rad: f64,
}

/// The directions that gyro and wheel speeds of a free platform can show. Effects with states of their own are left
/// out: what they do depends on a past that nobody has measured.
///
/// # Errors
/// When the platform cannot be simulated.
pub fn directions(
    model: &PlatformModel,
    prior: &ModelPrior,
    measured: &Measured,
) -> Result<Directions, DiagnosisError> {
    let reference = Reference::new(model, prior, Settings::default());
    let point = reference.point();
    let base = Gyrostat::new(&reference.model_at(&point)?)?;
    let wheels = !model.wheels().is_empty();
    let available = Available {
        body: true,
        jets: !model.jets().is_empty(),
        wheels,
        wheel_command: wheels && measured.wheel_torque,
        temperature: measured.temperature,
        voltage: measured.voltage,
        sample_s: measured.bin_s,
        // Turns are not counted while it runs.
        ..Available::default()
    };
    let clues = Clues {
        bin_s: measured.bin_s,
        largest_rate_rad_s: measured.largest_rate_rad_s,
        largest_tilt_rad: measured.largest_tilt_rad,
        ..Clues::default()
    };
    let mut found = Directions { base: base.clone(), directions: Vec::new(), suspects: Vec::new() };
    let moved = |entry: &Entry, units: f64| {
        reference.model_at(&entry.moved(&reference, &point, units)).ok().and_then(|m| Gyrostat::new(&m).ok())
    };
    // A direction in which no body can go is none.
    let moved_either = |entry: &Entry| {
        let (low, high) = entry.range(&reference);
        let inside = [STEP, -STEP].into_iter().filter(|units| (low..=high).contains(units));
        inside.filter_map(|units| Some((moved(entry, units)?, units))).next()
    };
    let mut add = |entry: &Entry, effect: &'static str| {
        let (moved, units) = moved_either(entry)?;
        let direction = match entry {
            Entry::Parameter(column) => Direction {
                effect,
                parameter: column.name.clone(),
                unit: column.unit,
                part: column.part,
                origin: reference.given(column),
                scale: column.scale,
                base_stddev: if column.base_stddev > 0.0 {
                    reference.given_stddev(column) / column.scale
                } else {
                    0.0
                },
                catalogue_stddev: column.catalogue_stddev,
                moved,
                units,
            },
            Entry::Direction(of, direction) => {
                let (index, by) = *direction.moves.first()?;
                let spec = of.parameters(model).into_iter().nth(index)?;
                Direction {
                    effect,
                    parameter: direction.name.clone(),
                    unit: spec.unit,
                    part: spec.part,
                    origin: 0.0,
                    scale: by,
                    base_stddev: 0.0,
                    catalogue_stddev: 1.0,
                    moved,
                    units,
                }
            }
        };
        found.directions.push(direction);
        Some(found.directions.len() - 1)
    };
    let mut suspects: Vec<Suspect> = Vec::new();
    let is_moment = |column: &&crate::parameter_space::Column| matches!(column.target, Target::Moment(_));
    for column in reference.base_columns(&available).iter().filter(is_moment) {
        add(&Entry::Parameter(column.clone()), column.group);
    }
    for effect in catalogue().iter().copied() {
        let id = effect.info().id;
        let is_in_model = reference.model.effects.contains_key(id) && !effect.is_base();
        let is_hidden = effect.hidden_states(model) > 0;
        if is_in_model || is_hidden || !available.can_test(effect) {
            continue;
        }
        let ways = Ways::of(&reference, effect, &clues, |entry| moved_either(entry).is_some());
        let places: Vec<Option<usize>> = ways.entries.iter().map(|entry| add(entry, id)).collect();
        let columns: Option<Vec<_>> = ways
            .entries
            .iter()
            .map(|entry| match entry {
                Entry::Parameter(column) => Some(column.clone()),
                Entry::Direction(..) => None,
            })
            .collect();
        let options =
            columns.map_or_else(|| ways.options.clone(), |columns| whole_parts(&ways.options, &columns));
        for option in options {
            let own: Option<Vec<usize>> = option.iter().map(|i| places.get(*i).copied().flatten()).collect();
            suspects.extend(own.map(|directions| Suspect { effect: id, directions }));
        }
    }
    found.suspects = suspects;
    Ok(found)
}

/// How far a platform is moved along a direction, in units: its torque is linear over that.
const STEP: f64 = 1e-3;

#[cfg(test)]
mod tests {
    use super::*;

    /// Thrusts and moments of inertia of a moved platform are those written in its direction.
    #[test]
    fn a_direction_moves_the_constant_that_it_names() {
        let model = PlatformModel::whorl_1_reference();
        let prior = ModelPrior::typical(&model);
        let measured = Measured {
            wheel_torque: true,
            temperature: true,
            voltage: true,
            bin_s: 0.1,
            largest_rate_rad_s: 0.1,
            largest_tilt_rad: 0.1,
        };
        let found = directions(&model, &prior, &measured).unwrap();
        let strength = |name: &str| {
            let is_it = |d: &&Direction| d.effect == "thruster_strength" && d.parameter == name;
            found.directions.iter().find(is_it).unwrap()
        };
        let third = strength("jet_3");
        let (before, after) = (model.jets()[2].thrust_n, third.moved.model().jets()[2].thrust_n);
        assert!((after / before - 1.0 - third.scale * third.units).abs() < 1e-12);
        assert_eq!(third.part, Part::Jet(2));
        assert!(third.base_stddev > 0.0 && strength("all").base_stddev == 0.0);
        let moment = found.directions.iter().find(|d| d.parameter == "izz_kg_m2").unwrap();
        let inertia = moment.moved.model().mass_properties.inertia_b_kg_m2();
        assert!((inertia[(2, 2)] - moment.origin - moment.scale * moment.units).abs() < 1e-9);
        // One suspect for each jet, and nobody who needs an accelerometer.
        let jets = found.suspects.iter().filter(|s| s.effect == "thruster_strength").count();
        assert!(jets > model.jets().len(), "{jets}");
        assert!(!found.suspects.iter().any(|s| s.effect == "accel_bias"));
    }
}
