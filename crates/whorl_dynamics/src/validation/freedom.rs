//! Motion that a rig leaves its body, by closed forms.

use nalgebra::{Matrix3, Unit, UnitQuaternion, Vector3};

use super::special_functions::complete_elliptic_k;
use super::{free_platform, ns, plant, set_mass, start};
use crate::platform::TiltLimit;
use crate::{Freedom, InitialState, Plant, PlatformModel};

const INERTIA: Matrix3<f64> = Matrix3::new(6.2, -0.9, -0.2, -0.9, 7.5, 0.1, -0.2, 0.1, 12.1);

fn shaft() -> Unit<Vector3<f64>> {
    Unit::new_normalize(Vector3::new(0.6, 0.8, 0.0))
}

/// Angle turned about the shaft from a given attitude \[rad\].
fn angle_rad(p: &Plant, from: &UnitQuaternion<f64>) -> f64 {
    let turned = from.inverse() * p.state().q_world_body;
    2.0 * turned.imag().dot(&shaft()).atan2(turned.w)
}

fn on_a_shaft(mgr_n_m: Vector3<f64>) -> PlatformModel {
    let mut model = free_platform();
    (model.freedom, model.tilt_limit) = (Freedom::Hinge { axis_b: shaft() }, TiltLimit::NONE);
    set_mass(&mut model, Some(INERTIA), mgr_n_m);
    model
}

/// A compound pendulum on a shaft that leans by b from the horizontal: T = 4 sqrt(a^T I a / (m g r cos b)) K(sin^2(A/2)),
/// r the distance of the centre of mass from the shaft. Where it lies along the shaft, and all other inertia, do not
/// matter, and the shaft keeps its direction in the world.
#[test]
fn a_pendulum_on_a_leaning_shaft_has_the_elliptic_period() {
    for (lean_rad, amplitude_rad) in [(0.0, 1e-3), (0.0, 1.7), (0.6, 0.9)] {
        let mut model = on_a_shaft(Vector3::new(0.0, 0.0, -2.0) + shaft().into_inner() * 0.7);
        model.wheels_mut().clear();
        let level = UnitQuaternion::rotation_between(
            &shaft(),
            &(shaft().into_inner() * f64::cos(lean_rad) + Vector3::z() * f64::sin(lean_rad)),
        )
        .unwrap();
        let initial = InitialState {
            q_world_body: level * UnitQuaternion::from_axis_angle(&shaft(), amplitude_rad),
            ..InitialState::default()
        };
        let mut p = plant(&model, &initial);
        let (mut before, mut crossings) = (amplitude_rad, Vec::new());
        let mut k = 0;
        while crossings.len() < 3 {
            k += 1;
            p.advance_to(k * 1_000_000).unwrap();
            let now = angle_rad(&p, &level);
            if before * now < 0.0 {
                crossings.push((k as f64 - now / (now - before)) * 1e-3);
            }
            before = now;
        }
        let about_shaft = shaft().dot(&(INERTIA * shaft().into_inner()));
        let modulus = (0.5 * amplitude_rad).sin().powi(2);
        let expected = 4.0 * (about_shaft / (2.0 * lean_rad.cos())).sqrt() * complete_elliptic_k(modulus);
        let period = crossings[2] - crossings[0];
        assert!((period / expected - 1.0).abs() < 1e-6, "{period} {expected}");
        let shaft_w = p.state().q_world_body * shaft().into_inner();
        assert!((shaft_w - level * shaft().into_inner()).norm() < 1e-11, "the shaft stays where it is");
        let omega = p.state().omega_wb_b_rad_s;
        assert!(omega.norm() > 1e-4 && (omega - shaft().into_inner() * shaft().dot(&omega)).norm() < 1e-13);
    }
}

