//! Vibration of valves or pumps folded into the band.

use std::f64::consts::TAU;

use nalgebra::Vector3;

use super::named::{Named as _, parameters};
use super::{Clues, Effect, EffectInfo, EffectKind, ParameterSpec, Regressed, Periodicity, Signature, Start, Starter, TrueImu};
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

parameters! {
    Vibration(_model: PlatformModel) {
        gyro_rad_s: Vector3<f64> = GYRO.map(|name| {
            ParameterSpec::new(name, "rad/s", (-0.5, 0.5), 0.01, "Amplitude in this gyro axis.")
                .regressed(Regressed::UnlessZero)
        }),
        accel_m_s2: Vector3<f64> = ACCELEROMETER.map(|name| {
            ParameterSpec::new(name, "m/s^2", (-20.0, 20.0), 0.1, "Amplitude in this accelerometer axis.")
                .regressed(Regressed::UnlessZero)
        }),
        frequency_hz: f64 =
            ParameterSpec::new(FREQUENCY, "Hz", (0.0, 5000.0), 50.0, "Frequency of the vibration itself.")
                .with_neutral(120.0)
                .floating_shape(),
        background: f64 = ParameterSpec::new(
            BACKGROUND,
            "1",
            (0.0, 1.0),
            0.5,
            "Share of the amplitude that is there with all valves shut (1: a pump that always runs).",
        )
        .floating_shape(),
    }
}

const GYRO: [&str; 3] = ["gyro_x_rad_s", "gyro_y_rad_s", "gyro_z_rad_s"];
const ACCELEROMETER: [&str; 3] = ["accel_x_m_s2", "accel_y_m_s2", "accel_z_m_s2"];
const FREQUENCY: &str = "frequency_hz";
const BACKGROUND: &str = "background";

impl Effect for VibrationAlias {
    fn info(&self) -> &'static EffectInfo {
        &INFO
    }

    fn parameters(&self, model: &PlatformModel) -> Vec<ParameterSpec> {
        Vibration::specs(model)
    }

    fn measure_imu(&self, values: &[f64], environment: &Environment<'_>, imu: &mut TrueImu) {
        let vibration = Vibration::of(values);
        let any_open = environment.valve_fraction.iter().copied().fold(0.0, f64::max);
        let share = any_open + (1.0 - any_open) * vibration.background;
        let wave = (TAU * vibration.frequency_hz * environment.time_s).sin() * share;
        imu.angular_velocity_b_rad_s += vibration.gyro_rad_s * wave;
        imu.specific_force_b_m_s2 += vibration.accel_m_s2 * wave;
    }

    fn starts(&self, model: &PlatformModel, clues: &Clues<'_>) -> Option<Vec<Start>> {
        let starter = Starter::new(self, model);
        let start = |hz: f64, background: f64| {
            let origin = starter.at(&[(FREQUENCY, hz), (BACKGROUND, background)]);
            GYRO.into_iter().chain(ACCELEROMETER).map(|name| starter.along(&origin, name)).collect()
        };
        Some(clues.sensor_lines_hz.iter().flat_map(|hz| [start(*hz, 0.0), start(*hz, 1.0)]).collect())
    }

    fn periodicity(&self) -> Option<Periodicity> {
        Some(Periodicity::Sensors)
    }

    fn signature(&self) -> Option<Signature> {
        Some(Signature::SensorLine {
            gyro: GYRO,
            accelerometer: ACCELEROMETER,
            frequency: FREQUENCY,
            background: BACKGROUND,
        })
    }
}
