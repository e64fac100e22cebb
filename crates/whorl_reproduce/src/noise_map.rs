//! Figure 4.21.

use nalgebra::{UnitQuaternion, Vector3};
use whorl_identification::mass_parameters::{MASS_PARAMETERS, mass_vector};
use whorl_math::statistics::median;
use whorl_report::{ReproducedPlot, Reproduction};

use crate::data::{Noise, level, rigid_whorl_1};
use crate::regression::{Form, Method, StateSeries, Weighting, rows, solve};
use crate::rigid_body::simulate_rigid_body;

/// Periods of the square wave \[s\].
const PERIODS_S: [f64; 6] = [0.5, 2.0, 5.0, 10.0, 30.0, 100.0];
/// Noise over the largest value of each channel \[%\].
const NOISE_PERCENT: [f64; 9] = [0.01, 0.03, 0.1, 0.3, 1.0, 3.0, 10.0, 30.0, 100.0];
/// Error up to which an estimate is useful \[%\].
const BEARABLE_PERCENT: f64 = 10.0;
/// Seeds whose median is shown.
const SEEDS: u128 = 5;

/// Name and points.
type Curve = (String, Vec<(f64, f64)>);

/// Median percent error of the nine parameters over noise, a curve for each period.
pub fn map() -> Reproduction {
    let model = rigid_whorl_1(true);
    let truth = mass_vector(&model.mass_properties);
    let mut curves: [Vec<Curve>; 2] = Default::default();
    for period_s in PERIODS_S {
        let square = move |t: f64| {
            Vector3::new(0.0, 0.0, if t.rem_euclid(period_s) < 0.5 * period_s { 0.1 } else { -0.1 })
        };
        let exact =
            simulate_rigid_body(&model.mass_properties, (level(), Vector3::zeros()), &square, 0.1, 1001, 10);
        for (form, list) in [Form::Natural, Form::IntegratedTrapezoid].into_iter().zip(&mut curves) {
            let points = NOISE_PERCENT.map(|percent| {
                let errors = (0..SEEDS).map(|seed| {
                    let noisy = spoiled(&exact, 0.01 * percent, seed);
                    let found = solve(&rows(&noisy, Method::Torque, form), Weighting::PseudoInverse);
                    found.map_or(f64::INFINITY, |s| {
                        let each = (0..MASS_PARAMETERS)
                            .map(|i| 100.0 * ((s.estimate[i] - truth[i]) / truth[i]).abs());
                        median(each)
                    })
                });
                (percent, median(errors))
            });
            list.push((format!("period {period_s} s"), points.to_vec()));
        }
    }
    let [natural, integrated] = curves;
    let [of_natural, of_integrated] = [&natural, &integrated]
        .map(|curves| median(curves.iter().map(|(_, points)| noise_with_error(points, BEARABLE_PERCENT))));
    let plot = |title: &str, curves| {
        ReproducedPlot {
        title: title.to_owned(),
        caption: "Median over the nine parameters of the percent error, and over five seeds; a curve for each period of the square wave about z.".to_owned(),
        labels: ["sensor noise [% of the largest value]".to_owned(), "median error [%]".to_owned()],
        logarithmic: [true, true],
        curves,
        dashed: Vec::new(),
    }
    };
    Reproduction {
        plots: vec![plot("natural form", natural), plot("integrated form", integrated)],
        sentences: vec![
            format!("As printed: the natural form is as good as the numerical derivative, whatever the motion, and the integrated form stands {:.0} times more noise: {BEARABLE_PERCENT:.0} % of error are reached at {of_natural:.2} % of noise with the natural form and at {of_integrated:.1} % with the integrated. Printed as a colour map over period and noise; here each period is a curve.", of_integrated / of_natural),
            "Periods near twice the sample time (0.2 s, the Nyquist limit), which give nothing in print, are left out here.".to_owned(),
            "What remains for the integrated form at high noise is bias, not scatter: noise of the rate stands in the matrix. Total least squares or the trajectory method remove it (Table 4.3).".to_owned(),
        ],
        ..Reproduction::default()
    }
}

/// Noise at which a curve reaches an error, between its points on logarithmic axes \[%\].
fn noise_with_error(points: &[(f64, f64)], error: f64) -> f64 {
    points.windows(2).find(|w| w[0].1 < error && w[1].1 >= error).map_or(f64::NAN, |w| {
        let share = (error / w[0].1).ln() / (w[1].1 / w[0].1).ln();
        w[0].0 * (w[1].0 / w[0].0).powf(share)
    })
}

/// White noise on rate and attitude, scaled to the largest value of each.
fn spoiled(exact: &StateSeries, share: f64, seed: u128) -> StateSeries {
    let mut noise = Noise::new(100 + seed);
    let rate = exact.samples.iter().map(|s| s.omega_wb_b_rad_s.amax()).fold(0.0, f64::max);
    let tilt = exact.samples.iter().map(|s| whorl_math::tilt_rad(&s.q_world_body)).fold(0.0, f64::max);
    let mut noisy = exact.clone();
    for sample in &mut noisy.samples {
        sample.omega_wb_b_rad_s += noise.vector() * (share * rate);
        sample.q_world_body *= UnitQuaternion::from_scaled_axis(noise.vector() * (share * tilt));
    }
    noisy
}
