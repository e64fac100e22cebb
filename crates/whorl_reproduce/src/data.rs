//! Simulated measurements.

use nalgebra::{Unit, UnitQuaternion, Vector3};
use rand_distr::{Distribution, StandardNormal};
use rand_pcg::Pcg64;
use whorl_dynamics::PlatformModel;
use whorl_dynamics::gyrostat::RateEquation;
use whorl_dynamics::gyrostat::equation::gravity_torque_n_m;
use whorl_dynamics::sensing::specific_force_b_m_s2;
use whorl_math::vertical_b;
use whorl_recording::{Recording, Series, VectorChannel};

use crate::regression::StateSeries;

/// Standard normal numbers.
pub struct Noise(Pcg64);

impl Noise {
    pub fn new(seed: u128) -> Self {
        Self(Pcg64::new(seed, 41))
    }

    pub fn draw(&mut self) -> f64 {
        StandardNormal.sample(&mut self.0)
    }

    pub fn vector(&mut self) -> Vector3<f64> {
        Vector3::new(self.draw(), self.draw(), self.draw())
    }
}

/// Whorl-I of Table 4.1 as a rigid body: no wheels, MotionPak-class sensors.
pub fn rigid_whorl_1(vector: bool) -> PlatformModel {
    let mut model = PlatformModel::whorl_1_reference();
    model.wheels_mut().clear();
    model.jets_mut().clear();
    // The studies of section 4.6.4 know no stops.
    model.tilt_limit = whorl_dynamics::platform::TiltLimit::Cone { max_rad: 0.5 };
    let force = &mut model.sensors.accelerometer.errors;
    force.bias_turn_on_stddev = Vector3::repeat(1.5e-3);
    if !vector {
        model.sensors.vector = None;
    }
    model
}

/// What the model's sensors read along an exact motion; `decimation`: samples between vector readings.
pub fn measured(truth: &StateSeries, model: &PlatformModel, seed: u128, decimation: usize) -> Recording {
    let mut noise = Noise::new(seed);
    let sensors = &model.sensors;
    let (gyro, force) = (&sensors.gyro.errors, &sensors.accelerometer.errors);
    let gyro_bias = gyro.bias_turn_on_stddev.component_mul(&noise.vector());
    let force_bias = force.bias_turn_on_stddev.component_mul(&noise.vector());
    let mass = &model.mass_properties;
    let equation = RateEquation::with_known_wheel_speeds(*mass.inertia_b_kg_m2());
    let mut run = Recording { name: "simulated".into(), platform: "whorl_1".into(), ..Recording::default() };
    let mut directions = Series::default();
    for (k, s) in truth.samples.iter().enumerate() {
        let omega = s.omega_wb_b_rad_s;
        let vertical = vertical_b(&s.q_world_body);
        let torque = s.external_torque_b_n_m + gravity_torque_n_m(mass.gravity_offset_b_n_m(), &vertical);
        // Mass properties are positive definite.
        let acceleration = equation.map_or_else(Vector3::zeros, |equation| {
            let zero = Vector3::zeros();
            let momentum = equation.momentum_b_n_m_s(&omega, &zero);
            equation.acceleration_b_rad_s2(&omega, &momentum, &torque, &zero)
        });
        let lever_arm = &sensors.accelerometer.lever_arm_b_m;
        let specific = specific_force_b_m_s2(lever_arm, &omega, &acceleration, &vertical);
        push(&mut run.gyro_b_rad_s, s.time_s, gyro.reading(&omega, &gyro_bias, &noise.vector()));
        push(
            &mut run.specific_force_b_m_s2,
            s.time_s,
            force.reading(&specific, &force_bias, &noise.vector()),
        );
        push(&mut run.body_torque_b_n_m, s.time_s, s.external_torque_b_n_m);
        if let Some(sensor) = sensors.vector.filter(|_| k % decimation.max(1) == 0) {
            let seen = sensor.reading(&s.q_world_body, &[noise.draw(), noise.draw()]);
            push(&mut directions, s.time_s, seen.into_inner());
        }
    }
    if let Some(sensor) = sensors.vector {
        let reference_world: Unit<Vector3<f64>> = sensor.reference_direction_world;
        run.vectors = vec![VectorChannel { reference_world, direction_b: directions }];
    }
    run
}

fn push<T>(series: &mut Series<T>, time_s: f64, value: T) {
    series.time_s.push(time_s);
    series.value.push(value);
}

/// Level, heading east.
pub fn level() -> UnitQuaternion<f64> {
    UnitQuaternion::identity()
}
