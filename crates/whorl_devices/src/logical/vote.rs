//! A vector of redundant measurements along single axes, and who disagrees.
//!
//! Each measurement is y = d . x + noise with a known direction d. The estimate is the least-squares solution; its residuals
//! are the parity of the measurements (Potter and Suman 1977: "Thresholdless redundancy management with arrays of skewed
//! instruments"). When one is too large, each member is left out in turn, with all of its axes: the culprit is the one without
//! which the rest agrees, if the rest still checks itself (more measurements than unknowns), and if no other member would do
//! about as well. Two sensors that disagree, or four single axes, can only say that something is wrong.

use nalgebra::{Matrix3, Unit, Vector3};

/// Least determinant of the sum of d d^T at which directions span the space.
const LEAST_DETERMINANT: f64 = 1e-4;
/// The culprit is clear when without it the largest residual is at most this share of what it is without any other.
const CLEAR_SHARE: f64 = 0.5;
/// Members that may be left out at a time.
const MOST_LEFT_OUT: usize = 2;

/// One measurement.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Row {
    /// Whose it is.
    pub member: usize,
    /// Direction along which it is measured, of length 1.
    pub direction_b: Vector3<f64>,
    /// What was measured.
    pub value: f64,
}

/// What became of a vote.
#[derive(Debug, Clone, PartialEq)]
pub enum Outcome {
    /// The vector, the members that were left out, and the largest difference that one of them has from it.
    Agreed {
        /// Body axes.
        vector_b: Vector3<f64>,
        /// Left out, with the largest difference of each.
        outvoted: Vec<(usize, f64)>,
    },
    /// They disagree by this, and nobody can say who is wrong.
    Undecided(f64),
    /// The measurements do not span all directions.
    TooFew,
}

/// Whether directions span all three dimensions.
pub fn spans<'a>(directions_b: impl Iterator<Item = &'a Unit<Vector3<f64>>>) -> bool {
    let normal = directions_b.fold(Matrix3::zeros(), |sum, d| sum + d.into_inner() * d.transpose());
    normal.determinant() > LEAST_DETERMINANT
}

/// The vector behind `rows`, when members may differ by `tolerance`, in the unit of the values.
#[must_use]
pub fn vote(rows: &[Row], tolerance: f64) -> Outcome {
    let mut left_out: Vec<usize> = Vec::new();
    loop {
        let Some(solution) = Solution::of(rows, &left_out, None) else { return Outcome::TooFew };
        if solution.largest_residual <= tolerance {
            let difference = |member: usize| {
                let own = rows.iter().filter(|row| row.member == member);
                own.map(|row| (row.value - row.direction_b.dot(&solution.vector_b)).abs()).fold(0.0, f64::max)
            };
            let outvoted = left_out.iter().map(|member| (*member, difference(*member))).collect();
            return Outcome::Agreed { vector_b: solution.vector_b, outvoted };
        }
        let Some(culprit) = culprit(rows, &left_out).filter(|_| left_out.len() < MOST_LEFT_OUT) else {
            return Outcome::Undecided(solution.largest_residual);
        };
        left_out.push(culprit);
    }
}

/// The member without which the others agree best, and clearly so.
fn culprit(rows: &[Row], left_out: &[usize]) -> Option<usize> {
    let mut members: Vec<usize> =
        rows.iter().map(|row| row.member).filter(|m| !left_out.contains(m)).collect();
    members.sort_unstable();
    members.dedup();
    let mut tried: Vec<(usize, f64)> = members
        .into_iter()
        .filter_map(|member| {
            let without = Solution::of(rows, left_out, Some(member))?;
            without.checks_itself.then_some((member, without.largest_residual))
        })
        .collect();
    tried.sort_by(|a, b| a.1.total_cmp(&b.1));
    match tried.as_slice() {
        [] => None,
        [(only, _)] => Some(*only),
        [(best, least), (_, next), ..] => (*least <= CLEAR_SHARE * next).then_some(*best),
    }
}

struct Solution {
    vector_b: Vector3<f64>,
    largest_residual: f64,
    /// There are more measurements than unknowns.
    checks_itself: bool,
}

