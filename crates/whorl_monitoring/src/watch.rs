//! One cell after the other: the filter, what it learns of motors and constants, and the evidence.
//!
//! No data sheet states the white noise of a motor's torque, and a filter that allows too much of it is slow to see what else
//! happens to a wheel. So its level is learned in the first part of a run: each innovation of a wheel that turns freely moves its logarithm
//! a little, until they have unit variance. It acts on later readings only, so that innovations stay white and the evidence a likelihood ratio.

use nalgebra::Vector3;
use whorl_dynamics::gyrostat::MAX_WHEELS;
use whorl_dynamics::platform::Wheel;
use whorl_dynamics::{ModelPrior, Plant, PlantError, PlatformModel};
use whorl_prediction::{Disturbance, RandomTorque, Reading, Recursive};
use whorl_recording::Channel;

use crate::Settings;
use crate::cell::{Cell, Driven, Inputs, Motion, ns};
use crate::directions::Directions;
use crate::evidence::{Evidence, ln_sum};
use crate::fit::{Fit, MonitorError, START_EVERY_S, State};

/// Starts that are followed at once: what broke longer ago than two minutes is for the diagnosis to find.
const STARTS: usize = 4;
/// Time over which the background torque forgets itself \[s\].
const BACKGROUND_S: f64 = 20.0;
/// What one pulse of a jet may differ from the next, and a motor's torque from one moment to the next, relative.
const PULSE: f64 = 0.02;
const MOTOR: f64 = 0.01;
/// Slow torque on a wheel that the model need not know (friction that warms up, a bias of its drive), over its largest
/// torque: a per mille, half of the bearing friction of a small wheel.
const WHEEL_TORQUE: f64 = 1e-3;
/// White noise of a motor's torque, over its largest torque [sqrt(s)], where learning begins; it ends after so many seconds \[s\], and an innovation
/// moves the logarithm of its variance by so much times the square less one, which is at most so large, down to a thirtieth of the noise.
const MOTOR_NOISE_SQRT_S: f64 = 1e-3;
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

/// The filter and what is concluded.
pub(crate) struct Watch {
    model: PlatformModel,
    directions: Directions,
    filter: Recursive,
    /// ln of the variance of the motors' noise over that at first, and how long it was learned \[s\].
    ln_motor_noise: f64,
    learned_s: f64,
    evidence: Evidence,
    limit_nats: f64,
    alarmed: bool,
    settling: u32,
    newest: Fit,
}

impl Watch {
    pub fn new(model: &PlatformModel, prior: &ModelPrior, settings: &Settings) -> Result<Self, MonitorError> {
        let torque_n_m = settings.background_torque_n_m;
        let directions = Directions::of(model, prior, torque_n_m).map_err(PlantError::from)?;
        let plant = Driven::new(model, None, 0, &Motion::default())?.plant;
        let disturbance = Disturbance {
            body: vec![RandomTorque { stddev_b_n_m: [torque_n_m; 3], correlation_s: BACKGROUND_S }],
            motors_n_m: model.wheels().iter().map(|wheel| WHEEL_TORQUE * wheel.max_torque_n_m).collect(),
            motors_correlation_s: BACKGROUND_S,
        };
        let (evidence, pairs) = Evidence::new(&directions);
        let parameters = (directions.constants, directions.all.len());
        let filter = Recursive::new(&directions.gyrostat, &plant, &disturbance, parameters, pairs);
        let newest = Fit {
            stamp_ns: None,
            state: State::Waiting,
            gyro: Vector3::repeat(f64::NAN),
            wheel_speed: vec![f64::NAN; model.wheels().len()],
            squares: (0.0, 0),
            ln_evidence: f64::NEG_INFINITY,
            likeliest: None,
            hole: None,
            holes: 0,
        };
        Ok(Self {
            model: model.clone(),
            directions,
            filter,
            ln_motor_noise: 0.0,
            learned_s: 0.0,
            evidence,
            limit_nats: settings.limit_nats(),
            alarmed: false,
            settling: SETTLING,
            newest,
        })
    }

    /// The motion is found, so that something can be concluded.
    fn is_settled(&self) -> bool {
        self.settling == 0
    }

    /// How well the model fits now, if the motion is known; squares begin anew.
    pub fn fit(&mut self, is_known: bool) -> Fit {
        let terms = self.evidence.terms(self.filter.starts());
        let ln_evidence = ln_sum(terms.iter().copied());
        self.alarmed |= ln_evidence >= self.limit_nats;
        let state = match (self.alarmed, is_known && self.is_settled()) {
            (true, _) => State::Mismatch,
            (false, false) => State::Waiting,
            (false, true) if ln_evidence >= 0.5 * self.limit_nats => State::Doubt,
            (false, true) => State::Agrees,
        };
        let likeliest = || self.evidence.likeliest(&terms, self.filter.starts(), &self.directions.all);
        let likeliest = self.alarmed.then(likeliest).flatten();
        let fit = Fit { state, ln_evidence, likeliest, ..self.newest.clone() };
        self.newest.squares = (0.0, 0);
        fit
    }

