//! One cell after the other: the filter, what it learns of motors and constants, and the evidence.

use std::fmt;

use nalgebra::{DVector, UnitQuaternion, Vector3};
use whorl_dynamics::gyrostat::MAX_WHEELS;
use whorl_dynamics::plant::RATE;
use whorl_dynamics::{ModelPrior, Plant, PlatformModel};
use whorl_prediction::{Disturbance, RandomTorque, Reading, Recursive};
use whorl_recording::Channel;

use crate::Settings;
use crate::cells::{Cell, Driven, Inputs, Supplies};
use crate::directions::Directions;
use crate::error::MonitorError;
use crate::evidence::Evidence;
use crate::fit::Likeliest;
use crate::motors::{HELD_RAD_S, MotorNoise, STICKING_S, Turning};

/// How the coordinates of the plant move by a torque of each motor [unit/s per N m].
type ByMotor = Vec<Vec<f64>>;

/// Uncertainty of a motion of which nothing is known: rate [rad/s], wheel speed [rad/s].
const ANY_RATE_RAD_S: f64 = 0.2;
const ANY_SPEED_RAD_S: f64 = 20.0;
/// Slow torque on a wheel that the model need not know (friction that warms up, a bias of its drive), over its largest
/// torque: a per mille, half of the bearing friction of a small wheel.
const WHEEL_TORQUE: f64 = 1e-3;
/// Cells after a gap in which the motion is found, before anything is concluded.
const SETTLING: u32 = 10;
/// Windows from one start to the next.
const WINDOWS: f64 = 8.0;

/// What is published of the newest cells.
#[derive(Debug, Clone)]
pub(crate) struct Newest {
    pub end_ns: Option<i64>,
    /// Innovations over their deviations, less what is known of the platform's constants.
    pub gyro: Vector3<f64>,
    pub wheel_speed: Vec<f64>,
    /// Sum of their squares since it was asked for, and their number.
    pub squares: (f64, u32),
}

/// The filter and what is concluded.
pub(crate) struct Watch {
    model: PlatformModel,
    settings: Settings,
    directions: Directions,
    filter: Recursive,
    pub motors: MotorNoise,
    pub evidence: Evidence,
    settling: u32,
    /// Begin of the present window \[ns\].
    window_ns: Option<i64>,
    newest: Newest,
}

impl fmt::Debug for Watch {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Watch").field("evidence", &self.evidence).finish_non_exhaustive()
    }
}

impl Watch {
    pub fn new(model: &PlatformModel, prior: &ModelPrior, settings: &Settings) -> Result<Self, MonitorError> {
        let directions = Directions::of(model, prior, settings)?;
        let plant = Driven::new(model, &Supplies::default(), 0, ns(settings.bin_s))?.plant;
        let torque = settings.background_torque_n_m;
        let disturbance = Disturbance {
            body: vec![RandomTorque { stddev_b_n_m: [torque; 3], correlation_s: settings.background_time_s }],
            motors_n_m: model.wheels().iter().map(|wheel| WHEEL_TORQUE * wheel.max_torque_n_m).collect(),
            motors_correlation_s: settings.background_time_s,
        };
        // Of ways that are not constants: how far their columns are apart.
        let effects =
            directions.ways.iter().filter(|(_, way)| way.iter().all(|k| *k >= directions.constants));
        let width =
            |way: &[usize]| way.iter().max().zip(way.iter().min()).map_or(0, |(last, first)| last - first);
        let apart = effects.map(|(_, way)| width(way)).max().unwrap_or(0);
        let parameters = (directions.constants, directions.all.len());
        let mut filter = Recursive::new(
            &directions.gyrostat,
            &plant,
            &disturbance,
            whorl_prediction::Settings::default(),
            parameters,
            apart + 1,
        );
        let gyro = &model.sensors.gyro.errors;
        for (axis, i) in filter.layout().gyro_bias().enumerate() {
            let bias = gyro.bias_turn_on_stddev[axis].max(gyro.one_sample_stddev()[axis]);
            filter.set_variance(i, bias * bias);
        }
        let newest = Newest {
            end_ns: None,
            gyro: Vector3::repeat(f64::NAN),
            wheel_speed: vec![f64::NAN; model.wheels().len()],
            squares: (0.0, 0),
        };
        Ok(Self {
            evidence: Evidence::new(&directions, filter.layout().size(), settings),
            motors: MotorNoise::new(settings.motor_noise_learned_s),
            model: model.clone(),
            settings: settings.clone(),
            directions,
            filter,
            settling: SETTLING,
            window_ns: None,
            newest,
        })
    }

