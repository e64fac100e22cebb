//! Bad input is refused by name; hopeless demands get the documented fallback.

use nalgebra::{Matrix3xX, Vector3};

use crate::layouts::{canted_pods, no_wheels, six_jets, three_wheels, wheels_only};
use crate::{
    Allocator, EffectorError, EffectorLayout, Effectors, FallbackReason, JetMask, ListError, Mode, Status,
    TorqueDemand, TorqueDemandError,
};

fn layout() -> EffectorLayout {
    canted_pods(three_wheels()).layout().clone()
}

#[test]
fn layouts_are_refused_by_field_and_index() {
    let mut bad = layout();
    bad.jet_torque_b_n_m[(1, 4)] = f64::NAN;
    let error = Effectors::new(bad).unwrap_err();
    assert!(error.to_string().starts_with("jet_torque_b_n_m[4] = NaN"), "{error}");

    let mut bad = layout();
    bad.jet_gas_rate_kg_s[2] = 0.0;
    assert!(matches!(
        Effectors::new(bad),
        Err(EffectorError::List(ListError::Value { field: "jet_gas_rate_kg_s", index: 2, .. }))
    ));

    let mut bad = layout();
    bad.motor_torque_b[(2, 0)] = f64::INFINITY;
    assert!(matches!(
        Effectors::new(bad),
        Err(EffectorError::List(ListError::Value { field: "motor_torque_b", index: 0, .. }))
    ));

    let mut bad = layout();
    bad.motor_limit.pop();
    assert_eq!(
        Effectors::new(bad),
        Err(EffectorError::List(ListError::Count { field: "motor_limit", found: 2, expected: 3 }))
    );

    let jets = |count: usize| EffectorLayout {
        jet_torque_b_n_m: Matrix3xX::zeros(count),
        jet_force_b_n: None,
        jet_gas_rate_kg_s: vec![1.0; count],
        motor_torque_b: Matrix3xX::zeros(0),
        motor_limit: vec![],
    };
    assert_eq!(Effectors::new(jets(33)), Err(EffectorError::TooManyJets(33)));
    assert!(Effectors::new(jets(32)).is_ok());
    assert_eq!(Effectors::new(jets(0)), Err(EffectorError::Empty));
}

#[test]
fn demands_are_refused_by_field_and_index() {
    let effectors = canted_pods(three_wheels());
    let mut allocator = Allocator::new(effectors.clone()).unwrap();
    let good = TorqueDemand::nominal(&effectors, Mode::Both, Vector3::new(0.1, 0.0, 0.0));
    let mut refuse = |change: &dyn Fn(&mut TorqueDemand)| {
        let mut demand = good.clone();
        change(&mut demand);
        allocator.allocate(&demand).unwrap_err()
    };
    for bad in [f64::NAN, f64::INFINITY] {
        assert!(matches!(refuse(&|d| d.torque_b_n_m.y = bad), TorqueDemandError::Torque(_)));
        assert!(matches!(
            refuse(&|d| d.motor_weight = bad),
            TorqueDemandError::List(ListError::Value { .. })
        ));
        assert!(matches!(
            refuse(&|d| d.motor_max[1] = bad),
            TorqueDemandError::List(ListError::Value { field: "motor_max", index: 1, .. })
        ));
        assert!(matches!(
            refuse(&|d| d.jet_on_fraction_max[11] = bad),
            TorqueDemandError::List(ListError::Value { field: "jet_on_fraction_max", index: 11, .. })
        ));
    }
    assert!(matches!(refuse(&|d| d.motor_weight = -1.0), TorqueDemandError::List(ListError::Value { .. })));
    assert!(matches!(
        refuse(&|d| d.jet_on_fraction_min[0] = -0.1),
        TorqueDemandError::List(ListError::Value { .. })
    ));
    let crossed = refuse(&|d| {
        d.jet_on_fraction_min[3] = 0.6;
        d.jet_on_fraction_max[3] = 0.4;
    });
    assert_eq!(crossed, TorqueDemandError::Crossed { what: "jet", index: 3, min: 0.6, max: 0.4 });
    assert!(matches!(
        refuse(&|d| d.motor_min[2] = 0.7),
        TorqueDemandError::Crossed { what: "motor", index: 2, .. }
    ));
    assert!(matches!(
        refuse(&|d| d.jet_on_fraction_min.push(0.0)),
        TorqueDemandError::List(ListError::Count { field: "jet_on_fraction_min", found: 13, expected: 12 })
    ));
}

#[test]
fn net_force_needs_forces() {
    let mut plain = layout();
    plain.jet_force_b_n = None;
    let effectors = Effectors::new(plain).unwrap();
    let mut demand = TorqueDemand::nominal(&effectors, Mode::Both, Vector3::x());
    demand.net_force_weight = 1.0;
    assert_eq!(Allocator::new(effectors).unwrap().allocate(&demand), Err(TorqueDemandError::NoForces));
}

#[test]
fn zero_demand_costs_nothing() {
    let effectors = canted_pods(three_wheels());
    let mut allocator = Allocator::new(effectors.clone()).unwrap();
    for mode in [Mode::Jets, Mode::Both, Mode::Motors] {
        let demand = TorqueDemand::nominal(&effectors, mode, Vector3::zeros());
        let allocation = allocator.allocate(&demand).unwrap();
        assert_eq!(allocation.alpha, 1.0);
        assert_eq!(allocation.gas_rate_kg_s, 0.0);
        assert!(allocation.motor_command.iter().all(|&w| w == 0.0));
        assert_eq!(allocation.status, Status::ClosedForm);
    }
}

