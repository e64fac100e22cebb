//! Sensors that are sampled at times of their own, as one sample at the time of each gyro sample.
//!
//! A gyro sample is the mean rate over the interval that ends with it. What another sensor measured within that interval is turned
//! on by the gyro to its end: `v_1 = exp(-omega (t_1 - t)) v`, for specific forces, directions and, the other way round,
//! attitudes. Several samples of one sensor in an interval are averaged, as the gyro averages. A specific force stands until the
//! next one, turned on, for at most `LONGEST_S`: the accelerometer may be slower than the gyro.

use nalgebra::{UnitQuaternion, Vector3};
use whorl_free_motion::{Observed, Sample};
use whorl_math::quaternion_exp;

/// What is older than this when a gyro sample comes is not used \[s\].
const LONGEST_S: f64 = 0.5;
/// Samples of one sensor that are kept until the gyro's next.
const MOST_KEPT: usize = 64;

/// What is kept of each sensor until the next gyro sample.
#[derive(Debug, Clone, Default)]
pub struct OwnTimes {
    force: Vec<(i64, Vector3<f64>)>,
    vectors: Vec<Vec<(i64, Observed)>>,
    truth: Option<(i64, UnitQuaternion<f64>)>,
    /// The latest specific force, turned on to the latest gyro sample: when it was measured, and when that was.
    held: Option<(i64, i64, Vector3<f64>)>,
    /// Whether there was a specific force for a gyro sample.
    has_force: bool,
    unused: Unused,
}

/// Samples that were of no use.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Unused {
    /// Gyro samples without a specific force near them, where one is needed.
    pub gyro: u64,
    /// Specific forces without a gyro sample after them.
    pub force: u64,
    /// Directions without a gyro sample after them.
    pub vectors: u64,
}

impl Unused {
    /// What was not used, in words.
    #[must_use]
    pub fn notes(&self) -> Vec<String> {
        let all = [
            (self.gyro, "gyro samples", "no specific force was measured in the half second before them"),
            (self.force, "samples of the accelerometer", "no gyro sample follows within half a second"),
            (self.vectors, "samples of vector sensors", "no gyro sample follows within half a second"),
        ];
        let some = all.iter().filter(|(count, ..)| *count > 0);
        some.map(|(count, what, why)| format!("{count} {what} are not used: {why}")).collect()
    }
}

impl OwnTimes {
    /// For a recording with so many vector sensors.
    #[must_use]
    pub fn new(vectors: usize) -> Self {
        Self { vectors: vec![Vec::new(); vectors], ..Self::default() }
    }

    /// A specific force, sensor axes [m/s^2].
    pub fn force(&mut self, at_ns: i64, force_m_s2: Vector3<f64>) {
        if self.force.len() >= MOST_KEPT {
            self.force.remove(0);
            self.unused.force += 1;
        }
        self.force.push((at_ns, force_m_s2));
    }

    /// What a vector sensor saw.
    pub fn vector(&mut self, sensor: usize, at_ns: i64, seen: Observed) {
        let Some(kept) = self.vectors.get_mut(sensor) else { return };
        if kept.len() >= MOST_KEPT {
            kept.remove(0);
            self.unused.vectors += 1;
        }
        kept.push((at_ns, seen));
    }

    /// A true attitude.
    pub fn truth(&mut self, at_ns: i64, q_world_body: UnitQuaternion<f64>) {
        self.truth = Some((at_ns, q_world_body));
    }

    /// The sample of a gyro sample, with the true attitude if there is one; `None` without a specific force where one is needed.
    pub fn gyro(
        &mut self,
        at_ns: i64,
        gyro_rad_s: Vector3<f64>,
        needs_force: bool,
    ) -> Option<(Sample, Option<UnitQuaternion<f64>>)> {
        let force_m_s2 = self.force_at(at_ns, &gyro_rad_s);
        let vectors = self.vectors.iter_mut();
        let vectors: Vec<Option<Observed>> =
            vectors.map(|kept| observed(kept, at_ns, &gyro_rad_s, &mut self.unused.vectors)).collect();
        let truth = self.truth.take().filter(|(then_ns, _)| is_near(*then_ns, at_ns));
        let truth = truth.map(|(then_ns, q)| q * turned(then_ns, at_ns, &gyro_rad_s));
        self.has_force |= force_m_s2.is_some();
        if needs_force && force_m_s2.is_none() {
            // Before the accelerometer begins nothing is lost.
            self.unused.gyro += u64::from(self.has_force);
            return None;
        }
        Some((Sample { stamp_ns: at_ns, gyro_rad_s, force_m_s2, vectors }, truth))
    }

    fn force_at(&mut self, at_ns: i64, gyro_rad_s: &Vector3<f64>) -> Option<Vector3<f64>> {
        let kept = std::mem::take(&mut self.force);
        let total = kept.len();
        let near: Vec<_> = kept.into_iter().filter(|(then_ns, _)| is_near(*then_ns, at_ns)).collect();
        self.unused.force += (total - near.len()) as u64;
        match near.last() {
            Some((newest_ns, force)) => {
                let mean = match near.len() {
                    1 => on(*newest_ns, at_ns, gyro_rad_s, force),
                    count => {
                        let turned = near.iter().map(|(then_ns, f)| on(*then_ns, at_ns, gyro_rad_s, f));
                        turned.sum::<Vector3<f64>>() / count as f64
                    }
                };
                self.held = Some((*newest_ns, at_ns, mean));
            }
            None => {
                self.held = self.held.filter(|(newest_ns, ..)| is_near(*newest_ns, at_ns)).map(
                    |(newest_ns, then_ns, force)| (newest_ns, at_ns, on(then_ns, at_ns, gyro_rad_s, &force)),
                );
            }
        }
        self.held.map(|(.., force)| force)
    }

