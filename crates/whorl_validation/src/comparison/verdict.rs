//! The model against the whole run: how large its errors are, and whether anything is left. Innovations of the true model are white.

use std::collections::BTreeMap;

use serde::Serialize;
use whorl_dynamics::PlatformModel;
use whorl_math::statistics::{autocorrelations, chi_squared_quantile, ljung_box, normal_quantile};
use whorl_prediction::{Disturbance, Innovation, Likelihood, Prepared};
use whorl_recording::Component;

use super::Comparison;

/// Lags of the test, and the fewest readings of a component that is tested.
const LAGS: u32 = 25;
pub(super) const FEWEST: usize = 4 * LAGS as usize;
/// Longest lag that is looked at to say over which time innovations are correlated.
const LONGEST: usize = 1000;

/// Errors of all channels together, over the deviations that the model predicts for them.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct PredictionError {
    /// Length of each prediction \[s\].
    pub horizon_s: f64,
    /// Sum of the squares of all errors on the way, each over its predicted deviation.
    pub squares: f64,
    /// How many numbers were predicted.
    pub numbers: usize,
}

/// Root mean square of all errors of these runs, each over the deviation that the model predicts; 1 = noise alone. `None` if no run is long enough.
pub fn prediction_error<'a>(runs: impl IntoIterator<Item = &'a Comparison>) -> Option<f64> {
    let all = runs.into_iter().filter_map(|run| run.prediction);
    let (squares, numbers) = all.fold((0.0, 0), |sum, of| (sum.0 + of.squares, sum.1 + of.numbers));
    (numbers > 0).then(|| (squares / numbers as f64).sqrt())
}

/// The test against noise alone: the run with the model alone, each reading against its prediction from everything before it.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Absolute {
    /// Sum of squares of the innovations, each over its predicted deviation, over their degrees of freedom; 1 = noise.
    pub chi_squared_per_degree: f64,
    /// 99 % band of this ratio for noise alone.
    pub band_99: (f64, f64),
    /// Degrees of freedom: numbers read less what the start takes of them.
    pub degrees: usize,
}

impl Absolute {
    pub(super) fn of(alone: &Likelihood, determined: f64) -> Self {
        let degrees = (alone.numbers as f64 - determined).max(1.0);
        let count = u32::try_from(degrees as u64).unwrap_or(u32::MAX);
        let band = |p: f64| chi_squared_quantile(p, count) / degrees;
        let squares = if alone.lost { f64::INFINITY } else { alone.chi_squared };
        let chi_squared_per_degree = squares / degrees;
        Self { chi_squared_per_degree, band_99: (band(0.005), band(0.995)), degrees: degrees as usize }
    }
}

/// What pushes the platform beside its model ([`Disturbance`]), as large as makes the run likeliest; zero where that is hardly likelier.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Unexplained {
    /// Standard deviation about each body axis [N m].
    pub torque_b_n_m: [f64; 3],
    /// Of each wheel's motor about its axis, with its wheel's name [N m].
    pub motors_n_m: Vec<(String, f64)>,
}

impl Unexplained {
    pub(super) fn of(model: &PlatformModel, levels: &Disturbance) -> Self {
        let wheels = model.wheels().iter().map(|wheel| wheel.name.clone());
        let motors_n_m = wheels.zip(levels.motors_n_m.iter().copied()).collect();
        Self { torque_b_n_m: levels.body_stddev_b_n_m(), motors_n_m }
    }

    pub(super) fn all_n_m(&self) -> impl Iterator<Item = f64> {
        self.torque_b_n_m.iter().chain(self.motors_n_m.iter().map(|(_, x)| x)).copied()
    }

    /// Whether there is any.
    pub fn is_some(&self) -> bool {
        self.all_n_m().any(|x| x > 0.0)
    }
}

/// One channel's innovations with the model alone.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Whiteness {
    /// Channel.
    pub channel: String,
    /// RMS of the innovations over their predicted deviations; 1 = noise.
    pub rms: f64,
    /// The portmanteau test of Ljung and Box of their first autocorrelations.
    pub ljung_box: LjungBox,
    /// Time over which they are correlated: to the first lag whose autocorrelation is within its 99 % band \[s\]; zero for white ones.
    pub correlated_over_s: f64,
}

/// Result of the test that the first autocorrelations are zero ([`ljung_box`]).
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct LjungBox {
    /// Lags tested.
    pub lags: u32,
    /// Q.
    pub statistic: f64,
    /// 99 % quantile of Q for white residuals.
    pub limit_99: f64,
    /// Probability of a Q this large for white residuals.
    pub p_value: f64,
}

impl LjungBox {
    /// Whether the residuals pass as white.
    pub fn is_white(&self) -> bool {
        self.statistic <= self.limit_99
    }
}

/// Innovations over their predicted deviations, by component, as the filter of a run makes them.
#[derive(Default)]
pub(super) struct Innovations(BTreeMap<Component, Vec<f64>>);

impl Innovations {
    pub fn add(&mut self, innovation: &Innovation) {
        self.0.entry(innovation.component).or_default().push(innovation.normalised());
    }

    /// The tests of every component that was read often enough.
    pub fn tests(&self, case: &Prepared<'_>) -> Vec<Whiteness> {
        let wheels: Vec<&str> = case.model().wheels().iter().map(|wheel| wheel.name.as_str()).collect();
        let duration_s = case.recording().duration_s().max(1e-9);
        let test = |(component, values): (&Component, &Vec<f64>)| {
            let count = values.len() as f64;
            let (statistic, p_value) = ljung_box(values, LAGS)?;
            let limit_99 = chi_squared_quantile(0.99, LAGS);
            let ljung_box = LjungBox { lags: LAGS, statistic, limit_99, p_value };
            let band = normal_quantile(0.995) / count.sqrt();
            let r = autocorrelations(values)?.take(LONGEST.min(values.len() / 4) + 1).skip(1);
            let lags = r.take_while(|r| r.abs() > band).count().max(1);
            let correlated_over_s = lags as f64 * duration_s / (count - 1.0);
            Some(Whiteness {
                channel: component.name(&wheels),
                rms: (values.iter().map(|x| x * x).sum::<f64>() / count).sqrt(),
                ljung_box,
                correlated_over_s: if ljung_box.is_white() { 0.0 } else { correlated_over_s },
            })
        };
        self.0.iter().filter(|(_, values)| values.len() > FEWEST).filter_map(test).collect()
    }
}
