//! The recent gyro-integrated attitudes, for vector samples that arrive late.

use nalgebra::{Quaternion, UnitQuaternion};
use whorl_math::{quaternion_exp, rotation_vector};

/// Attitudes kept: 1.28 s at 100 Hz.
const LENGTH: usize = 128;

/// Ring of `(stamp, q_inertial_body)`, newest last.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct History {
    stamps_ns: [i64; LENGTH],
    attitudes: [UnitQuaternion<f64>; LENGTH],
    /// Where the next entry goes.
    next: usize,
    filled: usize,
}

impl History {
    pub(crate) fn new() -> Self {
        let identity = UnitQuaternion::new_unchecked(Quaternion::identity());
        Self { stamps_ns: [0; LENGTH], attitudes: [identity; LENGTH], next: 0, filled: 0 }
    }

    pub(crate) fn push(&mut self, stamp_ns: i64, attitude: UnitQuaternion<f64>) {
        if let (Some(stamp), Some(q)) = (self.stamps_ns.get_mut(self.next), self.attitudes.get_mut(self.next))
        {
            (*stamp, *q) = (stamp_ns, attitude);
        }
        self.next = (self.next + 1) % LENGTH;
        self.filled = (self.filled + 1).min(LENGTH);
    }

    /// The attitude at `stamp_ns`, at a constant rate between its neighbours; `None` outside the
    /// ring's time span.
    pub(crate) fn at(&self, stamp_ns: i64) -> Option<UnitQuaternion<f64>> {
        let mut later: Option<(i64, UnitQuaternion<f64>)> = None;
        for age in 1..=self.filled {
            let index = (self.next + LENGTH - age) % LENGTH;
            let (stamp, attitude) = (*self.stamps_ns.get(index)?, *self.attitudes.get(index)?);
            if stamp > stamp_ns {
                later = Some((stamp, attitude));
                continue;
            }
            if stamp == stamp_ns {
                return Some(attitude);
            }
            let (later_stamp, later_attitude) = later?;
            let fraction = (stamp_ns - stamp) as f64 / (later_stamp - stamp) as f64;
            let turn = rotation_vector(&(attitude.inverse() * later_attitude));
            return Some(attitude * quaternion_exp(&(turn * fraction)));
        }
        None
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::Vector3;

    #[test]
    fn interpolates_and_knows_its_ends() {
        let mut history = History::new();
        assert_eq!(history.at(0), None);
        let rate = Vector3::new(0.1, -0.4, 1.0);
        for step in 0..300_i64 {
            history.push(step * 10, quaternion_exp(&(rate * (step as f64 * 0.01))));
        }
        let truth = |stamp_ns: f64| quaternion_exp(&(rate * (stamp_ns * 1e-3)));
        for stamp in [2990, 2985, 2983, 1721, 1720] {
            let found = history.at(stamp).expect("inside the ring");
            assert!(rotation_vector(&(found.inverse() * truth(stamp as f64))).norm() < 1e-12);
        }
        assert_eq!(history.at(2991), None, "after the newest");
        assert_eq!(history.at(1719), None, "before the oldest of 128");
    }
}
