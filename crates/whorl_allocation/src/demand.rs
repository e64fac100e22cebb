//! What is asked of the allocation at one instant.

use nalgebra::Vector3;

use crate::effectors::Effectors;
use crate::list::{ListError, check_list};

/// A set of jets, one bit each: bit j is jet j.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct JetMask(pub u32);

impl JetMask {
    /// Every jet.
    pub const ALL: Self = Self(u32::MAX);
    /// No jet.
    pub const NONE: Self = Self(0);

    /// True when jet `jet` is in the set.
    #[must_use]
    pub fn contains(self, jet: usize) -> bool {
        jet < 32 && (self.0 >> jet) & 1 == 1
    }

    /// The set with jet `jet` added.
    #[must_use]
    pub fn with(self, jet: usize) -> Self {
        Self(self.0 | u32::try_from(jet).ok().and_then(|j| 1_u32.checked_shl(j)).unwrap_or(0))
    }

    /// The set with jet `jet` taken out.
    #[must_use]
    pub fn without(self, jet: usize) -> Self {
        Self(self.0 & !Self::NONE.with(jet).0)
    }
}

/// Which effectors may take part.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Mode {
    /// Motors only: jets rest.
    Motors,
    /// Jets only: motors rest.
    Jets,
    /// Jets and motors in one program.
    Both,
}

impl Mode {
    pub(crate) fn uses_jets(self) -> bool {
        self != Self::Motors
    }

    pub(crate) fn uses_motors(self) -> bool {
        self != Self::Jets
    }
}

/// A torque and what may be used for it. Fields are plain; [`crate::Allocator::allocate`] checks
/// them all at every call.
///
/// An effector that the mode leaves out rests at the value nearest to zero within its bounds: a
/// stuck-open jet (bounds 1..1) or a wheel that its speed limit forces to slow down is allowed for
/// in every mode. A jet outside `jet_available` is closed whatever its bounds.
#[derive(Debug, Clone, PartialEq)]
pub struct TorqueDemand {
    /// Torque wanted on the body, body axes [N m].
    pub torque_b_n_m: Vector3<f64>,
    /// Which effectors may take part.
    pub mode: Mode,
    /// Jets that work.
    pub jet_available: JetMask,
    /// Least on-time fraction of each jet, 0..=1.
    pub jet_on_fraction_min: Vec<f64>,
    /// Largest on-time fraction of each jet, 0..=1, not below the least.
    pub jet_on_fraction_max: Vec<f64>,
    /// Least command of each motor at this instant, in its unit; limits of its motion included.
    pub motor_min: Vec<f64>,
    /// Largest command of each motor at this instant, in its unit; limits of its motion included.
    pub motor_max: Vec<f64>,
    /// Command that momentum management would like of each motor, in its unit: for a wheel -k (h - h_target), which
    /// pulls its momentum h to the target.
    pub motor_desired: Vec<f64>,
    /// Price of missing the desired commands, >= 0: a miss by a motor's whole limit costs as
    /// much as `motor_weight / 2` of the thirstiest jet fully open. Jets join in only where that
    /// saves more than their gas costs, so a small miss costs no gas at all.
    pub motor_weight: f64,
    /// Price of net force, >= 0; 0 turns it off. A net force as large as the strongest jet's costs
    /// as much as `net_force_weight / 2` of the thirstiest jet fully open.
    pub net_force_weight: f64,
}

/// Why a demand is invalid.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum TorqueDemandError {
    /// A component of the torque is NaN, infinite or beyond 1e9 N m.
    #[error("torque demand {0:?} N m: must be finite, at most 1e9 N m")]
    Torque([f64; 3]),
    /// A list does not fit.
    #[error(transparent)]
    List(#[from] ListError),
    /// A lower bound above its upper bound.
    #[error("{what} {index}: lower bound {min} above upper bound {max}")]
    Crossed {
        /// "jet" or "motor".
        what: &'static str,
        /// Which one.
        index: usize,
        /// Lower bound.
        min: f64,
        /// Upper bound.
        max: f64,
    },
    /// `net_force_weight` > 0, but the layout has no jet forces.
    #[error("net_force_weight needs jet_force_b_n in the effector layout")]
    NoForces,
}

impl TorqueDemand {
    /// A demand with every effector whole: jets 0..1, motors within their limits, no
    /// preference, no net-force price.
    #[must_use]
    pub fn nominal(effectors: &Effectors, mode: Mode, torque_b_n_m: Vector3<f64>) -> Self {
        let limit = &effectors.layout().motor_limit;
        Self {
            torque_b_n_m,
            mode,
            jet_available: JetMask::ALL,
            jet_on_fraction_min: vec![0.0; effectors.jets()],
            jet_on_fraction_max: vec![1.0; effectors.jets()],
            motor_min: limit.iter().map(|limit| -limit).collect(),
            motor_max: limit.clone(),
            motor_desired: vec![0.0; limit.len()],
            motor_weight: 0.0,
            net_force_weight: 0.0,
        }
    }

    /// Checks every field against the effectors.
    ///
    /// # Errors
    /// [`TorqueDemandError`] naming the first field that is wrong.
    pub fn check(&self, effectors: &Effectors) -> Result<(), TorqueDemandError> {
        if !self.torque_b_n_m.iter().all(|&value| sane(value)) {
            return Err(TorqueDemandError::Torque(self.torque_b_n_m.into()));
        }
        let fraction = |value: f64| (0.0..=1.0).contains(&value);
        for (field, values) in [
            ("jet_on_fraction_min", &self.jet_on_fraction_min),
            ("jet_on_fraction_max", &self.jet_on_fraction_max),
        ] {
            check_list(field, values, effectors.jets(), fraction, "0..=1")?;
        }
        for (field, values) in [
            ("motor_min", &self.motor_min),
            ("motor_max", &self.motor_max),
            ("motor_desired", &self.motor_desired),
        ] {
            check_list(field, values, effectors.motors(), sane, "finite, at most 1e9")?;
        }
        check_order("jet", &self.jet_on_fraction_min, &self.jet_on_fraction_max)?;
        check_order("motor", &self.motor_min, &self.motor_max)?;
        let weight = |value: f64| (0.0..=1e6).contains(&value);
        check_list("motor_weight", &[self.motor_weight], 1, weight, "0..=1e6")?;
        check_list("net_force_weight", &[self.net_force_weight], 1, weight, "0..=1e6")?;
        if self.net_force_weight > 0.0 && effectors.layout().jet_force_b_n.is_none() {
            return Err(TorqueDemandError::NoForces);
        }
        Ok(())
    }
}

/// Finite, and small enough for its square to be.
fn sane(value: f64) -> bool {
    value.abs() <= 1e9
}

fn check_order(what: &'static str, min: &[f64], max: &[f64]) -> Result<(), TorqueDemandError> {
    match min.iter().zip(max).enumerate().find(|(_, (min, max))| min > max) {
        None => Ok(()),
        Some((index, (&min, &max))) => Err(TorqueDemandError::Crossed { what, index, min, max }),
    }
}
