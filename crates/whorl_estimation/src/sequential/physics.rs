//! The gyrostat between samples, with the wheels' measured speeds as input.
//!
//! The state is attitude and total momentum; the equation is [`whorl_dynamics::gyrostat::equation`] with the wheels'
//! speeds known, and gravity, the model's effects and the jets as torque from outside.
//!
//! Motor torques and wheel friction do not appear: the momentum of the wheels is read from their speeds. Only
//! the vertical k_b enters the torque; the heading enters only through effects that depend on it.

use std::sync::Arc;

use nalgebra::{Matrix3, UnitQuaternion, Vector3};
use whorl_dynamics::effects::catalogue;
use whorl_dynamics::gyrostat::RateEquation;
use whorl_dynamics::gyrostat::equation::{gravity_torque_n_m, momentum_rate_b_n_m};
use whorl_dynamics::sensing::specific_force_b_m_s2;
use whorl_dynamics::{Effect, EffectSet, Environment, ParameterSpec, PlatformModel, TrueImu};
use whorl_math::{quaternion_exp, quaternion_rate};

use super::sample::AveragedSample;
use whorl_dynamics::mass_parameters::{MassVector, gravity_offset_b_n_m, inertia_b_kg_m2};

/// What a filter takes as it is: the platform but for its mass properties, and its effects. Those with states of their own are left
/// out.
#[derive(Debug, Clone)]
pub(crate) struct Carried {
    /// The platform, its constants corrected by the effects.
    pub platform: Arc<PlatformModel>,
    effects: EffectSet,
    /// What effects add to the file's own mass properties, which are estimated: they stay beside them.
    added_inertia_b_kg_m2: Matrix3<f64>,
    added_offset_b_n_m: Vector3<f64>,
}

impl Carried {
    pub fn new(given: &PlatformModel) -> Self {
        let values = |effect: &dyn Effect| {
            let of_effect = given.effects.get(effect.info().id)?;
            let value = |spec: &ParameterSpec| of_effect.get(&spec.name).copied().unwrap_or(spec.neutral);
            Some(effect.parameters(given).iter().map(value).collect::<Vec<f64>>())
        };
        let followed = catalogue().iter().copied().filter(|effect| effect.hidden_states(given) == 0);
        let with_values = followed.filter_map(|effect| Some((effect, values(effect)?)));
        let effects = EffectSet::with_values(with_values.collect::<Vec<_>>(), given);
        // Impossible effects are refused where the model is read.
        let platform = effects.adjusted(given).unwrap_or_else(|_| given.clone());
        let (own, all) = (&given.mass_properties, &platform.mass_properties);
        Self {
            added_inertia_b_kg_m2: all.inertia_b_kg_m2() - own.inertia_b_kg_m2(),
            added_offset_b_n_m: all.gravity_offset_b_n_m() - own.gravity_offset_b_n_m(),
            platform: Arc::new(platform),
            effects,
        }
    }
}

/// A platform with particular mass properties.
#[derive(Debug, Clone)]
pub(crate) struct Physics {
    equation: RateEquation,
    gravity_offset_b_n_m: Vector3<f64>,
    /// The platform, its constants corrected by the effects.
    platform: Arc<PlatformModel>,
    effects: EffectSet,
    /// A J: momentum per wheel speed.
    wheels: Vec<Vector3<f64>>,
    /// Nominal torque of every jet; those that never fire are there too.
    jets: Vec<Vector3<f64>>,
}

/// Motion of the body at one instant.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Motion {
    pub q_world_body: UnitQuaternion<f64>,
    pub omega_wb_b_rad_s: Vector3<f64>,
}

impl Physics {
    /// `None` if no such platform can be.
    pub fn new(carried: &Carried, mass: &MassVector) -> Option<Self> {
        let equation =
            RateEquation::with_known_wheel_speeds(inertia_b_kg_m2(mass) + carried.added_inertia_b_kg_m2)?;
        let platform = &carried.platform;
        let wheels = platform.wheels().iter();
        Some(Self {
            equation,
            gravity_offset_b_n_m: gravity_offset_b_n_m(mass) + carried.added_offset_b_n_m,
            wheels: wheels.map(|wheel| wheel.spin_axis_b.into_inner() * wheel.spin_inertia_kg_m2).collect(),
            jets: platform.jets().iter().map(|jet| jet.torque_b_n_m()).collect(),
            effects: carried.effects.clone(),
            platform: Arc::clone(platform),
        })
    }