/// A motor of torque u on a wheel with the cosine c to the shaft. Momentum about the shaft stays, a^T I a w + c J Om = 0,
/// and J (dOm/dt + c dw/dt) = u: dw/dt = -c u / (a^T I a - J c^2).
#[test]
fn a_wheel_turns_a_body_on_a_shaft_by_its_share_along_it() {
    let mut model = on_a_shaft(Vector3::zeros());
    model.wheels_mut().retain(|wheel| wheel.name == "wheel_y");
    let (spin_kg_m2, cosine, torque_n_m) = (model.wheels()[0].spin_inertia_kg_m2, 0.8, 0.2);
    let mut p = plant(&model, &InitialState::default());
    p.command_wheels(&[torque_n_m]).unwrap();
    p.advance_to(ns(20.0)).unwrap();
    let about_shaft = shaft().dot(&(INERTIA * shaft().into_inner()));
    let acceleration = -cosine * torque_n_m / (about_shaft - spin_kg_m2 * cosine * cosine);
    let rate = 20.0 * acceleration;
    let error = p.state().omega_wb_b_rad_s - shaft().into_inner() * rate;
    assert!(error.norm() < 1e-10, "{error} of {rate}");
    let speed = 20.0 * (torque_n_m / spin_kg_m2 - cosine * acceleration);
    assert!((p.state().wheel_speed_rad_s()[0] / speed - 1.0).abs() < 1e-10);
    assert!((about_shaft * rate + cosine * spin_kg_m2 * speed).abs() < 1e-10);
    // Only the share of a start that the shaft allows counts.
    let p = plant(&model, &start(Vector3::new(0.0, 0.0, 1.0) + shaft().into_inner() * 0.3, &[]));
    assert!((p.state().omega_wb_b_rad_s - shaft().into_inner() * 0.3).norm() < 1e-15);
}

/// A wheel on a bench coasts down: J dOm/dt = -c Om - d, so Om = (Om0 + d/c) exp(-c t / J) - d/c until it stops. The body
/// does not move, whatever is asked of it.
#[test]
fn a_wheel_on_a_bench_coasts_down_and_the_body_stays() {
    let mut model = free_platform();
    model.freedom = Freedom::Clamped;
    model.wheels_mut().retain(|wheel| wheel.name == "wheel_x");
    let wheel = &mut model.wheels_mut()[0];
    (wheel.viscous_friction_n_m_s, wheel.coulomb_friction_n_m) = (2e-3, 5e-2);
    let spin_kg_m2 = wheel.spin_inertia_kg_m2;
    let mut p = plant(&model, &start(Vector3::new(0.3, 0.2, 0.1), &[100.0]));
    p.set_body_torque(Vector3::new(1.0, 2.0, 3.0));
    let q_0 = p.state().q_world_body;
    for t in [5.0, 20.0, 40.0] {
        p.advance_to(ns(t)).unwrap();
        let expected = (100.0 + 25.0) * f64::exp(-2e-3 * t / spin_kg_m2) - 25.0;
        assert!((p.state().wheel_speed_rad_s()[0] - expected).abs() < 1e-9, "{t} s");
        assert_eq!((p.state().q_world_body, p.state().omega_wb_b_rad_s), (q_0, Vector3::zeros()));
    }
    // Five times as long brings it to rest: t = J/c ln(1 + c Om0 / d).
    let rest_s = spin_kg_m2 / 2e-3 * 5.0_f64.ln();
    p.advance_to(ns(rest_s - 0.1)).unwrap();
    assert!(p.state().wheel_speed_rad_s()[0] > 0.01);
    p.advance_to(ns(rest_s + 0.1)).unwrap();
    assert_eq!(p.state().wheel_speed_rad_s()[0], 0.0);
    p.set_clamped(false);
    p.advance_to(ns(rest_s + 1.0)).unwrap();
    assert_eq!(p.state().omega_wb_b_rad_s, Vector3::zeros(), "a bench does not let go");
}

/// Weight has no moment about the centre of mass: momentum in the world stays, and an accelerometer feels
/// dw/dt x r + w x (w x r) alone.
#[test]
fn a_free_body_feels_no_weight() {
    let mut model = free_platform();
    set_mass(&mut model, Some(INERTIA), Vector3::new(0.3, -0.2, -2.0));
    let tumble = start(Vector3::new(0.3, -0.5, 0.8), &[100.0, -50.0, 30.0]);
    let world = |p: &Plant| p.state().q_world_body * p.truth().momentum_b_n_m_s;
    let kept = |model: &PlatformModel| {
        let mut p = plant(model, &tumble);
        let before = world(&p);
        p.advance_to(ns(30.0)).unwrap();
        ((world(&p) - before).norm() < 1e-9 * before.norm(), p)
    };
    assert!(!kept(&model).0, "on a bearing its weight turns it");
    model.freedom = Freedom::Free;
    let (is_kept, p) = kept(&model);
    assert!(is_kept);
    let (omega, r) = (p.state().omega_wb_b_rad_s, model.sensors.accelerometer.lever_arm_b_m);
    let felt = p.gyrostat().true_imu(&p.environment()).specific_force_b_m_s2;
    let expected = p.angular_acceleration_b_rad_s2().cross(&r) + omega.cross(&omega.cross(&r));
    assert!(expected.norm() > 1e-3 && (felt - expected).norm() < 1e-14);
    assert_eq!(p.gyrostat().potential_energy_j(&p.state().q_world_body), 0.0);
}
