//! The state at the first reading.

use nalgebra::{DMatrix, DVector, UnitQuaternion, Vector3};
use whorl_dynamics::Plant;
use whorl_dynamics::plant::{RATE, ROTATION};
use whorl_math::quaternion_exp;

use crate::layout::Layout;
use crate::noise::Noise;
use crate::prepared::Prepared;

/// The state at the first reading: a normal distribution.
#[derive(Debug, Clone, PartialEq)]
pub struct Start {
    /// What the coordinates of `covariance` and `beside` are.
    pub layout: Layout,
    /// Attitude, v_world = q v_body.
    pub q_world_body: UnitQuaternion<f64>,
    /// Body rate, body axes [rad/s].
    pub omega_wb_b_rad_s: Vector3<f64>,
    /// Wheel speeds relative to the body [rad/s].
    pub wheel_speed_rad_s: Vec<f64>,
    /// Hidden states of effects.
    pub hidden: Vec<f64>,
    /// Disturbance and biases at their places in the layout; the plant's entries are zero.
    pub beside: DVector<f64>,
    /// Covariance, in the layout's coordinates and units.
    pub covariance: DMatrix<f64>,
}

impl Start {
    /// The same distribution about another mean: changed by coordinates of the layout.
    #[must_use]
    pub fn moved(&self, change: &DVector<f64>) -> Self {
        let mut moved = self.clone();
        let of = |from: usize| Vector3::from_fn(|i, _| change[from + i]);
        moved.q_world_body *= quaternion_exp(&of(ROTATION.start));
        moved.omega_wb_b_rad_s += of(RATE.start);
        for (i, speed) in self.layout.plant.wheels().zip(&mut moved.wheel_speed_rad_s) {
            *speed += change[i];
        }
        for (i, x) in self.layout.plant.hidden().zip(&mut moved.hidden) {
            *x += change[i];
        }
        for i in self.layout.plant.size()..self.layout.size() {
            moved.beside[i] += change[i];
        }
        moved
    }

    /// The same about the mean of another, whose disturbances it does not have.
    #[must_use]
    pub(crate) fn about(mut self, other: &Self) -> Self {
        (self.q_world_body, self.omega_wb_b_rad_s) = (other.q_world_body, other.omega_wb_b_rad_s);
        self.wheel_speed_rad_s.clone_from(&other.wheel_speed_rad_s);
        self.hidden.clone_from(&other.hidden);
        let biases =
            (self.layout.moving()..self.layout.size()).zip(other.layout.moving()..other.layout.size());
        for (i, k) in biases {
            self.beside[i] = other.beside[k];
        }
        self
    }

    /// The same with nothing known of the disturbances but their levels.
    #[must_use]
    pub(crate) fn with_disturbance(&self, noise: &Noise) -> Self {
        let mut start = self.clone();
        for (i, stddev) in noise.disturbance.coordinates(self.layout) {
            start.beside[i] = 0.0;
            start.covariance.row_mut(i).fill(0.0);
            start.covariance.column_mut(i).fill(0.0);
            start.covariance[(i, i)] = stddev * stddev;
        }
        start
    }

    /// The same with other disturbances, of which nothing is known but their levels.
    #[must_use]
    pub(crate) fn with_levels(&self, case: &Prepared<'_>, noise: &Noise) -> Self {
        let wide = Self::wide(case, noise);
        if wide.layout == self.layout {
            return self.with_disturbance(noise);
        }
        let mut start = wide.about(self).with_disturbance(noise);
        start.covariance = start.embedded(&self.covariance, self.layout);
        start
    }

    /// A covariance in coordinates of another layout, with the disturbances of this start.
    #[must_use]
    pub(crate) fn embedded(&self, covariance: &DMatrix<f64>, of: Layout) -> DMatrix<f64> {
        if of == self.layout {
            return covariance.clone();
        }
        let mut embedded = self.covariance.clone();
        let own = |layout: Layout| (0..layout.plant.size()).chain(layout.moving()..layout.size());
        for (i, from_i) in own(self.layout).zip(own(of)) {
            for (k, from_k) in own(self.layout).zip(own(of)) {
                embedded[(i, k)] = covariance[(from_i, from_k)];
            }
        }
        embedded
    }

    /// Whether it has the states of this model.
    pub(crate) fn is_of(&self, case: &Prepared<'_>) -> bool {
        self.layout.plant == case.plant().tangent()
    }

    /// Puts a plant into its mean.
    pub(crate) fn put(&self, plant: &mut Plant) {
        // Of another number of wheels it cannot be: the recording was checked against the model.
        let _ = plant.set_motion(&self.q_world_body, &self.omega_wb_b_rad_s, &self.wheel_speed_rad_s);
        let mut change = vec![0.0; self.layout.plant.size()];
        for ((i, wanted), now) in self.layout.plant.hidden().zip(&self.hidden).zip(plant.state().hidden) {
            change[i] = wanted - now;
        }
        plant.change_state(&change);
    }
}