    fn wheel_momentum(&self, values: &[f64]) -> Vector3<f64> {
        self.wheels.iter().zip(values).map(|(axis, x)| axis * *x).sum()
    }

    /// Known torque of jets and other actuators at a point.
    fn actuator_torque(&self, point: &AveragedSample) -> Vector3<f64> {
        let jets: Vector3<f64> =
            self.jets.iter().zip(&point.jet_share).filter(|(_, s)| **s != 0.0).map(|(t, s)| t * *s).sum();
        jets + point.body_torque_b_n_m
    }

    /// What effects see of a motion at a point.
    fn environment<'a>(
        &'a self,
        time_s: f64,
        q: &UnitQuaternion<f64>,
        omega: &Vector3<f64>,
        point: &'a AveragedSample,
    ) -> Environment<'a> {
        let around = &point.surroundings;
        Environment {
            time_s,
            wheel_speed_rad_s: &point.wheel_speed_rad_s,
            valve_fraction: &point.jet_share,
            tank_pressure_pa: around.tank_pressure_pa,
            gas_used_kg: around.gas_used_kg,
            bus_voltage_v: around.bus_voltage_v,
            temperature_k: around.temperature_k,
            ballast_direction: around.ballast_direction,
            ..Environment::new(&self.platform, *q, *omega)
        }
    }

    /// Torque of gravity and effects.
    fn torque(&self, environment: &Environment<'_>, ballast: &Vector3<f64>) -> Vector3<f64> {
        gravity_torque_n_m(&(self.gravity_offset_b_n_m + ballast), &environment.vertical_b)
            + self.effects.torque_b_n_m(environment, &[])
    }

    /// From one point to the next: classical Runge-Kutta, wheel speeds linear between.
    pub fn step(&self, from: &Motion, at: &AveragedSample, next: &AveragedSample) -> Motion {
        let h_s = next.time_s - at.time_s;
        let wheels_0 = self.wheel_momentum(&at.wheel_speed_rad_s);
        let wheels_1 = self.wheel_momentum(&next.wheel_speed_rad_s);
        let applied = self.actuator_torque(at);
        let derivative = |q: &UnitQuaternion<f64>, momentum: &Vector3<f64>, share: f64| {
            let omega = self.equation.rate_b_rad_s(momentum, &wheels_0.lerp(&wheels_1, share));
            let environment = self.environment(at.time_s + share * h_s, q, &omega, at);
            let torque = self.torque(&environment, &at.ballast_moment_b_n_m) + applied;
            (quaternion_rate(q, &omega), momentum_rate_b_n_m(&omega, momentum, &torque))
        };
        let q0 = from.q_world_body;
        let m0 = self.equation.momentum_b_n_m_s(&from.omega_wb_b_rad_s, &wheels_0);
        let moved =
            |dq: &nalgebra::Quaternion<f64>, h: f64| UnitQuaternion::new_unchecked(q0.into_inner() + dq * h);
        let (q1, m1) = derivative(&q0, &m0, 0.0);
        let (q2, m2) = derivative(&moved(&q1, 0.5 * h_s), &(m0 + m1 * (0.5 * h_s)), 0.5);
        let (q3, m3) = derivative(&moved(&q2, 0.5 * h_s), &(m0 + m2 * (0.5 * h_s)), 0.5);
        let (q4, m4) = derivative(&moved(&q3, h_s), &(m0 + m3 * h_s), 1.0);
        let momentum = m0 + (m1 + (m2 + m3) * 2.0 + m4) * (h_s / 6.0);
        let q = q0.into_inner() + (q1 + (q2 + q3) * 2.0 + q4) * (h_s / 6.0);
        Motion {
            q_world_body: UnitQuaternion::new_normalize(q),
            omega_wb_b_rad_s: self.equation.rate_b_rad_s(&momentum, &wheels_1),
        }
    }

    /// What the inertial sensors read at a point without bias and noise.
    pub fn imu(&self, motion: &Motion, point: &AveragedSample) -> TrueImu {
        let omega = motion.omega_wb_b_rad_s;
        let mut environment = self.environment(point.time_s, &motion.q_world_body, &omega, point);
        let wheels = self.wheel_momentum(&point.wheel_speed_rad_s);
        let momentum = self.equation.momentum_b_n_m_s(&omega, &wheels);
        let torque = self.torque(&environment, &point.ballast_moment_b_n_m) + self.actuator_torque(point);
        let on_wheels = self.wheel_momentum(&point.wheel_acceleration_rad_s2);
        let acceleration = self.equation.acceleration_b_rad_s2(&omega, &momentum, &torque, &on_wheels);
        environment.omega_dot_wb_b_rad_s2 = acceleration;
        let sensors = &self.platform.sensors;
        let arm = &sensors.accelerometer.lever_arm_b_m;
        let mut imu = TrueImu {
            angular_velocity_b_rad_s: omega,
            specific_force_b_m_s2: specific_force_b_m_s2(arm, &omega, &acceleration, &environment.vertical_b),
        };
        self.effects.measure_imu(&environment, &mut imu);
        TrueImu {
            angular_velocity_b_rad_s: sensors.gyro.errors.ideal(&imu.angular_velocity_b_rad_s),
            specific_force_b_m_s2: sensors.accelerometer.errors.ideal(&imu.specific_force_b_m_s2),
        }
    }

    /// Where a vector sensor sees a direction of the world.
    pub fn seen(&self, motion: &Motion, direction_world: &Vector3<f64>) -> Vector3<f64> {
        let direction_b = motion.q_world_body.inverse_transform_vector(direction_world);
        match self.platform.sensors.vector {
            Some(sensor) if sensor.misalignment_rad != Vector3::zeros() => {
                quaternion_exp(&sensor.misalignment_rad).inverse_transform_vector(&direction_b)
            }
            _ => direction_b,
        }
    }
}

