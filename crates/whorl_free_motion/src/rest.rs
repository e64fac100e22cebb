//! Does the sensor rest?

use super::FreeMotionParameters;
use nalgebra::Vector3;

/// Low-passed rate and specific force, and how long the samples have stayed near them.
#[derive(Clone, Debug, PartialEq, Default)]
pub(super) struct RestDetector {
    mean: Option<(Vector3<f64>, Vector3<f64>)>,
    still_s: f64,
    /// Rate, averaged since rest began.
    rate_sum: Vector3<f64>,
    rate_s: f64,
    /// Whether what seems to be rest is a slow turn.
    refused: bool,
}

/// What seems to be rest is looked at from here on \[s\]: the means of its beginning still hold the motion before.
const SEEMS_S: f64 = 0.5;

impl RestDetector {
    /// Takes a sample; gives the mean rate over each interval of rest.
    pub(super) fn add(
        &mut self,
        p: &FreeMotionParameters,
        dt_s: f64,
        gyro: &Vector3<f64>,
        force: &Vector3<f64>,
    ) -> Option<Vector3<f64>> {
        let (mean_gyro, mean_force) = self.mean.get_or_insert((*gyro, *force));
        let weight = dt_s / (0.3 * p.rest_time_s + dt_s);
        *mean_gyro += (gyro - *mean_gyro) * weight;
        *mean_force += (force - *mean_force) * weight;
        let moving = (gyro - *mean_gyro).norm() > p.rest_rate_rad_s
            || (force - *mean_force).norm() > p.rest_force_m_s2
            || mean_gyro.norm() > p.rest_rate_limit_rad_s;
        if moving {
            (self.still_s, self.rate_sum, self.rate_s) = (0.0, Vector3::zeros(), 0.0);
            self.refused = false;
            return None;
        }
        self.still_s += dt_s;
        if self.still_s < p.rest_time_s {
            return None;
        }
        self.rate_sum += gyro * dt_s;
        self.rate_s += dt_s;
        if self.rate_s < 0.25 {
            return None;
        }
        let rate = self.rate_sum / self.rate_s;
        (self.rate_sum, self.rate_s) = (Vector3::zeros(), 0.0);
        Some(rate)
    }

    pub(super) fn resting(&self, p: &FreeMotionParameters) -> bool {
        self.still_s >= p.rest_time_s && !self.refused
    }

    /// Whether gyro and accelerometer are as those of a sensor that rests, or turns slowly and steadily.
    pub(super) fn seems_still(&self) -> bool {
        self.still_s >= SEEMS_S
    }

    /// Says whether this is a slow turn and no rest.
    pub(super) fn refuse(&mut self, is_turn: bool) {
        self.refused = is_turn;
    }
}
