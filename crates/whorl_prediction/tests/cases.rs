//! Rigs of other people, simulated here by their own equations: what a fit says of them is right, whatever their size, rate, axes and signs.

#![expect(clippy::unwrap_used, reason = "a test stops at a broken precondition")]

use std::collections::BTreeMap;

use nalgebra::{Matrix3, Unit, Vector3};
use rand_distr::{Distribution, StandardNormal};
use rand_pcg::Pcg64;
use whorl_dynamics::platform::{TiltLimit, Wheel};
use whorl_dynamics::{Freedom, MassProperties, PlatformModel};
use whorl_prediction::{Fitted, Parameter, PredictionError, Prepared, Rival, Settings, fit};
use whorl_recording::{Mounting, Recording, Series, VectorChannel};

/// The most that one of a few dozen estimates is off, in its own deviations, by chance.
const MOST_STDDEVS: f64 = 3.3;

fn normals(seed: u64) -> impl FnMut(f64) -> f64 {
    // Streams of neighbouring states go together.
    let mut random = Pcg64::new(u128::from(seed + 1).wrapping_mul(0x9e37_79b9_7f4a_7c15_f39c), 9);
    move |stddev| {
        let z: f64 = StandardNormal.sample(&mut random);
        stddev * z
    }
}

fn stddev(found: &Fitted, i: usize) -> f64 {
    found.covariance[(i, i)].sqrt()
}

/// A wheel on a bench, held at a speed by a loop that acts on its noisy tachometer. The motor gives what is commanded, or a share of it.
#[derive(Debug, Clone, Copy)]
struct Held {
    spin_inertia_kg_m2: f64,
    /// Of the loop [1/s].
    gain_1_s: f64,
    tachometer_rad_s: f64,
    rate_hz: f64,
    axis_sign: f64,
    /// What the motor gives over what is commanded.
    constant: f64,
}

const HELD: Held = Held {
    spin_inertia_kg_m2: 0.004,
    gain_1_s: 0.6,
    tachometer_rad_s: 0.2,
    rate_hz: 100.0,
    axis_sign: 1.0,
    constant: 1.0,
};

/// Where fits begin: so far off that nobody could overlook it.
const WRONG: f64 = 0.3;

impl Held {
    fn model(&self) -> PlatformModel {
        let mut model = PlatformModel::whorl_1_reference();
        (model.freedom, model.tilt_limit) = (Freedom::Clamped, TiltLimit::NONE);
        model.jets_mut().clear();
        *model.wheels_mut() = vec![Wheel {
            name: "wheel".to_owned(),
            spin_axis_b: Unit::new_normalize(Vector3::x() * self.axis_sign),
            spin_inertia_kg_m2: self.spin_inertia_kg_m2,
            max_torque_n_m: 5.0 * self.spin_inertia_kg_m2,
            max_speed_rad_s: 314.0,
            viscous_friction_n_m_s: 0.0,
            coulomb_friction_n_m: 0.0,
        }];
        model.sensors.wheel_speed.noise_stddev_rad_s = self.tachometer_rad_s;
        model.sensors.wheel_speed.quantum_rad_s = 0.0;
        model
    }

    fn run(&self, seed: u64, reference_rad_s: f64) -> Recording {
        let mut normal = normals(seed);
        let (step_s, j) = (1.0 / self.rate_hz, self.spin_inertia_kg_m2);
        let mut r = Recording { name: "held".to_owned(), closed_loop: true, ..Recording::default() };
        r.mounting = Mounting::Clamped;
        let mut speed = reference_rad_s;
        for k in 0..9000 {
            let read = speed + normal(self.tachometer_rad_s);
            let command = (-self.gain_1_s * j * (read - reference_rad_s)).clamp(-5.0 * j, 5.0 * j);
            r.wheel_speed_rad_s.time_s.push(f64::from(k) * step_s);
            r.wheel_speed_rad_s.value.push(vec![read]);
            r.wheel_torque_command_n_m.time_s.push(f64::from(k) * step_s);
            r.wheel_torque_command_n_m.value.push(vec![command]);
            speed += self.constant * command / j * step_s;
        }
        r
    }

