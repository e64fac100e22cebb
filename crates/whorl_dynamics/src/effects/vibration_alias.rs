//! Vibration of valves or pumps folded into the band.

use std::f64::consts::TAU;

use super::parameter::{per_axis, value, vector};
use super::{Effect, EffectInfo, EffectKind, ParameterSpec, TrueImu};
use crate::{Environment, PlatformModel};

#[derive(Debug)]
pub(super) struct VibrationAlias;

static INFO: EffectInfo = EffectInfo {
    id: "vibration_alias",
    title: "aliased vibration",
    explanation: "Vibration above half the sample rate appears as a slow line in the inertial data, only while its source (valves, or a pump that always runs) is on.",
    equation: "y += amplitude sin(2 pi f t) s, s = 1 while a valve is open, else `background`; sampled at the sensor's rate",
    source: "sampling theorem; equipment motion (solenoids, relays) of Schwartz 2004, Table 3.1",
    kind: EffectKind::Sensor,
    confusable_with: &["wheel_imbalance", "flexible_mode"],
    separated_by: "rest with valves shut, then pulses; wheels stopped",
    is_passive: false,
};

impl Effect for VibrationAlias {
    fn info(&self) -> &'static EffectInfo {
        &INFO
    }

    fn parameters(&self, _model: &PlatformModel) -> Vec<ParameterSpec> {
        let mut specs = per_axis("gyro", "_rad_s", "rad/s", 0.5, 0.01, "Amplitude in this gyro axis.");
        specs.extend(per_axis("accel", "_m_s2", "m/s^2", 20.0, 0.1, "Amplitude in this accelerometer axis."));
        specs.push(
            ParameterSpec::new("frequency_hz", "Hz", (0.0, 5000.0), 50.0, "Frequency of the vibration itself.")
                .with_neutral(120.0),
        );
        specs.push(ParameterSpec::new(
            "background",
            "1",
            (0.0, 1.0),
            0.5,
            "Share of the amplitude that is there with all valves shut (1: a pump that always runs).",
        ));
        specs
    }

    fn measure_imu(&self, values: &[f64], environment: &Environment<'_>, imu: &mut TrueImu) {
        let any_open = environment.valve_fraction.iter().copied().fold(0.0, f64::max);
        let share = any_open + (1.0 - any_open) * value(values, 7);
        let wave = (TAU * value(values, 6) * environment.time_s).sin() * share;
        imu.angular_velocity_b_rad_s += vector(values, 0) * wave;
        imu.specific_force_b_m_s2 += vector(values, 3) * wave;
    }
}
