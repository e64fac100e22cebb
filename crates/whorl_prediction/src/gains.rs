//! The covariance of a state on its way along a motion, and the gains that follow from it.

use nalgebra::{DMatrix, UnitQuaternion, Vector3};
use whorl_dynamics::plant::{LinearisedPlant, Plant, RATE, ROTATION};
use whorl_dynamics::platform::SensorSuite;
use whorl_math::lanes::{Gain, Lanes, MOST_STATES, Sparse, Step, fastest_rate_1_s};
use whorl_math::vertical_b;
use whorl_recording::Channel;

use crate::readings::SHARE_OF_TIME;
use crate::rows::Readings;
use crate::{Disturbance, Layout, Noise, Prepared, Settings, Start};

pub(crate) struct Gains {
    settings: Settings,
    disturbance: Disturbance,
    layout: Layout,
    /// Variance that each coordinate gains in a second by its own random walk, that of what moves with disturbances,
    walks: Vec<f64>,
    drives: Vec<f64>,
    /// and roots of what turns gain by wheels that are driven along their speeds, from those of the momentum ([`Prepared::driven_momentum_roots`]).
    turns: Vec<Vector3<f64>>,
    driven_momentum_roots: Vec<Vector3<f64>>,
    pub covariance: Lanes,
    /// What the model alone claims to know, without disturbances; `None`: there are none, or nobody asks.
    claimed: Option<Lanes>,
    /// The same of predictions ahead, which no reading corrects.
    pub ahead: Vec<Lanes>,
    pub linearised: LinearisedPlant,
    place: Place,
    fastest_1_s: f64,
    /// d/dt of the error of what moves, now and before.
    motion: DMatrix<f64>,
    before: DMatrix<f64>,
    /// What a step of this length does to errors with the present derivatives; none yet: zero.
    pub step: Step,
    step_ns: i64,
    pub has_new_step: bool,
    set_back: Sparse,
    /// About which axis the attitude at the start is of no consequence, and which that is now.
    pub unseen_at_start: Option<Vector3<f64>>,
    pub unseen_axis: Option<Vector3<f64>>,
    pub gain: Gain,
}

impl Gains {
    pub fn new(case: &Prepared<'_>, noise: &Noise, start: &Start, plant: &Plant) -> Self {
        let (sensors, covariance) = (&case.model.sensors, Lanes::of(&start.covariance));
        let mut gains =
            Self::of(*case.settings(), &noise.disturbance, start.layout, sensors, plant, covariance);
        gains.driven_momentum_roots.clone_from(&case.driven_momentum_roots);
        gains.unseen_at_start = unseen_axis(case, plant, &gains.linearised);
        gains.unseen_at_start.iter().for_each(|axis| gains.covariance.level_covariance(axis));
        gains
    }

    /// Of a layout in which a plant stands, of a platform with these sensors; no heading is left out.
    pub fn of(
        settings: Settings,
        disturbance: &Disturbance,
        layout: Layout,
        sensors: &SensorSuite,
        plant: &Plant,
        covariance: Lanes,
    ) -> Self {
        let mut linearised = LinearisedPlant::none(plant);
        plant.linearise_into(&mut linearised, true);
        let walks = layout.walks(sensors, plant.gyrostat().effects());
        let mut drives = walks[..layout.moving()].to_vec();
        for (i, stddev, correlation_s) in disturbance.coordinates(layout) {
            drives[i] += stddev * stddev * 2.0 / correlation_s;
        }
        let none = DMatrix::zeros(layout.moving(), layout.moving());
        let mut gains = Self {
            settings,
            disturbance: disturbance.clone(),
            layout,
            walks,
            drives,
            turns: Vec::new(),
            driven_momentum_roots: Vec::new(),
            covariance,
            claimed: None,
            ahead: Vec::new(),
            fastest_1_s: fastest_1_s(plant, &linearised),
            linearised,
            place: Place::of(plant),
            motion: none.clone(),
            before: none,
            step: Step::new(layout.moving(), layout.size()),
            step_ns: 0,
            has_new_step: false,
            set_back: Sparse::default(),
            unseen_at_start: None,
            unseen_axis: None,
            gain: Gain::default(),
        };
        gains.find_motion(plant);
        gains
    }

    fn find_motion(&mut self, plant: &Plant) {
        let (n, a) = (self.layout.plant.size(), &mut self.motion);
        a.fill(0.0);
        a.view_mut((0, 0), (n, n)).copy_from(&self.linearised.rate_by_state);
        let by_torque = &self.linearised.rate_by_torque;
        for first in self.layout.disturbance().step_by(3) {
            a.view_mut((0, first), (n, 3)).copy_from(by_torque);
        }
        let wheels = self.layout.plant.wheels().zip(plant.gyrostat().model().wheels());
        for ((i, (speed, wheel)), held) in self.layout.motors().zip(wheels).zip(plant.held_wheels()) {
            // It pushes the wheel, and the body the other way; what friction holds, nothing pushes.
            if !held {
                a.column_mut(i).rows_mut(0, n).gemv(-1.0, by_torque, &wheel.spin_axis_b, 0.0);
                a[(speed, i)] += 1.0 / wheel.spin_inertia_kg_m2;
            }
        }
        for (i, _, correlation_s) in self.disturbance.coordinates(self.layout) {
            a[(i, i)] = -1.0 / correlation_s;
        }
    }

