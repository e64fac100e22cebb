//! Which actuator to move, and by how much, to balance a platform.

use nalgebra::{DMatrix, DVector, Matrix3, Unit, Vector3};

use whorl_recording::Finding;

/// Something that moves a known weight along a line: a linear actuator, a battery in its slots.
#[derive(Debug, Clone, PartialEq)]
pub struct Ballast {
    /// For people.
    pub name: String,
    /// Direction of travel, body axes.
    pub axis_b: Unit<Vector3<f64>>,
    /// Weight that moves \[N\], > 0.
    pub weight_n: f64,
    /// Where it is now \[m\].
    pub position_m: f64,
    /// Ends of its travel \[m\].
    pub travel_m: (f64, f64),
    /// Steps that it can be set in \[m\]; 0 = any position.
    pub step_m: f64,
}

/// What to do.
#[derive(Debug, Clone, PartialEq)]
pub struct BalancePlan {
    /// Move of each ballast \[m\].
    pub moves_m: Vec<f64>,
    /// Gravity offset after the moves, body axes [N m].
    pub offset_b_n_m: Vector3<f64>,
    /// Its standard deviation [N m], from the measurement.
    pub stddev_b_n_m: Vector3<f64>,
    /// Largest remaining torque when the platform is level [N m].
    pub level_torque_n_m: f64,
    /// Notes for the user.
    pub findings: Vec<Finding>,
}

/// Plans the moves that bring an offset (with its covariance) as near to a target as travel allows.
///
/// Each combination of ballasts at an end of their travel is tried with the rest free, which is exact for
/// the handful that a platform has (at most eight are looked at).
#[must_use]
pub fn plan_balance(
    offset_b_n_m: &Vector3<f64>,
    covariance: &Matrix3<f64>,
    target_b_n_m: &Vector3<f64>,
    ballasts: &[Ballast],
) -> BalancePlan {
    let ballasts = ballasts.get(..ballasts.len().min(8)).unwrap_or_default();
    let wanted = target_b_n_m - offset_b_n_m;
    let column = |b: &Ballast| b.axis_b.into_inner() * b.weight_n;
    let room = |b: &Ballast| (b.travel_m.0 - b.position_m, b.travel_m.1 - b.position_m);
    let mut best = vec![0.0; ballasts.len()];
    let mut least = f64::INFINITY;
    for combination in 0..3usize.pow(ballasts.len() as u32) {
        let mut code = combination;
        let states: Vec<usize> = ballasts
            .iter()
            .map(|_| {
                let state = code % 3;
                code /= 3;
                state
            })
            .collect();
        let mut moves: Vec<f64> = states
            .iter()
            .zip(ballasts)
            .map(|(s, b)| {
                if *s == 1 {
                    room(b).0
                } else if *s == 2 {
                    room(b).1
                } else {
                    0.0
                }
            })
            .collect();
        let free: Vec<usize> = (0..ballasts.len()).filter(|n| states.get(*n) == Some(&0)).collect();
        let fixed: Vector3<f64> = moves.iter().zip(ballasts).map(|(m, b)| column(b) * *m).sum();
        if !free.is_empty() {
            let columns: Vec<Vector3<f64>> =
                free.iter().filter_map(|n| ballasts.get(*n)).map(column).collect();
            let matrix = DMatrix::from_fn(3, free.len(), |i, j| columns.get(j).map_or(0.0, |c| c[i]));
            let right = DVector::from_column_slice((wanted - fixed).as_slice());
            // The shortest moves, where several ballasts share an axis.
            let Ok(solution) = matrix.svd(true, true).solve(&right, 1e-12) else { continue };
            for (n, x) in free.iter().zip(solution.iter()) {
                if let Some(slot) = moves.get_mut(*n) {
                    *slot = *x;
                }
            }
        }
        let possible = moves.iter().zip(ballasts).all(|(m, b)| {
            let (low, high) = room(b);
            (low - 1e-12..=high + 1e-12).contains(m)
        });
        let left: Vector3<f64> =
            wanted - moves.iter().zip(ballasts).map(|(m, b)| column(b) * *m).sum::<Vector3<f64>>();
        // Of equally good plans the one that moves least.
        let cost = left.norm() + 1e-9 * moves.iter().map(|m| m.abs()).sum::<f64>();
        if possible && cost < least {
            least = cost;
            best = moves;
        }
    }
    for (m, b) in best.iter_mut().zip(ballasts) {
        if b.step_m > 0.0 {
            let (low, high) = room(b);
            *m = ((*m / b.step_m).round() * b.step_m).max(low).min(high);
        }
    }
    let after: Vector3<f64> =
        offset_b_n_m + best.iter().zip(ballasts).map(|(m, b)| column(b) * *m).sum::<Vector3<f64>>();
    let stddev = covariance.diagonal().map(|v| v.max(0.0).sqrt());
    BalancePlan {
        findings: judge(&after, target_b_n_m, &stddev, &best, ballasts),
        moves_m: best,
        offset_b_n_m: after,
        stddev_b_n_m: stddev,
        level_torque_n_m: after.x.hypot(after.y),
    }
}

