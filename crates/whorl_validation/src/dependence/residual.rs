//! A torque that a model leaves unexplained, ready to be regressed.

use nalgebra::{Matrix3, UnitQuaternion, Vector3};

use super::{DependenceError, FEWEST_VALUES, Frame};

/// Share of the largest standard deviation below which an axis is one about which the rig holds the body.
const HELD: f64 = 1e-9;

/// Estimates of a torque at instants, each with the standard deviation of its noise, axis by axis, in one frame or two.
#[derive(Debug, Clone, PartialEq)]
pub struct Residual {
    /// Instants \[s\], increasing.
    pub time_s: Vec<f64>,
    /// (value, standard deviation) [N m] of three axes; the deviation is infinite, so that the axis weighs nothing, where nothing can
    /// turn.
    frames: Vec<(Frame, Axes)>,
    /// Of a body, at each instant the matrix that takes a body vector to the world.
    pub(super) r_world_body: Vec<Matrix3<f64>>,
}

/// (value, standard deviation) of three axes.
pub(super) type Axes = [Vec<(f64, f64)>; 3];

impl Residual {
    /// On the body, at instants with these attitudes (v_world = q v_body): torques in body axes [N m] and the covariances of their
    /// noise [N^2 m^2].
    #[must_use]
    pub fn of_body(
        time_s: Vec<f64>,
        torque_b_n_m: &[Vector3<f64>],
        noise_b_n2_m2: &[Matrix3<f64>],
        q_world_body: &[UnitQuaternion<f64>],
    ) -> Self {
        let mut body = [const { Vec::new() }; 3];
        let mut world = [const { Vec::new() }; 3];
        let mut r_world_body = Vec::new();
        for ((torque, noise), q) in torque_b_n_m.iter().zip(noise_b_n2_m2).zip(q_world_body) {
            let r = q.to_rotation_matrix().into_inner();
            push(&mut body, torque, noise);
            push(&mut world, &(r * torque), &(r * noise * r.transpose()));
            r_world_body.push(r);
        }
        Self { time_s, frames: vec![(Frame::Body, body), (Frame::World, world)], r_world_body }
    }

    /// On a body that turns on a hinge along this axis (unit, body axes), about it: the hinge holds all others.
    #[must_use]
    pub fn on_hinge(
        time_s: Vec<f64>,
        torque_b_n_m: &[Vector3<f64>],
        noise_b_n2_m2: &[Matrix3<f64>],
        axis_b: &Vector3<f64>,
    ) -> Self {
        let about = |(torque, noise): (&Vector3<f64>, &Matrix3<f64>)| {
            (axis_b.dot(torque), axis_b.dot(&(noise * axis_b)).max(0.0).sqrt())
        };
        Self::about_one(Frame::Hinge, time_s, torque_b_n_m.iter().zip(noise_b_n2_m2).map(about).collect())
    }

    /// Of a wheel's motor about its axis: values with the standard deviations of their noise [N m].
    #[must_use]
    pub fn of_motor(time_s: Vec<f64>, torque_n_m: Vec<(f64, f64)>) -> Self {
        Self::about_one(Frame::Wheel, time_s, torque_n_m)
    }

    fn about_one(frame: Frame, time_s: Vec<f64>, torque_n_m: Vec<(f64, f64)>) -> Self {
        let nothing = vec![(0.0, f64::INFINITY); torque_n_m.len()];
        let frames = vec![(frame, [torque_n_m, nothing.clone(), nothing])];
        Self { time_s, frames, r_world_body: Vec::new() }
    }

    /// Of each frame its axes.
    pub(super) fn frames(&self) -> impl Iterator<Item = (Frame, &Axes)> {
        self.frames.iter().map(|(frame, axes)| (*frame, axes))
    }

    /// Number of values, after validation.
    pub(super) fn checked(&self) -> Result<usize, DependenceError> {
        let count = self.time_s.len();
        if self.frames().any(|(_, axes)| axes.iter().any(|axis| axis.len() != count)) {
            return Err(DependenceError::NotUsable("its series differ in length"));
        }
        if count < FEWEST_VALUES {
            return Err(DependenceError::TooFewValues { given: count });
        }
        let all = || self.frames.iter().flat_map(|(_, axes)| axes.iter().flatten());
        if !all().all(|(value, _)| value.is_finite()) {
            return Err(DependenceError::NotUsable("a value is not finite"));
        }
        if !all().all(|(_, sigma)| *sigma > 0.0) || all().all(|(_, sigma)| !sigma.is_finite()) {
            return Err(DependenceError::NotUsable("a standard deviation is not positive"));
        }
        Ok(count)
    }
}

fn push(axes: &mut Axes, torque: &Vector3<f64>, noise: &Matrix3<f64>) {
    // NaN stays, to be refused.
    let sigma = noise.diagonal().map(|x| if x < 0.0 { 0.0 } else { x.sqrt() });
    let held = HELD * sigma.amax();
    for (i, axis) in axes.iter_mut().enumerate() {
        axis.push((torque[i], if sigma[i] <= held { f64::INFINITY } else { sigma[i] }));
    }
}
