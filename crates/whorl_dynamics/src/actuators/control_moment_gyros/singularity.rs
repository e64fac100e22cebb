//! How near gyros are to a configuration in which they cannot turn the body about some axis, and which way leads out.
//!
//! The unit torque of gyro j is t_j; C = [t_1 h_1/h .. t_n h_n/h], h the largest rotor momentum. The measure is the volume
//! that the columns span in as many dimensions r = min(n, 3) as they can,
//!
//! ```text
//! m = sqrt(sum over all sets of r columns of their squared volume) = sqrt(det C C^T) for three and more
//! ```
//!
//! (Margulies and Aubrun, "Geometric theory of single-gimbal control moment gyro systems", J. Astronautical Sciences 26,
//! 1978; Wie, *Space Vehicle Dynamics and Control*, section 7.5). m = 0 in singular configurations. For a pyramid of four
//! at rest with skew angle beta, m = 4 cos^2 beta sin beta.

use nalgebra::Vector3;

use super::{Gyro, MAX_GYROS};

/// Gimbal rate of null motion, over the largest, where the measure's square rises by one per radian.
const NULL_MOTION_SHARE: f64 = 0.2;

/// Volume m that the gyros' torques span at these gimbal angles \[rad\]; missing angles count as zero. 0 is singular.
#[must_use]
pub fn measure(gyros: &[Gyro], angle_rad: &[f64]) -> f64 {
    squared(&columns(gyros, angle_rad), gyros.len()).sqrt()
}

/// Gimbal rates along the slope of m^2 [rad/s], within 0.2 of each gimbal's largest for a slope of one per radian.
pub fn null_motion_rad_s(gyros: &[Gyro], angle_rad: &[f64], rate_rad_s: &mut [f64]) {
    let columns = columns(gyros, angle_rad);
    for (j, ((slot, gyro), slope)) in rate_rad_s.iter_mut().zip(gyros).zip(slopes(&columns, gyros.len())).enumerate() {
        // Not into the end of the gimbal's travel.
        let (least, most) = gyro.rates_rad_s(angle_rad.get(j).copied().unwrap_or(0.0));
        let wanted = NULL_MOTION_SHARE * gyro.max_rate_rad_s * slope.clamp(-1.0, 1.0);
        *slot = wanted.max(least).min(most);
    }
}

/// Each column and its derivative by the gyro's own angle, dt/dgamma = -s.
type Columns = [(Vector3<f64>, Vector3<f64>); MAX_GYROS];

fn columns(gyros: &[Gyro], angle_rad: &[f64]) -> Columns {
    let largest = gyros.iter().map(|gyro| gyro.rotor_momentum_n_m_s).fold(f64::MIN_POSITIVE, f64::max);
    let mut columns = [(Vector3::zeros(), Vector3::zeros()); MAX_GYROS];
    for (j, (slot, gyro)) in columns.iter_mut().zip(gyros).enumerate() {
        let (s, t) = gyro.axes_b(angle_rad.get(j).copied().unwrap_or(0.0));
        let share = gyro.rotor_momentum_n_m_s / largest;
        *slot = (t * share, -s * share);
    }
    columns
}

/// m^2.
fn squared(columns: &Columns, gyros: usize) -> f64 {
    let column = |j: usize| columns.get(j).map_or_else(Vector3::zeros, |c| c.0);
    match gyros {
        0 => 0.0,
        1 => column(0).norm_squared(),
        2 => column(0).cross(&column(1)).norm_squared(),
        _ => triples(gyros).map(|[a, b, c]| column(a).cross(&column(b)).dot(&column(c)).powi(2)).sum(),
    }
}

/// d(m^2)/dgamma of each gyro.
fn slopes(columns: &Columns, gyros: usize) -> [f64; MAX_GYROS] {
    let mut slopes = [0.0; MAX_GYROS];
    let at = |j: usize| columns.get(j).copied().unwrap_or_default();
    let mut add = |j: usize, slope: f64| {
        if let Some(slot) = slopes.get_mut(j) {
            *slot += slope;
        }
    };
    match gyros {
        0 | 1 => {}
        2 => {
            let ((a, da), (b, db)) = (at(0), at(1));
            let area = a.cross(&b);
            add(0, 2.0 * area.dot(&da.cross(&b)));
            add(1, 2.0 * area.dot(&a.cross(&db)));
        }
        _ => {
            for [i, j, k] in triples(gyros) {
                let ((a, da), (b, db), (c, dc)) = (at(i), at(j), at(k));
                let twice = 2.0 * a.cross(&b).dot(&c);
                add(i, twice * da.dot(&b.cross(&c)));
                add(j, twice * db.dot(&c.cross(&a)));
                add(k, twice * dc.dot(&a.cross(&b)));
            }
        }
    }
    slopes
}

fn triples(gyros: usize) -> impl Iterator<Item = [usize; 3]> {
    let n = gyros.min(MAX_GYROS);
    (0..n).flat_map(move |a| (a + 1..n).flat_map(move |b| (b + 1..n).map(move |c| [a, b, c])))
}
