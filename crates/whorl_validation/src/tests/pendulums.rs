//! Pendulums on a shaft and wheels in a loop, simulated here by their own equations and not by the plant: the model that made the
//! data explains them, whatever the rig, and without its friction it does not.

use std::collections::BTreeMap;

use nalgebra::{Matrix3, Unit, Vector3};
use rand_distr::{Distribution, Normal};
use rand_pcg::Pcg64;
use whorl_dynamics::platform::{TiltLimit, Wheel};
use whorl_dynamics::{Freedom, MassProperties, PlatformModel};
use whorl_prediction::{Parameter, Rival, Settings, fit};
use whorl_recording::{Mounting, Recording, VectorChannel};

use super::compare;
use crate::{Frame, Growth, Parity};
use crate::{explain_where, unexplained_torques};

const GYRO_RAD_S: f64 = 0.02;
const FORCE_M_S2: f64 = 0.05;
const VECTOR_RAD: f64 = 0.003;
const TACHOMETER_RAD_S: f64 = 0.2;

#[derive(Debug, Clone, Copy)]
struct Pendulum {
    inertia_kg_m2: f64,
    /// Weight times the distance of the centre of mass from the shaft.
    weight_n_m: f64,
    friction_n_m_s: f64,
    from_rad: f64,
    rate_hz: u32,
    duration_s: f64,
    sees_vertical: bool,
    has_accelerometer: bool,
}

/// 1.5 Hz, from 14 deg.
const CUBE: Pendulum = Pendulum {
    inertia_kg_m2: 0.0074,
    weight_n_m: 0.66,
    friction_n_m_s: 0.0006,
    from_rad: 0.25,
    rate_hz: 100,
    duration_s: 20.0,
    sees_vertical: false,
    has_accelerometer: true,
};

impl Pendulum {
    /// About body z; the centre of mass hangs along -x.
    fn model(&self) -> PlatformModel {
        let mut model = PlatformModel::whorl_1_reference();
        let inertia = Matrix3::from_diagonal(&Vector3::new(1.2, 1.2, 1.0)) * self.inertia_kg_m2;
        let offset = Vector3::new(-self.weight_n_m, 0.0, 0.0);
        model.mass_properties = MassProperties::new(inertia, offset, 1.0).unwrap();
        (model.freedom, model.tilt_limit) = (Freedom::Hinge { axis_b: Vector3::z_axis() }, TiltLimit::NONE);
        model.jets_mut().clear();
        model.wheels_mut().clear();
        let sensors = &mut model.sensors;
        sensors.rate_hz = f64::from(self.rate_hz);
        sensors.gyro.errors.noise_stddev = Vector3::repeat(GYRO_RAD_S);
        sensors.gyro.errors.bias_turn_on_stddev = Vector3::repeat(0.01);
        sensors.gyro.errors.bias_walk = Vector3::zeros();
        sensors.gyro.errors.range = 1e3;
        let force = &mut sensors.accelerometer;
        (force.fitted, force.lever_arm_b_m) = (self.has_accelerometer, Vector3::zeros());
        force.errors.noise_stddev = Vector3::repeat(FORCE_M_S2);
        force.errors.bias_turn_on_stddev = Vector3::repeat(0.02);
        force.errors.bias_walk = Vector3::zeros();
        if let Some(vector) = &mut sensors.vector {
            vector.noise_stddev_rad = VECTOR_RAD;
        }
        let friction = BTreeMap::from([("c_n_m_s".to_owned(), self.friction_n_m_s)]);
        if self.friction_n_m_s > 0.0 {
            model.effects.insert("bearing_viscous_friction".to_owned(), friction);
        }
        model
    }

