//! Does a true attitude turn with the gyro?

use nalgebra::{UnitQuaternion, Vector3};
use whorl_math::{quaternion_exp, rotation_vector};

use crate::Recording;

/// Turns of at least this are compared \[rad\] ...
const LEAST_TURN_RAD: f64 = 0.4;
/// ... within this time, in which a gyro's bias turns it by less \[s\].
const LONGEST_S: f64 = 4.0;
/// Turns that are needed.
const FEWEST: u32 = 8;
/// What is called true leaves more than this share of the gyro's turns unexplained \[1\]: a gyro whose scale is off by a fifth leaves a
/// twenty-fifth.
const LEFT: f64 = 0.5;
/// Another reading of its numbers is named where it leaves less than this \[1\].
const EXPLAINED: f64 = 0.1;

/// Compares the turns of an attitude that is called true with those of the gyro.
///
/// Between two instants the gyro turns by `R`, and `q_1 = q_0 R` for a true attitude, body to world. The squared angles of
/// `R^-1 q_0^-1 q_1` are summed up beside those of `R`, and so are those of the inverse attitude, world to body.
#[derive(Debug, Clone, Default)]
pub struct TruthCheck {
    last_s: Option<f64>,
    turn: UnitQuaternion<f64>,
    since_s: f64,
    before: Option<UnitQuaternion<f64>>,
    count: u32,
    turned: f64,
    misfit: f64,
    misfit_of_inverse: f64,
}

impl TruthCheck {
    /// A sample of the gyro, body axes [rad/s], the mean since the one before.
    pub fn add_gyro(&mut self, time_s: f64, gyro_rad_s: &Vector3<f64>) {
        let Some(last_s) = self.last_s.replace(time_s) else { return };
        let step_s = time_s - last_s;
        if !(0.0..LONGEST_S).contains(&step_s) || !gyro_rad_s.sum().is_finite() {
            self.before = None;
            return;
        }
        self.turn *= quaternion_exp(&(gyro_rad_s * step_s));
        self.since_s += step_s;
    }

    /// The attitude at the latest sample of the gyro, body to world.
    pub fn add_attitude(&mut self, q_world_body: &UnitQuaternion<f64>) {
        if let Some(before) = self.before.filter(|_| self.since_s < LONGEST_S) {
            if self.turn.angle() < LEAST_TURN_RAD {
                return;
            }
            let misfit = |before: UnitQuaternion<f64>, after: UnitQuaternion<f64>| {
                rotation_vector(&(self.turn.inverse() * before.inverse() * after)).norm_squared()
            };
            self.misfit += misfit(before, *q_world_body);
            self.misfit_of_inverse += misfit(before.inverse(), q_world_body.inverse());
            self.turned += self.turn.angle().powi(2);
            self.count += 1;
        }
        self.before = Some(*q_world_body);
        self.turn = UnitQuaternion::identity();
        self.since_s = 0.0;
    }

    /// Why the attitude is no truth, in a sentence; `None` where it is one, or too little turned.
    #[must_use]
    pub fn contradiction(&self) -> Option<String> {
        if self.count < FEWEST || self.misfit < LEFT * self.turned {
            return None;
        }
        let hint = if self.misfit_of_inverse < EXPLAINED * self.turned {
            "the other `rotation` in the map would fit"
        } else {
            "are its columns in the order w, x, y, z, of this sensor and in its axes?"
        };
        let rms_deg = |sum: f64| (sum / f64::from(self.count)).sqrt().to_degrees();
        Some(format!(
            "The true attitude turns against the gyro, by {:.0} deg where the gyro turns by {:.0} deg (root mean square of {} turns), and is \
             not used: {hint}",
            rms_deg(self.misfit),
            rms_deg(self.turned),
            self.count
        ))
    }
}

/// Why the true attitude of a recording is none, if so.
pub(crate) fn truth_contradiction(recording: &Recording) -> Option<String> {
    let truth = &recording.truth.as_ref()?.q_world_body;
    if !recording.has_whole_gyro() {
        return None;
    }
    let (mut check, mut next) = (TruthCheck::default(), 0);
    for (time_s, rate) in recording.gyro_b_rad_s.time_s.iter().zip(&recording.gyro_b_rad_s.value) {
        check.add_gyro(*time_s, rate);
        // The latest attitude up to here.
        let first = next;
        while truth.time_s.get(next).is_some_and(|t| t <= time_s) {
            next += 1;
        }
        if let Some(q) = truth.value.get(next.saturating_sub(1)).filter(|_| next > first) {
            check.add_attitude(q);
        }
    }
    check.contradiction()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A body that tumbles for a minute; its attitude is told as `told` makes it.
    fn check(told: impl Fn(f64, UnitQuaternion<f64>) -> UnitQuaternion<f64>, scale: f64) -> TruthCheck {
        let (mut check, mut q) = (TruthCheck::default(), UnitQuaternion::from_euler_angles(0.3, -0.2, 1.0));
        for i in 0..6000 {
            let t = f64::from(i) * 0.01;
            let rate = Vector3::new((0.7 * t).sin(), 0.8 * (0.4 * t).cos(), 0.5);
            q *= quaternion_exp(&(rate * 0.01));
            check.add_gyro(t, &(rate * scale + Vector3::new(0.005, -0.005, 0.005)));
            if i % 5 == 0 {
                check.add_attitude(&told(t, q));
            }
        }
        check
    }

    #[test]
    fn attitudes_that_are_none_are_named_and_others_are_not() {
        let swapped = |_: f64, q: UnitQuaternion<f64>| {
            UnitQuaternion::from_quaternion(nalgebra::Quaternion::new(q.i, q.j, q.k, q.w))
        };
        let said = check(swapped, 1.0).contradiction().unwrap();
        assert!(
            said.contains("turns against the gyro") && said.contains("in the order w, x, y, z"),
            "{said}"
        );
        let said = check(|_, q| q.inverse(), 1.0).contradiction().unwrap();
        assert!(said.contains("the other `rotation` in the map would fit"), "{said}");
        // In another frame of the world, with a gyro that reads low or high, in tremor of a degree: a truth.
        let frame = UnitQuaternion::from_euler_angles(0.0, 0.0, 2.0);
        let shaken = |t: f64, q: UnitQuaternion<f64>| {
            frame * q * UnitQuaternion::from_euler_angles(0.02 * (40.0 * t).sin(), 0.0, 0.0)
        };
        for scale in [1.0, 0.8, 1.3] {
            assert_eq!(check(shaken, scale).contradiction(), None, "{scale}");
        }
        assert_eq!(TruthCheck::default().contradiction(), None);
    }
}
