//! The directions in which a platform's model can be wrong, for those who evaluate evidence as data arrive.
//!
//! The columns, their priors and the ways in which effects enter are those of the diagnosis. What a direction changes
//! of a prediction is the difference between the platform moved along it and the platform as it is.

use whorl_dynamics::effects::Part;
use whorl_dynamics::{Gyrostat, ModelPrior, PlatformModel};

use crate::DiagnosisError;
use crate::explanations::candidates::{Design, whole_parts};
use crate::explanations::lines::Lines;
use crate::parameters::available::Available;
use crate::parameters::{Reference, Target};
use crate::whitening::columns::moved::Moved;
use crate::whitening::mechanics::Mechanics;

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
    let reference = Reference::new(model, prior);
    let point = reference.point();
    let base = Mechanics::new(&reference.model_at(&point)?)?;
    let wheels = !model.wheels().is_empty();
    let available = Available {
        body: true,
        jets: !model.jets().is_empty(),
        wheels,
        wheel_command: wheels && measured.wheel_torque,
        gimbals: false,
        accel: false,
        vector: false,
        temperature: measured.temperature,
        voltage: measured.voltage,
        ballast: false,
        bin_s: measured.bin_s,
        largest_rate_rad_s: measured.largest_rate_rad_s,
        largest_tilt_rad: measured.largest_tilt_rad,
        // Turns are not counted while it runs.
        largest_turn_rad: 0.0,
        clips: false,
    };
    let design = Design::new(&reference, &point, &available, &[], &Lines::default(), false);
    let mut found = Directions { base: base.gyrostat.clone(), directions: Vec::new(), suspects: Vec::new() };
    let mut places = vec![None; design.columns.len()];
    for (column, place) in design.columns.iter().zip(&mut places) {
        // A direction in which no body can go is none.
        let Ok(moved) = Moved::new(&base, &reference, &point, column) else { continue };
        *place = Some(found.directions.len());
        let origin = match column.target {
            Target::Moment(axis) => model.mass_properties.inertia_b_kg_m2()[(axis, axis)],
            Target::Effect(_) => reference.counted_from(&point, column),
        };
        found.directions.push(Direction {
            effect: column.group,
            parameter: column.name.clone(),
            unit: column.unit,
            part: column.part,
            origin,
            scale: column.scale,
            base_stddev: if column.base_stddev > 0.0 {
                reference.given_stddev(column) / column.scale
            } else {
                0.0
            },
            catalogue_stddev: column.catalogue_stddev,
            moved: moved.mechanics.gyrostat,
            // The signal of a column that is squared grows with the square of the units: those of one.
            units: moved.units,
        });
    }
    for candidate in &design.candidates {
        for option in whole_parts(&candidate.options, &design.columns) {
            let own: Option<Vec<usize>> =
                option.iter().map(|column| places.get(*column).copied().flatten()).collect();
            if let Some(directions) = own {
                found.suspects.push(Suspect { effect: candidate.id, directions });
            }
        }
    }
    Ok(found)
}

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
