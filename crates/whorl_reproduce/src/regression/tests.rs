//! On exact motion the regressions must return the exact parameters.

use nalgebra::{UnitQuaternion, Vector3};
use rand_distr::{Distribution, StandardNormal};
use rand_pcg::Pcg64;
use whorl_dynamics::mass_parameters::mass_vector;
use whorl_dynamics::{InitialState, Plant, PlatformModel};

use crate::regression::{Form, Method, StateSample, StateSeries, Weighting, rows, solve};
use crate::rigid_body::simulate_rigid_body;

const METHODS: [Method; 5] = [
    Method::Torque,
    Method::Momentum { shift: 1 },
    Method::Momentum { shift: 2 },
    Method::Momentum { shift: 3 },
    Method::Energy,
];

fn torque(t: f64) -> Vector3<f64> {
    Vector3::new(0.05 * (0.9 * t).sin(), 0.04 * (1.3 * t).cos(), 0.1 * (0.5 * t).sin().signum())
}

fn largest_error(truth: &PlatformModel, estimate: &whorl_dynamics::MassVector) -> f64 {
    let t = mass_vector(&truth.mass_properties);
    (estimate - t).component_div(&t).amax()
}

#[test]
fn every_method_is_exact_on_exact_motion() {
    let model = PlatformModel::whorl_1_reference();
    let start = (UnitQuaternion::from_euler_angles(0.06, 0.03, 0.2), Vector3::new(0.02, 0.01, 0.1));
    let series = simulate_rigid_body(&model.mass_properties, start, &torque, 0.01, 6000, 2);
    for method in METHODS {
        for form in [Form::Natural, Form::IntegratedTrapezoid] {
            let found = solve(&rows(&series, method, form), Weighting::PseudoInverse).unwrap();
            let error = largest_error(&model, &found.estimate);
            assert!(error < 0.01, "{method:?} {form:?}: {error} {}", found.estimate);
        }
    }
}

/// The gyrostat, with wheels that start running; its energy balance included, of which the dissertation
/// says that there is none.
#[test]
fn gyrostat_forms_are_exact_on_exact_motion() {
    let mut model = PlatformModel::whorl_1_reference();
    model.tilt_limit = whorl_dynamics::platform::TiltLimit::Cone { max_rad: 1.0 };
    let initial = InitialState {
        omega_wb_b_rad_s: Vector3::new(0.02, -0.03, 0.1),
        wheel_speed_rad_s: vec![2.0, -1.0, 5.0],
        ..InitialState::default()
    };
    let mut plant = Plant::new(&model, &initial, 1).unwrap();
    let wheel_momentum_b_kg_m2 = StateSeries::momentum_axes(model.wheels());
    let mut series = StateSeries { samples: Vec::new(), wheel_momentum_b_kg_m2 };
    for k in 0..4000 {
        let truth = plant.truth();
        series.samples.push(StateSample {
            time_s: plant.time_s(),
            q_world_body: truth.q_world_body,
            omega_wb_b_rad_s: truth.omega_wb_b_rad_s,
            wheel_speed_rad_s: truth.wheel_speed_rad_s,
            external_torque_b_n_m: Vector3::zeros(),
        });
        let t = 0.01 * f64::from(k);
        let u = [0.06 * (0.9 * t).sin(), 0.05 * (1.3 * t).cos(), 0.2 * (0.5 * t).sin()];
        plant.command_wheels(&u).unwrap();
        plant.advance_to((i64::from(k) + 1) * 10_000_000).unwrap();
    }
    for method in METHODS {
        let found =
            solve(&rows(&series, method, Form::IntegratedTrapezoid), Weighting::PseudoInverse).unwrap();
        let error = largest_error(&model, &found.estimate);
        assert!(error < 0.02, "{method:?}: {error} {}", found.estimate);
    }
}

/// Noise on the rate biases the pseudo-inverse towards zero; total least squares with the noise known
/// does not, on average.
#[test]
fn total_least_squares_takes_the_bias_of_noise_away() {
    let model = PlatformModel::whorl_1_reference();
    let start = (UnitQuaternion::from_euler_angles(0.06, 0.03, 0.2), Vector3::zeros());
    let slow = |t: f64| Vector3::new(0.0, 0.0, 0.004 * (0.4 * t).sin());
    let exact = simulate_rigid_body(&model.mass_properties, start, &slow, 0.1, 1000, 5);
    let sigma = 1.0e-3;
    let mut rng = Pcg64::new(3, 4);
    let (mut plain, mut total, mut markov) = (0.0, 0.0, 0.0);
    let runs = 20;
    for _ in 0..runs {
        let mut noisy = exact.clone();
        for sample in &mut noisy.samples {
            for axis in 0..3 {
                let n: f64 = StandardNormal.sample(&mut rng);
                sample.omega_wb_b_rad_s[axis] += sigma * n;
            }
        }
        let system = rows(&noisy, Method::Torque, Form::IntegratedTrapezoid);
        let izz = |w| solve(&system, w).unwrap().estimate[5] / f64::from(runs);
        plain += izz(Weighting::PseudoInverse);
        total += izz(Weighting::TotalLeastSquares { rate_stddev_rad_s: sigma });
        markov += izz(Weighting::Markov { row_stddev: [6.2e-3, 7.5e-3, 12.1e-3] });
    }
    println!("I_zz: pseudo-inverse {plain}, total {total}, Markov {markov}");
    assert!(plain < 0.8 * 12.1, "{plain}");
    // Weights cannot remove it: the noise is in the matrix.
    assert!(markov < 0.8 * 12.1, "{markov}");
    assert!((total / 12.1 - 1.0).abs() < 0.15, "{total}");
}

/// A wrong first rate is the same error in every integrated row: the weighted solution estimates it along.
#[test]
fn an_error_of_the_first_rate_does_not_matter_to_the_weighted_solution() {
    let model = PlatformModel::whorl_1_reference();
    let start = (UnitQuaternion::from_euler_angles(0.06, 0.03, 0.2), Vector3::new(0.02, 0.01, 0.1));
    let mut series = simulate_rigid_body(&model.mass_properties, start, &torque, 0.01, 6000, 2);
    series.samples[0].omega_wb_b_rad_s += Vector3::new(0.01, -0.01, 0.01);
    let system = rows(&series, Method::Torque, Form::IntegratedTrapezoid);
    let error = |weighting| largest_error(&model, &solve(&system, weighting).unwrap().estimate);
    let (plain, weighted) =
        (error(Weighting::PseudoInverse), error(Weighting::Markov { row_stddev: [1.0, 2.0, 3.0] }));
    assert!(weighted < 0.01 && plain > 0.1, "{weighted} {plain}");
}
