//! What an inertial unit does to the motion before it is read: nothing, a low-pass, or the mean of a window.
//!
//! Both are worked out from running integrals of what the sensors are given, which the trapezoidal rule adds up
//! between edges: a low-pass as tau (y - y0) = X - Y with X and Y the integrals of input and output, a window as the
//! difference of X at its two ends.

use std::collections::VecDeque;

use nalgebra::SVector;

/// Rate, then specific force.
pub type Seen = SVector<f64, 6>;

/// Filters of gyro and accelerometer.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Filters {
    /// Delay of gyro and accelerometer for slow motion \[s\]: time constant, or half the window.
    pub delay_s: [f64; 2],
    /// Windows instead of low-passes.
    pub windows: bool,
}

/// Filters at work.
#[derive(Debug, Clone)]
pub struct Filtering {
    filters: Filters,
    output: Seen,
    /// Time, input, and its integral, over the longest window.
    past: VecDeque<(f64, Seen, Seen)>,
}

impl Filtering {
    /// They had settled at this input.
    pub fn new(filters: Filters, time_s: f64, input: Seen) -> Self {
        let longest_s = 2.0 * filters.delay_s[0].max(filters.delay_s[1]) + 0.1;
        let before = (time_s - longest_s, input, -input * longest_s);
        Self { filters, output: input, past: VecDeque::from([before, (time_s, input, Seen::zeros())]) }
    }

    /// Whether anything is filtered at all.
    pub fn is_idle(&self) -> bool {
        self.filters.delay_s == [0.0; 2]
    }

    /// Goes on to `time_s`, over which the input went from `from` to `to`.
    pub fn advance(&mut self, time_s: f64, from: &Seen, to: &Seen) {
        let Some((before_s, _, sum)) = self.past.back().copied() else { return };
        let step_s = time_s - before_s;
        if step_s <= 0.0 {
            return;
        }
        // An edge since the last step: the input there is the one after it.
        if let Some(last) = self.past.back_mut() {
            last.1 = *from;
        }
        self.past.push_back((time_s, *to, sum + (from + to) * (0.5 * step_s)));
        let oldest_s = time_s - 2.0 * self.filters.delay_s[0].max(self.filters.delay_s[1]) - 0.05;
        while self.past.get(1).is_some_and(|second| second.0 < oldest_s) {
            self.past.pop_front();
        }
        for i in 0..6 {
            let tau_s = self.filters.delay_s[i / 3];
            // tau (y1 - y0) = h (x0 + x1)/2 - h (y0 + y1)/2.
            let mean = 0.5 * (from[i] + to[i]);
            self.output[i] += step_s * (mean - self.output[i]) / (tau_s + 0.5 * step_s);
            if tau_s == 0.0 {
                self.output[i] = to[i];
            }
        }
    }

    /// What is read now.
    pub fn output(&self) -> Seen {
        if !self.filters.windows {
            return self.output;
        }
        let Some((now_s, input, sum)) = self.past.back() else { return self.output };
        Seen::from_fn(|i, _| {
            let window_s = 2.0 * self.filters.delay_s[i / 3];
            if window_s == 0.0 { input[i] } else { (sum[i] - self.integral(now_s - window_s, i)) / window_s }
        })
    }

    fn integral(&self, time_s: f64, i: usize) -> f64 {
        let after = self.past.partition_point(|(t, ..)| *t <= time_s).clamp(1, self.past.len() - 1);
        let ((t0, x0, s0), (t1, _, s1)) = (&self.past[after - 1], &self.past[after]);
        let (h, u) = (t1 - t0, time_s - t0);
        // The parabola through both sums with the input's value at the first.
        let bend = (s1[i] - s0[i] - x0[i] * h) / (h * h);
        s0[i] + x0[i] * u + bend * u * u
    }
}
