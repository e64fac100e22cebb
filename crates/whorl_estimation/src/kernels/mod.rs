//! The filter algorithms, and the table of those that can be chosen.
//!
//! A new one is a file with a [`Kernel`], its name in [`AnyKernel`] and a row in [`FilterKind::ALL`]. The filters of the
//! dissertation that are only compared are in `whorl_reproduce`: [`crate::Estimator`] runs any kernel.

pub(crate) mod attitude_bias;
mod bias_state;
mod free_motion;
mod gyrostat;
mod invariant;
mod iterated;
mod kernel;
mod unscented;

pub use free_motion::FreeMotionKernel;
pub use gyrostat::GyrostatFilter;
pub use invariant::InvariantFilter;
pub use iterated::IteratedFilter;
pub use kernel::{
    DirectionMeasurement, FilterStep, Kernel, KernelStart, Solution, Update, correct_three_components,
};
pub use unscented::UnscentedFilter;

use nalgebra::Vector3;
use std::fmt;

/// Which filter makes the estimate: a row of [`FilterKind::ALL`], or one of another crate with its own kernel.
pub struct FilterKind<K = AnyKernel> {
    /// Name in parameter files.
    pub name: &'static str,
    /// Whether it needs a [`crate::BodyModel`].
    pub needs_body: bool,
    /// Whether it gates its samples itself: then only samples that are not measurements at all are kept from it.
    pub own_gates: bool,
    /// Starts its kernel; `None` for the supervising filter itself.
    pub start: Option<fn(&KernelStart<'_>) -> Option<K>>,
}

/// Delegates to the kernel that runs; nothing is allocated.
macro_rules! any_kernel {
    ($($(#[$doc:meta])* $name:ident($kernel:ty)),+ $(,)?) => {
        /// A kernel of [`FilterKind::ALL`].
        #[derive(Clone, Debug)]
        #[expect(clippy::large_enum_variant, reason = "nothing is allocated while it runs")]
        pub enum AnyKernel {
            $($(#[$doc])* $name($kernel)),+
        }

        impl Kernel for AnyKernel {
            fn step(&mut self, step: &FilterStep) -> Update {
                match self { $(Self::$name(kernel) => kernel.step(step)),+ }
            }

            fn takes_raw_force(&self) -> bool {
                match self { $(Self::$name(kernel) => kernel.takes_raw_force()),+ }
            }

            fn correct_direction(&mut self, measured: &DirectionMeasurement) -> Update {
                match self {
                    $(Self::$name(kernel) => kernel.correct_direction(measured)),+
                }
            }

            fn take_raw_vector(&mut self, vector_b: &Vector3<f64>) {
                match self { $(Self::$name(kernel) => kernel.take_raw_vector(vector_b)),+ }
            }

            fn solution(&self) -> Solution {
                match self { $(Self::$name(kernel) => kernel.solution()),+ }
            }
        }
    };
}

any_kernel! {
    /// Of [`FilterKind::GYROSTAT`].
    Gyrostat(GyrostatFilter),
    /// Of [`FilterKind::ITERATED`].
    Iterated(IteratedFilter),
    /// Of [`FilterKind::UNSCENTED`].
    Unscented(UnscentedFilter),
    /// Of [`FilterKind::INVARIANT`].
    Invariant(InvariantFilter),
    /// Of [`FilterKind::FREE_MOTION`].
    FreeMotion(FreeMotionKernel),
}

impl FilterKind {
    /// Attitude error and gyro bias (dissertation 4.5.4): [`crate::AttitudeBiasEstimator`]. Needs no model of the body.
    pub const ATTITUDE_BIAS: Self =
        Self { name: "attitude_bias", needs_body: false, own_gates: false, start: None };
    /// Attitude error, momentum, gyro bias, torque and accelerometer bias of a gyrostat: [`GyrostatFilter`] (4.5.3 with
    /// wheels).
    pub const GYROSTAT: Self = Self {
        name: "gyrostat",
        needs_body: true,
        own_gates: false,
        start: Some(|s| GyrostatFilter::new(s.parameters, s.body?, s.solution).map(AnyKernel::Gyrostat)),
    };
    /// Attitude error and gyro bias, iterated update: [`IteratedFilter`].
    pub const ITERATED: Self = Self {
        name: "iterated",
        needs_body: false,
        own_gates: false,
        start: Some(|s| Some(AnyKernel::Iterated(IteratedFilter::new(s.parameters, s.solution)))),
    };
    /// Attitude error and gyro bias, sigma points (USQUE): [`UnscentedFilter`].
    pub const UNSCENTED: Self = Self {
        name: "unscented",
        needs_body: false,
        own_gates: false,
        start: Some(|s| Some(AnyKernel::Unscented(UnscentedFilter::new(s.parameters, s.solution)))),
    };
    /// Attitude and gyro bias, equivariant: [`InvariantFilter`].
    pub const INVARIANT: Self = Self {
        name: "invariant",
        needs_body: false,
        own_gates: false,
        start: Some(|s| Some(AnyKernel::Invariant(InvariantFilter::new(s.parameters, s.solution)))),
    };
    /// A sensor that moves freely, the vector sensor its magnetometer: [`FreeMotionKernel`].
    pub const FREE_MOTION: Self = Self {
        name: "free_motion",
        needs_body: false,
        own_gates: true,
        start: Some(|s| Some(AnyKernel::FreeMotion(FreeMotionKernel::new(s.parameters, s.solution)))),
    };

    /// All filters that can be chosen.
    pub const ALL: [Self; 6] = [
        Self::ATTITUDE_BIAS,
        Self::GYROSTAT,
        Self::ITERATED,
        Self::UNSCENTED,
        Self::INVARIANT,
        Self::FREE_MOTION,
    ];

    /// The kind of that name.
    #[must_use]
    pub fn find(name: &str) -> Option<Self> {
        Self::ALL.into_iter().find(|kind| kind.name == name)
    }
}

impl Default for FilterKind {
    fn default() -> Self {
        Self::ATTITUDE_BIAS
    }
}

// Deriving these would require the same traits of the kernel.
impl<K> Clone for FilterKind<K> {
    fn clone(&self) -> Self {
        *self
    }
}

impl<K> Copy for FilterKind<K> {}

impl<K> PartialEq for FilterKind<K> {
    fn eq(&self, other: &Self) -> bool {
        self.name == other.name
    }
}

impl<K> fmt::Debug for FilterKind<K> {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        formatter.write_str(self.name)
    }
}
