//! Gyros against closed forms.

use nalgebra::{Matrix3, Unit, UnitQuaternion, Vector3};

use super::{ControlMomentGyros, Gyro, singularity};
use crate::actuators::{ActuatorKind, Joints, Kind, Motor};
use crate::{InitialState, MassProperties, Plant, PlatformModel};

fn gyro(gimbal_axis: Vector3<f64>, spin_axis: Vector3<f64>) -> Gyro {
    Gyro {
        name: "gyro".to_owned(),
        gimbal_axis_b: Unit::new_normalize(gimbal_axis),
        spin_axis_b: Unit::new_normalize(spin_axis),
        rotor_momentum_n_m_s: 1.5,
        gimbal_inertia_kg_m2: 0.05,
        max_rate_rad_s: 0.4,
        max_angle_rad: 1.2,
        time_constant_s: 0.005,
        viscous_friction_n_m_s: 0.0,
        coulomb_friction_n_m: 0.0,
    }
}

/// A balanced platform with these gyros and nothing else.
fn plant(inertia_b_kg_m2: Matrix3<f64>, gyros: Vec<Gyro>, omega: Vector3<f64>) -> Plant {
    let mut model = PlatformModel::whorl_1_reference();
    model.wheels_mut().clear();
    model.mass_properties = MassProperties::new(inertia_b_kg_m2, Vector3::zeros(), 100.0).unwrap();
    model.actuators.control_moment_gyros = ControlMomentGyros(gyros);
    model.tilt_limit = crate::platform::TiltLimit::Cone { max_rad: 3.1 };
    let initial = InitialState {
        q_world_body: UnitQuaternion::from_euler_angles(0.2, -0.1, 0.3),
        omega_wb_b_rad_s: omega,
        ..InitialState::default()
    };
    Plant::new(&model, &initial, 1).unwrap()
}

/// Two gyros that turn against each other: all momentum stays along one axis of the body, so that
/// I w = -2 h0 sin(gamma) whatever the gimbals' motion.
#[test]
fn a_scissored_pair_turns_the_body_by_the_momentum_it_stores() {
    let inertia = Matrix3::from_diagonal(&Vector3::new(6.0, 7.0, 12.0));
    let (x, y) = (Vector3::x(), Vector3::y());
    let mut plant = plant(inertia, vec![gyro(-y, x), gyro(y, -x)], Vector3::zeros());
    plant.command_motors(Kind::ControlMomentGyros, &[9.0, 9.0]).unwrap();
    for second in 1..=4_i64 {
        plant.advance_to(second * 500_000_000).unwrap();
        let gimbals = plant.state().actuators.control_moment_gyros;
        // 0.4 rad/s is the limit; the rate control's lag and the body's own rate (the gyro's load) take a little.
        assert!(gimbals.rate_rad_s[0] > 0.2 && gimbals.rate_rad_s[0] < 0.45, "{gimbals:?}");
        let expected = -2.0 * 1.5 * gimbals.angle_rad[0].sin() / 12.0;
        let omega = plant.state().omega_wb_b_rad_s;
        assert!((omega.z - expected).abs() < 1e-9, "{} {expected}", omega.z);
        assert!(omega.xy().norm() < 1e-12 && expected.abs() > 0.02, "{omega:?} {expected}");
    }
}

