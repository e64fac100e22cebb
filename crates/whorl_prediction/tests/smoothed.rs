//! The torque that a model lacks is where the smoothed disturbance says, within its band: against rigs that are integrated here, by
//! their own equations and not by the plant.

#![expect(clippy::unwrap_used, reason = "a test stops at a broken precondition")]

use nalgebra::{Matrix3, Unit, Vector3};
use rand_distr::{Distribution, StandardNormal};
use rand_pcg::Pcg64;
use whorl_dynamics::platform::{TiltLimit, Wheel};
use whorl_dynamics::{Freedom, MassProperties, PlatformModel};
use whorl_prediction::{Noise, Prepared, Settings, SmoothedState, follow, smoothed};
use whorl_recording::{Mounting, Recording};

const SAMPLE_S: f64 = 0.01;

/// A table on a shaft along z with a wheel, or that wheel alone on a bench.
#[derive(Debug, Clone, Copy)]
struct Table {
    inertia_kg_m2: f64,
    spin_inertia_kg_m2: f64,
    /// Torque on the table that the model lacks, -c w |w| [N m s^2].
    drag_n_m_s2: f64,
    /// The same, first-order Markov over a second: standard deviation [N m].
    random_n_m: f64,
    /// Torque of the motor that the model lacks, -c times the wheel's speed [N m s].
    loss_n_m_s: f64,
    gyro_rad_s: f64,
    tachometer_rad_s: f64,
    /// Amplitude of the wheel's torque [N m] and its rate [rad/s].
    torque_n_m: f64,
    wave_rad_s: f64,
    /// Of the wheel's axis against the table's.
    sign: f64,
    clamped: bool,
}

const TABLE: Table = Table {
    inertia_kg_m2: 2.0,
    spin_inertia_kg_m2: 0.05,
    drag_n_m_s2: 0.0,
    random_n_m: 0.0,
    loss_n_m_s: 0.0,
    gyro_rad_s: 2e-3,
    tachometer_rad_s: 0.05,
    torque_n_m: 0.5,
    wave_rad_s: 0.8,
    sign: 1.0,
    clamped: false,
};

impl Table {
    fn model(&self) -> PlatformModel {
        let mut model = PlatformModel::whorl_1_reference();
        let inertia = Matrix3::identity() * self.inertia_kg_m2;
        model.mass_properties = MassProperties::new(inertia, Vector3::zeros(), 10.0).unwrap();
        model.freedom =
            if self.clamped { Freedom::Clamped } else { Freedom::Hinge { axis_b: Vector3::z_axis() } };
        model.tilt_limit = TiltLimit::NONE;
        model.jets_mut().clear();
        *model.wheels_mut() = vec![Wheel {
            name: "wheel".to_owned(),
            spin_axis_b: Unit::new_normalize(Vector3::z() * self.sign),
            spin_inertia_kg_m2: self.spin_inertia_kg_m2,
            max_torque_n_m: 10.0,
            max_speed_rad_s: 1e6,
            viscous_friction_n_m_s: 0.0,
            coulomb_friction_n_m: 0.0,
        }];
        let sensors = &mut model.sensors;
        sensors.accelerometer.fitted = false;
        let gyro = &mut sensors.gyro.errors;
        (gyro.bias_turn_on_stddev, gyro.bias_walk) = (Vector3::zeros(), Vector3::zeros());
        (gyro.noise_stddev, gyro.range) = (Vector3::repeat(self.gyro_rad_s), 1e3);
        sensors.wheel_speed.noise_stddev_rad_s = self.tachometer_rad_s;
        sensors.wheel_speed.quantum_rad_s = 0.0;
        model
    }

    /// Half a minute of it: what was recorded, and at each sample the torques that the model lacks, on table and motor.
    fn turned(&self, seed: u64) -> (Recording, Vec<[f64; 2]>) {
        let mut random = Pcg64::new(u128::from(seed).wrapping_mul(0x9e37_79b9_7f4a_7c15_f39c), 8);
        let mut normal = || -> f64 { StandardNormal.sample(&mut random) };
        let mut r = Recording { name: "table".to_owned(), ..Recording::default() };
        r.no_gyro_axis = [true, true, false];
        if self.clamped {
            r.mounting = Mounting::Clamped;
        }
        let (body, spin) = (self.inertia_kg_m2 - self.spin_inertia_kg_m2, self.spin_inertia_kg_m2);
        let (mut rate, mut speed) = (if self.clamped { 0.0 } else { 0.1 }, 5.0);
        let mut pushes = self.random_n_m * normal();
        let mut lacking = Vec::new();
        for k in 0..3000 {
            let t = f64::from(k) * SAMPLE_S;
            if !self.clamped {
                r.gyro_b_rad_s.time_s.push(t);
                r.gyro_b_rad_s.value.push(Vector3::new(0.0, 0.0, rate + self.gyro_rad_s * normal()));
            }
            r.wheel_speed_rad_s.time_s.push(t);
            r.wheel_speed_rad_s.value.push(vec![speed + self.tachometer_rad_s * normal()]);
            let command = self.torque_n_m * (self.wave_rad_s * t).sin();
            r.wheel_torque_command_n_m.time_s.push(t);
            r.wheel_torque_command_n_m.value.push(vec![command]);
            let of_table = |w: f64| pushes - self.drag_n_m_s2 * w * w.abs();
            let of_motor = |speed: f64| -self.loss_n_m_s * speed;
            lacking.push([of_table(rate), of_motor(speed)]);
            for _ in 0..10 {
                let h = 0.1 * SAMPLE_S;
                let slopes = |w: f64, speed: f64| {
                    let motor = command + of_motor(speed);
                    let table = if self.clamped { 0.0 } else { (of_table(w) - self.sign * motor) / body };
                    [table, motor / spin - self.sign * table]
                };
                // Heun's rule.
                let [a, b] = slopes(rate, speed);
                let [c, d] = slopes(rate + h * a, speed + h * b);
                rate += 0.5 * h * (a + c);
                speed += 0.5 * h * (b + d);
            }
            let kept = (-SAMPLE_S).exp();
            pushes = kept * pushes + self.random_n_m * (1.0 - kept * kept).sqrt() * normal();
        }
        (r, lacking)
    }