    /// Goes along with so many predictions ahead, and with what the model alone claims to know.
    pub fn claim(&mut self, horizons: usize) {
        let disturbances = self.layout.plant.size()..self.layout.moving();
        if horizons > 0 && !disturbances.is_empty() {
            let claimed = self.claimed.insert(self.covariance.clone());
            disturbances.for_each(|i| claimed.hold(i));
        }
        self.ahead = vec![self.covariance.clone(); horizons];
    }

    pub fn begin_ahead(&mut self, position: usize) {
        self.ahead[position].clone_from(self.claimed.as_ref().unwrap_or(&self.covariance));
    }

    pub fn longest_s(&self) -> f64 {
        let of_motion = self.settings.covariance_step / self.fastest_1_s.max(1e-9);
        let share = if self.settings.cell_s > 0.0 { SHARE_OF_TIME } else { self.settings.covariance_step };
        let times_s = self.disturbance.coordinates(self.layout).map(|(_, _, time_s)| share * time_s);
        times_s.fold(of_motion, f64::min)
    }

    pub fn follow(&mut self, plant: &Plant, step_ns: i64) {
        let step_s = step_ns as f64 * 1e-9;
        self.find_step(plant, step_ns);
        // What touches is known to a share, independently from one touch to the next: white noise whose integral over a touch has that share of the impulse.
        let Settings { touch_impulse_share, touch_s, .. } = self.settings;
        let touch_rad_s = (self.place.touching != [false; 2]).then(|| {
            plant.contact_acceleration_b_rad_s2() * (touch_impulse_share * (touch_s * step_s).sqrt())
        });
        self.unseen_axis = self.unseen_at_start.map(|_| vertical_b(&plant.state().q_world_body));
        let Step { transition, noise, of_model, .. } = &self.step;
        let filtered = [(Some(&mut self.covariance), noise), (self.claimed.as_mut(), of_model)];
        let filtered = filtered.into_iter().map(|(covariance, noise)| (covariance, noise, touch_rad_s));
        // A prediction ahead claims that it knows what touches do.
        let ahead = self.ahead.iter_mut().map(|covariance| (Some(covariance), of_model, None));
        for (covariance, noise, touch_rad_s) in filtered.chain(ahead) {
            let Some(covariance) = covariance else { continue };
            covariance.grow(transition, Some(noise));
            if let Some(touch) = touch_rad_s {
                let pairs = RATE.zip(&touch).flat_map(|x| RATE.zip(&touch).map(move |y| (x, y)));
                pairs.for_each(|((i, x), (k, y))| covariance.row_mut(i)[k] += x * y);
            }
            for i in self.layout.moving()..self.layout.size() {
                covariance.row_mut(i)[i] += self.walks[i] * step_s;
            }
            self.unseen_axis.iter().for_each(|axis| covariance.level_covariance(axis));
        }
    }

    /// What the step that ends now does to errors. Derivatives, and what equal steps do, are held while the state is close to that of which they were made.
    fn find_step(&mut self, plant: &Plant, step_ns: i64) {
        let now = Place::of(plant);
        let is_near = self.place.distance_rad(&now, self.fastest_1_s) <= self.settings.derivatives_held;
        self.has_new_step = !(is_near && self.step_ns == step_ns);
        if !self.has_new_step {
            return;
        }
        self.step_ns = step_ns;
        if !is_near {
            self.before.copy_from(&self.motion);
            plant.linearise_into(&mut self.linearised, true);
            self.place = now;
            self.find_motion(plant);
            self.fastest_1_s = fastest_1_s(plant, &self.linearised);
            // Of the two ends.
            self.before += &self.motion;
            self.before *= 0.5;
            self.step_ns = 0;
        }
        // The noise of a speed along which a wheel is driven is one of the body's rate, and its attitude follows.
        let by_torque = self.linearised.rate_by_torque.fixed_rows::<3>(RATE.start);
        self.turns.clear();
        self.turns.extend(self.driven_momentum_roots.iter().map(|momentum_b| by_torque * momentum_b));
        let motion = if is_near { &self.motion } else { &self.before };
        let alone = (!self.ahead.is_empty()).then(|| &self.walks[..self.drives.len()]);
        self.step.make(motion, &self.drives, alone, &self.turns, step_ns as f64 * 1e-9);
    }

