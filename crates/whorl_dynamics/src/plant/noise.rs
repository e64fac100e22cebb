//! Random numbers of a run, one stream for each user, so that adding a sensor does not change the
//! noise of the others.

use nalgebra::Vector3;
use rand_distr::{Distribution, StandardNormal};
use rand_pcg::Pcg64;

use crate::platform::TriaxialErrors;

/// Who draws. The numbers are part of what makes a run repeatable: never reuse one.
#[derive(Debug, Clone, Copy)]
pub(crate) enum Stream {
    Gyro = 1,
    Accelerometer = 2,
    Vector = 3,
    WheelSpeed = 4,
    BusVoltage = 5,
    TankPressure = 6,
    Temperature = 7,
    Effects = 8,
}

/// Standard normal numbers from one stream of a seed.
#[derive(Debug, Clone)]
pub(crate) struct Normal {
    generator: Pcg64,
}

impl Normal {
    pub fn new(seed: u64, stream: Stream) -> Self {
        // Seeds 0, 1, 2... must not give neighbouring states: spread them first (SplitMix64).
        let spread = |x: u64| {
            let x = x.wrapping_add(0x9e37_79b9_7f4a_7c15);
            let x = (x ^ (x >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
            let x = (x ^ (x >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
            x ^ (x >> 31)
        };
        let state = (u128::from(spread(seed)) << 64) | u128::from(spread(!seed));
        Self { generator: Pcg64::new(state, stream as u128) }
    }

    pub fn draw(&mut self) -> f64 {
        StandardNormal.sample(&mut self.generator)
    }

    pub fn draw_vector(&mut self) -> Vector3<f64> {
        let [x, y, z] = [self.draw(), self.draw(), self.draw()];
        Vector3::new(x, y, z)
    }
}

/// A three-axis sensor with the bias that it has acquired.
#[derive(Debug, Clone)]
pub(super) struct TriaxialSensor {
    errors: TriaxialErrors,
    normal: Normal,
    bias: Vector3<f64>,
    last_ns: i64,
}

impl TriaxialSensor {
    /// Draws the turn-on bias.
    pub fn new(errors: TriaxialErrors, mut normal: Normal, now_ns: i64) -> Self {
        let bias = errors.bias + errors.bias_turn_on_stddev.component_mul(&normal.draw_vector());
        Self { errors, normal, bias, last_ns: now_ns }
    }

    /// Walks the bias on to `now_ns` and reads `truth`.
    pub fn sample(&mut self, truth: &Vector3<f64>, now_ns: i64) -> Vector3<f64> {
        let elapsed_s = (now_ns - self.last_ns).max(0) as f64 * 1e-9;
        self.last_ns = now_ns;
        // Drawn even when the intensity is zero, so that changing it changes nothing else.
        let walk = self.normal.draw_vector();
        self.bias += self.errors.bias_walk.component_mul(&walk) * elapsed_s.sqrt();
        let noise = self.normal.draw_vector();
        self.errors.reading(truth, &self.bias, &noise)
    }

    pub fn bias(&self) -> &Vector3<f64> {
        &self.bias
    }
}