/// A tumbling platform whose gyros swing freely about skew axes keeps its momentum in the world, and its Jacobi
/// integral 1/2 w.I w + 1/2 J_g gamma'^2 + J_g gamma' g.w: with the rotors' speed held and no motor torque it is
/// conserved, whatever the rotors store.
#[test]
fn momentum_and_the_jacobi_integral_of_free_gimbals_stay() {
    let inertia = Matrix3::new(6.2, -0.9, -0.2, -0.9, 7.5, 0.1, -0.2, 0.1, 12.1);
    let mut gyros = vec![
        gyro(Vector3::new(0.3, 1.0, -0.2), Vector3::new(1.0, 0.1, 0.4)),
        gyro(Vector3::new(-0.5, 0.2, 1.0), Vector3::new(0.2, 1.0, 0.1)),
    ];
    for gyro in &mut gyros {
        // A motor so slow that it gives no torque.
        gyro.time_constant_s = 1e12;
        gyro.gimbal_inertia_kg_m2 = 0.3;
    }
    let mut plant = plant(inertia, gyros.clone(), Vector3::new(0.3, -0.2, 0.25));
    let world_momentum = |plant: &Plant| {
        let truth = plant.truth();
        truth.q_world_body * truth.momentum_b_n_m_s
    };
    let jacobi = |plant: &Plant| {
        let (omega, gimbals) =
            (plant.state().omega_wb_b_rad_s, plant.state().actuators.control_moment_gyros);
        gyros.iter().zip(gimbals.rate_rad_s).fold(0.5 * omega.dot(&(inertia * omega)), |sum, (gyro, rate)| {
            sum + gyro.gimbal_inertia_kg_m2 * rate * (0.5 * rate + gyro.gimbal_axis_b.dot(&omega))
        })
    };
    let (momentum, integral) = (world_momentum(&plant), jacobi(&plant));
    assert!(momentum.norm() > 3.0);
    let mut swung = 0.0_f64;
    for second in 1..=20_i64 {
        plant.advance_to(second * 1_000_000_000).unwrap();
        assert!((world_momentum(&plant) - momentum).norm() < 1e-8, "{second} s");
        assert!((jacobi(&plant) - integral).abs() < 1e-9, "{second} s");
        swung = swung.max(plant.state().actuators.control_moment_gyros.angle_rad[0].abs());
    }
    assert!(swung > 0.3, "the gimbals really swing: {swung}");
}

/// By differences of the momentum itself, at several gimbal angles.
#[test]
fn momentum_changes_at_the_rate_that_its_derivative_says() {
    let gyros = ControlMomentGyros(vec![
        gyro(Vector3::y(), Vector3::x()),
        gyro(Vector3::new(0.3, 0.4, 1.0), Vector3::new(1.0, -0.2, 0.1)),
    ]);
    let (rate, h) = ([0.3, -0.2], 1e-5);
    let at = |time_s: f64| Joints {
        position_rad: vec![0.7 + rate[0] * time_s, -0.4 + rate[1] * time_s],
        velocity_rad_s: rate.to_vec(),
    };
    let numeric = (gyros.momentum_b_n_m_s(&at(h)) - gyros.momentum_b_n_m_s(&at(-h))) / (2.0 * h);
    let given = gyros.momentum_rate_b_n_m(&at(0.0), &[]);
    assert!((given - numeric).norm() < 1e-9 && given.norm() > 0.3, "{given} {numeric}");
}

#[test]
fn the_allocation_column_is_the_torque_that_the_plant_gives() {
    let inertia = Matrix3::from_diagonal(&Vector3::new(6.0, 7.0, 12.0));
    let gyros = vec![gyro(Vector3::y(), Vector3::x())];
    let mut plant = plant(inertia, gyros.clone(), Vector3::zeros());
    plant.command_motors(Kind::ControlMomentGyros, &[0.3]).unwrap();
    plant.advance_to(1_000_000_000).unwrap();
    let gimbals = plant.state().actuators.control_moment_gyros;
    let sample = plant.sample_joints(Kind::ControlMomentGyros);
    let joints = Joints { position_rad: sample.position_rad, velocity_rad_s: sample.velocity_rad_s };
    let mut motors = [Motor::default()];
    ControlMomentGyros(gyros).motors(&joints, &[], &mut motors);
    // The gimbal's acceleration acts about y alone.
    let truth = plant.truth();
    let given = inertia * truth.omega_dot_wb_b_rad_s2
        + truth.omega_wb_b_rad_s.cross(&truth.momentum_b_n_m_s);
    let expected = motors[0].torque_b * gimbals.rate_rad_s[0];
    assert!((given - expected).xz().norm() < 1e-9 && expected.norm() > 0.3, "{given:?} {expected:?}");
    let stopped = Joints { position_rad: vec![1.3], velocity_rad_s: vec![0.0] };
    plant.gyrostat().model().actuators.control_moment_gyros.motors(&stopped, &[], &mut motors);
    assert!(motors[0].max < 0.0 && motors[0].min == -0.4, "beyond its largest angle only back");
}