#[cfg(test)]
mod tests {
    use whorl_dynamics::{InitialState, Plant};

    use super::*;
    use crate::sequential::sample::Surroundings;
    use whorl_dynamics::mass_parameters::mass_vector;

    /// The truth plant integrates motor torques and friction at 1 kHz; here the wheels' speeds alone are
    /// given, at 20 Hz. Both must arrive at the same motion.
    #[test]
    fn wheel_speeds_alone_give_the_motion_of_the_plant() {
        let model = PlatformModel::whorl_1_reference();
        let initial = InitialState {
            omega_wb_b_rad_s: Vector3::new(0.02, -0.01, 0.1),
            wheel_speed_rad_s: vec![5.0, -3.0, 20.0],
            ..InitialState::default()
        };
        let mut plant = Plant::new(&model, &initial, 1).unwrap();
        let carried = Carried::new(&model);
        let physics = Physics::new(&carried, &mass_vector(&model.mass_properties)).unwrap();
        let point = |plant: &Plant| AveragedSample {
            time_s: plant.time_s(),
            gyro_b_rad_s: Vector3::zeros(),
            gyro_samples: 1.0,
            specific_force_b_m_s2: None,
            directions: Vec::new(),
            wheel_speed_rad_s: plant.truth().wheel_speed_rad_s,
            wheel_acceleration_rad_s2: vec![0.0; 3],
            jet_share: Vec::new(),
            body_torque_b_n_m: Vector3::zeros(),
            ballast_moment_b_n_m: Vector3::zeros(),
            surroundings: Surroundings::at_start(&model),
        };
        let mut motion =
            Motion { q_world_body: initial.q_world_body, omega_wb_b_rad_s: initial.omega_wb_b_rad_s };
        let mut at = point(&plant);
        for k in 1..=200 {
            let t = at.time_s;
            plant.command_wheels(&[0.05 * (0.9 * t).sin(), 0.04 * t.cos(), 0.2 * (0.4 * t).sin()]).unwrap();
            plant.advance_to(k * 50_000_000).unwrap();
            let next = point(&plant);
            motion = physics.step(&motion, &at, &next);
            at = next;
        }
        let truth = plant.truth();
        assert!(motion.q_world_body.angle_to(&truth.q_world_body) < 2e-5, "{motion:?} {truth:?}");
        assert!((motion.omega_wb_b_rad_s - truth.omega_wb_b_rad_s).norm() < 2e-6);
    }
}
