//! Steering of motors whose torque turns as they move: gimbals of control moment gyros.
//!
//! Near a singular configuration the torques of all motors lie nearly in one plane, and torque across it would take rates
//! without bound. The singularity-robust inverse (Nakamura and Hanafusa, J. Dynamic Systems, Measurement and Control 108,
//! 1986; with the off-diagonal terms of Wie, Bailey and Heiberg, J. Guidance, Control and Dynamics 24(5), 2001, which lead
//! out of singularities that null motion cannot leave) gives instead the rates
//!
//! ```text
//! x = C^T (C C^T + lambda E)^-1 tau      lambda = lambda_0 exp(-mu det C C^T)
//! E = [1 e3 e2; e3 1 e1; e2 e1 1]        e_i = e_0 sin(pi t / 2 + phi_i)
//! ```
//!
//! x_i being commands over their limits and C the torques at these, over the largest of them. Their torque is
//! C C^T (C C^T + lambda E)^-1 tau. That torque is what the allocation is asked for: of all commands that give it, x has the
//! smallest norm, which is the allocation's own cost, so that its answer is x as long as that is within every limit; and the
//! commands that motors prefer for their own sake (null motion) enter it as desired commands, of which it keeps what does
//! not change the torque.

use nalgebra::{Matrix3, Vector3};
use whorl_dynamics::actuators::Motor;

/// lambda_0, mu, e_0 as Wie, Bailey and Heiberg 2001 use them.
const LARGEST: f64 = 0.01;
const FADING: f64 = 10.0;
const MIXED: f64 = 0.01;
/// Period of the mixing \[s\].
pub(super) const PERIOD_S: f64 = 4.0;

/// Torque that the singularity-robust inverse gives where `torque_b_n_m` is demanded, body axes \[N m\], and det C C^T; at
/// this time \[s\].
pub(super) fn attainable(motors: &[Motor], torque_b_n_m: &Vector3<f64>, time_s: f64) -> (Vector3<f64>, f64) {
    let largest = motors.iter().map(|motor| motor.torque_b.norm() * motor.limit).fold(0.0, f64::max);
    if largest <= 0.0 {
        return (*torque_b_n_m, 0.0);
    }
    let square: Matrix3<f64> = motors
        .iter()
        .map(|motor| motor.torque_b * (motor.limit / largest))
        .map(|column| column * column.transpose())
        .sum();
    let measure = square.determinant().max(0.0);
    let lambda = LARGEST * (-FADING * measure).exp();
    let phase = std::f64::consts::TAU * time_s / PERIOD_S;
    let [e1, e2, e3] =
        [0.0, 0.25, 0.5].map(|turns: f64| MIXED * (phase + std::f64::consts::TAU * turns).sin());
    let mixing = Matrix3::new(1.0, e3, e2, e3, 1.0, e1, e2, e1, 1.0);
    // Positive definite: the mixing's eigenvalues are within 0.02 of one.
    let given = (square + mixing * lambda).try_inverse().map(|inverse| square * inverse * torque_b_n_m);
    (given.unwrap_or(*torque_b_n_m), measure)
}

#[cfg(test)]
mod tests {
    use nalgebra::Matrix3xX;
    use whorl_allocation::{Allocator, EffectorLayout, Effectors, Mode, TorqueDemand};
    use whorl_dynamics::PlatformModel;
    use whorl_dynamics::actuators::{ActuatorKind, Joints, control_moment_gyros::ControlMomentGyros};

    use super::*;

    /// Four gyros in a pyramid whose faces make this angle with the base \[rad\].
    fn pyramid(skew_rad: f64) -> ControlMomentGyros {
        let mut gyros = ControlMomentGyros::default();
        for j in 0..4 {
            let heading = std::f64::consts::FRAC_PI_2 * f64::from(j);
            gyros.add(format!("gyro_{j}"));
            let gyro = gyros.0.last_mut().unwrap();
            let (sin, cos) = heading.sin_cos();
            let outwards = Vector3::new(cos * skew_rad.sin(), sin * skew_rad.sin(), skew_rad.cos());
            gyro.gimbal_axis_b = nalgebra::Unit::new_normalize(outwards);
            gyro.spin_axis_b = nalgebra::Unit::new_normalize(Vector3::new(-sin, cos, 0.0));
            gyro.rotor_momentum_n_m_s = 0.8;
            gyro.gimbal_inertia_kg_m2 = 2e-3;
            (gyro.max_rate_rad_s, gyro.max_angle_rad, gyro.time_constant_s) = (1.0, 10.0, 0.02);
        }
        gyros
    }

    fn motors(gyros: &ControlMomentGyros, angle_rad: [f64; 4]) -> Vec<Motor> {
        let joints = Joints { position_rad: angle_rad.to_vec(), velocity_rad_s: vec![0.0; 4] };
        let mut motors = vec![Motor::default(); 4];
        gyros.motors(&joints, &[], &mut motors);
        motors
    }

    fn allocator(motors: &[Motor]) -> Allocator {
        let columns: Vec<Vector3<f64>> = motors.iter().map(|motor| motor.torque_b).collect();
        let layout = EffectorLayout {
            jet_torque_b_n_m: Matrix3xX::zeros(0),
            jet_force_b_n: None,
            jet_gas_rate_kg_s: Vec::new(),
            motor_torque_b: Matrix3xX::from_columns(&columns),
            motor_limit: motors.iter().map(|motor| motor.limit).collect(),
        };
        Allocator::new(Effectors::new(layout).unwrap()).unwrap()
    }

