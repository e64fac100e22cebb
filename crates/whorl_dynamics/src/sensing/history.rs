//! The recent past of the body's motion, for sensors whose data are late.

use std::collections::VecDeque;

use nalgebra::{UnitQuaternion, Vector3};

use crate::TrueImu;

/// The body's motion at one instant.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Snapshot {
    pub time_ns: i64,
    pub q_world_body: UnitQuaternion<f64>,
    pub omega_wb_b_rad_s: Vector3<f64>,
    pub omega_dot_wb_b_rad_s2: Vector3<f64>,
    /// Behind the low-pass of gyro and accelerometer.
    pub behind_filter: TrueImu,
}

impl Snapshot {
    /// Linear in time between this and `later`. Over one step of a millisecond the error is of the
    /// order of 1e-7 of the second derivative.
    fn towards(&self, later: &Self, time_ns: i64) -> Self {
        let span_ns = (later.time_ns - self.time_ns).max(1);
        let share = (time_ns - self.time_ns) as f64 / span_ns as f64;
        let turn = self.q_world_body.rotation_to(&later.q_world_body).scaled_axis();
        Self {
            time_ns,
            // `rotation_to` is the turn in world axes: it acts from the left.
            q_world_body: UnitQuaternion::from_scaled_axis(turn * share) * self.q_world_body,
            omega_wb_b_rad_s: self.omega_wb_b_rad_s.lerp(&later.omega_wb_b_rad_s, share),
            omega_dot_wb_b_rad_s2: self.omega_dot_wb_b_rad_s2.lerp(&later.omega_dot_wb_b_rad_s2, share),
            behind_filter: self.behind_filter.towards(&later.behind_filter, share),
        }
    }
}

/// The last snapshots, oldest first, over the longest latency.
#[derive(Debug, Clone)]
pub(crate) struct History {
    snapshots: VecDeque<Snapshot>,
    span_ns: i64,
}

impl History {
    pub fn new(span_ns: i64) -> Self {
        Self { snapshots: VecDeque::new(), span_ns }
    }

    /// False when no sensor is late, so that nothing need be kept.
    pub fn is_needed(&self) -> bool {
        self.span_ns > 0
    }

    pub fn forget(&mut self) {
        self.snapshots.clear();
    }

    pub fn push(&mut self, snapshot: Snapshot) {
        self.snapshots.push_back(snapshot);
        // Keep one that is older than the span, for interpolation.
        let oldest_ns = snapshot.time_ns - self.span_ns;
        while self.snapshots.get(1).is_some_and(|second| second.time_ns <= oldest_ns) {
            self.snapshots.pop_front();
        }
    }

    /// The motion at `time_ns`; before the start of the run, the motion at its start.
    pub fn at(&self, time_ns: i64, now: &Snapshot) -> Snapshot {
        if time_ns >= now.time_ns {
            return *now;
        }
        let mut later = now;
        for earlier in self.snapshots.iter().rev() {
            if earlier.time_ns <= time_ns {
                return earlier.towards(later, time_ns);
            }
            later = earlier;
        }
        *later
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn snapshot(time_ns: i64) -> Snapshot {
        let t = time_ns as f64 * 1e-9;
        Snapshot {
            time_ns,
            q_world_body: UnitQuaternion::from_euler_angles(0.0, 0.1, 0.7 * t),
            omega_wb_b_rad_s: Vector3::new(2.0 * t, 0.0, 0.0),
            omega_dot_wb_b_rad_s2: Vector3::new(2.0, 0.0, 0.0),
            behind_filter: TrueImu {
                angular_velocity_b_rad_s: Vector3::new(2.0 * t, 0.0, 0.0),
                specific_force_b_m_s2: Vector3::z(),
            },
        }
    }

    #[test]
    fn recalls_the_past_between_snapshots_and_forgets_what_is_too_old() {
        let mut history = History::new(5_000_000);
        for k in 0..100 {
            history.push(snapshot(k * 1_000_000));
        }
        assert!(history.snapshots.len() <= 7);
        let now = snapshot(100_000_000);
        let recalled = history.at(95_300_000, &now);
        let expected = snapshot(95_300_000);
        assert!((recalled.omega_wb_b_rad_s - expected.omega_wb_b_rad_s).norm() < 1e-12);
        assert!(recalled.q_world_body.angle_to(&expected.q_world_body) < 1e-9);
        // The youngest part is between the last snapshot and now.
        let recalled = history.at(99_500_000, &now);
        assert!((recalled.omega_wb_b_rad_s.x - 0.199).abs() < 1e-12);
    }
}
