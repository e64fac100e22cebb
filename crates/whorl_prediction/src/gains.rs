//! The covariance of a state on its way along a motion, and the gains that follow from it.

use std::borrow::Cow;

use nalgebra::{DMatrix, Vector3};
use whorl_dynamics::plant::{LinearisedPlant, Plant, RATE};
use whorl_math::lanes::{Gain, Lanes, MOST_STATES, Sparse, Step, fastest_rate_1_s};
use whorl_math::vertical_b;

use crate::cells::SHARE_OF_TIME;
use crate::linearisation::{Place, unseen_axis};
use crate::noise::{Disturbance, Layout, Noise};
use crate::prepared::Prepared;
use crate::rows::Readings;
use crate::settings::Settings;
use crate::start::Start;

/// Covariance and gains along a motion.
pub(crate) struct Gains<'a> {
    settings: Settings,
    disturbance: Cow<'a, Disturbance>,
    layout: Layout,
    /// Variance that each coordinate gains in a second by its own random walk,
    walks: Vec<f64>,
    /// and noise of what wheels that are driven along their measured speeds give the body ([`Prepared::driven_momentum_roots`]).
    driven_momentum_roots: &'a [Vector3<f64>],
    pub covariance: Lanes,
    /// What the model alone claims to know, without disturbances; `None`: there are none, or nobody asks.
    claimed: Option<Lanes>,
    /// The same of predictions ahead, which no reading corrects.
    pub ahead: Vec<Lanes>,
    pub linearised: LinearisedPlant,
    /// Where the derivatives were made.
    place: Place,
    pub fastest_1_s: f64,
    /// d/dt of the error of what moves, now and before.
    motion: DMatrix<f64>,
    before: DMatrix<f64>,
    /// Variance that each coordinate gains in a second, with disturbances, and roots of those that turns gain by wheels that are driven along their speeds.
    drives: Vec<f64>,
    turns: Vec<Vector3<f64>>,
    /// What a step of this length does to errors with the present derivatives; none yet: zero.
    pub step: Step,
    step_ns: i64,
    /// It was made for the last step.
    pub has_new_step: bool,
    /// Length of the last step \[s\]; none yet: zero.
    last_s: f64,
    /// Room for rows of readings.
    set_back: Sparse,
    /// About which axis the attitude at the start is of no consequence,
    pub unseen_at_start: Option<Vector3<f64>>,
    /// and which that is now.
    pub unseen_axis: Option<Vector3<f64>>,
    /// Of the readings of the present instant.
    pub gain: Gain,
}

impl<'a> Gains<'a> {
    /// At a start, in which the plant stands.
    pub fn new(case: &'a Prepared<'a>, noise: &'a Noise, start: &Start, plant: &Plant) -> Self {
        let layout = start.layout;
        let mut linearised = LinearisedPlant::none(plant);
        plant.linearise_into(&mut linearised, true);
        let unseen_at_start = unseen_axis(case, plant, &linearised);
        let mut covariance = Lanes::of(&start.covariance);
        if let Some(axis) = unseen_at_start {
            covariance.level_covariance(&axis);
        }
        let walks = layout.walks(&case.model.sensors, &case.hidden_noise);
        let disturbance = Cow::Borrowed(&noise.disturbance);
        let roots = &case.driven_momentum_roots;
        let mut gains =
            Self::of(*case.settings(), disturbance, layout, walks, roots, covariance, linearised, plant);
        gains.unseen_at_start = unseen_at_start;
        gains
    }

    /// Of a layout in which a plant stands, with its derivatives there, by a torque as well; no heading is left out.
    #[expect(clippy::too_many_arguments, reason = "each is a part of its own")]
    pub fn of(
        settings: Settings,
        disturbance: Cow<'a, Disturbance>,
        layout: Layout,
        walks: Vec<f64>,
        driven_momentum_roots: &'a [Vector3<f64>],
        covariance: Lanes,
        linearised: LinearisedPlant,
        plant: &Plant,
    ) -> Self {
        let none = DMatrix::zeros(layout.moving(), layout.moving());
        let mut drives = walks[..layout.moving()].to_vec();
        for (i, stddev, correlation_s) in disturbance.coordinates(layout) {
            drives[i] += stddev * stddev * 2.0 / correlation_s;
        }
        let mut gains = Self {
            settings,
            disturbance,
            layout,
            walks,
            driven_momentum_roots,
            covariance,
            claimed: None,
            ahead: Vec::new(),
            linearised,
            place: Place::of(plant),
            fastest_1_s: 0.0,
            motion: none.clone(),
            before: none,
            drives,
            turns: Vec::new(),
            step: Step::new(layout.moving(), layout.size()),
            step_ns: 0,
            has_new_step: false,
            last_s: 0.0,
            set_back: Sparse::default(),
            unseen_at_start: None,
            unseen_axis: None,
            gain: Gain::default(),
        };
        gains.find_motion(plant);
        gains.fastest_1_s = fastest_1_s(plant, &gains.linearised);
        gains
    }