    /// C C^T of a pyramid at rest is diag(2 c^2, 2 c^2, 4 s^2) for skew angle b, c = cos b, s = sin b (Wie, section 7.5).
    #[test]
    fn far_from_singularities_the_demand_stays_as_it_is() {
        let skew = 53.13_f64.to_radians();
        let torque = Vector3::new(0.05, -0.1, 0.2);
        let (given, measure) = attainable(&motors(&pyramid(skew), [0.0; 4]), &torque, 0.3);
        let expected = (2.0 * skew.cos().powi(2)).powi(2) * 4.0 * skew.sin().powi(2);
        assert!((measure - expected).abs() < 1e-12, "{measure} {expected}");
        assert!((given - torque).norm() < 1e-7 * torque.norm());
    }

    /// The saturation singularity of a pyramid: every rotor as far along y as its gimbal can bring it, so that none gives
    /// torque about y.
    #[test]
    fn in_a_singularity_rates_are_bounded_and_equal_the_robust_inverse() {
        let gyros = pyramid(53.13_f64.to_radians());
        let singular = [0.0, 1.0, 2.0, 3.0].map(|j: f64| {
            // Angle that puts rotor j's momentum furthest along y: tan gamma = (t . y) / (s . y).
            let gyro = &gyros.0[j as usize];
            let (s, t) = (gyro.spin_axis_b.into_inner(), gyro.gimbal_axis_b.cross(&gyro.spin_axis_b));
            t.y.atan2(s.y)
        });
        let motors = motors(&gyros, singular);
        assert!(motors.iter().all(|motor| motor.torque_b.y.abs() < 1e-12), "no gyro turns the body about y");
        for torque in [Vector3::new(0.0, 0.05, 0.0), Vector3::new(0.02, 0.05, -0.03)] {
            let (given, measure) = attainable(&motors, &torque, 0.7);
            assert!(measure < 1e-20);
            let limits: Vec<f64> = motors.iter().map(|motor| motor.torque_b.norm() * motor.limit).collect();
            let largest = limits.iter().copied().fold(0.0, f64::max);
            // The inverse itself, by its definition.
            let c = Matrix3xX::from_columns(
                &motors.iter().map(|motor| motor.torque_b * (motor.limit / largest)).collect::<Vec<_>>(),
            );
            let phase = std::f64::consts::FRAC_PI_2 * 0.7;
            let e = [phase.sin(), phase.cos(), -phase.sin()].map(|x| 0.01 * x);
            let mixing = Matrix3::new(1.0, e[2], e[1], e[2], 1.0, e[0], e[1], e[0], 1.0);
            let c_transposed = c.transpose();
            let inverse = (&c * &c_transposed + mixing * 0.01).try_inverse().unwrap();
            let x = &c_transposed * inverse * torque / largest;
            assert!(x.amax() < 1.0, "within the limits: {x}");
            let mut allocator = allocator(&motors);
            let mut demand = TorqueDemand::nominal(allocator.effectors(), Mode::Motors, given);
            demand.motor_weight = 200.0;
            let allocation = allocator.allocate(&demand).unwrap();
            for ((rate, motor), x) in allocation.motor_command.iter().zip(&motors).zip(x.iter()) {
                assert!((rate - x * motor.limit).abs() < 1e-6, "{rate} {}", x * motor.limit);
            }
        }
    }

    /// Null motion gives no torque, and what it does to the measure is what it is for: it grows.
    #[test]
    fn null_motion_gives_no_torque_and_leads_away_from_singularities() {
        let gyros = pyramid(0.9);
        let angle_rad = [0.9, -0.5, 0.7, -1.1];
        let motors = motors(&gyros, angle_rad);
        let joints = Joints { position_rad: angle_rad.to_vec(), velocity_rad_s: vec![0.0; 4] };
        let mut allocator = allocator(&motors);
        let torque = Vector3::new(0.02, -0.03, 0.01);
        let mut demand = TorqueDemand::nominal(allocator.effectors(), Mode::Motors, torque);
        demand.motor_weight = 200.0;
        let without = allocator.allocate(&demand).unwrap();
        gyros.prefer(&joints, &mut demand.motor_desired);
        let with = allocator.allocate(&demand).unwrap();
        assert!((with.achieved_torque_b_n_m - torque).norm() < 1e-9);
        let null: Vec<f64> =
            with.motor_command.iter().zip(&without.motor_command).map(|(a, b)| a - b).collect();
        let torque_of_null: Vector3<f64> = motors.iter().zip(&null).map(|(m, rate)| m.torque_b * *rate).sum();
        assert!(torque_of_null.norm() < 1e-9 && null.iter().any(|rate| rate.abs() > 1e-3), "{null:?}");
        let measure = |step_s: f64| {
            let moved: Vec<f64> = angle_rad.iter().zip(&null).map(|(a, rate)| a + rate * step_s).collect();
            whorl_dynamics::actuators::control_moment_gyros::singularity::measure(&gyros.0, &moved)
        };
        assert!(measure(0.1) > measure(0.0) && measure(0.0) > measure(-0.1));
    }

    #[test]
    fn wheels_alone_are_never_singular() {
        assert!(!PlatformModel::whorl_1_reference().actuators.may_be_singular());
    }
}
