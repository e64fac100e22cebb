//! One cell after the other: the filter, what it learns of motors and constants, and the evidence.

use whorl_dynamics::gyrostat::MAX_WHEELS;
use whorl_dynamics::{ModelPrior, Plant, PlantError, PlatformModel};
use whorl_prediction::{Disturbance, Push, RandomTorque, Recursive};
use whorl_recording::Channel;

use crate::Settings;
use crate::cell::{Cell, Driven, Inputs, Motion, ns};
use crate::directions::Directions;
use crate::evidence::{Evidence, ln_sum};
use crate::fit::{Fit, START_EVERY_S, State};

/// Starts that are followed at once: what broke longer ago than two minutes is for the diagnosis to find.
const STARTS: usize = 3;
/// Time over which the background torque forgets itself \[s\].
const BACKGROUND_S: f64 = 20.0;
/// What one pulse of a jet may differ from the next, and a motor's torque from one moment to the next, relative.
const PULSE: f64 = 0.02;
const MOTOR: f64 = 0.01;
/// Slow torque on a wheel that the model need not know (friction warms up, a drive has a bias), over its largest: half a small wheel's friction.
const WHEEL_TORQUE: f64 = 1e-3;
/// White noise of a motor's torque, over its largest torque [sqrt(s)], where learning begins; it ends after so many seconds \[s\], and an innovation
/// moves the logarithm of its variance by so much times the square less one, which is at most so large, down to a thirtieth of the noise.
pub(crate) const MOTOR_NOISE_SQRT_S: f64 = 1e-3;
const LEARNED_S: f64 = 60.0;
const LEARNING: f64 = 0.05;
const LARGEST_SQUARE: f64 = 9.0;
const LEAST_LN_NOISE: f64 = -7.0;
/// A wheel slower than this may stick or turn back [rad/s], and for so long at a time \[s\].
const SLOW_RAD_S: f64 = 1.0;
const STICKING_S: f64 = 5.0;
/// A wheel slower than this rests [rad/s] while its motor asks for less than this share of its bearing's friction: that holds
/// it even where it is half of what the model says. What it may yet move by in a cell [rad/s].
const RESTING_RAD_S: f64 = 0.1;
const HELD_SHARE: f64 = 0.5;
const HELD_RAD_S: f64 = 1e-3;
/// Constants of the platform may wander through their prior in this time \[s\].
const CONSTANTS_S: f64 = 3600.0;
/// Uncertainty of a motion of which nothing is known: rate [rad/s], wheel speed [rad/s].
const ANY_RATE_RAD_S: f64 = 0.2;
const ANY_SPEED_RAD_S: f64 = 20.0;
/// Cells after a gap in which the motion is found, before anything is concluded.
const SETTLING: u32 = 10;

pub(crate) struct Watch {
    directions: Directions,
    filter: Recursive,
    /// ln of the variance of the motors' noise over that at first, and how long it was learned \[s\].
    pub ln_motor_noise: f64,
    learned_s: f64,
    evidence: Evidence,
    limit_nats: f64,
    settling: u32,
    pub newest: Fit,
}

impl Watch {
    pub fn new(model: &PlatformModel, prior: &ModelPrior, settings: &Settings) -> Result<Self, PlantError> {
        let torque_n_m = settings.background_torque_n_m;
        let directions = Directions::of(model, prior, torque_n_m)?;
        let plant = Driven::new(model, None, 0, &Motion::default())?.plant;
        let disturbance = Disturbance {
            body: vec![RandomTorque { stddev_b_n_m: [torque_n_m; 3], correlation_s: BACKGROUND_S }],
            motors_n_m: model.wheels().iter().map(|wheel| WHEEL_TORQUE * wheel.max_torque_n_m).collect(),
            motors_correlation_s: BACKGROUND_S,
        };
        let (evidence, pairs) = Evidence::new(&directions);
        let parameters = (directions.constants, directions.all.len());
        Ok(Self {
            filter: Recursive::new(&directions.gyrostat, &plant, &disturbance, parameters, pairs),
            directions,
            ln_motor_noise: 0.0,
            learned_s: 0.0,
            evidence,
            limit_nats: settings.limit_nats(),
            settling: SETTLING,
            newest: Fit::default(),
        })
    }

    /// How well the model fits now, if the motion is known; squares begin anew.
    pub fn fit(&mut self, is_known: bool) -> Fit {
        let (starts, newest) = (&self.filter.starts, &mut self.newest);
        let terms = self.evidence.terms(starts);
        newest.ln_evidence = ln_sum(terms.iter().copied());
        newest.state = if newest.state == State::Mismatch || newest.ln_evidence >= self.limit_nats {
            State::Mismatch
        } else if !is_known || self.settling > 0 {
            State::Waiting
        } else if newest.ln_evidence >= 0.5 * self.limit_nats {
            State::Doubt
        } else {
            State::Agrees
        };
        let likeliest = || self.evidence.likeliest(&terms, starts, &self.directions.all);
        newest.likeliest = (newest.state == State::Mismatch).then(likeliest).flatten();
        newest.hole = newest.hole.take().filter(|_| newest.state == State::Waiting);
        let fit = newest.clone();
        newest.squares = (0.0, 0);
        fit
    }