/// Wie, section 7.5: a pyramid of four gyros at rest with skew angle b has det(C C^T) = 16 cos^4 b sin^2 b; it is singular
/// with all rotors along one direction as far as they go.
#[test]
fn the_measure_of_a_pyramid_is_the_known_one() {
    for skew in [0.4_f64, 0.927_3, 1.2] {
        let gyros: Vec<Gyro> = (0..4)
            .map(|j| {
                let (sin, cos) = (std::f64::consts::FRAC_PI_2 * f64::from(j)).sin_cos();
                let out = Vector3::new(cos * skew.sin(), sin * skew.sin(), skew.cos());
                gyro(out, Vector3::new(-sin, cos, 0.0))
            })
            .collect();
        let expected = 4.0 * skew.cos().powi(2) * skew.sin();
        let found = singularity::measure(&gyros, &[0.0; 4]);
        assert!((found - expected).abs() < 1e-12, "{found} {expected}");
        // All momentum towards y.
        let towards_y: Vec<f64> = gyros
            .iter()
            .map(|g| g.gimbal_axis_b.cross(&g.spin_axis_b).y.atan2(g.spin_axis_b.y))
            .collect();
        assert!(singularity::measure(&gyros, &towards_y) < 1e-9);
    }
}

/// The slope that null motion follows, by differences; of two gyros, three, and four.
#[test]
fn null_motion_follows_the_slope_of_the_squared_measure() {
    let all = [
        gyro(Vector3::new(0.3, 1.0, -0.2), Vector3::new(1.0, 0.1, 0.4)),
        gyro(Vector3::new(-0.5, 0.2, 1.0), Vector3::new(0.2, 1.0, 0.1)),
        gyro(Vector3::new(1.0, 0.2, 0.3), Vector3::new(0.1, 0.1, 1.0)),
        gyro(Vector3::new(0.2, -0.7, 0.4), Vector3::new(1.0, 0.0, 0.0)),
    ];
    for count in 2..=4 {
        let gyros = &all[..count];
        let angle_rad = [0.3, -0.2, 0.5, 0.1];
        let squared = |j: usize, by: f64| {
            let mut moved = angle_rad;
            moved[j] += by;
            singularity::measure(gyros, &moved[..count]).powi(2)
        };
        let mut rate_rad_s = vec![0.0; count];
        singularity::null_motion_rad_s(gyros, &angle_rad[..count], &mut rate_rad_s);
        for (j, rate) in rate_rad_s.iter().enumerate() {
            let slope = (squared(j, 1e-5) - squared(j, -1e-5)) / 2e-5;
            let expected = 0.2 * 0.4 * slope.clamp(-1.0, 1.0);
            assert!((rate - expected).abs() < 1e-8, "{count} {j}: {rate} {expected}");
        }
    }
}

/// With the body held, a gimbal that is asked for rate r against Coulomb friction T turns at r - T tau/J, and not at all
/// while J r / tau < T.
#[test]
fn a_rate_control_gives_way_to_friction_and_sticks() {
    let mut with_friction = gyro(Vector3::y(), Vector3::x());
    with_friction.coulomb_friction_n_m = 1.0;
    with_friction.viscous_friction_n_m_s = 2.0;
    let mut plant = plant(Matrix3::identity() * 8.0, vec![with_friction], Vector3::zeros());
    plant.set_clamped(true);
    let rate_after = |plant: &mut Plant, asked: f64| {
        plant.command_motors(Kind::ControlMomentGyros, &[asked]).unwrap();
        plant.advance_to(plant.now_ns() + 200_000_000).unwrap();
        plant.state().actuators.control_moment_gyros.rate_rad_s[0]
    };
    // J / tau = 10 N m s: held below 0.1 rad/s, and (10 + 2) rate = 10 asked - 1 above.
    assert_eq!(rate_after(&mut plant, 0.09), 0.0);
    assert!((rate_after(&mut plant, 0.3) - (10.0 * 0.3 - 1.0) / 12.0).abs() < 1e-9);
    assert!((rate_after(&mut plant, -0.2) - -(10.0 * 0.2 - 1.0) / 12.0).abs() < 1e-9);
    assert_eq!(rate_after(&mut plant, 0.0), 0.0, "it comes to rest and stays");
    // What control commands on top is what friction takes.
    let joints = Joints { position_rad: vec![0.0], velocity_rad_s: vec![0.2] };
    let mut motors = [Motor::default()];
    plant.gyrostat().model().actuators.control_moment_gyros.motors(&joints, &[], &mut motors);
    assert!((rate_after(&mut plant, 0.2 + motors[0].feedforward) - 0.2).abs() < 1e-9);
}