    /// The motor's constant, of which nothing is known before.
    fn fitted(&self, seed: u64) -> (f64, f64) {
        let runs: Vec<Recording> =
            [(0, 0.0), (1, 40.0), (2, -40.0)].map(|(k, at)| self.run(10 * seed + k, at)).into();
        let model_at = |at: &[f64]| {
            let mut model = self.model();
            let constants = BTreeMap::from([("wheel".to_owned(), at[0])]);
            model.effects.insert("wheel_motor_constant".to_owned(), constants);
            Some(model)
        };
        let free = [Parameter { stddev: f64::INFINITY, range: (-0.95, 2.0) }];
        let found =
            fit(&runs, &free, &model_at, &[vec![WRONG], vec![-WRONG]], Rival::NONE, &Settings::default())
                .unwrap();
        (1.0 + found.at[0], stddev(&found, 0))
    }
}

/// Commands are mostly the tachometer's noise: within a bin of samples they go with it, and only a likelihood sample by sample says that
/// the motor is as it should be.
#[test]
fn the_motor_of_a_wheel_that_its_loop_holds_is_what_it_is() {
    let benches = [
        HELD,
        Held { axis_sign: -1.0, ..HELD },
        Held { spin_inertia_kg_m2: 4e-7, ..HELD },
        Held { spin_inertia_kg_m2: 2.0, ..HELD },
        Held { rate_hz: 20.0, ..HELD },
        Held { rate_hz: 500.0, gain_1_s: 3.0, ..HELD },
        Held { gain_1_s: 3.0, ..HELD },
        Held { gain_1_s: 1.0, spin_inertia_kg_m2: 1e-5, ..HELD },
        Held { tachometer_rad_s: 1.0, ..HELD },
        Held { constant: 0.7, ..HELD },
        Held { constant: 1.5, gain_1_s: 2.0, ..HELD },
    ];
    for (seed, bench) in (1..).zip(benches) {
        let (constant, stddev) = bench.fitted(seed);
        println!("measured: motor constant {constant:.3} +- {stddev:.3} of {bench:?}");
        assert!(
            ((constant - bench.constant) / stddev).abs() < MOST_STDDEVS,
            "{bench:?}: {constant} +- {stddev}"
        );
        assert!(stddev < 0.5, "{bench:?}: {stddev}");
    }
}

/// A pendulum on a level shaft: the first of three axes hangs down, the third is the shaft.
#[derive(Debug, Clone, Copy)]
struct Pendulum {
    inertia_kg_m2: f64,
    weight_n_m: f64,
    friction_n_m_s: f64,
    from_rad: f64,
    rate_hz: f64,
    duration_s: f64,
    /// Columns are the three axes in the body's.
    axes: [[f64; 3]; 3],
    has_accelerometer: bool,
}

const X_DOWN: [[f64; 3]; 3] = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]];
const CUBE: Pendulum = Pendulum {
    inertia_kg_m2: 0.0074,
    weight_n_m: 0.66,
    friction_n_m_s: 0.0035,
    from_rad: 0.05,
    rate_hz: 200.0,
    duration_s: 10.0,
    axes: X_DOWN,
    has_accelerometer: false,
};
/// What is known of inertia and weight before, shares of them, and how far off the inertia is that is believed.
const KNOWN: f64 = 0.04;
const BELIEVED: f64 = 1.0135;

impl Pendulum {
    fn to_body(self, v: Vector3<f64>) -> Vector3<f64> {
        let [a, b, c] = self.axes.map(Vector3::from);
        a * v.x + b * v.y + c * v.z
    }