    /// I a'' = -W sin a - c a', by Runge and Kutta's rule in steps of at most 0.5 ms.
    fn swing(&self, seed: u64) -> Recording {
        let mut random = Pcg64::new(u128::from(seed), 5);
        let mut normal = |stddev: f64| Normal::new(0.0, stddev).unwrap().sample(&mut random);
        let acceleration =
            |a: f64, w: f64| (-self.weight_n_m * a.sin() - self.friction_n_m_s * w) / self.inertia_kg_m2;
        let sample_s = 1.0 / f64::from(self.rate_hz);
        let steps = (sample_s / 5e-4).ceil();
        let h = sample_s / steps;
        let (mut a, mut w) = (self.from_rad, 0.0);
        let mut r =
            Recording { name: "swing".to_owned(), no_gyro_axis: [true, true, false], ..Recording::default() };
        let mut directions = Vec::new();
        for k in 0..(self.duration_s / sample_s) as usize {
            let t = k as f64 * sample_s;
            r.gyro_b_rad_s.time_s.push(t);
            r.gyro_b_rad_s.value.push(Vector3::new(0.0, 0.0, w + normal(GYRO_RAD_S)));
            let up = |a: f64| Vector3::new(a.cos(), -a.sin(), 0.0);
            if self.has_accelerometer {
                let noise = Vector3::from_fn(|_, _| normal(FORCE_M_S2));
                r.specific_force_b_m_s2.time_s.push(t);
                r.specific_force_b_m_s2.value.push(up(a) * whorl_math::GRAVITY_M_S2 + noise);
            }
            if self.sees_vertical {
                let tilt = up(a)
                    + Vector3::new(-a.sin(), -a.cos(), 0.0) * normal(VECTOR_RAD)
                    + Vector3::z() * normal(VECTOR_RAD);
                directions.push((t, Unit::new_normalize(tilt).into_inner()));
            }
            for _ in 0..steps as usize {
                let (a1, w1) = (w, acceleration(a, w));
                let (a2, w2) = (w + 0.5 * h * w1, acceleration(a + 0.5 * h * a1, w + 0.5 * h * w1));
                let (a3, w3) = (w + 0.5 * h * w2, acceleration(a + 0.5 * h * a2, w + 0.5 * h * w2));
                let (a4, w4) = (w + h * w3, acceleration(a + h * a3, w + h * w3));
                a += h / 6.0 * (a1 + 2.0 * a2 + 2.0 * a3 + a4);
                w += h / 6.0 * (w1 + 2.0 * w2 + 2.0 * w3 + w4);
            }
        }
        if self.sees_vertical {
            let direction_b = directions.into_iter().collect();
            r.vectors.push(VectorChannel { reference_world: Vector3::z_axis(), direction_b });
        }
        r
    }
}

/// Pendulums of every size, and what sees them.
fn pendulums() -> [Pendulum; 10] {
    let seen = Pendulum { sees_vertical: true, has_accelerometer: false, ..CUBE };
    [
        Pendulum { duration_s: 60.0, ..CUBE },
        seen,
        Pendulum { from_rad: 0.05, ..CUBE },
        Pendulum { from_rad: 1.0, ..CUBE },
        Pendulum { from_rad: 2.5, ..seen },
        Pendulum { friction_n_m_s: 0.0035, from_rad: 0.05, rate_hz: 200, duration_s: 10.0, ..seen },
        // A heavy one at 0.3 Hz, slowly read.
        Pendulum {
            inertia_kg_m2: 8.0,
            weight_n_m: 30.0,
            friction_n_m_s: 0.4,
            rate_hz: 10,
            duration_s: 60.0,
            ..CUBE
        },
        // 5 Hz, quickly read.
        Pendulum { inertia_kg_m2: 6e-4, friction_n_m_s: 1e-5, rate_hz: 500, duration_s: 4.0, ..CUBE },
        Pendulum { friction_n_m_s: 0.0, ..CUBE },
        Pendulum { sees_vertical: true, from_rad: 0.6, rate_hz: 50, ..CUBE },
    ]
}

#[test]
fn the_exact_model_of_a_pendulum_explains_it() {
    for (seed, pendulum) in (1..).zip(pendulums()) {
        let comparison = compare(&pendulum.swing(seed), &pendulum.model()).unwrap();
        let error = comparison.prediction_error().unwrap();
        assert!((error - 1.0).abs() < 0.06, "{pendulum:?}: {error}");
        assert!(comparison.is_noise(), "{pendulum:?}: {}", comparison.answer());
        for channel in &comparison.channels {
            assert!(
                (channel.noise_floor / channel.stated_noise - 1.0).abs() < 0.08,
                "{pendulum:?}: {channel:?}"
            );
        }
    }
}