/// A gimbal asked to go on at its end of travel stops there without overshoot.
#[test]
fn a_gimbal_stops_at_the_end_of_its_travel() {
    let mut plant = plant(Matrix3::identity() * 8.0, vec![gyro(Vector3::y(), Vector3::x())], Vector3::zeros());
    plant.set_clamped(true);
    plant.command_motors(Kind::ControlMomentGyros, &[0.4]).unwrap();
    let mut furthest = 0.0_f64;
    for step in 1..=500 {
        plant.advance_to(step * 10_000_000).unwrap();
        furthest = furthest.max(plant.state().actuators.control_moment_gyros.angle_rad[0]);
    }
    assert!((furthest - 1.2).abs() < 1e-6, "{furthest}");
}

/// A model that takes the gimbals' motion as measured accelerates as the plant in which they move so, whatever the rates.
#[test]
fn the_model_with_measured_gimbals_is_the_plants_equation() {
    let inertia = Matrix3::new(6.2, -0.9, -0.2, -0.9, 7.5, 0.1, -0.2, 0.1, 12.1);
    let gyros = vec![
        gyro(Vector3::new(0.3, 1.0, -0.2), Vector3::new(1.0, 0.1, 0.4)),
        gyro(Vector3::new(-0.5, 0.2, 1.0), Vector3::new(0.2, 1.0, 0.1)),
    ];
    let mut plant = plant(inertia, gyros, Vector3::new(0.3, -0.2, 0.25));
    plant.command_motors(Kind::ControlMomentGyros, &[0.3, -0.2]).unwrap();
    plant.advance_to(30_000_000).unwrap();
    let (before, now_ns) = (plant.clone(), plant.now_ns());
    let step_ns = 10_000;
    plant.advance_to(now_ns + step_ns).unwrap();
    // The gimbals' accelerations by differences of what the free gimbals did.
    let step_s = step_ns as f64 * 1e-9;
    let gimbals = [&before, &plant].map(|p| p.state().actuators.control_moment_gyros);
    let acceleration: Vec<f64> =
        (0..2).map(|j| (gimbals[1].rate_rad_s[j] - gimbals[0].rate_rad_s[j]) / step_s).collect();
    assert!(acceleration.iter().all(|a| a.abs() > 0.01), "they do accelerate: {acceleration:?}");
    let mut environment = before.environment();
    environment.gimbal_acceleration_rad_s2 = &acceleration;
    let predicted = before.gyrostat().angular_acceleration_b_rad_s2(&environment, &[]);
    let found = before.angular_acceleration_b_rad_s2();
    assert!((predicted - found).norm() < 1e-4 * found.norm(), "{predicted} {found}");
}

/// Gimbals that are moved along a measured motion take up and give back momentum as free ones do.
#[test]
fn gimbals_moved_along_conserve_momentum() {
    let inertia = Matrix3::from_diagonal(&Vector3::new(6.0, 7.0, 12.0));
    let mut plant = plant(inertia, vec![gyro(Vector3::y(), Vector3::x())], Vector3::zeros());
    plant.move_gimbals_along(&[0.0], &[0.0]).unwrap();
    let momentum = |plant: &Plant| plant.truth().q_world_body * plant.truth().momentum_b_n_m_s;
    let start = momentum(&plant);
    let mut fastest = 0.0_f64;
    for k in 0..50_i64 {
        let angle = plant.state().actuators.control_moment_gyros.angle_rad[0];
        plant.move_gimbals_along(&[angle], &[0.3 * (0.2 * k as f64).sin()]).unwrap();
        plant.advance_to((k + 1) * 20_000_000).unwrap();
        fastest = fastest.max(plant.state().omega_wb_b_rad_s.norm());
    }
    assert!((momentum(&plant) - start).norm() < 1e-9);
    assert!(fastest > 5e-3, "the body really turns: {fastest}");
    assert!(plant.move_gimbals_along(&[0.0, 0.0], &[0.0]).is_err());
    assert!(plant.move_gimbals_along(&[f64::NAN], &[0.0]).is_err());
}