    /// With these shares more of inertia and weight, and this friction.
    fn model(self, inertia: f64, weight: f64, friction_n_m_s: f64) -> PlatformModel {
        let mut model = PlatformModel::whorl_1_reference();
        let inertia_b = Matrix3::identity() * (self.inertia_kg_m2 * inertia);
        let offset = self.to_body(Vector3::new(-self.weight_n_m * weight, 0.0, 0.0));
        model.mass_properties = MassProperties::new(inertia_b, offset, 0.77).unwrap();
        let axis_b = Unit::new_normalize(self.to_body(Vector3::z()));
        (model.freedom, model.tilt_limit) = (Freedom::Hinge { axis_b }, TiltLimit::NONE);
        model.jets_mut().clear();
        model.wheels_mut().clear();
        let sensors = &mut model.sensors;
        sensors.rate_hz = self.rate_hz;
        let gyro = &mut sensors.gyro.errors;
        (gyro.noise_stddev, gyro.range) = (Vector3::repeat(0.02), 1e3);
        (gyro.bias_turn_on_stddev, gyro.bias_walk) = (Vector3::repeat(0.01), Vector3::zeros());
        let force = &mut sensors.accelerometer;
        (force.fitted, force.lever_arm_b_m) = (self.has_accelerometer, Vector3::zeros());
        force.errors.noise_stddev = Vector3::repeat(0.05);
        (force.errors.bias_turn_on_stddev, force.errors.bias_walk) =
            (Vector3::repeat(0.02), Vector3::zeros());
        sensors.vector.as_mut().unwrap().noise_stddev_rad = 0.003;
        let friction = BTreeMap::from([("c_n_m_s".to_owned(), friction_n_m_s)]);
        model.effects.insert("bearing_viscous_friction".to_owned(), friction);
        model
    }

    /// I a'' = -W sin a - c a', by the midpoint rule in steps of at most 0.1 ms.
    fn swing(self, seed: u64) -> Recording {
        let mut normal = normals(seed);
        let slope =
            |a: f64, w: f64| (-self.weight_n_m * a.sin() - self.friction_n_m_s * w) / self.inertia_kg_m2;
        let sample_s = 1.0 / self.rate_hz;
        let steps = (sample_s / 1e-4).ceil();
        let h = sample_s / steps;
        let (mut a, mut w) = (self.from_rad, 0.0);
        let mut r = Recording { name: "swing".to_owned(), ..Recording::default() };
        let axis = self.to_body(Vector3::z());
        r.no_gyro_axis = [0, 1, 2].map(|i| axis[i].abs() < 1e-9);
        let mut directions = Vec::new();
        for k in 0..(self.duration_s * self.rate_hz) as usize {
            let t = k as f64 * sample_s;
            r.gyro_b_rad_s.time_s.push(t);
            let noise = Vector3::from_fn(|_, _| normal(0.02));
            let seen = Vector3::from_fn(|i, _| f64::from(u8::from(!r.no_gyro_axis[i])));
            r.gyro_b_rad_s.value.push((axis * w + noise).component_mul(&seen));
            let up = self.to_body(Vector3::new(a.cos(), -a.sin(), 0.0));
            let noise = Vector3::from_fn(|_, _| normal(1.0));
            if self.has_accelerometer {
                r.specific_force_b_m_s2.time_s.push(t);
                r.specific_force_b_m_s2.value.push(up * whorl_math::GRAVITY_M_S2 + noise * 0.05);
            } else {
                directions.push((t, Unit::new_normalize(up + up.cross(&noise) * 0.003).into_inner()));
            }
            for _ in 0..steps as usize {
                let (am, wm) = (a + 0.5 * h * w, w + 0.5 * h * slope(a, w));
                (a, w) = (a + h * wm, w + h * slope(am, wm));
            }
        }
        if !self.has_accelerometer {
            let direction_b = directions.into_iter().collect();
            r.vectors.push(VectorChannel { reference_world: Vector3::z_axis(), direction_b });
        }
        r
    }