fn judge(
    after: &Vector3<f64>,
    target: &Vector3<f64>,
    stddev: &Vector3<f64>,
    moves: &[f64],
    ballasts: &[Ballast],
) -> Vec<Finding> {
    let mut findings = Vec::new();
    let missed = (after - target).norm();
    let at_end: Vec<&str> = moves
        .iter()
        .zip(ballasts)
        .filter(|(m, b)| {
            let end = b.position_m + **m;
            end <= b.travel_m.0 + 1e-9 || end >= b.travel_m.1 - 1e-9
        })
        .map(|(_, b)| b.name.as_str())
        .collect();
    if missed > 1e-3 && !at_end.is_empty() {
        findings.push(Finding::warning(format!(
            "{} at the end of travel: {:.1} N mm of the offset remain. Move a battery in its slots first.",
            at_end.join(", "),
            1e3 * missed
        )));
    } else if missed > 1e-3 {
        findings.push(Finding::warning(format!(
            "{:.1} N mm of the offset remain in a direction that no ballast moves in.",
            1e3 * missed
        )));
    }
    if stddev.amax() > 1e-3 {
        findings.push(Finding::warning(format!(
            "The offset is known to {:.1}, {:.1}, {:.1} N mm only (one standard deviation): balance, swing again, and repeat.",
            1e3 * stddev.x,
            1e3 * stddev.y,
            1e3 * stddev.z
        )));
    }
    if after.z > -2.0 * stddev.z {
        findings.push(Finding::warning(
            "The centre of mass may then lie above the bearing's centre: the platform would tip over. Leave a small negative z as target.".to_owned(),
        ));
    }
    findings
}

#[cfg(test)]
mod tests {
    use super::*;

    fn three() -> Vec<Ballast> {
        [("x", Vector3::x_axis()), ("y", Vector3::y_axis()), ("z", Vector3::z_axis())]
            .into_iter()
            .map(|(name, axis_b)| Ballast {
                name: name.to_owned(),
                axis_b,
                weight_n: 20.0,
                position_m: 0.01,
                travel_m: (-0.1, 0.1),
                step_m: 0.0,
            })
            .collect()
    }

    #[test]
    fn three_actuators_take_an_offset_away() {
        let offset = Vector3::new(0.03, -0.05, 0.02);
        let target = Vector3::new(0.0, 0.0, -0.01);
        let plan = plan_balance(&offset, &(Matrix3::identity() * 1e-8), &target, &three());
        // 20 N: 1.5 mm back, 2.5 mm on, 1.5 mm down.
        for (found, expected) in plan.moves_m.iter().zip([-0.0015, 0.0025, -0.0015]) {
            assert!((found - expected).abs() < 1e-12, "{plan:?}");
        }
        assert!((plan.offset_b_n_m - target).norm() < 1e-12 && plan.findings.is_empty(), "{plan:?}");
    }

    #[test]
    fn travel_ends_and_missing_axes_are_said() {
        let offset = Vector3::new(3.0, 0.0, -0.1);
        let plan = plan_balance(&offset, &Matrix3::zeros(), &Vector3::new(0.0, 0.0, -0.1), &three());
        assert!((plan.moves_m[0] + 0.11).abs() < 1e-12);
        assert!((plan.level_torque_n_m - 0.8).abs() < 1e-9, "{plan:?}");
        assert!(plan.findings.iter().any(|f| f.text.contains("x at the end of travel")));
        // A slanted one helps along.
        let mut more = three();
        more.push(Ballast {
            name: "battery".into(),
            axis_b: Unit::new_normalize(Vector3::new(1.0, 1.0, 0.0)),
            weight_n: 30.0,
            position_m: 0.0,
            travel_m: (-0.2, 0.2),
            step_m: 0.0,
        });
        let plan = plan_balance(&offset, &Matrix3::zeros(), &Vector3::new(0.0, 0.0, -0.1), &more);
        assert!(plan.level_torque_n_m < 1e-9, "{plan:?}");
        let plan = plan_balance(&offset, &Matrix3::zeros(), &Vector3::zeros(), &three()[1..]);
        assert!((plan.offset_b_n_m.x - 3.0).abs() < 1e-12);
        assert!(plan.findings.iter().any(|f| f.text.contains("no ballast moves in")), "{plan:?}");
    }
}