    /// The motion is unknown: after a gap in the data. What was learned of constants and sensors stays.
    pub fn forget_motion(&mut self) {
        self.filter.forget_motion(ANY_RATE_RAD_S, ANY_SPEED_RAD_S);
        self.settling = SETTLING;
    }

    /// Takes the platform through a cell that ends at `end_ns`, with the inputs until then; false where the motion is lost.
    pub fn cell(&mut self, driven: &mut Driven, inputs: &mut Inputs, end_ns: i64) -> bool {
        let start_ns = driven.plant.now_ns();
        let Ok(cell) = driven.pass(inputs, end_ns) else { return false };
        let readings = driven.readings(&cell);
        if readings.is_empty() {
            return false;
        }
        self.settling = self.settling.saturating_sub(1);
        let (settled, last) = (self.settling == 0, self.filter.starts.last());
        if settled && last.is_none_or(|last| start_ns - last.start_ns >= ns(START_EVERY_S)) {
            self.filter.begin(start_ns, STARTS);
        }
        let state = driven.in_state(&cell);
        let does: Vec<_> = self.directions.all.iter().map(|of| of.moved.in_state(&state)).collect();
        let (random, free) = self.random(&driven.plant, &cell);
        let wandered = settled.then_some(cell.length_s / CONSTANTS_S);
        if !self.filter.pass(&mut driven.plant, end_ns - start_ns, &does, &random, &readings, wandered) {
            return false;
        }
        let (newest, mut has_learned) = (&mut self.newest, false);
        newest.stamp_ns = Some(end_ns);
        newest.whitened.clear();
        for (reading, y) in readings.iter().zip(self.filter.innovations()) {
            newest.whitened.push((reading.component, y));
            if settled {
                newest.squares = (newest.squares.0 + y * y, newest.squares.1 + 1);
            }
            let is_free = reading.component.channel == Channel::WheelSpeed && free[reading.component.index()];
            if is_free && settled && self.learned_s < LEARNED_S {
                let step = LEARNING * ((y * y).min(LARGEST_SQUARE) - 1.0);
                self.ln_motor_noise = (self.ln_motor_noise + step).max(LEAST_LN_NOISE);
                has_learned = true;
            }
        }
        self.learned_s += if has_learned { cell.length_s } else { 0.0 };
        true
    }

    /// Impulses by which pulses and motors may differ from what was commanded, one standard deviation each; and which wheels turn freely.
    fn random(&self, plant: &Plant, cell: &Cell) -> (Vec<Push>, [bool; MAX_WHEELS]) {
        let model = self.directions.gyrostat.model();
        let jets = model.jets().iter().zip(&cell.valve_fraction).filter(|(_, share)| **share > 0.0);
        let jets = jets.map(|(jet, share)| Push::Body(jet.torque_b_n_m() * (share * cell.length_s * PULSE)));
        let (mut random, mut free): (Vec<Push>, _) = (jets.collect(), [false; MAX_WHEELS]);
        for (j, wheel) in model.wheels().iter().take(MAX_WHEELS).enumerate() {
            let (speed_rad_s, torque_n_m) = (plant.state().wheel_speed_rad_s()[j], cell.wheel_torque_n_m[j]);
            let friction_n_m = wheel.coulomb_friction_n_m;
            let rests = speed_rad_s.abs() < RESTING_RAD_S && torque_n_m.abs() < HELD_SHARE * friction_n_m;
            if rests {
                random.push(Push::Wheel(j, HELD_RAD_S * wheel.spin_inertia_kg_m2));
                continue;
            }
            // Nobody knows which way the friction of a slow one points.
            let doubtful_n_m = if speed_rad_s.abs() < SLOW_RAD_S { friction_n_m } else { 0.0 };
            free[j] = doubtful_n_m == 0.0;
            let white = (MOTOR_NOISE_SQRT_S * wheel.max_torque_n_m).powi(2) * self.ln_motor_noise.exp();
            let asked = (torque_n_m * cell.length_s * MOTOR).powi(2);
            let density = white + doubtful_n_m * doubtful_n_m * STICKING_S;
            let variance = asked + density * cell.length_s + cell.wheel_impulse_variance[j];
            random.push(Push::Wheel(j, variance.sqrt()));
        }
        (random, free)
    }
}