    /// Forgets a mismatch: nothing is suspected any more, and of the platform's constants nothing is known but their priors.
    pub fn forget(&mut self) {
        self.alarmed = false;
        self.filter.forget_parameters();
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
        let readings = cell.readings(&self.model);
        if readings.is_empty() {
            return false;
        }
        self.settling = self.settling.saturating_sub(1);
        let last = self.filter.starts().last();
        if self.is_settled() && last.is_none_or(|last| start_ns - last.start_ns >= ns(START_EVERY_S)) {
            self.filter.begin(start_ns, STARTS);
        }
        let half_ns = (end_ns - start_ns) / 2;
        let state = driven.in_state(&cell);
        let does = self.directions.all.iter().map(|direction| direction.moved.in_state(&state));
        self.filter.push(&driven.plant, does, half_ns as f64 * 1e-9);
        self.filter.follow(&driven.plant, half_ns);
        // Half of what is random in the cell comes before its middle.
        let random = self.random(&driven.plant, &cell);
        random.iter().for_each(|change| self.filter.add_random(change));
        let wandered = self.is_settled().then_some(cell.length_s / CONSTANTS_S);
        if !self.filter.take_in(&readings, wandered) {
            return false;
        }
        self.conclude(&driven.plant, &cell, &readings);
        random.iter().for_each(|change| self.filter.add_random(change));
        self.filter.follow(&driven.plant, end_ns - start_ns - half_ns);
        self.filter.move_plant(&mut driven.plant);
        true
    }

    /// Pulses and motors are not quite what was commanded: by how much that may move the plant in half a cell, each by itself.
    fn random(&self, plant: &Plant, cell: &Cell) -> Vec<Vec<f64>> {
        let half = 0.5_f64.sqrt();
        let by_torque = |body, wheels: &[f64]| self.filter.rates_by_torque(plant, body, wheels).to_vec();
        let jets = self.model.jets().iter().zip(&cell.valve_fraction).filter(|(_, share)| **share > 0.0);
        let impulse = |share: &f64| share * cell.length_s * PULSE * half;
        let jets = jets.map(|(jet, share)| by_torque(jet.torque_b_n_m() * impulse(share), &[]));
        let wheels = self.model.wheels().iter().take(MAX_WHEELS).enumerate().map(|(j, wheel)| {
            let torque_n_m = cell.wheel_torque_n_m[j];
            let Some(friction_n_m) = doubtful_friction_n_m(plant, wheel, j, torque_n_m) else {
                let mut change = vec![0.0; plant.tangent().size()];
                change[plant.tangent().wheels().start + j] = HELD_RAD_S * half;
                return change;
            };
            let white = (MOTOR_NOISE_SQRT_S * wheel.max_torque_n_m).powi(2) * self.ln_motor_noise.exp();
            let asked = (torque_n_m * cell.length_s * MOTOR).powi(2);
            let density = white + friction_n_m * friction_n_m * STICKING_S;
            let variance = asked + density * cell.length_s + cell.wheel_impulse_variance[j];
            let mut impulse = [0.0; MAX_WHEELS];
            impulse[j] = half * variance.sqrt();
            by_torque(Vector3::zeros(), &impulse)
        });
        jets.chain(wheels).collect()
    }

    /// What the innovations of a cell say.
    fn conclude(&mut self, plant: &Plant, cell: &Cell, readings: &[Reading]) {
        let (settled, newest) = (self.is_settled(), &mut self.newest);
        newest.stamp_ns = Some(plant.now_ns());
        newest.gyro.fill(f64::NAN);
        newest.wheel_speed.fill(f64::NAN);
        let learns = settled && self.learned_s < LEARNED_S;
        let mut has_learned = false;
        for (reading, y) in readings.iter().zip(self.filter.innovations()) {
            let index = reading.component.index();
            if settled {
                newest.squares = (newest.squares.0 + y * y, newest.squares.1 + 1);
            }
            if reading.component.channel == Channel::Gyro {
                newest.gyro[index] = y;
                continue;
            }
            newest.wheel_speed[index] = y;
            let (wheel, torque_n_m) = (&self.model.wheels()[index], cell.wheel_torque_n_m[index]);
            if learns && doubtful_friction_n_m(plant, wheel, index, torque_n_m) == Some(0.0) {
                let step = LEARNING * ((y * y).min(LARGEST_SQUARE) - 1.0);
                self.ln_motor_noise = (self.ln_motor_noise + step).max(LEAST_LN_NOISE);
                has_learned = true;
            }
        }
        self.learned_s += if has_learned { cell.length_s } else { 0.0 };
    }
}

/// Friction of a wheel of which nobody knows which way it points, as it may stick or turn back [N m]; `None`: its bearing holds the wheel.
fn doubtful_friction_n_m(plant: &Plant, wheel: &Wheel, j: usize, torque_n_m: f64) -> Option<f64> {
    let (speed, friction_n_m) = (plant.state().wheel_speed_rad_s()[j].abs(), wheel.coulomb_friction_n_m);
    let is_held = speed < RESTING_RAD_S && torque_n_m.abs() < HELD_SHARE * friction_n_m;
    (!is_held).then_some(if speed < SLOW_RAD_S { friction_n_m } else { 0.0 })
}

