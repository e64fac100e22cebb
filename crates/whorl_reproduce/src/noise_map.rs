//! Figure 4.21.

use nalgebra::{UnitQuaternion, Vector3};
use whorl_dynamics::mass_parameters::{MASS_PARAMETERS, mass_vector};
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
    let limits = |curves: &[Curve]| -> Vec<f64> {
        curves.iter().map(|(_, points)| noise_with_error(points, BEARABLE_PERCENT)).collect()
    };
    let (natural_limits, integrated_limits) = (limits(&natural), limits(&integrated));
    let finite = |of: &[f64]| median(of.iter().copied().filter(|x| x.is_finite()));
    let (of_natural, of_integrated) = (finite(&natural_limits), finite(&integrated_limits));
    let plot = |title: &str, curves| {
        ReproducedPlot {
        title: title.to_owned(),
        caption: "Median over the nine parameters of the percent error, and over five seeds; a curve for each period of the square wave about z.".to_owned(),
        labels: ["sensor noise [% of the largest value]".to_owned(), "median error [%]".to_owned()],
        logarithmic: [true, true],
        curves,
        ..ReproducedPlot::default()
    }
    };
    Reproduction {
        plots: vec![plot("natural form", natural), plot("integrated form", integrated)],
        sentences: vec![
            of_natural_form(&natural_limits),
            format!("{BEARABLE_PERCENT:.0} % of error are reached at {of_natural:.2} % of noise with the natural form and at {of_integrated:.1} % with the integrated (median over the periods), which stands {:.0} times more noise. Printed: valid results up to 1 % and 10 %, ten times more; {}. Printed as a colour map over period and noise; here each period is a curve.", of_integrated / of_natural, limits_agree(of_natural, of_integrated)),
            "Periods near twice the sample time (0.2 s, the Nyquist limit), which give nothing in print, are left out here.".to_owned(),
            of_integrated_form(&integrated_limits),
            bias_or_scatter(&model),
        ],
        ..Reproduction::default()
    }
}

/// Whether the limits of noise are the printed ones, and their ratio \[%\].
fn limits_agree(of_natural: f64, of_integrated: f64) -> String {
    let near = |found: f64, printed: f64| (found / printed).ln().abs() < 2.0_f64.ln();
    match (near(of_natural, 1.0) && near(of_integrated, 10.0), near(of_integrated / of_natural, 10.0)) {
        (true, _) => "ours are the same".to_owned(),
        (false, true) => {
            "the ratio is ours, the limits are not: what counts as noise is not printed".to_owned()
        }
        (false, false) => "neither limits nor ratio are ours".to_owned(),
    }
}

/// Whether the integrated form makes more of a larger motion.
fn of_integrated_form(limits: &[f64]) -> String {
    let finite = || limits.iter().copied().filter(|x| x.is_finite());
    let (least, most) = (finite().fold(f64::INFINITY, f64::min), finite().fold(0.0, f64::max));
    let agrees = most > 3.0 * least;
    format!(
        "Printed: the integrated form depends on the motion, so that noisy data show large manoeuvres. {}: {BEARABLE_PERCENT:.0} % of error are reached between {least:.2} % and {most:.2} % of noise over the periods.",
        if agrees { "So does ours" } else { "Ours hardly does" }
    )
}

/// Whether the natural form depends on the motion.
fn of_natural_form(limits: &[f64]) -> String {
    let reached = |(period, limit): (&f64, &f64)| {
        if limit.is_finite() {
            format!("{limit:.3} % at {period} s")
        } else {
            format!("below {} % at {period} s", NOISE_PERCENT[0])
        }
    };
    let each = PERIODS_S.iter().zip(limits).map(reached).collect::<Vec<_>>().join(", ");
    let finite = || limits.iter().copied().filter(|x| x.is_finite());
    let (least, most) = (finite().fold(f64::INFINITY, f64::min), finite().fold(0.0, f64::max));
    let depends = most > 3.0 * least || limits.iter().any(|x| !x.is_finite());
    format!(
        "Printed: the natural form is as good as the numerical derivative, whatever the motion. {}: the noise at which its error is {BEARABLE_PERCENT:.0} % is {each}.",
        if depends { "Ours depends on the motion" } else { "So is ours" }
    )
}

/// What the integrated form's error is made of, over the seeds, at the noise up to which the dissertation calls it robust.
fn bias_or_scatter(model: &whorl_dynamics::PlatformModel) -> String {
    let truth = mass_vector(&model.mass_properties);
    let (period_s, percent) = (10.0, 10.0);
    let square = move |t: f64| {
        Vector3::new(0.0, 0.0, if t.rem_euclid(period_s) < 0.5 * period_s { 0.1 } else { -0.1 })
    };
    let exact =
        simulate_rigid_body(&model.mass_properties, (level(), Vector3::zeros()), &square, 0.1, 1001, 10);
    let found: Vec<_> = (0..4 * SEEDS)
        .filter_map(|seed| {
            let noisy = spoiled(&exact, 0.01 * percent, seed);
            solve(&rows(&noisy, Method::Torque, Form::IntegratedTrapezoid), Weighting::PseudoInverse).ok()
        })
        .map(|s| s.estimate)
        .collect();
    let count = found.len() as f64;
    let of = |i: usize| {
        let mean = found.iter().map(|e| e[i]).sum::<f64>() / count;
        let variance = found.iter().map(|e| (e[i] - mean).powi(2)).sum::<f64>() / (count - 1.0);
        [100.0 * ((mean - truth[i]) / truth[i]).abs(), 100.0 * variance.sqrt() / truth[i].abs()]
    };
    let [bias, scatter] = [0, 1].map(|k: usize| median((0..MASS_PARAMETERS).map(|i| of(i)[k])));
    let (which, why) = if bias > scatter {
        (
            "bias",
            ": noise of the rate stands in the matrix, and total least squares or the likelihood method remove it (Table 4.3)",
        )
    } else {
        ("scatter", "")
    };
    format!(
        "What remains for the integrated form at {percent} % of noise and a period of {period_s} s is mostly {which}{why}: {bias:.0} % of bias and {scatter:.0} % of scatter (medians over the nine parameters, {count} seeds)."
    )
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