    /// The likeliest single effect.
    pub fn likeliest(&self) -> Option<Likeliest> {
        self.evidence.likeliest(&self.directions.all)
    }

    /// The motion is found, so that something can be concluded.
    pub fn is_settled(&self) -> bool {
        self.settling == 0
    }

    /// The newest cells; squares begin anew.
    pub fn newest(&mut self) -> Newest {
        let newest = self.newest.clone();
        self.newest.squares = (0.0, 0);
        newest
    }

    /// See [`Evidence::clear`].
    pub fn forget(&mut self) {
        self.window_ns = None;
        self.evidence.clear();
        self.filter.window(&[]);
    }

    /// The motion is unknown: after a gap in the data. What was learned of constants and sensors stays.
    pub fn forget_motion(&mut self) {
        self.end_window();
        let plant = self.filter.layout().plant;
        self.evidence.forget_motion(plant.size());
        for i in RATE {
            self.filter.set_variance(i, ANY_RATE_RAD_S * ANY_RATE_RAD_S);
        }
        for i in plant.wheels() {
            self.filter.set_variance(i, ANY_SPEED_RAD_S * ANY_SPEED_RAD_S);
        }
        self.settling = SETTLING;
    }

    /// Takes the platform through a cell that ends at `end_ns`, with the inputs until then; false where the motion is lost.
    pub fn cell(
        &mut self,
        driven: &mut Driven,
        q_world_body: &UnitQuaternion<f64>,
        inputs: &mut Inputs,
        end_ns: i64,
    ) -> bool {
        let state = *driven.plant.state();
        let wheels = self.model.wheels().len().min(MAX_WHEELS);
        let speeds = &state.wheel_speed_rad_s()[..wheels];
        if driven.plant.set_motion(q_world_body, &state.omega_wb_b_rad_s, speeds).is_err() {
            return false;
        }
        let start_ns = driven.plant.now_ns();
        let by_motor = self.by_motor(&driven.plant);
        let Ok(cell) = driven.pass(inputs, end_ns) else { return false };
        let readings = cell.readings(&self.model.sensors);
        if readings.is_empty() {
            return false;
        }
        self.settling = self.settling.saturating_sub(1);
        if self.is_settled() && self.window_ns.is_none() {
            self.filter.window(&[]);
            self.evidence.begin(start_ns);
            self.window_ns = Some(start_ns);
        }
        let half_ns = (end_ns - start_ns) / 2;
        self.filter.rest();
        if self.window_ns.is_some() {
            // What parameters do in the cell.
            let state = cell.in_state(&driven.plant);
            for (k, direction) in self.directions.all.iter().enumerate() {
                self.filter.push(&driven.plant, k, &direction.in_state(&state), half_ns as f64 * 1e-9);
            }
        }
        self.filter.follow(&driven.plant, half_ns);
        let noise = self.add_random(&driven.plant, &cell, &by_motor);
        if !self.filter.take_in(&readings) {
            return false;
        }
        self.conclude(&cell, &readings, &noise, end_ns);
        self.add_random(&driven.plant, &cell, &by_motor);
        self.filter.follow(&driven.plant, end_ns - start_ns - half_ns);
        self.filter.move_plant(&mut driven.plant);
        let window_s = self.settings.start_every_s / WINDOWS;
        if self.window_ns.is_some_and(|begin_ns| end_ns - begin_ns >= ns(window_s) - half_ns) {
            self.end_window();
        }
        true
    }

    fn by_motor(&self, plant: &Plant) -> ByMotor {
        (0..self.model.wheels().len().min(MAX_WHEELS))
            .map(|j| {
                let mut unit = [0.0; MAX_WHEELS];
                unit[j] = 1.0;
                self.filter.rates_by_torque(plant, Vector3::zeros(), &unit).to_vec()
            })
            .collect()
    }