#[cfg(test)]
mod tests {
    use nalgebra::{Matrix3, UnitQuaternion, Vector3};
    use rand_distr::{Distribution, StandardNormal};
    use rand_pcg::Pcg64Mcg;

    use whorl_dynamics::platform::TiltLimit;
    use whorl_dynamics::{MassProperties, ModelPrior, PlatformModel};

    use crate::{Monitor, Settings};

    const STEP_S: f64 = 0.01;

    /// A balanced platform with three wheels that turn without friction, moved by nothing but their motors' noise: Euler's
    /// equation of a gyrostat, integrated here.
    fn watched(noise_n_m_sqrt_s: f64, end_s: f64) -> (Monitor, f64) {
        let mut model = PlatformModel::whorl_1_reference();
        let inertia = Matrix3::from_diagonal(&Vector3::new(6.0, 7.0, 12.0));
        model.mass_properties = MassProperties::new(inertia, Vector3::zeros(), 110.0).unwrap();
        // Noise turns it further than the dissertation's stops would let it.
        model.tilt_limit = TiltLimit::Cone { max_rad: 1.5 };
        for wheel in model.wheels_mut() {
            (wheel.viscous_friction_n_m_s, wheel.coulomb_friction_n_m) = (0.0, 0.0);
        }
        let jets = model.jets().len();
        let spin_inertia = model.wheels()[0].spin_inertia_kg_m2;
        let settings = Settings { background_torque_n_m: 1e-6, ..Settings::of(&model) };
        let mut monitor = Monitor::new(&model, &ModelPrior::typical(&model), &settings).unwrap();

        let mut rng = Pcg64Mcg::new(3);
        let mut normal = || -> f64 { StandardNormal.sample(&mut rng) };
        let gyro_noise = model.sensors.gyro.errors.one_sample_stddev();
        let speed_noise = model.sensors.wheel_speed.one_sample_stddev_rad_s();
        let (mut q, mut omega, mut speed) =
            (UnitQuaternion::identity(), Vector3::<f64>::zeros(), Vector3::new(40.0, -35.0, 30.0));
        let (mut squares, mut count, mut steps) = (0.0, 0_u32, 0);
        while f64::from(steps) * STEP_S < end_s {
            steps += 1;
            let at_ns = i64::from(steps) * 10_000_000;
            let torque = Vector3::from_fn(|_, _| noise_n_m_sqrt_s / STEP_S.sqrt() * normal());
            let momentum = inertia * omega + speed * spin_inertia;
            // Of the body without the wheels' inertia about their spin axes.
            let resisting = inertia - Matrix3::identity() * spin_inertia;
            let omega_dot = resisting.try_inverse().unwrap() * (-omega.cross(&momentum) - torque);
            speed += (torque / spin_inertia - omega_dot) * STEP_S;
            q *= UnitQuaternion::from_scaled_axis((omega + omega_dot * (0.5 * STEP_S)) * STEP_S);
            omega += omega_dot * STEP_S;
            let reading = omega + gyro_noise.map(|s| s * normal());
            let speeds = speed.map(|s| s + speed_noise * normal());
            monitor.on_gyro(at_ns, &reading);
            monitor.on_wheels(at_ns, speeds.as_slice(), &[0.0; 3]);
            monitor.on_valves(at_ns, &vec![false; jets], &vec![0.0; jets]);
            monitor.on_controlled(at_ns);
            monitor.on_attitude(at_ns, &q, &omega);
            if steps % 100 == 0 {
                let fit = monitor.fit();
                if f64::from(steps) * STEP_S > 70.0 {
                    squares += fit.squares.0;
                    count += fit.squares.1;
                }
            }
        }
        (monitor, squares / f64::from(count))
    }

    /// From a thirtieth of what is assumed to three times it. The residuals then have the variance they should have. A small
    /// noise is told less well: the readings' own is larger, and the slow torque that the filter allows stands in for it; a thirtieth hardly shows at all.
    #[test]
    fn the_noise_of_motors_is_learned_from_how_wheels_move() {
        let assumed =
            super::MOTOR_NOISE_SQRT_S * PlatformModel::whorl_1_reference().wheels()[0].max_torque_n_m;
        for (over_assumed, tolerance) in
            [(1.0 / 30.0, 10.0), (0.1, 3.0), (1.0 / 3.0, 2.0), (1.0, 1.5), (3.0, 1.5)]
        {
            let (monitor, mean_square) = watched(assumed * over_assumed, 130.0);
            let ratio = (0.5 * monitor.watch.ln_motor_noise).exp() / over_assumed;
            assert!(ratio > 1.0 / tolerance && ratio < tolerance, "{over_assumed}: {ratio} times the truth");
            assert!((mean_square - 1.0).abs() < 0.2, "{over_assumed}: mean square {mean_square}");
        }
    }
}