    /// What was of no use so far.
    #[must_use]
    pub fn unused(&self) -> Unused {
        self.unused
    }
}

/// The mean of what a sensor saw since the gyro's last sample.
fn observed(
    kept: &mut Vec<(i64, Observed)>,
    at_ns: i64,
    gyro_rad_s: &Vector3<f64>,
    unused: &mut u64,
) -> Option<Observed> {
    let total = kept.len();
    kept.retain(|(then_ns, _)| is_near(*then_ns, at_ns));
    *unused += (total - kept.len()) as u64;
    let kept = std::mem::take(kept);
    let (_, newest) = kept.last()?;
    let sum: Vector3<f64> =
        kept.iter().map(|(then_ns, seen)| on(*then_ns, at_ns, gyro_rad_s, &seen.body)).sum();
    let body = if let [(then_ns, one)] = kept.as_slice() {
        on(*then_ns, at_ns, gyro_rad_s, &one.body)
    } else {
        sum / kept.len() as f64
    };
    Some(Observed { body, reference_w: newest.reference_w })
}

fn is_near(then_ns: i64, at_ns: i64) -> bool {
    at_ns.saturating_sub(then_ns) as f64 * 1e-9 <= LONGEST_S
}

/// How the body turned since then.
fn turned(then_ns: i64, at_ns: i64, gyro_rad_s: &Vector3<f64>) -> UnitQuaternion<f64> {
    quaternion_exp(&(gyro_rad_s * (at_ns.saturating_sub(then_ns) as f64 * 1e-9)))
}

/// Components of what was measured then in the axes of now; of now itself it stays as it is, to the bit.
fn on(then_ns: i64, at_ns: i64, gyro_rad_s: &Vector3<f64>, v: &Vector3<f64>) -> Vector3<f64> {
    if then_ns == at_ns { *v } else { turned(then_ns, at_ns, gyro_rad_s).inverse_transform_vector(v) }
}

#[cfg(test)]
mod tests {
    use super::*;

    const RATE: Vector3<f64> = Vector3::new(0.0, 0.0, 2.0);

    fn seen(body: Vector3<f64>) -> Observed {
        Observed { body, reference_w: None }
    }

    /// North and the vertical, seen by a sensor that turns about the vertical at 2 rad/s, at any time.
    fn at(time_s: f64) -> Vector3<f64> {
        Vector3::new((2.0 * time_s).sin(), (2.0 * time_s).cos(), 0.3)
    }

    #[test]
    fn what_was_seen_between_gyro_samples_is_turned_on_to_them() {
        let mut all = OwnTimes::new(1);
        for ms in [91_i64, 95, 97] {
            let v = at(ms as f64 * 1e-3);
            all.force(ms * 1_000_000, v);
            all.vector(0, ms * 1_000_000, seen(v * 40.0));
        }
        all.truth(94_000_000, quaternion_exp(&Vector3::new(0.0, 0.0, 0.188)));
        let (sample, truth) = all.gyro(100_000_000, RATE, true).unwrap();
        assert!((sample.force_m_s2.unwrap() - at(0.1)).norm() < 1e-12);
        assert!((sample.vectors[0].unwrap().body - 40.0 * at(0.1)).norm() < 1e-10);
        assert!(truth.unwrap().angle_to(&quaternion_exp(&Vector3::new(0.0, 0.0, 0.2))) < 1e-9);
        // A slower accelerometer: the force stands, turned on; a direction is used once.
        let (sample, truth) = all.gyro(110_000_000, RATE, true).unwrap();
        assert!((sample.force_m_s2.unwrap() - at(0.11)).norm() < 1e-12);
        assert_eq!((sample.vectors[0], truth), (None, None));
        assert_eq!(all.unused(), Unused::default());
    }

    #[test]
    fn what_is_too_old_is_counted() {
        let mut all = OwnTimes::new(1);
        assert!(all.gyro(-20_000_000, RATE, true).is_none());
        all.force(-11_000_000, Vector3::z());
        assert!(all.gyro(-10_000_000, RATE, true).is_some());
        all.force(0, Vector3::z());
        all.vector(0, 0, seen(Vector3::y()));
        assert!(all.gyro(600_000_000, RATE, true).is_none());
        assert!(all.gyro(610_000_000, RATE, false).is_some());
        assert_eq!(all.unused(), Unused { gyro: 1, force: 1, vectors: 1 });
        assert_eq!(all.unused().notes().len(), 3);
        for ms in 0..80 {
            all.force(700_000_000 + ms * 1_000_000, Vector3::z());
        }
        assert_eq!(all.unused().force, 17);
    }

    #[test]
    fn samples_of_one_time_stay_as_they_are() {
        let mut all = OwnTimes::new(1);
        let v = Vector3::new(0.1, 0.2, 0.7);
        all.force(5, v);
        all.vector(0, 5, seen(v));
        let (sample, _) = all.gyro(5, RATE, true).unwrap();
        assert_eq!((sample.force_m_s2, sample.vectors[0].unwrap().body), (Some(v), v));
    }
}
