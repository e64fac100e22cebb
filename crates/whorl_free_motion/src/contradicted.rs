//! What the filter does where its sensors contradict each other.

use super::FreeMotionFilter;
use super::covariance::{ATTITUDE, FIELD, FORCE_BIAS, GYRO_BIAS, POSITION, UNKNOWN_RAD, VELOCITY};
use super::still_field::Verdict;
use nalgebra::Vector3;

/// A steady rate that is off the bias by so many standard deviations is a turn.
const BIAS_SIGMAS: f64 = 4.0;
/// How wrong an inclination is, about, that a wrong accelerometer corrected until it was found \[rad\].
const WRONG_FORCE_RAD: f64 = 0.3;

impl FreeMotionFilter {
    /// Whether what seems to be rest is a slow turn. The field tells, where it can; else a rate that the bias cannot have come to
    /// since it was known is a turn: a bias changes no faster than it walks.
    pub(super) fn turns_slowly(&mut self, rate: &Vector3<f64>) -> bool {
        let verdict = self.still_field.verdict();
        let of_rest = self.parameters.rest_rate_sigma_rad_s.powi(2);
        let unlikely = (0..3).any(|axis| {
            let variance = self.covariance[(GYRO_BIAS + axis, GYRO_BIAS + axis)] + of_rest;
            (rate[axis] - self.gyro_bias_rad_s[axis]).powi(2) > BIAS_SIGMAS.powi(2) * variance
        });
        match verdict {
            // The bias is another than was believed.
            Verdict::Rests if unlikely => self.forget_bias(*rate),
            Verdict::Turns => {
                if let Some(before) = self.still_field.bias_before() {
                    self.forget_bias(before);
                }
            }
            _ => {}
        }
        let turns = verdict == Verdict::Turns || unlikely && verdict != Verdict::Rests;
        self.rest.refuse(turns);
        turns
    }

    /// Sets a bias that is known as little as at the start.
    fn forget_bias(&mut self, bias_rad_s: Vector3<f64>) {
        self.gyro_bias_rad_s = bias_rad_s;
        for state in GYRO_BIAS..GYRO_BIAS + 3 {
            self.covariance.fill_row(state, 0.0);
            self.covariance.fill_column(state, 0.0);
            self.covariance[(state, state)] = self.parameters.gyro_bias_sigma_rad_s.powi(2);
        }
    }

    /// Goes on without a magnetometer: the heading is that of the gyro since the start, and from where it counts is not known.
    pub(super) fn give_up_field(&mut self) {
        self.turn_heading(-self.turned_rad);
        self.turned_rad = 0.0;
        self.field_length = None;
        for state in [ATTITUDE + 2, FIELD, FIELD + 1, FIELD + 2] {
            self.covariance.fill_row(state, 0.0);
            self.covariance.fill_column(state, 0.0);
        }
        self.covariance[(ATTITUDE + 2, ATTITUDE + 2)] = UNKNOWN_RAD.powi(2);
    }

    /// Goes on without an accelerometer: the inclination is carried by the gyro alone.
    pub(super) fn give_up_force(&mut self) {
        self.without_force = true;
        (self.velocity_w_m_s, self.position_w_m) = (Vector3::zeros(), Vector3::zeros());
        for state in (ATTITUDE..ATTITUDE + 2).chain(VELOCITY..POSITION + 3).chain(FORCE_BIAS..FORCE_BIAS + 3)
        {
            let variance = self.covariance[(state, state)];
            self.covariance.fill_row(state, 0.0);
            self.covariance.fill_column(state, 0.0);
            self.covariance[(state, state)] = variance;
        }
        for state in ATTITUDE..ATTITUDE + 2 {
            self.covariance[(state, state)] += WRONG_FORCE_RAD.powi(2);
        }
    }
}