    fn end_window(&mut self) {
        if let Some((begin_ns, end_ns)) = self.window_ns.take().zip(self.newest.end_ns) {
            let window = self.filter.window(self.evidence.pairs());
            self.evidence.add(&window, (end_ns - begin_ns) as f64 * 1e-9);
        }
    }

    /// Pulses and motors are not quite what was commanded: half of it, as for half of a cell. The variance that the noise of its motor gives
    /// each wheel's speed over a cell, where the wheel turns freely.
    fn add_random(&mut self, plant: &Plant, cell: &Cell, by_motor: &[Vec<f64>]) -> [Option<f64>; MAX_WHEELS] {
        let (settings, half) = (&self.settings, 0.5_f64.sqrt());
        for (jet, share) in
            self.model.jets().iter().zip(&cell.valve_fraction).filter(|(_, share)| **share > 0.0)
        {
            let impulse = jet.torque_b_n_m() * (share * cell.length_s * settings.pulse_relative_sigma * half);
            let change = self.filter.rates_by_torque(plant, impulse, &[]);
            self.filter.add_random(&change);
        }
        let mut noise = [None; MAX_WHEELS];
        let first = self.filter.layout().plant.wheels().start;
        for (j, wheel) in self.model.wheels().iter().enumerate().take(MAX_WHEELS) {
            let turning = Turning::of(wheel, cell.wheel_speed_rad_s[j], cell.wheel_torque_n_m[j]);
            if turning == Turning::Held {
                let mut change = vec![0.0; first + j + 1];
                change[first + j] = HELD_RAD_S * half;
                self.filter.add_random(&change);
                continue;
            }
            let asked = cell.wheel_torque_n_m[j] * cell.length_s * settings.motor_relative_sigma;
            let white = settings.motor_noise_sqrt_s * wheel.max_torque_n_m;
            let white = white * white * self.motors.share() * cell.length_s;
            let friction = if turning == Turning::Slowly { wheel.coulomb_friction_n_m } else { 0.0 };
            let sticking = friction * friction * STICKING_S * cell.length_s;
            let variance = asked * asked + white + sticking + cell.wheel_impulse_variance[j];
            let change: Vec<f64> = by_motor[j].iter().map(|x| x * half * variance.sqrt()).collect();
            self.filter.add_random(&change);
            noise[j] = (turning == Turning::Freely).then(|| by_motor[j][first + j].powi(2) * white);
        }
        noise
    }

    /// What the innovations of a cell say.
    fn conclude(
        &mut self,
        cell: &Cell,
        readings: &[Reading],
        motor_noise: &[Option<f64>; MAX_WHEELS],
        end_ns: i64,
    ) {
        let constants = self.evidence.constants();
        let follows = self.window_ns.is_some();
        let states = self.filter.layout().size();
        let newest = &mut self.newest;
        newest.end_ns = Some(end_ns);
        newest.gyro.fill(f64::NAN);
        newest.wheel_speed.fill(f64::NAN);
        let mut of_wheels = Vec::new();
        for (r, (reading, mut y)) in readings.iter().zip(self.filter.innovations()).enumerate() {
            if follows {
                let by_state = DVector::from_fn(states, |i, _| self.filter.of_state(r, i));
                let (mean, more) = constants.expected(&by_state, &|k| self.filter.of_parameter(r, k));
                y = (y - mean) / (1.0 + more).sqrt();
                newest.squares = (newest.squares.0 + y * y, newest.squares.1 + 1);
            }
            let index = reading.component.index();
            if reading.component.channel == Channel::Gyro {
                newest.gyro[index] = y;
            } else {
                newest.wheel_speed[index] = y;
                of_wheels.extend(motor_noise[index].map(|noise| (y, noise, reading.variance)));
            }
        }
        if follows {
            self.motors.learn(cell.length_s, of_wheels.into_iter());
        }
    }
}

fn ns(seconds: f64) -> i64 {
    (seconds * 1e9).round() as i64
}
