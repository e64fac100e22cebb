//! Effects that correct the platform's own parameters, and their prior.

use nalgebra::Matrix3;

use super::{Effect, ParameterSpec, Part};
use crate::{ModelPrior, PlatformModel};

/// The entry of [`ModelPrior`] that holds the standard deviation of a parameter: the base model of every fit has
/// it, as far as that prior leaves it open.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum BasePrior {
    /// `gravity_offset_b_n_m` along this body axis.
    GravityOffset(usize),
    /// This element of `inertia_b_kg_m2`: row, column.
    Inertia(usize, usize),
    /// `actuators.wheels.spin_inertia` of the parameter's wheel.
    WheelSpinInertia,
    /// `actuators.wheels.axis_rad` of the parameter's wheel.
    WheelAxis,
    /// `actuators.wheels.viscous_friction_n_m_s` of the parameter's wheel.
    WheelViscousFriction,
    /// `actuators.wheels.coulomb_friction_n_m` of the parameter's wheel.
    WheelCoulombFriction,
    /// `actuators.jets.thrust` of the parameter's jet.
    JetThrust,
    /// `actuators.jets.direction_rad` of the parameter's jet.
    JetDirection,
    /// `actuators.jets.opening_delay_s` of all jets alike: the largest of theirs.
    OpeningDelay,
    /// `actuators.jets.closing_delay_s` of all jets alike: the largest of theirs.
    ClosingDelay,
    /// `actuators.control_moment_gyros.rotor_momentum` of the parameter's gyro.
    RotorMomentum,
    /// `actuators.control_moment_gyros.axis_rad` of the parameter's gyro.
    GimbalAxis,
}

impl BasePrior {
    /// The standard deviation of a parameter of `part`; 0 = known exactly.
    #[must_use]
    pub fn stddev(self, prior: &ModelPrior, part: Part) -> f64 {
        let of = |list: &[f64]| part.index().and_then(|j| list.get(j)).copied().unwrap_or(0.0);
        let largest = |list: &[f64]| list.iter().copied().fold(0.0, f64::max);
        match self {
            Self::GravityOffset(axis) => prior.gravity_offset_b_n_m.get(axis).copied().unwrap_or(0.0),
            Self::Inertia(row, column) => prior.inertia_b_kg_m2.get((row, column)).copied().unwrap_or(0.0),
            Self::WheelSpinInertia => of(&prior.actuators.wheels.spin_inertia),
            Self::WheelAxis => of(&prior.actuators.wheels.axis_rad),
            Self::WheelViscousFriction => of(&prior.actuators.wheels.viscous_friction_n_m_s),
            Self::WheelCoulombFriction => of(&prior.actuators.wheels.coulomb_friction_n_m),
            Self::JetThrust => of(&prior.actuators.jets.thrust),
            Self::JetDirection => of(&prior.actuators.jets.direction_rad),
            Self::OpeningDelay => largest(&prior.actuators.jets.opening_delay_s),
            Self::ClosingDelay => largest(&prior.actuators.jets.closing_delay_s),
            Self::RotorMomentum => of(&prior.actuators.control_moment_gyros.rotor_momentum),
            Self::GimbalAxis => of(&prior.actuators.control_moment_gyros.axis_rad),
        }
    }

    /// Enters the standard deviation of a parameter of `part`; nothing where the prior has no place for it.
    pub fn set_stddev(self, prior: &mut ModelPrior, part: Part, stddev: f64) {
        let set = |list: &mut Vec<f64>| {
            if let Some(slot) = part.index().and_then(|j| list.get_mut(j)) {
                *slot = stddev;
            }
        };
        match self {
            Self::GravityOffset(axis) => {
                prior.gravity_offset_b_n_m.get_mut(axis).into_iter().for_each(|slot| *slot = stddev);
            }
            Self::Inertia(row, column) => {
                for at in [(row, column), (column, row)] {
                    prior.inertia_b_kg_m2.get_mut(at).into_iter().for_each(|slot| *slot = stddev);
                }
            }
            Self::WheelSpinInertia => set(&mut prior.actuators.wheels.spin_inertia),
            Self::WheelAxis => set(&mut prior.actuators.wheels.axis_rad),
            Self::WheelViscousFriction => set(&mut prior.actuators.wheels.viscous_friction_n_m_s),
            Self::WheelCoulombFriction => set(&mut prior.actuators.wheels.coulomb_friction_n_m),
            Self::JetThrust => set(&mut prior.actuators.jets.thrust),
            Self::JetDirection => set(&mut prior.actuators.jets.direction_rad),
            Self::OpeningDelay => prior.actuators.jets.opening_delay_s.fill(stddev),
            Self::ClosingDelay => prior.actuators.jets.closing_delay_s.fill(stddev),
            Self::RotorMomentum => set(&mut prior.actuators.control_moment_gyros.rotor_momentum),
            Self::GimbalAxis => set(&mut prior.actuators.control_moment_gyros.axis_rad),
        }
    }

    /// The platform's constant to which a parameter of `part` is added, in the parameter's unit; `None`: the parameter
    /// scales or turns what it corrects.
    #[must_use]
    pub fn constant(self, model: &PlatformModel, part: Part) -> Option<f64> {
        let properties = &model.mass_properties;
        let inertia: &Matrix3<f64> = properties.inertia_b_kg_m2();
        let wheel = || part.index().and_then(|j| model.wheels().get(j));
        match self {
            Self::GravityOffset(axis) => properties.gravity_offset_b_n_m().get(axis).copied(),
            Self::Inertia(row, column) => inertia.get((row, column)).copied(),
            Self::WheelViscousFriction => wheel().map(|wheel| wheel.viscous_friction_n_m_s),
            Self::WheelCoulombFriction => wheel().map(|wheel| wheel.coulomb_friction_n_m),
            Self::WheelSpinInertia
            | Self::WheelAxis
            | Self::JetThrust
            | Self::JetDirection
            | Self::OpeningDelay
            | Self::ClosingDelay
            | Self::RotorMomentum
            | Self::GimbalAxis => None,
        }
    }
}

impl ModelPrior {
    /// Prior standard deviation of an effect's parameter as part of the model: of an effect that the model has, or
    /// of a correction of the platform's own parameters; 0 = it is neither, or known exactly.
    #[must_use]
    pub fn of_parameter(&self, model: &PlatformModel, effect: &dyn Effect, spec: &ParameterSpec) -> f64 {
        let id = effect.info().id;
        if let Some(of_effect) = self.effects.get(id) {
            return of_effect.get(&spec.name).copied().unwrap_or(0.0);
        }
        if model.effects.contains_key(id) {
            return spec.prior_stddev;
        }
        spec.base.map_or(0.0, |base| base.stddev(self, spec.part))
    }
}
