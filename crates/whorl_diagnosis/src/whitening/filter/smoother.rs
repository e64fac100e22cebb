//! The smoother that runs back along the filter (modified Bryson-Frazier).

use nalgebra::{DMatrix, DMatrixView, DVectorView, Vector3};

use super::{ANGLE, Forward, Linear, RATE, System, WHEEL};
use crate::bins::motion::Motion;

/// Smoothed errors of the trajectory.
#[derive(Debug, Clone, Default)]
pub(crate) struct Smoothed {
    /// nodes x n
    pub state: Vec<f64>,
    /// Variance of the torque states, nodes x 3; empty without them.
    pub torque_variance: Vec<f64>,
}

impl System<'_> {
    /// The motion with its smoothed errors taken out, and the log likelihood of the measurements along it.
    pub fn corrected(&self, linear: &Linear) -> (Motion, f64) {
        let forward = self.filtered(linear);
        let smoothed = self.smoothed_from(linear, &forward);
        let mut better = self.motion.clone();
        for (k, state) in smoothed.state.chunks_exact(linear.n).enumerate() {
            let part = |first: usize| Vector3::new(state[first], state[first + 1], state[first + 2]);
            better.correct(k, &part(ANGLE), &part(RATE), &state[WHEEL..WHEEL + self.wheels()]);
        }
        let hidden = smoothed.state.get(self.first_hidden()..linear.n).unwrap_or_default();
        better.correct_hidden_start(self.mechanics.gyrostat.effects(), hidden);
        better.fill_middle(self.run);
        (better, forward.log_likelihood)
    }

    /// Runs back along a run of the filter.
    pub fn smoothed_from(&self, linear: &Linear, forward: &Forward) -> Smoothed {
        let n = linear.n;
        let nodes = self.run.nodes();
        let with_torque = self.settings.torque_walk > 0.0;
        let torque = WHEEL + self.wheels();
        let mut smoothed = Smoothed { state: vec![0.0; nodes * n], torque_variance: Vec::new() };
        if with_torque {
            smoothed.torque_variance = vec![0.0; nodes * 3];
        }
        let (mut lambda, mut back) = (vec![0.0; n], vec![0.0; n]);
        let mut big = DMatrix::<f64>::zeros(n, n);
        let mut dense = vec![0.0; n * n];
        for k in (0..nodes).rev() {
            if k + 1 < nodes {
                back.fill(0.0);
                for ((columns, row), l) in linear.transition_over(k).zip(&lambda) {
                    columns.iter().zip(row).for_each(|(m, x)| back[*m] += x * l);
                }
                std::mem::swap(&mut lambda, &mut back);
                if with_torque {
                    // F^T L F; what is stored by rows is seen as its transpose.
                    linear.dense_transition(k, &mut dense);
                    let transposed = DMatrixView::from_slice(&dense, n, n);
                    let moved = &big * transposed.transpose();
                    big.gemm(1.0, &transposed, &moved, 0.0);
                }
            }
            for r in linear.rows_of(k).rev() {
                let row = &linear.rows()[r];
                let gain = &forward.gain[r * n..(r + 1) * n];
                let inverse = forward.inverse_stddev[r];
                let along: f64 = gain.iter().zip(&lambda).map(|(g, l)| g * l).sum();
                let pull = forward.whitened[r] * inverse + along;
                if with_torque {
                    // (I - K H)^T L (I - K H) + H^T H / S
                    let gain = DVectorView::from_slice(gain, n);
                    let lk = &big * gain;
                    let weight = gain.dot(&lk) + inverse * inverse;
                    for (i, x) in row.parts() {
                        for (j, y) in row.parts() {
                            big[(i, j)] += weight * x * y;
                        }
                        for (j, l) in lk.iter().enumerate() {
                            big[(i, j)] -= x * l;
                            big[(j, i)] -= l * x;
                        }
                    }
                }
                for (i, h) in row.parts() {
                    lambda[i] -= h * pull;
                }
            }
            let p = &forward.covariance[k * n * n..(k + 1) * n * n];
            let predicted = &forward.state[k * n..(k + 1) * n];
            let states = smoothed.state[k * n..(k + 1) * n].iter_mut();
            for ((slot, x), row) in states.zip(predicted).zip(p.chunks_exact(n)) {
                *slot = x - row.iter().zip(&lambda).map(|(c, l)| c * l).sum::<f64>();
            }
            if with_torque {
                // P - P L P
                let p = DMatrixView::from_slice(p, n, n);
                for i in 0..3 {
                    let along = p.column(torque + i);
                    let learnt = along.dot(&(&big * along));
                    smoothed.torque_variance[k * 3 + i] = (p[(torque + i, torque + i)] - learnt).max(0.0);
                }
            }
        }
        smoothed
    }
}
