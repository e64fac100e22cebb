//! What one pass of the filter shows of the levels of noise and disturbance.

use std::collections::BTreeMap;

use nalgebra::DVector;
use whorl_recording::{Channel, Component};

use crate::filter::{Filter, Innovation};
use crate::layout::Layout;
use crate::noise::Noise;
use crate::prepared::Prepared;
use crate::start::Start;

/// Whether no level changes by more than a share.
pub(crate) fn stands(now: &Noise, next: &Noise, share: f64) -> bool {
    let levels = |noise: &Noise| -> Vec<f64> {
        let of = noise.disturbance.stddev_b_n_m.iter().chain(&noise.disturbance.motors_n_m);
        let readings = noise.gyro_rad_s.iter().chain(&noise.force_m_s2).chain(&noise.vector_rad);
        of.chain(readings).chain([&noise.wheel_speed_rad_s]).copied().collect()
    };
    levels(now).iter().zip(levels(next)).all(|(now, next)| (next - now).abs() <= share * now)
}

/// What a pass shows of the levels.
pub(crate) struct Moments {
    pub log: f64,
    layout: Layout,
    /// Of each coordinate over time: square of the estimate, and variance.
    estimate: DVector<f64>,
    variance: DVector<f64>,
    time_s: f64,
    /// Of each sensor's component: squares of the readings' own errors.
    readings: BTreeMap<Component, Squares>,
}

#[derive(Debug, Clone, Copy, Default)]
struct Squares {
    squares: f64,
    numbers: usize,
}

impl Moments {
    pub fn of(case: &Prepared<'_>, noise: &Noise, start: &Start, part: usize) -> Self {
        let mut filter = Filter::new(case, noise, start).about_known_biases(start);
        let layout = filter.layout;
        let mut found = Self {
            log: filter.log_known,
            layout,
            estimate: DVector::zeros(layout.size()),
            variance: DVector::zeros(layout.size()),
            time_s: 0.0,
            readings: BTreeMap::new(),
        };
        let mut last_ns = filter.plant.now_ns();
        for _ in 0..part {
            let mut add = |innovation: &Innovation| {
                found.log += innovation.log_likelihood();
                let own = noise.of(innovation.component).powi(2);
                // What the innovation says of the reading's own error, and how uncertain that is: EM of a variance.
                let sums = found.readings.entry(pooled(innovation.component)).or_default();
                let share = own / innovation.stddev.powi(2);
                sums.squares += own + own * share * (innovation.normalised().powi(2) - 1.0);
                sums.numbers += 1;
            };
            if !filter.step(&mut add) {
                break;
            }
            let since_s = (filter.plant.now_ns() - last_ns) as f64 * 1e-9;
            last_ns = filter.plant.now_ns();
            for i in layout.plant.size()..layout.moving() {
                found.estimate[i] += filter.beside[i].powi(2) * since_s;
                found.variance[i] += filter.covariance[(i, i)] * since_s;
            }
            found.time_s += since_s;
        }
        if filter.lost {
            found.log = f64::NEG_INFINITY;
        }
        found
    }

    /// Levels that agree better with what was found.
    pub fn improved(&self, case: &Prepared<'_>, noise: &Noise, stated: &Noise) -> Noise {
        let settings = case.settings();
        let mut next = noise.clone();
        let (body, motors) = (self.layout.disturbance(), self.layout.motors());
        let level = |i: usize, stddev: f64| {
            let (variance, time_s) = (stddev * stddev, self.time_s);
            let seen = 1.0 - self.variance[i] / time_s / variance;
            if !(variance > 0.0 && seen > settings.level_seen) {
                return 0.0;
            }
            // Exact where the disturbance is seen well, slow where it is hardly: steps are as much longer.
            let ratio = self.estimate[i] / time_s / variance / seen;
            stddev * ratio.powf(0.5 * (1.0 / seen).min(settings.level_longest_step)).clamp(0.01, 100.0)
        };
        for (i, stddev) in body.zip(&mut next.disturbance.stddev_b_n_m) {
            *stddev = level(i, *stddev);
        }
        for (i, stddev) in motors.zip(&mut next.disturbance.motors_n_m) {
            *stddev = level(i, *stddev);
        }
        for (component, sums) in &self.readings {
            let stated = stated.of(*component);
            let found = (sums.squares / sums.numbers as f64).sqrt();
            // The stated level counts as some readings more.
            let prior = 0.5 * settings.stated_noise_factor.ln().powi(-2);
            let share = sums.numbers as f64 / (sums.numbers as f64 + prior);
            next.set(*component, stated * (found / stated).powf(share));
        }
        next
    }
}

/// Components that share a level, by the first of them: the axes across a direction; all tachometers.
fn pooled(component: Component) -> Component {
    match component.channel {
        Channel::Vector | Channel::WheelSpeed => Component::new(component.channel, component.sensor(), 0),
        _ => component,
    }
}
