//! Bias against temperature.

use nalgebra::Vector3;
use whorl_math::line::Line;
use whorl_recording::{Finding, Recording};

use crate::still::Still;
use crate::{PerAxis, SensorCalibration};

/// Least change of temperature that a slope is sought for \[K\].
const LEAST_CHANGE_K: f64 = 2.0;

/// Straight lines of the gyro's bias over temperature from still stretches; of the accelerometer's from
/// stretches in one position.
pub(super) fn slopes(
    runs: &[&Recording],
    still: &[Still],
    gyro: &mut SensorCalibration,
    accelerometer: &mut SensorCalibration,
    findings: &mut Vec<Finding>,
) {
    let warm: Vec<(f64, &Still)> = still.iter().filter_map(|s| Some((s.temperature_k?, s))).collect();
    let range = warm.iter().fold((f64::INFINITY, f64::NEG_INFINITY), |(l, h), (t, _)| (l.min(*t), h.max(*t)));
    let change_k = range.1 - range.0;
    let enough = change_k >= LEAST_CHANGE_K;
    if warm.len() < 3 || !enough {
        let text = if runs.iter().all(|r| r.temperature_k.is_empty()) {
            "Dependence on temperature not determined: no temperature was recorded.".to_owned()
        } else {
            format!(
                "Dependence on temperature not determined: it changed by {:.1} K between still stretches, {LEAST_CHANGE_K:.0} K are needed.",
                change_k.max(0.0)
            )
        };
        findings.push(Finding::warning(text));
        return;
    }
    let first = warm.first().map(|(_, s)| s.specific_force_m_s2).unwrap_or_default();
    let one_position: Vec<(f64, &Still)> =
        warm.iter().filter(|(_, s)| (s.specific_force_m_s2 - first).amax() < 0.2).copied().collect();
    let slope = |stretches: &[(f64, &Still)], of: fn(&Still) -> (&Vector3<f64>, &Vector3<f64>)| {
        let mut slope = PerAxis::default();
        for axis in 0..3 {
            let points: Vec<[f64; 3]> =
                stretches.iter().map(|(t, s)| [*t, of(s).0[axis], of(s).1[axis]]).collect();
            if let Some(found) = line(&points) {
                (slope.value[axis], slope.stddev[axis]) = found;
            }
        }
        slope
    };
    gyro.temperature_slope = slope(&warm, |s| (&s.gyro_rad_s, &s.gyro_stddev_rad_s));
    accelerometer.temperature_slope =
        slope(&one_position, |s| (&s.specific_force_m_s2, &s.specific_force_stddev_m_s2));
}

/// Slope of a straight line through (x, y, sigma of y) and its standard deviation, enlarged where the
/// scatter is larger than sigma says.
fn line(points: &[[f64; 3]]) -> Option<(f64, f64)> {
    if points.len() < 3 {
        return None;
    }
    let weight = |p: &[f64; 3]| (p[2].powi(2) + 1e-20).recip();
    let line = Line::weighted(points.iter().map(|p| (p[0], p[1], weight(p))))?;
    let misfit: f64 = points.iter().map(|p| weight(p) * (p[1] - line.at(p[0])).powi(2)).sum();
    let scatter = (misfit / (points.len() - 2) as f64).max(1.0);
    (line.spread > 0.0).then(|| (line.slope, (scatter / line.spread).sqrt()))
}
