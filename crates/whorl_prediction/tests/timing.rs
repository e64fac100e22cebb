//! How fast a random torque changes is what the run shows, and what it does slowly is no evidence for a law.

#![expect(clippy::unwrap_used, reason = "a test stops at a broken precondition")]

mod table;

use table::{TABLE, Table};
use whorl_prediction::{Noise, Parameter, Prepared, Settings, fit, follow};

/// A table that turns to and fro in half a minute, pushed at random.
const PUSHED: Table =
    Table { random_n_m: 0.01, wave_rad_s: 0.2, torque_n_m: 0.05, duration_s: 90.0, ..TABLE };

#[test]
fn the_correlation_time_is_the_true_one() {
    for random_s in [0.4, 1.0, 3.0, 8.0] {
        // So strong that its fast part shows too.
        let table = Table { random_s, random_n_m: 0.1, duration_s: 120.0, ..PUSHED };
        let scores: Vec<f64> = (1..5)
            .map(|seed| {
                let (recording, _) = table.turned(seed);
                let model = table.model();
                let case = Prepared::new(&recording, &model, Settings::default()).unwrap();
                let found = follow(&case, &Noise::stated(&case).unwrap()).noise.disturbance;
                // Of a first-order process that is seen as it is, the time's logarithm is known to the root of 2 tau/T.
                (found.correlation_s / random_s).ln() / (2.0 * random_s / table.duration_s).sqrt()
            })
            .collect();
        println!("measured: {random_s} s: {scores:.2?} deviations");
        let mean = scores.iter().sum::<f64>() / scores.len() as f64;
        assert!(
            mean.abs() < 1.5 && scores.iter().all(|score| score.abs() < 4.0),
            "{random_s} s: {scores:.2?}"
        );
    }
}

/// A friction that is not there, fitted beside a torque that changes over three seconds. Taken for one that changes within a second it
/// would do a third of the true slow torque, and the friction would be known half as well again as it is.
#[test]
fn a_law_beside_a_slow_random_torque_is_known_as_well_as_it_says() {
    let table = Table { random_s: 3.0, ..PUSHED };
    let model_at = |at: &[f64]| {
        let mut model = table.model();
        let values = [("c_n_m_s".to_owned(), 0.05 * at[0])].into_iter().collect();
        model.effects.insert("bearing_viscous_friction".to_owned(), values);
        Some(model)
    };
    let parameters = [Parameter { stddev: 10.0, range: (-100.0, 100.0) }];
    let scores: Vec<f64> = (1..17)
        .map(|seed| {
            let (recording, _) = table.turned(seed);
            let found =
                fit(&[recording], &parameters, &model_at, &[vec![0.0]], &Settings::default()).unwrap();
            found.at[0] / found.covariance[(0, 0)].sqrt()
        })
        .collect();
    let n = scores.len() as f64;
    let mean = scores.iter().sum::<f64>() / n;
    let rms = (scores.iter().map(|score| score * score).sum::<f64>() / n).sqrt();
    println!("measured: {mean:.2} +- {rms:.2} of {n} fits");
    // Chance makes a sixth of the root mean square of 16, and 0.25 of the mean.
    assert!(mean.abs() < 0.75 && (0.5..1.4).contains(&rms), "{mean:.2}, {rms:.2}: {scores:.2?}");
}
