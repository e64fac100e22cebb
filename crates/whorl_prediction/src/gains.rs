//! The covariance of a state on its way along a motion, and the gains that follow from it.

use std::borrow::Cow;

use nalgebra::{DMatrix, Vector3};
use whorl_dynamics::plant::{LinearisedPlant, Plant, RATE};

use crate::cells::SHARE_OF_TIME;
use crate::claims::Claims;
use crate::heading::UnseenHeading;
use crate::lanes::{Gain, Lanes, MOST_STATES, Sparse};
use crate::layout::Layout;
use crate::linearisation::Place;
use crate::noise::{Disturbance, Noise};
use crate::prepared::Prepared;
use crate::rows::Readings;
use crate::settings::Settings;
use crate::start::Start;
use crate::transition::{Step, WhiteNoise, fastest_rate_1_s};

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
    /// What predictions ahead need.
    pub claims: Option<Claims>,
    pub linearised: LinearisedPlant,
    /// Where the derivatives were made.
    place: Place,
    pub fastest_1_s: f64,
    /// Derivatives by a torque are needed.
    has_torques: bool,
    /// d/dt of the error of what moves, now and before.
    motion: DMatrix<f64>,
    before: DMatrix<f64>,
    /// What drives errors, and what of that there is without disturbances.
    drives: WhiteNoise,
    drives_alone: WhiteNoise,
    /// What a step of this length does to errors with the present derivatives; none yet: zero.
    pub step: Step,
    step_ns: i64,
    /// It was made for the last step.
    pub has_new_step: bool,
    /// Length of the last step \[s\]; none yet: zero.
    last_s: f64,
    /// Room for rows of readings.
    set_back: Sparse,
    /// What of the attitude at the start is of no consequence,
    pub heading: UnseenHeading,
    /// and about which axis that is now.
    pub unseen_axis: Option<Vector3<f64>>,
    /// Of the readings of the present instant.
    pub gain: Gain,
}

impl<'a> Gains<'a> {
    /// At a start, in which the plant stands; `has_laws`: derivatives by a torque are needed whatever disturbances there are.
    pub fn new(case: &'a Prepared<'a>, noise: &'a Noise, start: &Start, plant: &Plant) -> Self {
        let layout = start.layout;
        let has_torques = noise.disturbance.is_some() || case.drives_with_noise();
        let mut linearised = LinearisedPlant::none(plant);
        plant.linearise_into(&mut linearised, has_torques);
        let heading = UnseenHeading::of(case, plant, &linearised);
        let mut covariance = Lanes::of(&start.covariance);
        if let Some(axis) = heading.at_start() {
            covariance.level_covariance(&axis);
        }
        let walks = (0..layout.size()).map(|i| case.walk_variance(layout, i, 1.0)).collect();
        let disturbance = Cow::Borrowed(&noise.disturbance);
        let roots = case.driven_momentum_roots();
        let mut gains =
            Self::of(*case.settings(), disturbance, layout, walks, roots, covariance, linearised, plant);
        (gains.has_torques, gains.heading) = (has_torques, heading);
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
        let turns = vec![Vector3::zeros(); driven_momentum_roots.len()];
        let drives_alone = WhiteNoise { density: walks[..layout.moving()].to_vec(), turns };
        let mut drives = drives_alone.clone();
        let of = &disturbance;
        for ((i, stddev), (_, correlation_s)) in of.coordinates(layout).zip(of.times(layout)) {
            drives.density[i] += stddev * stddev * 2.0 / correlation_s;
        }
        let mut gains = Self {
            settings,
            disturbance,
            layout,
            walks,
            driven_momentum_roots,
            covariance,
            claims: None,
            linearised,
            place: Place::of(plant),
            fastest_1_s: 0.0,
            has_torques: true,
            motion: none.clone(),
            before: none,
            drives,
            drives_alone,
            step: Step::new(layout.moving(), layout.size()),
            step_ns: 0,
            has_new_step: false,
            last_s: 0.0,
            set_back: Sparse::default(),
            heading: UnseenHeading::NONE,
            unseen_axis: None,
            gain: Gain::default(),
        };
        gains.find_motion(plant);
        gains.fastest_1_s = fastest_1_s(plant, &gains.linearised);
        gains
    }

    /// With derivatives by a torque, whatever disturbances there are.
    pub fn with_torques(&mut self, plant: &Plant) {
        self.has_torques = true;
        plant.linearise_into(&mut self.linearised, true);
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
        for (i, correlation_s) in self.disturbance.times(self.layout) {
            a[(i, i)] = -1.0 / correlation_s;
        }
    }

    /// Sets out to the instant of the next readings.
    pub fn set_out(&mut self) {
        if let Some(claims) = &mut self.claims {
            claims.set_out();
        }
    }

    /// The longest step that covariances may take \[s\].
    pub fn longest_s(&self) -> f64 {
        let of_motion = self.settings.covariance_step / self.fastest_1_s.max(1e-9);
        let share = if self.settings.cell_s > 0.0 { SHARE_OF_TIME } else { self.settings.covariance_step };
        self.disturbance.times(self.layout).map(|(_, time_s)| share * time_s).fold(of_motion, f64::min)
    }

    /// Behind a step of the plant.
    pub fn follow(&mut self, plant: &Plant, step_ns: i64) {
        let step_s = step_ns as f64 * 1e-9;
        self.last_s = step_s;
        self.find_step(plant, step_ns);
        let touch = self.touch_rad_s(plant, step_s);
        self.unseen_axis = self.heading.now(plant);
        let (Step { transition, noise, of_model, .. }, axis) = (&self.step, self.unseen_axis.as_ref());
        let claimed = self.claims.as_mut().and_then(|claims| claims.covariance.as_mut());
        for (covariance, noise) in [(Some(&mut self.covariance), noise), (claimed, of_model)] {
            let Some(covariance) = covariance else { continue };
            covariance.grow(transition, noise.as_ref());
            touch.iter().for_each(|touch_rad_s| add_square(covariance, touch_rad_s));
            for i in self.layout.moving()..self.layout.size() {
                covariance.row_mut(i)[i] += self.walks[i] * step_s;
            }
            if let Some(axis) = axis {
                covariance.level_covariance(axis);
            }
        }
        if let Some(claims) = &mut self.claims {
            claims.follow(&self.step, axis);
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
            plant.linearise_into(&mut self.linearised, self.has_torques);
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
        for noise in [&mut self.drives, &mut self.drives_alone] {
            let driven = self.driven_momentum_roots.iter().zip(&mut noise.turns);
            driven.for_each(|(momentum_b, turn)| *turn = by_torque * momentum_b);
        }
        let motion = if is_near { &self.motion } else { &self.before };
        let alone = self.claims.is_some().then_some(&self.drives_alone);
        self.step.make(motion, &self.drives, alone, step_ns as f64 * 1e-9);
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
        let claimed = self.claims.as_mut().and_then(|claims| claims.covariance.as_mut());
        if let Some(claimed) = claimed {
            claimed.correct(&readings.by_state, &readings.variances, &mut self.gain);
        }
        self.covariance.correct(&readings.by_state, &readings.variances, &mut self.gain)
    }

    /// Nothing is uncertain of a coordinate.
    pub fn hold(&mut self, i: usize) {
        self.covariance.hold(i);
        if let Some(claimed) = self.claims.as_mut().and_then(|claims| claims.covariance.as_mut()) {
            claimed.hold(i);
        }
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