/// From so close to the top, only the exact start tells when a pendulum falls: a random torque of the first seconds must not take its place.
#[test]
fn a_pendulum_that_leaves_the_top_is_explained() {
    for (seed, off_rad, friction_n_m_s) in [(50, 0.003, 0.0006), (51, -0.01, 0.003)] {
        let from_rad = std::f64::consts::PI - off_rad;
        let pendulum =
            Pendulum { from_rad, friction_n_m_s, duration_s: 40.0, has_accelerometer: false, ..CUBE };
        let comparison = compare(&pendulum.swing(seed), &pendulum.model()).unwrap();
        assert!(comparison.is_noise(), "{pendulum:?}: {}", comparison.answer());
    }
}

/// What a model explains leaves nothing to locate; without its friction the torque that is missing is a function of the rate, and that is the
/// law.
#[test]
fn what_a_pendulum_leaves_unexplained_is_its_friction() {
    for (seed, pendulum) in (1..).zip(pendulums()) {
        let run = pendulum.swing(seed);
        let model = pendulum.model();
        let right = explain_where(&[(&run, &unexplained_torques(&run, &model, None).unwrap())], &model);
        assert!(!right.is_anything_left(), "{pendulum:?}: {:?}", right.answer());
        if pendulum.friction_n_m_s == 0.0 {
            continue;
        }
        let model = Pendulum { friction_n_m_s: 0.0, ..pendulum }.model();
        let wrong = explain_where(&[(&run, &unexplained_torques(&run, &model, None).unwrap())], &model);
        let Some(found) = &wrong.dependences else { panic!("{pendulum:?}: {:?}", wrong.answer()) };
        let rate = &found.ranked[0];
        let law = (rate.variable.as_str(), rate.axis, rate.parity, rate.growth);
        assert_eq!(law, ("yaw_rate", 0, Parity::Odd, Growth::Linear), "{pendulum:?}: {:?}", wrong.answer());
        assert!(rate.share > 0.8, "{pendulum:?}: {:?}", wrong.answer());
        assert_eq!(rate.frame, Frame::Hinge);
        let (x, torque) = (&rate.shape.x, &rate.shape.torque_n_m[0]);
        let slope = (torque[30] - torque[10]) / (x[30] - x[10]) / -pendulum.friction_n_m_s;
        // An estimate is smaller than the torque by what noise hides of it, most where the torque is hardly seen.
        println!("measured: {slope:.2} of the friction of {pendulum:?}");
        assert!((0.4..1.1).contains(&slope), "{pendulum:?}: {slope}");
    }
}

#[test]
fn without_its_friction_a_pendulum_is_not_explained() {
    for (seed, pendulum) in (1..).zip(pendulums()).filter(|(_, pendulum)| pendulum.friction_n_m_s > 0.0) {
        let without = Pendulum { friction_n_m_s: 0.0, ..pendulum };
        let comparison = compare(&pendulum.swing(seed), &without.model()).unwrap();
        assert!(!comparison.is_noise(), "{pendulum:?}: {}", comparison.answer());
        assert!(comparison.unexplained.torque_b_n_m[2] > 0.0, "{pendulum:?}: {:?}", comparison.unexplained);
        // Errors grow with the horizon.
        let gyro = &comparison.channels[0].horizons;
        assert!(gyro[gyro.len() - 1].ratio > gyro[0].ratio, "{pendulum:?}: {gyro:?}");
    }
}

/// A wheel on a bench, held at a speed by a loop that acts on its noisy tachometer; the motor gives what is commanded, with a
/// ripple. The commands are mostly noise, which is no fault of the model.
#[test]
fn a_wheel_that_its_loop_holds_is_explained() {
    let mut model = CUBE.model();
    (model.freedom, model.effects) = (Freedom::Clamped, BTreeMap::new());
    *model.wheels_mut() = vec![Wheel {
        name: "wheel".to_owned(),
        spin_axis_b: Vector3::x_axis(),
        spin_inertia_kg_m2: 0.004,
        max_torque_n_m: 0.02,
        max_speed_rad_s: 314.0,
        viscous_friction_n_m_s: 0.0,
        coulomb_friction_n_m: 0.0,
    }];
    model.sensors.wheel_speed.noise_stddev_rad_s = TACHOMETER_RAD_S;
    for (seed, reference_rad_s) in [(1, 0.0), (2, 40.0), (3, -40.0), (4, 20.0)] {
        let mut random = Pcg64::new(seed, 6);
        let mut normal = |stddev: f64| Normal::new(0.0, stddev).unwrap().sample(&mut random);
        let mut r = Recording {
            name: "held".to_owned(),
            mounting: Mounting::Clamped,
            closed_loop: true,
            ..Recording::default()
        };
        let mut speed_rad_s = reference_rad_s;
        for k in 0..3000 {
            let t = f64::from(k) * 0.01;
            let read = speed_rad_s + normal(TACHOMETER_RAD_S);
            let torque = (-0.0024 * (read - reference_rad_s)).clamp(-0.02, 0.02);
            r.wheel_speed_rad_s.time_s.push(t);
            r.wheel_speed_rad_s.value.push(vec![read]);
            r.wheel_torque_command_n_m.time_s.push(t);
            r.wheel_torque_command_n_m.value.push(vec![torque]);
            speed_rad_s += (torque + normal(5e-5)) * 0.01 / 0.004;
        }
        let comparison = compare(&r, &model).unwrap();
        let error = comparison.prediction_error().unwrap();
        assert!(comparison.is_noise() && (error - 1.0).abs() < 0.05, "{}", comparison.answer());
    }
}