    /// Friction beside inertia and weight, which are known to some per cent: what it is and its deviation, over the true one.
    fn fitted(self, seed: u64) -> (f64, f64) {
        let unit_n_m_s = 2.0 * self.friction_n_m_s;
        let model_at = |at: &[f64]| {
            let friction = unit_n_m_s * at[2];
            Some(self.model(BELIEVED * (1.0 + KNOWN * at[0]), 1.0 + KNOWN * at[1], friction))
        };
        let known = Parameter { stddev: 1.0, range: (-5.0, 5.0) };
        let friction = Parameter { stddev: 1.0, range: (0.0, 20.0) };
        let runs = [self.swing(seed)];
        let found = fit(
            &runs,
            &[known, known, friction],
            &model_at,
            &[vec![0.0; 3]],
            Rival::NONE,
            &Settings::default(),
        )
        .unwrap();
        assert!(found.log_posterior >= found.log_posterior_before, "{self:?}");
        let scale = unit_n_m_s / self.friction_n_m_s;
        (found.at[2] * scale, stddev(&found, 2) * scale)
    }
}

#[test]
fn friction_of_a_pendulum_is_what_it_is() {
    let pendulums = [
        CUBE,
        Pendulum { has_accelerometer: true, ..CUBE },
        Pendulum { from_rad: 0.6, ..CUBE },
        Pendulum { from_rad: -0.05, ..CUBE },
        // The shaft along x, y, and askew; hanging by other faces.
        Pendulum { axes: [[0.0, 1.0, 0.0], [0.0, 0.0, 1.0], [1.0, 0.0, 0.0]], ..CUBE },
        Pendulum {
            axes: [[0.0, 0.0, -1.0], [-1.0, 0.0, 0.0], [0.0, 1.0, 0.0]],
            has_accelerometer: true,
            ..CUBE
        },
        Pendulum { axes: [[1.0, 0.0, 0.0], [0.0, 0.8, -0.6], [0.0, 0.6, 0.8]], ..CUBE },
        Pendulum { rate_hz: 50.0, ..CUBE },
        Pendulum { friction_n_m_s: 6e-4, from_rad: 0.25, duration_s: 20.0, rate_hz: 100.0, ..CUBE },
        // A heavy one at 0.3 Hz.
        Pendulum {
            inertia_kg_m2: 8.0,
            weight_n_m: 30.0,
            friction_n_m_s: 2.0,
            from_rad: 0.25,
            rate_hz: 20.0,
            duration_s: 40.0,
            ..CUBE
        },
        // 5 Hz.
        Pendulum { inertia_kg_m2: 6e-4, friction_n_m_s: 4e-4, rate_hz: 500.0, duration_s: 4.0, ..CUBE },
    ];
    for (seed, pendulum) in (1..).zip(pendulums) {
        let (friction, stddev) = pendulum.fitted(seed);
        println!("measured: friction {friction:.3} +- {stddev:.3} of the true one, {pendulum:?}");
        assert!(((friction - 1.0) / stddev).abs() < MOST_STDDEVS, "{pendulum:?}: {friction} +- {stddev}");
        assert!(stddev < 0.15, "{pendulum:?}: {stddev}");
    }
}

/// A column too many or too few of speeds or commands is another platform's, whatever else was recorded.
#[test]
fn recordings_of_other_numbers_of_wheels_are_refused() {
    let model = PlatformModel::whorl_1_reference();
    let series = |columns: usize| Series { time_s: vec![0.0, 0.01], value: vec![vec![1.0; columns]; 2] };
    let gyro = Series { time_s: vec![0.0, 0.01], value: vec![Vector3::x(); 2] };
    let run = Recording { name: "run".to_owned(), gyro_b_rad_s: gyro, ..Recording::default() };
    let speeds = |columns| Recording { wheel_speed_rad_s: series(columns), ..run.clone() };
    let commands = |columns| Recording { wheel_torque_command_n_m: series(columns), ..run.clone() };
    let refused = |run: &Recording| Prepared::new(run, &model, Settings::default()).err();
    for columns in [1, 2, 4, 9] {
        for run in [speeds(columns), commands(columns)] {
            let error = refused(&run).unwrap();
            assert!(matches!(error, PredictionError::Refused(_)), "{error}");
            let said = format!("run: {columns} wheels in the data, 3 in the model");
            assert!(error.to_string().starts_with(&said), "{error}");
        }
    }
    assert_eq!(refused(&speeds(3)), None);
    assert_eq!(refused(&commands(3)), None);
}