#[test]
fn zero_torque_with_wheels_to_unload_runs_the_program() {
    let effectors = canted_pods(three_wheels());
    let mut allocator = Allocator::new(effectors.clone()).unwrap();
    let mut demand = TorqueDemand::nominal(&effectors, Mode::Both, Vector3::zeros());
    demand.motor_desired = vec![0.1, -0.1, 0.05];
    demand.motor_weight = 1e4;
    let allocation = allocator.allocate(&demand).unwrap();
    assert!(matches!(allocation.status, Status::Solved { .. }));
    assert!(allocation.achieved_torque_b_n_m.norm() < 1e-9 && allocation.gas_rate_kg_s > 0.0);
    assert!((allocation.motor_command[0] - 0.1).abs() < 2e-3, "{allocation:?}");
}

#[test]
fn no_effector_left_is_a_fallback_with_zero() {
    let effectors = canted_pods(no_wheels());
    let mut allocator = Allocator::new(effectors.clone()).unwrap();
    let mut demand = TorqueDemand::nominal(&effectors, Mode::Jets, Vector3::x());
    demand.jet_available = JetMask::NONE;
    let allocation = allocator.allocate(&demand).unwrap();
    assert_eq!(allocation.status, Status::Fallback(FallbackReason::NoEffector));
    assert_eq!(allocation.alpha, 0.0);
    assert!(allocation.jet_on_fraction.iter().all(|&u| u == 0.0));
    demand.torque_b_n_m = Vector3::zeros();
    assert_eq!(allocator.allocate(&demand).unwrap().alpha, 1.0);
}

#[test]
fn coplanar_jets_give_the_projection_of_what_they_cannot_give() {
    // Only roll and pitch jets, and a demand with yaw in it: the nearest torque is in their plane.
    let mut flat = canted_pods(no_wheels()).layout().clone();
    flat.jet_torque_b_n_m.row_mut(2).fill(0.0);
    let effectors = Effectors::new(flat).unwrap();
    let mut allocator = Allocator::new(effectors.clone()).unwrap();
    let demand = TorqueDemand::nominal(&effectors, Mode::Jets, Vector3::new(0.05, -0.03, 0.2));
    let allocation = allocator.allocate(&demand).unwrap();
    assert_eq!(allocation.status, Status::Fallback(FallbackReason::DirectionUnattainable));
    let error = allocation.achieved_torque_b_n_m - Vector3::new(0.05, -0.03, 0.0);
    assert!(error.norm() < 1e-5, "{allocation:?}");
    // In the plane they are as good as any.
    let demand = TorqueDemand::nominal(&effectors, Mode::Jets, Vector3::new(0.05, -0.03, 0.0));
    let allocation = allocator.allocate(&demand).unwrap();
    assert!(matches!(allocation.status, Status::Solved { .. }), "{allocation:?}");
    assert!(allocator.check(&demand, &allocation).unwrap().agrees());
}

#[test]
fn two_wheels_keep_the_axes_they_have() {
    let effectors = wheels_only(&[Vector3::x(), Vector3::y()], 0.2);
    let mut allocator = Allocator::new(effectors.clone()).unwrap();
    let mut allocate = |x, y, z| {
        allocator.allocate(&TorqueDemand::nominal(&effectors, Mode::Motors, Vector3::new(x, y, z))).unwrap()
    };
    let inside = allocate(0.1, -0.4, 0.0);
    assert_eq!(inside.status, Status::ClosedForm);
    assert!((inside.alpha - 0.5).abs() < 1e-9);
    let outside = allocate(0.1, -0.1, 0.1);
    assert_eq!(outside.status, Status::Fallback(FallbackReason::DirectionUnattainable));
    assert!((outside.achieved_torque_b_n_m - Vector3::new(0.1, -0.1, 0.0)).norm() < 1e-9);
}

#[test]
fn a_stuck_open_jet_is_countered_or_reported() {
    let effectors = six_jets(no_wheels());
    let mut allocator = Allocator::new(effectors.clone()).unwrap();
    let mut demand = TorqueDemand::nominal(&effectors, Mode::Jets, Vector3::zeros());
    demand.jet_on_fraction_min[0] = 1.0;
    let countered = allocator.allocate(&demand).unwrap();
    assert!(countered.achieved_torque_b_n_m.norm() < 1e-9, "{countered:?}");
    // Its opposite has failed: no share of any other torque is attainable.
    demand.jet_available = JetMask::ALL.without(1);
    demand.torque_b_n_m = Vector3::new(0.1, 0.0, 0.0);
    let reported = allocator.allocate(&demand).unwrap();
    assert_eq!(reported.status, Status::Fallback(FallbackReason::BoundsExcludeDemand));
    assert_eq!(reported.jet_on_fraction[0], 1.0);
    assert!((reported.achieved_torque_b_n_m.x - 0.1).abs() < 1e-5, "{reported:?}");
}

#[test]
fn allocators_may_move_between_threads() {
    fn assert_send<T: Send>() {}
    assert_send::<Allocator>();
}