impl Solution {
    fn of(rows: &[Row], left_out: &[usize], also: Option<usize>) -> Option<Self> {
        let used = || rows.iter().filter(|row| !left_out.contains(&row.member) && also != Some(row.member));
        let (mut normal, mut right) = (Matrix3::zeros(), Vector3::zeros());
        for row in used() {
            normal += row.direction_b * row.direction_b.transpose();
            right += row.direction_b * row.value;
        }
        let inverse = normal.try_inverse().filter(|_| normal.determinant() > LEAST_DETERMINANT)?;
        let vector_b = inverse * right;
        let residuals = used().map(|row| (row.value - row.direction_b.dot(&vector_b)).abs());
        Some(Self {
            vector_b,
            largest_residual: residuals.fold(0.0, f64::max),
            checks_itself: used().count() > 3,
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Three axes of a whole sensor.
    fn triad(member: usize, value: Vector3<f64>) -> Vec<Row> {
        let axes = [Vector3::x(), Vector3::y(), Vector3::z()];
        axes.into_iter()
            .enumerate()
            .map(|(i, direction_b)| Row { member, direction_b, value: value[i] })
            .collect()
    }

    fn single(member: usize, direction: Vector3<f64>, truth: &Vector3<f64>) -> Row {
        let direction_b = Unit::new_normalize(direction).into_inner();
        Row { member, direction_b, value: direction_b.dot(truth) }
    }

    const TRUTH: Vector3<f64> = Vector3::new(0.1, -0.2, 0.3);

    #[test]
    fn what_agrees_is_averaged() {
        let off = Vector3::new(0.003, 0.0, -0.003);
        let rows: Vec<Row> = [triad(0, TRUTH + off), triad(1, TRUTH - off)].concat();
        let Outcome::Agreed { vector_b, outvoted } = vote(&rows, 0.01) else { panic!() };
        assert!((vector_b - TRUTH).norm() < 1e-12 && outvoted.is_empty());
    }

    /// With three sensors, the result is the mean of the two that agree, whichever axis of whichever sensor is wrong, by
    /// however much beyond the tolerance.
    #[test]
    fn one_of_three_is_outvoted() {
        for bad in 0..3 {
            for axis in 0..3 {
                for error in [0.02, -0.5, 40.0] {
                    let mut rows: Vec<Row> = (0..3).flat_map(|m| triad(m, TRUTH)).collect();
                    rows[3 * bad + axis].value += error;
                    let Outcome::Agreed { vector_b, outvoted } = vote(&rows, 0.01) else {
                        panic!("{bad} {axis}")
                    };
                    assert!((vector_b - TRUTH).norm() < 1e-12, "{vector_b}");
                    assert_eq!(outvoted.len(), 1);
                    assert_eq!(outvoted[0].0, bad);
                    assert!((outvoted[0].1 - error.abs()).abs() < 1e-9);
                }
            }
        }
    }

    #[test]
    fn two_that_disagree_cannot_say_who_is_wrong() {
        let rows: Vec<Row> = [triad(0, TRUTH), triad(1, TRUTH + Vector3::x())].concat();
        let Outcome::Undecided(by) = vote(&rows, 0.01) else { panic!() };
        assert!((by - 0.5).abs() < 1e-12, "{by}");
    }

    /// Skewed axes on a cone: four find that something is wrong, five and six also what (Potter and Suman 1977).
    #[test]
    fn skewed_axes_need_five_to_name_the_culprit() {
        let cone = |count: usize| -> Vec<Row> {
            let turn = |k: usize| std::f64::consts::TAU * k as f64 / count as f64;
            (0..count).map(|k| single(k, Vector3::new(turn(k).cos(), turn(k).sin(), 0.7), &TRUTH)).collect()
        };
        for (count, bad) in [(4, 1), (5, 2), (6, 4)] {
            let mut rows = cone(count);
            assert!(matches!(vote(&rows, 1e-9), Outcome::Agreed { .. }), "{count} whole");
            rows[bad].value += 0.4;
            match vote(&rows, 0.05) {
                Outcome::Undecided(_) => assert_eq!(count, 4),
                Outcome::Agreed { vector_b, outvoted } => {
                    assert!(
                        count > 4 && outvoted.len() == 1 && outvoted[0].0 == bad,
                        "{count}: {outvoted:?}"
                    );
                    assert!((vector_b - TRUTH).norm() < 1e-12);
                }
                Outcome::TooFew => panic!("{count}"),
            }
        }
    }

    #[test]
    fn two_of_five_sensors_can_be_wrong_at_once() {
        let mut rows: Vec<Row> = (0..5).flat_map(|m| triad(m, TRUTH)).collect();
        rows[0].value += 0.7;
        rows[3 * 3 + 2].value -= 0.2;
        let Outcome::Agreed { vector_b, mut outvoted } = vote(&rows, 0.01) else { panic!() };
        outvoted.sort_by_key(|(member, _)| *member);
        assert!((vector_b - TRUTH).norm() < 1e-12);
        assert_eq!(outvoted.iter().map(|(m, _)| *m).collect::<Vec<_>>(), [0, 3]);
    }

    #[test]
    fn axes_in_one_plane_are_too_few() {
        let flat = [(1.0, 0.0), (0.0, 1.0), (1.0, 1.0)];
        let rows: Vec<Row> =
            flat.iter().enumerate().map(|(k, (x, y))| single(k, Vector3::new(*x, *y, 0.0), &TRUTH)).collect();
        assert_eq!(vote(&rows, 0.01), Outcome::TooFew);
    }
}
