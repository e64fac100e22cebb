//! Gyro and accelerometer that follow the motion only up to their bandwidth.

use super::named::{Named as _, parameters};
use super::{Effect, EffectError, EffectInfo, EffectKind, Evidence, ParameterSpec};
use crate::PlatformModel;

#[derive(Debug)]
pub(super) struct ImuBandwidth;

static INFO: EffectInfo = EffectInfo {
    id: "imu_bandwidth",
    title: "inertial sensors with a low-pass",
    explanation: "A filter or an averaging window in the inertial unit rounds off what is quick: after each jet pulse the gyro comes up late and the accelerometer's answer is smeared, which repeats with the valves' slots and looks like a vibration.",
    equation: "tau dy/dt = x - y, x = rate or specific force; an averaging window of length T counts as tau = T/2 (same delay, a third of the attenuation of slow motion)",
    source: "first-order low-pass, tau = 1/(2 pi bandwidth)",
    kind: EffectKind::Sensor,
    confusable_with: &["imu_latency", "thruster_rise", "vibration_alias"],
    separated_by: "single jet pulses shorter than the time constant: a latency shifts the answer, a low-pass smears it; steps of wheel torque are smeared alike",
    is_passive: false,
};

parameters! {
    Bandwidth(_model: PlatformModel) {
        gyro_s: f64 = ParameterSpec::new("gyro_s", "s", (0.0, 0.5), 0.01, "Added to the time constant of the gyro."),
        accel_s: f64 =
            ParameterSpec::new("accel_s", "s", (0.0, 0.5), 0.01, "Added to the time constant of the accelerometer."),
    }
}

impl Effect for ImuBandwidth {
    fn info(&self) -> &'static EffectInfo {
        &INFO
    }

    /// It is simulated and predicted, and not looked for: a fit takes accelerations as constant within a bin, so that it
    /// cannot tell a low-pass from a clock that is late.
    fn evidence(&self) -> Evidence {
        &[]
    }

    fn parameters(&self, model: &PlatformModel) -> Vec<ParameterSpec> {
        Bandwidth::specs(model)
    }

    fn is_correction(&self) -> bool {
        true
    }

    fn adjust(&self, values: &[f64], model: &mut PlatformModel) -> Result<(), EffectError> {
        let bandwidth = Bandwidth::of(values);
        model.sensors.gyro.errors.time_constant_s += bandwidth.gyro_s;
        model.sensors.accelerometer.errors.time_constant_s += bandwidth.accel_s;
        Ok(())
    }
}
