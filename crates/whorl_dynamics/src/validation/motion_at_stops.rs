//! Where laws have a corner or a jump: stops, and motors at their largest speed.

use nalgebra::{Matrix3, UnitQuaternion, Vector3};

use super::effects::add;
use super::{free_platform, ns, plant, set_mass};
use crate::platform::TiltLimit;
use crate::{Environment, InitialState, PlatformModel};

/// Stops at 0.09 rad, inertia (6, 7, 12), nothing else.
fn between_stops() -> PlatformModel {
    let mut model = free_platform();
    model.wheels_mut().clear();
    set_mass(&mut model, Some(Matrix3::from_diagonal(&Vector3::new(6.0, 7.0, 12.0))), Vector3::zeros());
    model.tilt_limit = TiltLimit::Cone { max_rad: 0.09 };
    model
}

/// Tilt and rate at 1, 10 and 30 s of a platform that is thrown at 0.5 rad/s from a tilt of 0.01 rad, by
/// reference/bouncing.py (DOP853 from event to event). Without locating the events the rate was 4e-4 rad/s off at the end.
const BOUNCING: [(f64, f64, f64); 3] = [
    (1.0, -0.017_361_780_137_054_847, -0.164_569_475_506_925_23),
    (10.0, 0.003_350_029_422_498_595_6, -0.017_828_214_324_536_053),
    (30.0, -0.004_466_884_083_154_289, 0.005_867_959_761_218_2),
];

fn thrown() -> InitialState {
    InitialState {
        q_world_body: UnitQuaternion::from_axis_angle(&Vector3::x_axis(), 0.01),
        omega_wb_b_rad_s: Vector3::new(0.5, 0.0, 0.0),
        ..InitialState::default()
    }
}

fn follows_the_reference(model: &PlatformModel) {
    let mut p = plant(model, &thrown());
    for (time_s, tilt_rad, rate_rad_s) in BOUNCING {
        p.advance_to(ns(time_s)).unwrap();
        let (tilt, rate) = (p.state().q_world_body.scaled_axis().x, p.state().omega_wb_b_rad_s.x);
        assert!((rate - rate_rad_s).abs() < 1e-7, "{time_s}: {rate} {rate_rad_s}");
        assert!((tilt - tilt_rad).abs() < 1e-6, "{time_s}: {tilt} {tilt_rad}");
    }
}

#[test]
fn a_platform_that_bounces_between_its_stops() {
    follows_the_reference(&between_stops());
}

/// The same contact as an effect, inside a stop that is not reached.
#[test]
fn a_contact_of_an_effect_is_followed_alike() {
    let mean = 25.0 / 3.0;
    let mut model = between_stops();
    model.tilt_limit = TiltLimit::Cone { max_rad: 0.5 };
    let values = [("k_n_m_rad", 2000.0 / 8.6 * mean), ("c_n_m_s", 100.0 / 8.6 * mean), ("angle_rad", 0.09)];
    add(&mut model, "tilt_stop_contact", &values);
    follows_the_reference(&model);
}

/// At its largest speed a motor gives no torque that a low battery, or a wrong constant, could lower.
#[test]
fn a_wheel_at_its_largest_speed_stays_there_on_a_low_battery() {
    for (id, values) in
        [("supply_voltage", [("wheel_torque_per_v", 0.05)]), ("wheel_motor_constant", [("wheel_z", -0.2)])]
    {
        let mut model = free_platform();
        (model.bus.initial_v, model.bus.full_v, model.bus.discharge_v_s) = (20.0, 25.0, 0.0);
        add(&mut model, id, &values);
        let top = model.wheels()[2].max_speed_rad_s;
        let initial = InitialState { wheel_speed_rad_s: vec![0.0, 0.0, top], ..InitialState::default() };
        let mut p = plant(&model, &initial);
        p.command_wheels(&[0.0, 0.0, 0.2]).unwrap();
        for k in 1..=20 {
            p.advance_to(ns(0.5 * f64::from(k))).unwrap();
            let speed = p.state().wheel_speed_rad_s()[2];
            assert!((speed - top).abs() < 1e-9 * top, "{id}: {speed} of {top}");
        }
    }
}

/// The accelerometer's part of the Earth's rotation, by differences of the sensor's position in axes that do not turn.
#[test]
fn an_accelerometer_on_a_turning_earth() {
    let mut model = free_platform();
    add(&mut model, "earth_rotation", &[("scale", 1.0)]);
    let arm = Vector3::new(0.3, -0.2, 0.4);
    model.sensors.accelerometer.lever_arm_b_m = arm;
    let (omega, alpha) = (Vector3::new(0.3, -0.5, 0.8), Vector3::new(0.1, 0.2, -0.3));
    let q = UnitQuaternion::from_euler_angles(0.3, -0.2, 1.0);
    let earth = Vector3::new(0.0, 0.649_437_f64.cos(), 0.649_437_f64.sin()) * 7.292_115e-5;
    // Position of the sensor after t in room axes, then in axes that do not turn: the Earth's turn comes on top. The
    // differences' rounding must not hide a term of 1e-4 m/s^2, hence a step of a tenth of a second and sixth order.
    let at = |t: f64, turn: bool| -> Vector3<f64> {
        let steps = 2000;
        let mut attitude = q;
        for k in 0..steps {
            let middle = (f64::from(k) + 0.5) * t / f64::from(steps);
            attitude *= UnitQuaternion::from_scaled_axis((omega + alpha * middle) * (t / f64::from(steps)));
        }
        let earth_turn =
            if turn { UnitQuaternion::from_scaled_axis(earth * t) } else { UnitQuaternion::identity() };
        earth_turn * (attitude * arm)
    };
    let acceleration = |turn: bool| -> Vector3<f64> {
        let h = 0.02;
        let pair = |n: f64| at(n * h, turn) + at(-n * h, turn);
        (pair(3.0) * 2.0 - pair(2.0) * 27.0 + pair(1.0) * 270.0 - at(0.0, turn) * 490.0) / (180.0 * h * h)
    };
    let expected = q.inverse() * (acceleration(true) - acceleration(false));
    let environment = Environment::new(&model, q, omega);
    let mut imu = crate::TrueImu { angular_velocity_b_rad_s: omega, specific_force_b_m_s2: Vector3::zeros() };
    let p = plant(&model, &InitialState::default());
    p.gyrostat().effects().measure_imu(&environment, &mut imu);
    let found = imu.specific_force_b_m_s2;
    assert!(found.norm() > 1e-5, "{found}");
    assert!((found - expected).norm() < 1e-8, "{found} {expected}");
}
