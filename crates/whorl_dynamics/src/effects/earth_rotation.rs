//! The rotating Earth under the laboratory.

use std::f64::consts::FRAC_PI_2;

use nalgebra::Vector3;

use super::named::{Named as _, parameters};
use super::{Effect, EffectInfo, EffectKind, Evidence, ParameterSpec, TrueImu};
use crate::{Environment, PlatformModel};

#[derive(Debug)]
pub(super) struct EarthRotation;

/// Sidereal rate of the Earth [rad/s].
const EARTH_RATE_RAD_S: f64 = 7.292_115e-5;

/// Latitude of Blacksburg, Virginia \[rad\] (Schwartz 2004, section 4.3.1: 37.21 degrees north).
const BLACKSBURG_RAD: f64 = 0.649_437;

static INFO: EffectInfo = EffectInfo {
    id: "earth_rotation",
    title: "rotation of the Earth",
    explanation: "The laboratory turns by 15.04 degrees an hour: the gyro reads it, and the gyrostat precesses against the room; with MotionPak-class noise it is below what most runs can show.",
    equation: "I (dw/dt - w x e) + A J dOm/dt + (w + e) x (I (w + e) + A J Om) = g, gyro reads w + e, accelerometer 2 e x (w x r) + e x (e x r) more, e = R^T e_world",
    source: "Schwartz 2004, eqs. 4.16-4.25, with the centrifugal part in the local vertical (plumb line); derived anew for the gyrostat",
    kind: EffectKind::Torque,
    confusable_with: &["gyro_bias"],
    separated_by: "turn the platform: the Earth's rate keeps its direction in the room",
    is_passive: false,
};

parameters! {
    Earth(_model: PlatformModel) {
        scale: f64 = ParameterSpec::new("scale", "1", (0.0, 1.0), 1.0, "1 = the Earth turns, 0 = it does not."),
        latitude_rad: f64 = ParameterSpec::new("latitude_rad", "rad", (-FRAC_PI_2, FRAC_PI_2), 0.01, "Latitude, north positive.")
            .with_neutral(BLACKSBURG_RAD)
            .known(),
    }
}

/// The Earth's rate in body axes [rad/s].
fn rate_b_rad_s(values: &[f64], environment: &Environment<'_>) -> Vector3<f64> {
    let Earth { scale, latitude_rad } = Earth::of(values);
    let rate_rad_s = scale * EARTH_RATE_RAD_S;
    // East-north-up: the axis points north and up.
    environment.to_body(&(Vector3::new(0.0, latitude_rad.cos(), latitude_rad.sin()) * rate_rad_s))
}

impl Effect for EarthRotation {
    fn info(&self) -> &'static EffectInfo {
        &INFO
    }

    fn parameters(&self, model: &PlatformModel) -> Vec<ParameterSpec> {
        Earth::specs(model)
    }

    fn torque_b_n_m(&self, values: &[f64], environment: &Environment<'_>, _hidden: &[f64]) -> Vector3<f64> {
        let model = environment.model;
        let inertia = model.mass_properties.inertia_b_kg_m2();
        let omega = environment.omega_wb_b_rad_s;
        let earth = rate_b_rad_s(values, environment);
        let mut wheel_momentum = Vector3::zeros();
        for (j, wheel) in model.wheels().iter().enumerate() {
            wheel_momentum +=
                wheel.spin_axis_b.into_inner() * (wheel.spin_inertia_kg_m2 * environment.wheel_speed(j));
        }
        // The wheels take their part of I (w x e) themselves: `add_wheel_torque_n_m` below, whose reaction
        // on the body the plant adds.
        inertia * omega.cross(&earth)
            - omega.cross(&(inertia * earth))
            - earth.cross(&(inertia * (omega + earth) + wheel_momentum))
    }

    fn add_wheel_torque_n_m(&self, values: &[f64], environment: &Environment<'_>, torque_n_m: &mut [f64]) {
        // J (a . (dw/dt - w x e) + dOm/dt) = u.
        let frame = environment.omega_wb_b_rad_s.cross(&rate_b_rad_s(values, environment));
        for (torque, wheel) in torque_n_m.iter_mut().zip(environment.model.wheels()) {
            *torque += wheel.spin_inertia_kg_m2 * wheel.spin_axis_b.dot(&frame);
        }
    }

    fn measure_imu(&self, values: &[f64], environment: &Environment<'_>, imu: &mut TrueImu) {
        let earth = rate_b_rad_s(values, environment);
        imu.angular_velocity_b_rad_s += earth;
        // In axes that do not turn, the sensor at r from the pivot accelerates by d(w + e)/dt x r + (w + e) x ((w + e) x r)
        // with de/dt = -w x e; beyond the room's w' x r + w x (w x r) that is Coriolis's 2 e x (w x r), and the
        // centrifugal e x (e x r). That of the pivot itself is in the vertical of the plumb line.
        let arm = environment.model.sensors.accelerometer.lever_arm_b_m;
        let motion = environment.omega_wb_b_rad_s.cross(&arm) * 2.0 + earth.cross(&arm);
        imu.specific_force_b_m_s2 += earth.cross(&motion);
    }

    fn evidence(&self) -> Evidence {
        // Known beforehand.
        &[]
    }
}