    /// d/dt of the error of what moves.
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

    /// A prediction ahead begins in the present state.
    pub fn begin_ahead(&mut self, position: usize) {
        self.ahead[position].clone_from(self.claimed.as_ref().unwrap_or(&self.covariance));
    }

    /// The longest step that covariances may take \[s\].
    pub fn longest_s(&self) -> f64 {
        let of_motion = self.settings.covariance_step / self.fastest_1_s.max(1e-9);
        let share = if self.settings.cell_s > 0.0 { SHARE_OF_TIME } else { self.settings.covariance_step };
        self.disturbance
            .coordinates(self.layout)
            .map(|(_, _, time_s)| share * time_s)
            .fold(of_motion, f64::min)
    }

    /// Behind a step of the plant.
    pub fn follow(&mut self, plant: &Plant, step_ns: i64) {
        let step_s = step_ns as f64 * 1e-9;
        self.last_s = step_s;
        self.find_step(plant, step_ns);
        let touch = self.touch_rad_s(plant, step_s);
        self.unseen_axis = self.unseen_at_start.map(|_| vertical_b(&plant.state().q_world_body));
        let (Step { transition, noise, of_model, .. }, axis) = (&self.step, self.unseen_axis.as_ref());
        // A prediction ahead claims that it knows what touches do.
        let filtered = [(Some(&mut self.covariance), noise, touch), (self.claimed.as_mut(), of_model, touch)];
        let ahead = self.ahead.iter_mut().map(|covariance| (Some(covariance), of_model, None));
        for (covariance, noise, touch) in filtered.into_iter().chain(ahead) {
            let Some(covariance) = covariance else { continue };
            covariance.grow(transition, Some(noise));
            touch.iter().for_each(|touch_rad_s| add_square(covariance, touch_rad_s));
            for i in self.layout.moving()..self.layout.size() {
                covariance.row_mut(i)[i] += self.walks[i] * step_s;
            }
            if let Some(axis) = axis {
                covariance.level_covariance(axis);
            }
        }
    }

    /// By how much what touches may have changed the rate otherwise than the model says, one standard deviation [rad/s]; `None`:
    /// nothing touches. Its torque is known to a share, independently from one touch to the next: white noise whose integral over a
    /// touch has that share of the impulse.
    fn touch_rad_s(&self, plant: &Plant, step_s: f64) -> Option<Vector3<f64>> {
        if !self.place.touches() {
            return None;
        }
        let Settings { touch_impulse_share, touch_s, .. } = self.settings;
        Some(plant.contact_acceleration_b_rad_s2() * (touch_impulse_share * (touch_s * step_s).sqrt()))
    }

    /// What the step that ends now does to errors. Derivatives are held while the state is close to that of which they were made, and
    /// with them what equal steps do.
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

    /// What the last step did to errors, and its length \[s\].
    pub fn last_step(&self) -> Option<(&Sparse, f64)> {
        (self.last_s > 0.0).then_some((&self.step.transition, self.last_s))
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

    /// Nothing is uncertain of a coordinate.
    pub fn hold(&mut self, i: usize) {
        self.covariance.hold(i);
        self.claimed.iter_mut().for_each(|claimed| claimed.hold(i));
    }
}

/// Adds an error of the body's rate to a covariance.
fn add_square(covariance: &mut Lanes, of_rate: &Vector3<f64>) {
    for (i, x) in RATE.zip(of_rate) {
        let row = covariance.row_mut(i);
        RATE.zip(of_rate).for_each(|(k, y)| row[k] += x * y);
    }
}

/// How fast errors grow, swing or fade [1/s], or the body turns: with it derivatives change.
fn fastest_1_s(plant: &Plant, linearised: &LinearisedPlant) -> f64 {
    fastest_rate_1_s(&linearised.rate_by_state).max(plant.state().omega_wb_b_rad_s.norm())
}
