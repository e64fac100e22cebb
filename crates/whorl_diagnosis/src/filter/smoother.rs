//! The smoother that runs back along the filter (modified Bryson-Frazier).

use super::square::{multiply, transposed_multiply};
use super::{Keep, Linear, System, WHEEL};

/// Smoothed errors of the trajectory.
#[derive(Debug, Clone, Default)]
pub(crate) struct Smoothed {
    /// nodes x n
    pub state: Vec<f64>,
    /// Variance of the torque states, nodes x 3; empty without them.
    pub torque_variance: Vec<f64>,
}

impl System<'_> {
    /// Runs the filter and back.
    pub fn smoothed(&self, linear: &Linear) -> Smoothed {
        let forward = self.forward(linear, Keep::Predictions);
        let n = linear.n;
        let nodes = self.run.nodes();
        let with_torque = self.settings.torque_walk > 0.0;
        let torque = WHEEL + self.wheels();
        let mut smoothed = Smoothed { state: vec![0.0; nodes * n], torque_variance: Vec::new() };
        if with_torque {
            smoothed.torque_variance = vec![0.0; nodes * 3];
        }
        let (mut lambda, mut back) = (vec![0.0; n], vec![0.0; n]);
        let mut big = vec![0.0; n * n];
        let mut work = vec![0.0; n * n];
        let mut work2 = vec![0.0; n * n];
        for k in (0..nodes).rev() {
            if k + 1 < nodes {
                let f = linear.transition_over(k);
                back.fill(0.0);
                for (row, l) in f.chunks_exact(n).zip(&lambda) {
                    back.iter_mut().zip(row).for_each(|(slot, x)| *slot += x * l);
                }
                std::mem::swap(&mut lambda, &mut back);
                if with_torque {
                    // F^T L F
                    multiply(&big, f, &mut work, n);
                    transposed_multiply(f, &work, &mut big, n);
                }
            }
            for r in linear.rows_of(k).rev() {
                let row = &linear.rows[r];
                let gain = &forward.gain[r * n..(r + 1) * n];
                let inverse = forward.inverse_stddev[r];
                let along: f64 = gain.iter().zip(&lambda).map(|(g, l)| g * l).sum();
                let pull = forward.whitened[r] * inverse + along;
                if with_torque {
                    // (I - K H)^T L (I - K H) + H^T H / S
                    let lk: Vec<f64> = big
                        .chunks_exact(n)
                        .map(|row| row.iter().zip(gain).map(|(l, g)| l * g).sum())
                        .collect();
                    let klk: f64 = gain.iter().zip(&lk).map(|(g, l)| g * l).sum();
                    let weight = klk + inverse * inverse;
                    for (i, x) in row.parts() {
                        for (j, y) in row.parts() {
                            big[i * n + j] += weight * x * y;
                        }
                        for (j, l) in lk.iter().enumerate() {
                            big[i * n + j] -= x * l;
                            big[j * n + i] -= l * x;
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
                multiply(p, &big, &mut work, n);
                multiply(&work, p, &mut work2, n);
                for i in 0..3 {
                    let at = (torque + i) * (n + 1);
                    smoothed.torque_variance[k * 3 + i] = (p[at] - work2[at]).max(0.0);
                }
            }
        }
        smoothed
    }
}
