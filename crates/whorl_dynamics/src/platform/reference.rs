//! Whorl-I as published, for tests and benches of the crates that build on this one.

use std::collections::BTreeMap;

use nalgebra::{Matrix3, Unit, Vector3};

use super::{
    Accelerometer, BusVoltage, Freedom, Jet, PlatformModel, RateGyro, ScalarSensor, SensorSuite, Tank,
    TiltLimit, TriaxialErrors, VectorSensor, Wheel, WheelSpeedSensor,
};
use crate::MassProperties;
use crate::actuators::Actuators;
use crate::actuators::jets::Jets;
use crate::actuators::wheels::Wheels;

impl PlatformModel {
    /// Whorl-I with the mass properties of Table 4.1 (Schwartz 2004), three orthogonal wheels,
    /// twelve jets in six pairs of pure torque about the body axes and sensors of the MotionPak
    /// class. What the dissertation does not give (wheels, jets, noise) is plausible.
    /// Experiments read their numbers from parameter files instead.
    #[must_use]
    #[expect(clippy::expect_used, reason = "constants, checked by the test below")]
    pub fn whorl_1_reference() -> Self {
        let inertia_b_kg_m2 = Matrix3::new(6.2, -0.9, -0.2, -0.9, 7.5, 0.1, -0.2, 0.1, 12.1);
        let gravity_offset_b_n_m = Vector3::new(-0.02, -0.07, -2.0);
        Self {
            mass_properties: MassProperties::new(inertia_b_kg_m2, gravity_offset_b_n_m, 110.0)
                .expect("Table 4.1 is realisable"),
            freedom: Freedom::OnBearing,
            actuators: Actuators {
                wheels: Wheels(vec![
                    wheel("wheel_x", Vector3::x_axis()),
                    wheel("wheel_y", Vector3::y_axis()),
                    wheel("wheel_z", Vector3::z_axis()),
                ]),
                jets: Jets { list: jets(), tank: tank() },
                ..Actuators::default()
            },
            bus: BusVoltage { initial_v: 25.2, full_v: 25.2, discharge_v_s: 2.0e-4, sag_v_n_m: 0.5 },
            tilt_limit: TiltLimit::Cone { max_rad: 5.0_f64.to_radians() },
            sensors: sensors(),
            effects: BTreeMap::new(),
        }
    }
}

fn tank() -> Tank {
    Tank {
        volume_m3: 0.0045,
        initial_pressure_pa: 2.0e7,
        reference_pressure_pa: 2.0e7,
        thrust_pressure_exponent: 0.0,
        temperature_k: 293.15,
        gas_constant_j_kg_k: 296.8,
        specific_impulse_s: 60.0,
    }
}

fn wheel(name: &str, spin_axis_b: Unit<Vector3<f64>>) -> Wheel {
    Wheel {
        name: name.to_owned(),
        spin_axis_b,
        spin_inertia_kg_m2: 0.08,
        max_torque_n_m: 0.5,
        max_speed_rad_s: 200.0,
        viscous_friction_n_m_s: 5.0e-5,
        coulomb_friction_n_m: 2.0e-3,
    }
}

fn jets() -> Vec<Jet> {
    let (x, y, z) = (Vector3::x(), Vector3::y(), Vector3::z());
    let arm_m = 0.45;
    // Pairs (position, force): two jets each for +x, -x, +y, -y, +z, -z torque.
    let geometry = [
        (y, z),
        (-y, -z),
        (y, -z),
        (-y, z),
        (x, -z),
        (-x, z),
        (x, z),
        (-x, -z),
        (x, y),
        (-x, -y),
        (x, -y),
        (-x, y),
    ];
    geometry
        .into_iter()
        .enumerate()
        .map(|(j, (position, force))| Jet {
            name: format!("jet_{}", j + 1),
            position_b_m: position * arm_m,
            force_direction_b: Unit::new_unchecked(force),
            thrust_n: 0.5,
            min_on_time_s: 0.010,
            opening_delay_s: 0.006,
            closing_delay_s: 0.004,
        })
        .collect()
}

fn sensors() -> SensorSuite {
    let no_errors = TriaxialErrors {
        noise_stddev: Vector3::zeros(),
        bias: Vector3::zeros(),
        bias_turn_on_stddev: Vector3::zeros(),
        bias_walk: Vector3::zeros(),
        scale: Vector3::zeros(),
        misalignment_rad: Vector3::zeros(),
        skew_rad: Vector3::zeros(),
        quantum: 0.0,
        range: f64::MAX,
        latency_s: 0.0,
        time_constant_s: 0.0,
        averaging_window_s: 0.0,
    };
    SensorSuite {
        rate_hz: 100.0,
        gyro: RateGyro {
            axes: [true; 3],
            errors: TriaxialErrors {
                noise_stddev: Vector3::repeat(1.7e-3),
                bias_turn_on_stddev: Vector3::repeat(5.0e-3),
                bias_walk: Vector3::repeat(2.0e-5),
                range: 75.0_f64.to_radians(),
                ..no_errors
            },
        },
        accelerometer: Accelerometer {
            fitted: true,
            errors: TriaxialErrors {
                noise_stddev: Vector3::repeat(0.02),
                bias_turn_on_stddev: Vector3::repeat(0.01),
                bias_walk: Vector3::repeat(1.0e-5),
                range: 19.62,
                ..no_errors
            },
            lever_arm_b_m: Vector3::new(0.10, 0.05, 0.15),
        },
        vector: Some(VectorSensor {
            reference_direction_world: Vector3::x_axis(),
            noise_stddev_rad: 2.0e-3,
            misalignment_rad: Vector3::zeros(),
            rate_hz: 10.0,
            latency_s: 0.0,
        }),
        wheel_speed: WheelSpeedSensor { noise_stddev_rad_s: 0.05, quantum_rad_s: 0.0 },
        bus_voltage: ScalarSensor { noise_stddev: 0.01, quantum: 0.0 },
        tank_pressure: ScalarSensor { noise_stddev: 5.0e3, quantum: 0.0 },
        temperature: ScalarSensor { noise_stddev: 0.05, quantum: 0.0 },
        ambient_temperature_k: 293.15,
        temperature_drift_k_s: 2.0e-3,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn jets_come_in_pairs_of_pure_torque() {
        let model = PlatformModel::whorl_1_reference();
        let expected = [
            Vector3::x(),
            Vector3::x(),
            -Vector3::x(),
            -Vector3::x(),
            Vector3::y(),
            Vector3::y(),
            -Vector3::y(),
            -Vector3::y(),
            Vector3::z(),
            Vector3::z(),
            -Vector3::z(),
            -Vector3::z(),
        ];
        for (jet, axis) in model.jets().iter().zip(expected) {
            assert!((jet.torque_b_n_m() - axis * 0.225).norm() < 1e-15, "{}", jet.name);
        }
    }
}