    /// Derivatives of means of readings that came before the present state, by this: h exp(-A t) on average, by its first terms.
    pub fn set_back(&mut self, readings: &mut Readings) {
        if readings.rows.iter().all(|row| row.lag_s == 0.0) {
            return;
        }
        let (motion, size) = (self.step.motion(), self.layout.size());
        self.set_back.clear();
        for (row, by_state) in readings.rows.iter().zip(readings.by_state.rows()) {
            let (mut sum, mut term) = ([0.0; MOST_STATES], [0.0; MOST_STATES]);
            by_state.iter().for_each(|(i, x)| (sum[*i], term[*i]) = (*x, *x));
            for factor in [-row.lag_s, 0.5 * row.lag_squared_s2] {
                let mut next = [0.0; MOST_STATES];
                for (x, of) in term.iter().zip(motion.rows()).filter(|(x, _)| **x != 0.0) {
                    of.iter().for_each(|(k, a)| next[*k] += x * a);
                }
                sum.iter_mut().zip(&next).for_each(|(sum, x)| *sum += factor * x);
                term = next;
            }
            self.set_back.push(sum[..size].iter().copied());
        }
        std::mem::swap(&mut self.set_back, &mut readings.by_state);
    }

    /// Takes readings out of the covariances; false where one is none any more.
    pub fn correct(&mut self, readings: &Readings) -> bool {
        if let Some(claimed) = &mut self.claimed {
            claimed.correct(&readings.by_state, &readings.variances, &mut self.gain);
        }
        self.covariance.correct(&readings.by_state, &readings.variances, &mut self.gain)
    }

    pub fn hold(&mut self, i: usize) {
        self.covariance.hold(i);
        self.claimed.iter_mut().for_each(|claimed| claimed.hold(i));
    }
}

/// How fast errors grow, swing or fade [1/s], or the body turns: with it derivatives change.
fn fastest_1_s(plant: &Plant, linearised: &LinearisedPlant) -> f64 {
    fastest_rate_1_s(&linearised.rate_by_state).max(plant.state().omega_wb_b_rad_s.norm())
}

/// Where derivatives were made, as far as they depend on it.
#[derive(Debug, Clone, PartialEq)]
struct Place {
    q_world_body: UnitQuaternion<f64>,
    /// Rate of the body, and what its wheels' momentum would be as a rate of it [rad/s].
    rates_rad_s: [Vector3<f64>; 2],
    held: u64,
    touching: [bool; 2],
}

impl Place {
    fn of(plant: &Plant) -> Self {
        let (model, state) = (plant.gyrostat().model(), plant.state());
        let inertia_kg_m2 = model.mass_properties.inertia_b_kg_m2().trace() / 3.0;
        let wheels = model.wheels().iter().zip(state.wheel_speed_rad_s());
        let momenta = wheels.map(|(wheel, speed)| *wheel.spin_axis_b * (wheel.spin_inertia_kg_m2 * speed));
        Self {
            q_world_body: state.q_world_body,
            rates_rad_s: [state.omega_wb_b_rad_s, momenta.sum::<Vector3<f64>>() / inertia_kg_m2],
            held: plant.held_wheels().fold(0, |bits, on| bits << 1 | u64::from(on)),
            touching: plant.touching(),
        }
    }

    /// How far another place is: an angle, and rates against the fastest motion, or 1 rad/s; infinite on another branch.
    fn distance_rad(&self, other: &Self, fastest_1_s: f64) -> f64 {
        if (self.held, self.touching) != (other.held, other.touching) {
            return f64::INFINITY;
        }
        let angle = 2.0 * (self.q_world_body.inverse() * other.q_world_body).imag().norm();
        let rates = self.rates_rad_s.iter().zip(&other.rates_rad_s).map(|(a, b)| (a - b).norm()).sum::<f64>();
        angle + rates / fastest_1_s.max(1.0)
    }
}

/// Share of the derivatives by attitude below which nothing depends on the heading: differences that make them err by less than a hundredth of it.
const NOTHING: f64 = 1e-6;

/// The vertical at the start, body axes, if neither the motion nor a reading depends on how far the platform is turned about it: such a heading can be
/// anything, and a filter takes the one that it has, at the start and all the way (METHOD.md, "Start").
fn unseen_axis(case: &Prepared<'_>, plant: &Plant, linearised: &LinearisedPlant) -> Option<Vector3<f64>> {
    let vertical_b = vertical_b(&plant.state().q_world_body);
    let motion = linearised.rate_by_state.fixed_columns::<3>(ROTATION.start);
    let readings = linearised.imu_by_state.fixed_columns::<3>(ROTATION.start);
    // By row: a torque is no speed. How a turn itself goes on does not count.
    let mut rows = motion.row_iter().skip(ROTATION.end).chain(readings.row_iter());
    let matters = rows.any(|row| (row * vertical_b).x.abs() > NOTHING * row.norm());
    (!case.reads(Channel::Vector) && !matters).then_some(vertical_b)
}
