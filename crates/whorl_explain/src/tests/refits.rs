//! Numbers that the platform's file states with a prior are refitted within it: friction of a wheel, on turntables that are integrated
//! here by their own equations.

use nalgebra::{Matrix3, Unit, Vector3};
use rand_distr::{Distribution, StandardNormal};
use rand_pcg::Pcg64;
use whorl_dynamics::platform::{TiltLimit, Wheel};
use whorl_dynamics::{Freedom, MassProperties, ModelPrior, PlatformModel};
use whorl_identification::Options;
use whorl_recording::Recording;

use crate::Case;
use crate::adopt::{Adoption, adopt};

/// A table on a shaft along z with a wheel.
#[derive(Debug, Clone, Copy)]
struct Turntable {
    inertia_kg_m2: f64,
    rate_hz: f64,
    axis_sign: f64,
    /// True viscous and dry friction over what is believed.
    viscous: f64,
    dry: f64,
}

const TURNTABLE: Turntable =
    Turntable { inertia_kg_m2: 0.052, rate_hz: 50.0, axis_sign: 1.0, viscous: 0.84, dry: 1.09 };
/// How well friction is known, a share of it.
const KNOWN: f64 = 0.3;
const GYRO_RAD_S: f64 = 0.003;
const TACHOMETER_RAD_S: f64 = 0.055;

impl Turntable {
    /// Spin inertia [kg m^2], believed viscous [N m s] and dry friction [N m].
    fn wheel(&self) -> (f64, f64, f64) {
        let size = self.inertia_kg_m2 / 0.052;
        (4.2e-4 * size, 6e-6 * size, 4e-4 * size)
    }

    fn model(&self) -> PlatformModel {
        let mut model = PlatformModel::whorl_1_reference();
        let inertia = Matrix3::identity() * self.inertia_kg_m2;
        model.mass_properties = MassProperties::new(inertia, Vector3::zeros(), 4.0).unwrap();
        (model.freedom, model.tilt_limit) = (Freedom::Hinge { axis_b: Vector3::z_axis() }, TiltLimit::NONE);
        model.jets_mut().clear();
        let (spin_inertia_kg_m2, viscous_friction_n_m_s, coulomb_friction_n_m) = self.wheel();
        *model.wheels_mut() = vec![Wheel {
            name: "rw_1".to_owned(),
            spin_axis_b: Unit::new_normalize(Vector3::z() * self.axis_sign),
            spin_inertia_kg_m2,
            max_torque_n_m: 80.0 * spin_inertia_kg_m2,
            max_speed_rad_s: 800.0,
            viscous_friction_n_m_s,
            coulomb_friction_n_m,
        }];
        let sensors = &mut model.sensors;
        sensors.rate_hz = self.rate_hz;
        sensors.accelerometer.fitted = false;
        let gyro = &mut sensors.gyro.errors;
        (gyro.noise_stddev, gyro.range) = (Vector3::repeat(GYRO_RAD_S), 100.0);
        (gyro.bias_turn_on_stddev, gyro.bias_walk) = (Vector3::repeat(0.005), Vector3::zeros());
        sensors.wheel_speed.noise_stddev_rad_s = TACHOMETER_RAD_S;
        sensors.wheel_speed.quantum_rad_s = 0.0;
        model
    }

    /// A minute and a half; the wheel reverses many times.
    fn run(&self, seed: u64) -> Recording {
        let mut random = Pcg64::new(u128::from(seed).wrapping_mul(0x9e37_79b9_7f4a_7c15_f39c), 12);
        let mut normal = || -> f64 { StandardNormal.sample(&mut random) };
        let (spin, viscous, dry) = self.wheel();
        let (viscous, dry) = (viscous * self.viscous, dry * self.dry);
        let body = self.inertia_kg_m2 - spin;
        let mut r = Recording { name: format!("run_{seed}"), ..Recording::default() };
        r.no_gyro_axis = [true, true, false];
        let (mut rate, mut speed) = (0.2, 30.0);
        let step_s = 1.0 / self.rate_hz;
        for k in 0..(90.0 * self.rate_hz) as usize {
            let t = k as f64 * step_s;
            r.gyro_b_rad_s.time_s.push(t);
            r.gyro_b_rad_s.value.push(Vector3::new(0.0, 0.0, rate + GYRO_RAD_S * normal()));
            r.wheel_speed_rad_s.time_s.push(t);
            r.wheel_speed_rad_s.value.push(vec![speed + TACHOMETER_RAD_S * normal()]);
            let command = spin * 30.0 * (0.4 * t + seed as f64).sin();
            r.wheel_torque_command_n_m.time_s.push(t);
            r.wheel_torque_command_n_m.value.push(vec![command]);
            // Steps so short that where the wheel reverses does not matter.
            for _ in 0..100 {
                let h = step_s / 100.0;
                let motor = command - viscous * speed - dry * f64::signum(speed);
                rate -= self.axis_sign * motor / body * h;
                speed += (motor / spin + motor / body) * h;
            }
        }
        r
    }
}

#[test]
fn friction_of_a_wheel_is_refitted_within_its_prior() {
    let tables = [
        TURNTABLE,
        Turntable { axis_sign: -1.0, viscous: 1.25, dry: 0.8, ..TURNTABLE },
        Turntable { inertia_kg_m2: 5.2e-4, viscous: 1.3, dry: 1.2, ..TURNTABLE },
        Turntable { inertia_kg_m2: 8.0, rate_hz: 25.0, viscous: 0.7, dry: 0.9, ..TURNTABLE },
    ];
    for (seed, table) in (1..).zip(tables) {
        let (training, held_out) = ([table.run(10 * seed)], [table.run(10 * seed + 1)]);
        let model = table.model();
        let (_, viscous, dry) = table.wheel();
        let mut prior = ModelPrior::typical(&model);
        prior.actuators.wheels.viscous_friction_n_m_s = vec![KNOWN * viscous];
        prior.actuators.wheels.coulomb_friction_n_m = vec![KNOWN * dry];
        let case = Case { training: &training, held_out: &held_out, model: &model, prior: &prior };
        let options = Options::default();
        let Adoption { versions, .. } = adopt(&case, &[], &options, &mut |_, _| {}).unwrap();
        let error = |k: usize, held_out| versions[k].prediction_error(held_out).unwrap();
        let said = format!(
            "{table:?}: as given {:.3}, refitted {:.3}, held out {:.3}",
            error(0, false),
            error(1, false),
            error(1, true)
        );
        println!("measured: {said}");
        assert!(error(0, false) > 1.2 && error(1, false) < 1.08 && error(1, true) < 1.08, "{said}");
        let fit = versions[1].fit.as_ref().unwrap();
        // What the fit has handed on says what a look at the run from nothing says.
        let anew = whorl_validation::compare(&training[0], &fit.model, None).unwrap();
        let anew = whorl_validation::prediction_error([&anew]).unwrap();
        assert!((error(1, false) / anew - 1.0).abs() < 0.01, "{said}, anew {anew:.3}");
        let (found, known) = (&fit.model.wheels()[0], &fit.prior.actuators.wheels);
        let off = [
            (found.viscous_friction_n_m_s - viscous * table.viscous) / known.viscous_friction_n_m_s[0],
            (found.coulomb_friction_n_m - dry * table.dry) / known.coulomb_friction_n_m[0],
        ];
        assert!(off.iter().all(|z| z.abs() < 3.3), "{said}: {off:?} deviations off");
    }
}
