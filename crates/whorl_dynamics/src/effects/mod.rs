//! The catalogue of physical effects: one effect, one file, four uses.
//!
//! The truth plant simulates with an effect, the model predicts with it, the diagnosis fits it,
//! estimator and controller compensate it, all from the one definition in its file, which also says
//! what else those uses need: the role of each parameter, the data that show the effect, ways to start
//! a search. No other file names an effect by its id (a test reads the sources). To add an effect to the
//! system: write a file beside the others and name it in `register!` below, or without a rebuild as data ([`written`],
//! [`register`]); `docs/adding_an_effect.md`.

mod base;
mod effect;
mod error;
mod named;
mod parameter;
mod registry;
mod search;
mod set;
mod size;
#[cfg(test)]
mod tests;
mod tilted;
pub mod written;

pub use base::BasePrior;
pub use effect::{Effect, EffectInfo, EffectKind, TrueImu};
pub use error::EffectError;
pub use parameter::{ParameterSpec, Part, Regressed, Role};
pub use registry::{RegisterError, catalogue, find, register, register_secret, registered, withdraw};
pub use search::{
    Aid, Clues, Contribution, Direction, Evidence, Grouping, Need, Periodicity, Resonance, Signature, Start,
    Starter, hard_without, untold_without,
};
pub use set::{ActiveEffect, EffectSet, MAX_HIDDEN_STATES, describe, describe_catalogue};
pub use thruster_rise::ThrustLag;
pub use tilt_stop_contact::Touching;
pub(crate) use tilt_stop_contact::{contact_torque_b_n_m, is_clear};

macro_rules! register {
    ($($module:ident::$effect:ident),* $(,)?) => {
        $(mod $module;)*

        /// The effects that are compiled in: torques first, then actuators, sensors and hidden states.
        #[must_use]
        pub fn built_in() -> &'static [&'static dyn Effect] {
            static CATALOGUE: &[&dyn Effect] = &[$(&$module::$effect),*];
            CATALOGUE
        }
    };
}

register! {
    gravity_offset::GravityOffset,
    inertia_products::InertiaProducts,
    bearing_viscous_friction::BearingViscousFriction,
    bearing_coulomb_friction::BearingCoulombFriction,
    air_drag_quadratic::AirDragQuadratic,
    air_drag_power::AirDragPower,
    air_current::AirCurrent,
    air_current_periodic::AirCurrentPeriodic,
    periodic_torque::PeriodicTorque,
    bearing_turbine::BearingTurbine,
    magnetic_torque::MagneticTorque,
    harness_spring::HarnessSpring,
    anisoelastic_sag::AnisoelasticSag,
    mass_shift::MassShift,
    moving_ballast_backlash::MovingBallastBacklash,
    tilt_stop_contact::TiltStopContact,
    earth_rotation::EarthRotation,
    gravity_gradient::GravityGradient,
    thruster_strength::ThrusterStrength,
    thruster_misalignment::ThrusterMisalignment,
    thruster_delay::ThrusterDelay,
    thruster_rise::ThrusterRise,
    thruster_leak::ThrusterLeak,
    thruster_pressure::ThrusterPressure,
    supply_voltage::SupplyVoltage,
    thruster_voltage::ThrusterVoltage,
    wheel_friction::WheelFriction,
    wheel_misalignment::WheelMisalignment,
    wheel_inertia::WheelInertia,
    wheel_imbalance::WheelImbalance,
    wheel_windage::WheelWindage,
    wheel_motor_bias::WheelMotorBias,
    wheel_motor_constant::WheelMotorConstant,
    gimbal_misalignment::GimbalMisalignment,
    gimbal_friction::GimbalFriction,
    rotor_momentum::RotorMomentum,
    gyro_bias::GyroBias,
    gyro_scale::GyroScale,
    gyro_misalignment::GyroMisalignment,
    gyro_temperature::GyroTemperature,
    gyro_g_sensitivity::GyroGSensitivity,
    gyro_saturation::GyroSaturation,
    accel_bias::AccelBias,
    accel_scale::AccelScale,
    accel_lever_arm::AccelLeverArm,
    imu_latency::ImuLatency,
    imu_bandwidth::ImuBandwidth,
    vector_sensor_misalignment::VectorSensorMisalignment,
    vibration_alias::VibrationAlias,
    slosh::Slosh,
    flexible_mode::FlexibleMode,
    winding_cable::WindingCable,
    unmodelled_torque::UnmodelledTorque,
}
