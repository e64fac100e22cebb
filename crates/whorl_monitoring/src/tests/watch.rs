use nalgebra::{Matrix3, UnitQuaternion, Vector3};
use rand_distr::{Distribution, StandardNormal};
use rand_pcg::Pcg64Mcg;

use whorl_dynamics::platform::TiltLimit;
use whorl_dynamics::{MassProperties, ModelPrior, PlatformModel};

use crate::{Monitor, Settings};

const STEP_S: f64 = 0.01;

/// A balanced platform with three wheels that turn without friction, moved by nothing but their motors' noise: Euler's
/// equation of a gyrostat, integrated here.
fn watched(noise_n_m_sqrt_s: f64, end_s: f64) -> (Monitor, f64) {
    let mut model = PlatformModel::whorl_1_reference();
    let inertia = Matrix3::from_diagonal(&Vector3::new(6.0, 7.0, 12.0));
    model.mass_properties = MassProperties::new(inertia, Vector3::zeros(), 110.0).unwrap();
    // Noise turns it further than the dissertation's stops would let it.
    model.tilt_limit = TiltLimit::Cone { max_rad: 1.5 };
    for wheel in model.wheels_mut() {
        (wheel.viscous_friction_n_m_s, wheel.coulomb_friction_n_m) = (0.0, 0.0);
    }
    let jets = model.jets().len();
    let spin_inertia = model.wheels()[0].spin_inertia_kg_m2;
    let settings = Settings { background_torque_n_m: 1e-6, ..Settings::of(&model) };
    let mut monitor = Monitor::new(&model, &ModelPrior::typical(&model), &settings).unwrap();

    let mut rng = Pcg64Mcg::new(3);
    let mut normal = || -> f64 { StandardNormal.sample(&mut rng) };
    let gyro_noise = model.sensors.gyro.errors.one_sample_stddev();
    let speed_noise = model.sensors.wheel_speed.one_sample_stddev_rad_s();
    let (mut q, mut omega, mut speed) =
        (UnitQuaternion::identity(), Vector3::<f64>::zeros(), Vector3::new(40.0, -35.0, 30.0));
    let (mut squares, mut count, mut steps) = (0.0, 0_u32, 0);
    while f64::from(steps) * STEP_S < end_s {
        steps += 1;
        let at_ns = i64::from(steps) * 10_000_000;
        let torque = Vector3::from_fn(|_, _| noise_n_m_sqrt_s / STEP_S.sqrt() * normal());
        let momentum = inertia * omega + speed * spin_inertia;
        // Of the body without the wheels' inertia about their spin axes.
        let resisting = inertia - Matrix3::identity() * spin_inertia;
        let omega_dot = resisting.try_inverse().unwrap() * (-omega.cross(&momentum) - torque);
        speed += (torque / spin_inertia - omega_dot) * STEP_S;
        q *= UnitQuaternion::from_scaled_axis((omega + omega_dot * (0.5 * STEP_S)) * STEP_S);
        omega += omega_dot * STEP_S;
        let reading = omega + gyro_noise.map(|s| s * normal());
        let speeds = speed.map(|s| s + speed_noise * normal());
        monitor.on_gyro(at_ns, &reading);
        monitor.on_wheels(at_ns, speeds.as_slice(), &[0.0; 3]);
        monitor.on_valves(at_ns, &vec![false; jets], &vec![0.0; jets]);
        monitor.on_controlled(at_ns);
        monitor.on_attitude(at_ns, &q, &omega);
        if steps % 100 == 0 {
            let fit = monitor.fit();
            if f64::from(steps) * STEP_S > 70.0 {
                squares += fit.squares.0;
                count += fit.squares.1;
            }
        }
    }
    (monitor, squares / f64::from(count))
}

/// From a thirtieth of what is assumed to three times it. The residuals then have the variance they should have. A small
/// noise is told less well: the readings' own is larger, and the slow torque that the filter allows stands in for it; a thirtieth hardly shows at all.
#[test]
fn the_noise_of_motors_is_learned_from_how_wheels_move() {
    let assumed =
        crate::watch::MOTOR_NOISE_SQRT_S * PlatformModel::whorl_1_reference().wheels()[0].max_torque_n_m;
    for (over_assumed, tolerance) in
        [(1.0 / 30.0, 10.0), (0.1, 3.0), (1.0 / 3.0, 2.0), (1.0, 1.5), (3.0, 1.5)]
    {
        let (monitor, mean_square) = watched(assumed * over_assumed, 130.0);
        let ratio = (0.5 * monitor.watch.ln_motor_noise).exp() / over_assumed;
        assert!(ratio > 1.0 / tolerance && ratio < tolerance, "{over_assumed}: {ratio} times the truth");
        assert!((mean_square - 1.0).abs() < 0.2, "{over_assumed}: mean square {mean_square}");
    }
}
