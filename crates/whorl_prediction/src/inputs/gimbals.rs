//! The measured motion of the gimbals of control moment gyros, which models take as known.

use whorl_recording::Recording;

/// Mean motion of every gimbal over a stretch of time; empty without gimbals.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct GimbalMotion {
    /// Half-way between the angles at its ends \[rad\].
    pub angle_rad: Vec<f64>,
    /// Mean rates [rad/s].
    pub rate_rad_s: Vec<f64>,
    /// Mean accelerations [rad/s^2].
    pub acceleration_rad_s2: Vec<f64>,
}

impl GimbalMotion {
    /// Over a stretch of a recording. Angles and rates are straight between samples, constant before the first and after
    /// the last; rates that were not recorded follow from the angles.
    #[must_use]
    pub fn between(recording: &Recording, from_s: f64, to_s: f64) -> Self {
        let (angle, rate) = (&recording.gimbal_angle_rad, &recording.gimbal_rate_rad_s);
        let gyros = angle.value.first().map_or(0, Vec::len);
        let length_s = to_s - from_s;
        let mut motion = Self::default();
        for j in 0..gyros {
            let [a0, a1] = [from_s, to_s].map(|t| straight(&angle.time_s, &angle.value, j, t));
            let [r0, r1] = [from_s, to_s].map(|t| straight(&rate.time_s, &rate.value, j, t));
            let mean = |from: f64, to: f64| if length_s > 0.0 { (to - from) / length_s } else { 0.0 };
            motion.angle_rad.push(0.5 * (a0 + a1));
            motion.rate_rad_s.push(if length_s > 0.0 { mean(a0, a1) } else { r0 });
            motion.acceleration_rad_s2.push(mean(r0, r1));
        }
        motion
    }
}

fn straight(time_s: &[f64], value: &[Vec<f64>], gimbal: usize, at_s: f64) -> f64 {
    let after = time_s.partition_point(|t| *t <= at_s);
    let of = |k: usize| value.get(k).and_then(|v| v.get(gimbal)).copied();
    let before = after.checked_sub(1);
    match (before.and_then(of), of(after)) {
        (Some(a), Some(b)) => {
            let (t0, t1) = (time_s[after - 1], time_s[after]);
            a + (b - a) * (at_s - t0) / (t1 - t0)
        }
        (Some(only), None) | (None, Some(only)) => only,
        (None, None) => 0.0,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use whorl_recording::Series;

    /// gamma = t^2: means over 1..3 s are angle 5 (of the ends 1 and 9), rate 4, acceleration 2.
    #[test]
    fn means_are_those_of_the_samples_at_both_ends() {
        let time_s: Vec<f64> = (0..=40).map(|k| f64::from(k) * 0.1).collect();
        let recording = Recording {
            gimbal_angle_rad: Series {
                value: time_s.iter().map(|t| vec![t * t]).collect(),
                time_s: time_s.clone(),
            },
            gimbal_rate_rad_s: Series { value: time_s.iter().map(|t| vec![2.0 * t]).collect(), time_s },
            ..Recording::default()
        };
        let motion = GimbalMotion::between(&recording, 1.0, 3.0);
        let found = [motion.angle_rad[0], motion.rate_rad_s[0], motion.acceleration_rad_s2[0]];
        for (found, expected) in found.into_iter().zip([5.0, 4.0, 2.0]) {
            assert!((found - expected).abs() < 1e-12, "{found} {expected}");
        }
        assert_eq!(GimbalMotion::between(&Recording::default(), 0.0, 1.0), GimbalMotion::default());
    }
}