/// An accelerometer of one or two axes: what it lacks is not there, neither as a reading nor as a zero.
#[test]
fn a_pendulum_is_explained_with_an_accelerometer_that_lacks_axes() {
    let with = pendulums().into_iter().filter(|pendulum| pendulum.has_accelerometer);
    let lacking = [
        [true, false, false],
        [false, true, false],
        [false, false, true],
        [true, false, true],
        [false, true, true],
        [true, true, false],
    ];
    for (seed, (pendulum, lacks)) in (20..).zip(with.zip(lacking.into_iter().cycle())) {
        let mut run = pendulum.swing(seed);
        run.no_force_axis = lacks;
        for force in &mut run.specific_force_b_m_s2.value {
            *force = force.zip_map(&Vector3::from(lacks), |f, lacks| if lacks { 0.0 } else { f });
        }
        let comparison = compare(&run, &pendulum.model()).unwrap();
        let error = comparison.prediction_error().unwrap();
        assert!((error - 1.0).abs() < 0.06, "{pendulum:?} {lacks:?}: {error}");
        assert!(comparison.is_noise(), "{pendulum:?} {lacks:?}: {}", comparison.answer());
        let axes = lacks.iter().filter(|lacks| !**lacks).count();
        let of_vector = usize::from(pendulum.sees_vertical);
        assert_eq!(comparison.channels.len(), 1 + axes + of_vector, "{pendulum:?} {lacks:?}");
    }
}

/// Weight and friction fitted to swings whose accelerometer lacks axes, from a model that is two deviations off: as far from the truth as
/// the fits say, and to no side of it. A bias that followed the fit would give the shaft another tilt and the weight another size.
#[test]
fn what_is_fitted_with_an_accelerometer_that_lacks_axes_is_as_good_as_it_says() {
    let truth = Pendulum { duration_s: 10.0, ..CUBE };
    let at = |z: &[f64]| {
        let weight_n_m = truth.weight_n_m * (1.0 + 0.05 * z.first()?);
        let friction_n_m_s = truth.friction_n_m_s * (0.3 * z.get(1)?).exp();
        Some(Pendulum { weight_n_m, friction_n_m_s, ..truth }.model())
    };
    let parameters = vec![Parameter { stddev: 1.0, range: (-5.0, 5.0) }; 2];
    let start = [vec![2.0, -2.0]];
    for lacks in [[false, true, false], [false, true, true]] {
        let mut off = [Vec::new(), Vec::new()];
        for seed in 31..41 {
            let mut run = truth.swing(seed);
            run.no_force_axis = lacks;
            for force in &mut run.specific_force_b_m_s2.value {
                *force = force.zip_map(&Vector3::from(lacks), |f, lacks| if lacks { 0.0 } else { f });
            }
            let fitted = fit(&[run], &parameters, &at, &start, Rival::NONE, &Settings::default()).unwrap();
            for (i, off) in off.iter_mut().enumerate() {
                off.push(fitted.at[i] / fitted.covariance[(i, i)].sqrt());
            }
        }
        for off in off {
            let mean = off.iter().sum::<f64>() / off.len() as f64;
            println!("measured: {lacks:?}: off by {off:.2?} deviations, mean {mean:.2}");
            assert!(off.iter().all(|z| z.abs() < 3.3), "{lacks:?}: {off:?}");
            assert!(mean.abs() < 3.3 / (off.len() as f64).sqrt(), "{lacks:?}: {off:?}");
        }
    }
}