    /// How far the smoothed torque is from the true one, with its deviation [N m]: of the motor, or of the table.
    fn off(&self, seed: u64, of_motor: bool) -> Vec<(f64, f64)> {
        let (recording, lacking) = self.turned(seed);
        let model = self.model();
        let case = Prepared::new(&recording, &model, Settings::default()).unwrap();
        let followed = follow(&case, &Noise::stated(&case).unwrap());
        assert!(followed.noise.disturbance.is_some(), "{self:?}");
        let states = smoothed(&case, &followed.noise, &followed.fitted.start, 0.1).unwrap();
        assert_eq!(states.len(), 300);
        let of_state = |state: &SmoothedState| {
            let truth = lacking[(state.time_s / SAMPLE_S).round() as usize];
            if of_motor {
                (state.motor_torque_n_m[0] - truth[1], state.motor_torque_stddev_n_m[0])
            } else {
                (state.torque_b_n_m.z - truth[0], state.torque_covariance_b[(2, 2)].sqrt())
            }
        };
        states.iter().map(of_state).collect()
    }
}

/// Shares of true torques within 1, 2 and 2.58 deviations of the smoothed ones: of a normal distribution 0.68, 0.95, 0.99.
fn shares(off: &[(f64, f64)]) -> [f64; 3] {
    [1.0, 2.0, 2.576].map(|k| {
        let within = off.iter().filter(|(off, stddev)| off.abs() < k * stddev);
        within.count() as f64 / off.len() as f64
    })
}

/// A torque that comes and goes as the filter takes it to.
#[test]
fn a_random_torque_is_within_the_band_as_often_as_it_says() {
    let random = Table { random_n_m: 0.05, ..TABLE };
    let small =
        Table { inertia_kg_m2: 2e-3, spin_inertia_kg_m2: 5e-5, torque_n_m: 5e-4, random_n_m: 5e-5, ..TABLE };
    let tables = [
        random,
        Table { sign: -1.0, ..random },
        small,
        Table { gyro_rad_s: 2e-2, ..random },
        Table { wave_rad_s: 0.2, ..random },
        Table { random_n_m: 0.5, tachometer_rad_s: 1.0, ..random },
    ];
    let off: Vec<_> =
        (1..13).flat_map(|seed| tables[seed as usize % tables.len()].off(seed, false)).collect();
    let [one, two, three] = shares(&off);
    println!(
        "measured: {one:.3}, {two:.3}, {three:.3} of {} true torques within 1, 2, 2.58 deviations",
        off.len()
    );
    // Torques that follow each other belong together: these are hundreds of independent ones, a hundredth and two in a share of
    // 0.95 and 0.68.
    assert!((one - 0.683).abs() < 0.06 && (two - 0.954).abs() < 0.03 && (three - 0.99).abs() < 0.015);
}

/// Laws are steadier than such a torque, so that the band is on the safe side.
#[test]
fn drag_of_the_table_is_within_the_band() {
    let drag = Table { drag_n_m_s2: 0.5, ..TABLE };
    let tables = [
        drag,
        Table { sign: -1.0, ..drag },
        Table { inertia_kg_m2: 2e-3, spin_inertia_kg_m2: 5e-5, drag_n_m_s2: 5e-4, torque_n_m: 5e-4, ..drag },
        Table { gyro_rad_s: 2e-2, ..drag },
        Table { wave_rad_s: 0.2, ..drag },
        Table { wave_rad_s: 2.5, drag_n_m_s2: 3.0, ..drag },
    ];
    for (seed, table) in (1..).zip(tables) {
        let [one, two, _] = shares(&table.off(seed, false));
        assert!(one > 0.68 && two > 0.95, "{table:?}: {one} {two}");
    }
}

/// On a bench, and on a table that turns.
#[test]
fn losses_of_a_motor_are_within_the_band() {
    let lossy = Table { loss_n_m_s: 0.005, ..TABLE };
    let bench = Table { clamped: true, ..lossy };
    let tables = [
        bench,
        Table { sign: -1.0, ..bench },
        Table { spin_inertia_kg_m2: 5e-5, torque_n_m: 5e-4, loss_n_m_s: 5e-6, ..bench },
        Table { tachometer_rad_s: 0.5, ..bench },
        lossy,
        Table { sign: -1.0, ..lossy },
    ];
    for (seed, table) in (1..).zip(tables) {
        let [one, two, _] = shares(&table.off(seed, true));
        assert!(one > 0.68 && two > 0.95, "{table:?}: {one} {two}");
    }
}
