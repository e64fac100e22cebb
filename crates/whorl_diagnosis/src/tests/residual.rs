//! The torque that the smoother finds, against one that the test adds.

use nalgebra::Vector3;
use whorl_dynamics::{ModelPrior, PlatformModel};

use super::generator::{normal, random, record};
use crate::evidence::problem::{FREE_RATE_WALK, Problem, ProcessNoise};
use crate::parameters::Reference;
use crate::whitening::columns::predict;
use crate::whitening::filter::{Settings, System, WHEEL};
use crate::whitening::mechanics::Mechanics;

#[test]
fn a_torque_that_wanders_lies_within_its_band() {
    const WALK_N_M_SQRT_S: f64 = 3e-3;
    let mut rng = random(77);
    let mut torque = Vector3::zeros();
    let walk: Vec<Vector3<f64>> = (0..4_000)
        .map(|_| {
            torque += Vector3::from_fn(|_, _| normal(&mut rng)) * WALK_N_M_SQRT_S * 0.01_f64.sqrt();
            torque
        })
        .collect();
    let at = |t: f64| walk[((t * 100.0).round() as usize).min(walk.len() - 1)];
    let mut model = PlatformModel::whorl_1_reference();
    // Its stop stays out of reach: near it nothing is known of the torque.
    model.tilt_limit = whorl_dynamics::platform::TiltLimit::Cone { max_rad: 0.5 };
    let recording = record(&model, 6, 40.0, Some(&|t, _, _| at(t)));
    let reference = Reference::new(&model, &ModelPrior::typical(&model));
    let mut problem = Problem::new(std::slice::from_ref(&recording), reference, 40.0, 1).unwrap();
    let point = problem.reference.point();
    for walk in [FREE_RATE_WALK, 5e-3] {
        problem.smooth(&point, ProcessNoise::Fixed(walk)).unwrap();
    }
    let mechanics = Mechanics::new(&model).unwrap();
    let (run, motion) = (&problem.runs[0], &problem.motions[0]);
    let (_, prediction) = predict(&mechanics, run, motion);
    let settings = Settings { torque_walk: WALK_N_M_SQRT_S, ..problem.settings(0) };
    let system = System { run, motion, mechanics: &mechanics, prediction: &prediction, settings };
    let linear = system.linear();
    let smoothed = system.smoothed_from(&linear, &system.filtered(&linear));
    let first = WHEEL + model.wheels().len();
    let (mut sum, mut count) = (0.0, 0.0);
    for (k, variance) in smoothed.torque_variance.chunks_exact(3).enumerate() {
        let found = &smoothed.state[k * linear.n + first..][..3];
        let truth = at(run.time(k));
        for i in 0..3 {
            sum += (found[i] - truth[i]).powi(2) / variance[i];
            count += 1.0;
        }
    }
    // A normal law all along, of a hundred or so independent errors.
    let mean: f64 = sum / count;
    assert!((0.6..1.6).contains(&mean), "{mean}");
    // At the ends one side is missing: half the information.
    let stddev = |k: usize| smoothed.torque_variance[3 * k + 2].sqrt();
    let (middle, last) = (stddev(run.nodes() / 2), stddev(run.nodes() - 2));
    assert!(last > 1.2 * middle, "{last} {middle}");
}
