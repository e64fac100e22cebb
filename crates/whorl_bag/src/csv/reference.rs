//! The direction of a vector sensor's target in the world, from the file itself.

use nalgebra::{Unit, UnitQuaternion, Vector3};

use super::rows::CsvRow;
use crate::channels::Channel;

/// Length of the interval that is looked for \[s\].
const INTERVAL_S: f64 = 1.0;
/// A body is still when its rate stays below this [rad/s]: well above the bias of a consumer gyro ...
const STILL_RATE_RAD_S: f64 = 0.05;
/// ... and its specific force within this of its own mean length [m/s^2].
const STILL_FORCE_M_S2: f64 = 0.5;
/// Cosine between the specific force of a still second, in the world of the truth, and up: 25 deg apart at most \[1\].
const UPRIGHT: f64 = 0.9;

/// Gathers seconds until one is still.
#[derive(Default)]
pub(crate) struct ReferenceSearch {
    interval: Interval,
    /// The first second, still or not, in case that none is.
    first: Option<Interval>,
}

#[derive(Default, Clone)]
struct Interval {
    start_s: Option<f64>,
    force_m_s2: Vector3<f64>,
    forces: u32,
    vector_b: Vector3<f64>,
    vectors: u32,
    /// Sum of the vector measurements turned into the world by the truth.
    vector_world: Vector3<f64>,
    vectors_with_truth: u32,
    /// Sum of the specific forces turned into the world by the truth, of those that have one.
    force_world_m_s2: Vector3<f64>,
    last_truth: Option<UnitQuaternion<f64>>,
    largest_rate_rad_s: f64,
    force_range_m_s2: Option<(f64, f64)>,
}

impl Interval {
    fn add(&mut self, row: &CsvRow) {
        self.start_s.get_or_insert(seconds(row.time_ns));
        // Sensors may have lines of their own.
        if let Some(gyro) = row.axes(Channel::Gyro) {
            self.largest_rate_rad_s = self.largest_rate_rad_s.max(gyro.norm());
        }
        if let Some(force) = row.axes(Channel::Accelerometer) {
            self.force_m_s2 += force;
            self.last_truth = row.q_world_body.or(self.last_truth);
            self.force_world_m_s2 += self.last_truth.map_or(force, |q_world_body| q_world_body * force);
            self.forces += 1;
            let (low, high) = self.force_range_m_s2.unwrap_or((force.norm(), force.norm()));
            self.force_range_m_s2 = Some((low.min(force.norm()), high.max(force.norm())));
        }
        if let Some(vector) = row.vectors_b.first().copied().flatten() {
            self.vector_b += vector.into_inner();
            self.vectors += 1;
            if let Some(q_world_body) = row.q_world_body {
                self.vector_world += q_world_body * vector.into_inner();
                self.vectors_with_truth += 1;
            }
        }
    }

    fn usable(&self) -> bool {
        self.forces > 0 && self.vectors > 0
    }

    fn still(&self) -> bool {
        self.largest_rate_rad_s < STILL_RATE_RAD_S
            && self.force_range_m_s2.is_some_and(|(low, high)| high - low < STILL_FORCE_M_S2)
    }

    /// Whether the specific force points up in the world of the truth: else this is the attitude of something else, or in another order.
    fn truth_is_upright(&self) -> bool {
        self.force_world_m_s2.z > UPRIGHT * self.force_m_s2.norm()
    }

    /// With truth: the mean of the measurements in the world of the truth. Without: the world is the one
    /// whose y axis (north) is the horizontal part of the measured direction.
    fn reference_world(&self) -> Option<Unit<Vector3<f64>>> {
        if self.vectors_with_truth > 0 && self.truth_is_upright() {
            return Unit::try_new(self.vector_world, 1e-9);
        }
        let up_b = Unit::try_new(self.force_m_s2, 1e-9)?;
        let vector_b = Unit::try_new(self.vector_b, 1e-9)?;
        let up = up_b.dot(&vector_b);
        Unit::try_new(Vector3::new(0.0, (1.0 - up * up).max(0.0).sqrt(), up), 1e-9)
    }
}

impl ReferenceSearch {
    /// Takes a row; gives the direction once a still second is complete.
    pub fn add(&mut self, row: &CsvRow) -> Option<Unit<Vector3<f64>>> {
        let complete = self.interval.start_s.is_some_and(|start| seconds(row.time_ns) - start >= INTERVAL_S);
        if !complete {
            self.interval.add(row);
            return None;
        }
        let interval = std::mem::take(&mut self.interval);
        self.interval.add(row);
        if !interval.usable() {
            return None;
        }
        if interval.still() {
            return interval.reference_world();
        }
        self.first.get_or_insert(interval);
        None
    }

    /// At the end of the file: the best there was.
    pub fn at_the_end(self) -> Option<Unit<Vector3<f64>>> {
        let whole = Some(self.interval).filter(Interval::usable);
        let still = whole.clone().filter(Interval::still);
        still.or(self.first).or(whole)?.reference_world()
    }
}

fn seconds(ns: i64) -> f64 {
    ns as f64 / 1e9
}
