//! The way from one instant to the next: the plant carries the mean, its linearisation the covariance.

use nalgebra::{DMatrix, DVector, Vector3};
use whorl_dynamics::plant::{RATE, ROTATION};

use crate::filter::Filter;
use crate::linearisation::{Place, linearised};
use crate::transition::{Step, add_product_transposed, added, fastest_rate_1_s, transition};

impl Filter<'_> {
    /// d/dt of the error of what moves.
    pub(super) fn motion(&self) -> DMatrix<f64> {
        let (n, size) = (self.layout.plant.size(), self.layout.moving());
        let mut a = DMatrix::zeros(size, size);
        a.view_mut((0, 0), (n, n)).copy_from(&self.linearised.rate_by_state);
        let (torque, motors) = (self.layout.disturbance(), self.layout.motors());
        let by_torque = &self.linearised.rate_by_torque;
        if !torque.is_empty() {
            a.view_mut((0, torque.start), (n, 3)).copy_from(by_torque);
        }
        let wheels = self.layout.plant.wheels().zip(self.case.model().wheels());
        for ((i, (speed, wheel)), held) in motors.clone().zip(wheels).zip(self.plant.held_wheels()) {
            // It pushes the wheel, and the body the other way; what friction holds, nothing pushes.
            if !held {
                a.column_mut(i).rows_mut(0, n).gemv(-1.0, by_torque, &wheel.spin_axis_b, 0.0);
                a[(speed, i)] += 1.0 / wheel.spin_inertia_kg_m2;
            }
        }
        for i in torque.start..motors.end {
            a[(i, i)] = -1.0 / self.noise.disturbance.correlation_s;
        }
        a
    }

    pub(super) fn propagate(&mut self, to_ns: i64) {
        if let Some(claims) = &mut self.claims {
            claims.set_out();
        }
        while self.plant.now_ns() < to_ns && !self.lost {
            let from_ns = self.plant.now_ns();
            let longest_s = self.case.settings().covariance_step / self.fastest_1_s.max(1e-9);
            let left_ns = to_ns - from_ns;
            // Equal steps, so that none is tiny.
            let steps = (left_ns as f64 * 1e-9 / longest_s).ceil().clamp(1.0, 1e6);
            let end_ns = from_ns + ((left_ns as f64 / steps).ceil() as i64).max(1);
            let end_ns = end_ns.min(to_ns);
            self.show_disturbance();
            if let Some(columns) = &mut self.columns {
                columns.set_out(self.case, &self.plant, end_ns, to_ns);
            }
            self.lost = !self.case.run_to(&mut self.plant, &mut self.event, end_ns);
            let h_s = (end_ns - from_ns) as f64 * 1e-9;
            let (held, holds) = self.errors_over(end_ns - from_ns);
            let levelled = self.heading.out_of_step(&held, &self.plant);
            let step = levelled.as_ref().unwrap_or(&held);
            if let Some(columns) = &mut self.columns {
                let (plant, linearised) = (&self.plant, &self.linearised);
                self.lost |= !columns.follow(self.case, plant, linearised, &step.transition, self.heading);
            }
            self.grow(step, h_s);
            self.push_motors(&step.transition);
            let fades = (-h_s / self.noise.disturbance.correlation_s).exp();
            for i in self.layout.plant.size()..self.layout.moving() {
                self.beside[i] *= fades;
            }
            if let Some(claims) = &mut self.claims {
                claims.follow(step);
            }
            self.over_step = holds.then_some((end_ns - from_ns, held));
        }
        self.hold_wheels();
    }

    /// What the step that ends now does to errors, and whether the next equal one does the same. Derivatives are held while
    /// the state is close to that of which they were made, and with them what equal steps do.
    fn errors_over(&mut self, step_ns: i64) -> (Step, bool) {
        let step_s = step_ns as f64 * 1e-9;
        let now = Place::of(&self.plant);
        if self.place.distance_rad(&now, self.fastest_1_s) > self.case.settings().derivatives_held {
            let before = self.motion();
            self.linearised = linearised(&self.plant, self.has_torques());
            self.place = now;
            let after = self.motion();
            self.fastest_1_s = fastest_rate_1_s(&after);
            return (self.step_of(&((before + after) * 0.5), step_s), false);
        }
        match self.over_step.take() {
            Some((of_ns, step)) if of_ns == step_ns => (step, true),
            _ => (self.step_of(&self.motion(), step_s), true),
        }
    }

    /// Whether anything random moves besides disturbances.
    pub fn has_own_noise(&self) -> bool {
        self.case.hidden_noise().any(|level| level > 0.0) || self.case.drives_with_noise()
    }

    /// Of these derivatives, with the white noise that drives what moves.
    fn step_of(&self, motion: &DMatrix<f64>, step_s: f64) -> Step {
        let noise = added(motion, &self.noise_roots(true), step_s);
        // Of predictions ahead alone.
        let of_model = self.claims.as_ref().and_then(|_| added(motion, &self.noise_roots(false), step_s));
        Step { transition: transition(motion, step_s), noise, of_model }
    }

    /// White noise that drives what moves, a column each [unit per root of a second].
    fn noise_roots(&self, with_disturbances: bool) -> DMatrix<f64> {
        let (m, of) = (self.layout.moving(), &self.noise.disturbance);
        let walks = (0..m).map(|i| (i, self.walk_variance(i, 1.0).sqrt()));
        let disturbances = of.coordinates(self.layout).filter(|_| with_disturbances);
        let pushes = disturbances.map(|(i, stddev)| (i, stddev * (2.0 / of.correlation_s).sqrt()));
        let single = walks.chain(pushes).filter(|(_, root)| *root > 0.0);
        let mut columns: Vec<DVector<f64>> = single
            .map(|(i, root)| {
                let mut column = DVector::zeros(m);
                column[i] = root;
                column
            })
            .collect();
        // The noise of a speed along which a wheel is driven is one of the body's rate, and its attitude follows.
        for momentum_b in self.case.driven_momentum_roots() {
            let rate = self.linearised.rate_by_torque.rows(RATE.start, 3) * momentum_b;
            let mut column = DVector::zeros(m);
            column.rows_mut(ROTATION.start, 3).copy_from(&rate);
            columns.push(column);
        }
        DMatrix::from_fn(m, columns.len(), |i, k| columns[k][i])
    }

    /// What the motors' disturbances, which the plant does not know, have moved over a step.
    fn push_motors(&mut self, transition: &DMatrix<f64>) {
        let (motors, n) = (self.layout.motors(), self.layout.plant.size());
        if !motors.is_empty() {
            let by_motor = transition.view((0, motors.start), (n, motors.len()));
            let moved = by_motor * self.beside.rows(motors.start, motors.len());
            self.plant.change_state(moved.as_slice());
        }
    }

    fn show_disturbance(&mut self) {
        let torque = self.layout.disturbance();
        if !torque.is_empty() {
            let now_n_m = Vector3::from_fn(|i, _| self.beside[torque.start + i]);
            self.plant.set_disturbance(now_n_m, 1.0 / self.noise.disturbance.correlation_s);
        }
    }

    /// Lets the covariances grow over a step.
    fn grow(&mut self, step: &Step, h_s: f64) {
        let (phi, layout) = (&step.transition, self.layout);
        let m = phi.nrows();
        let walked = DVector::from_fn(layout.size() - m, |i, _| self.walk_variance(m + i, h_s));
        grow(&mut self.covariance, phi, step.noise.as_ref(), &walked);
        if let Some(claimed) = self.claims.as_mut().and_then(|claims| claims.covariance.as_mut()) {
            grow(claimed, phi, step.of_model.as_ref(), &walked);
        }
        if let Some(origin) = &mut self.origin {
            let mut moved = DMatrix::zeros(origin.covariance.nrows(), m);
            add_product_transposed(&mut moved, &origin.covariance, phi);
            origin.covariance.columns_mut(0, m).copy_from(&moved);
        }
        if let Some(since) = &mut self.since {
            since.carry(phi);
        }
    }

    /// Variance that a coordinate gains by its own random walk in this time \[s\].
    pub(super) fn walk_variance(&self, i: usize, after_s: f64) -> f64 {
        let (layout, sensors) = (self.layout, &self.case.model().sensors);
        let of = |walk: Option<f64>| walk.unwrap_or(0.0).powi(2) * after_s;
        if layout.plant.hidden().contains(&i) {
            return of(self.case.hidden_noise().nth(i - layout.plant.hidden().start));
        }
        if layout.gyro_bias().contains(&i) {
            return of(sensors.gyro.errors.bias_walk.get(i - layout.gyro_bias().start).copied());
        }
        if layout.force_bias().contains(&i) {
            return of(sensors.accelerometer.errors.bias_walk.get(i - layout.force_bias().start).copied());
        }
        0.0
    }

    /// Nothing is uncertain of a wheel that its friction holds.
    fn hold_wheels(&mut self) {
        let held: Vec<usize> = self
            .layout
            .plant
            .wheels()
            .zip(self.plant.held_wheels())
            .filter_map(|(i, held)| held.then_some(i))
            .collect();
        for i in held {
            self.covariance.row_mut(i).fill(0.0);
            self.covariance.column_mut(i).fill(0.0);
            if let Some(claimed) = self.claims.as_mut().and_then(|claims| claims.covariance.as_mut()) {
                claimed.row_mut(i).fill(0.0);
                claimed.column_mut(i).fill(0.0);
            }
            if let Some(origin) = &mut self.origin {
                origin.covariance.column_mut(i).fill(0.0);
            }
            if let Some(since) = &mut self.since {
                since.hold(i);
            }
            if let Some(columns) = &mut self.columns {
                columns.hold(i);
            }
        }
    }
}

/// P <- F P F^T + Q of what moves; what is behind it walks.
fn grow(p: &mut DMatrix<f64>, phi: &DMatrix<f64>, noise: Option<&DMatrix<f64>>, walked: &DVector<f64>) {
    let (m, n) = (phi.nrows(), p.nrows());
    // P F^T: a covariance is symmetric.
    let mut moved = DMatrix::zeros(n, m);
    add_product_transposed(&mut moved, p, phi);
    let mut within = noise.cloned().unwrap_or_else(|| DMatrix::zeros(m, m));
    add_product_transposed(&mut within, &moved.rows(0, m).transpose(), phi);
    p.view_mut((0, 0), (m, m)).copy_from(&within);
    if n > m {
        let beside = moved.rows(m, n - m);
        p.view_mut((m, 0), (n - m, m)).copy_from(&beside);
        p.view_mut((0, m), (m, n - m)).copy_from(&beside.transpose());
    }
    for i in m..n {
        p[(i, i)] += walked[i - m];
    }
}
