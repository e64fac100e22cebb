//! Balancing plans.

use super::*;

fn three() -> Vec<Ballast> {
    [("x", Vector3::x_axis()), ("y", Vector3::y_axis()), ("z", Vector3::z_axis())]
        .into_iter()
        .map(|(name, axis_b)| Ballast { name: name.to_owned(), axis_b, weight_n: 20.0, travel_m: 0.1 })
        .collect()
}

#[test]
fn three_actuators_take_an_offset_away() {
    let offset = Vector3::new(0.03, -0.05, 0.02);
    let target = Vector3::new(0.0, 0.0, -0.01);
    let (moves_m, after) = plan_balance(&offset, &target, &three());
    // 20 N: 1.5 mm back, 2.5 mm on, 1.5 mm down.
    for (found, expected) in moves_m.iter().zip([-0.0015, 0.0025, -0.0015]) {
        assert!((found - expected).abs() < 1e-12, "{moves_m:?}");
    }
    assert!((after - target).norm() < 1e-12, "{after}");
}

#[test]
fn travel_ends_and_axes_may_be_missing_or_slanted() {
    let (offset, target) = (Vector3::new(3.0, 0.0, -0.1), Vector3::new(0.0, 0.0, -0.1));
    let (moves_m, after) = plan_balance(&offset, &target, &three());
    assert!((moves_m[0] + 0.1).abs() < 1e-12 && (after.xy().norm() - 1.0).abs() < 1e-9, "{after}");
    // A slanted one helps along.
    let mut more = three();
    let axis_b = Unit::new_normalize(Vector3::new(1.0, 1.0, 0.0));
    more.push(Ballast { name: "battery".into(), axis_b, weight_n: 30.0, travel_m: 0.2 });
    assert!(plan_balance(&offset, &target, &more).1.xy().norm() < 1e-9);
    let (_, after) = plan_balance(&offset, &Vector3::zeros(), &three()[1..]);
    assert!((after.x - 3.0).abs() < 1e-12 && after.z.abs() < 1e-12, "{after}");
}
