//! Is anything left? Innovations of the true model are white, and follow no input.

use std::collections::BTreeMap;

use serde::Serialize;
use whorl_prediction::{Innovation, Prepared};
use whorl_recording::Component;

use super::white::{LAGS, White};
use crate::statistics::{
    CrossCorrelation, CumulativePeriodogram, LjungBox, cross_correlation, cumulative_periodogram, ljung_box,
};

/// Tests of one channel's innovations.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Whiteness {
    /// Channel.
    pub channel: String,
    /// RMS of the innovations over their predicted deviations; 1 = noise.
    pub rms: f64,
    /// Test of the first autocorrelations.
    pub ljung_box: Option<LjungBox>,
    /// Cumulative power over frequency.
    pub periodogram: Option<CumulativePeriodogram>,
    /// Correlations with inputs, the largest first.
    pub inputs: Vec<InputCorrelation>,
}

/// Correlation of innovations with one input.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct InputCorrelation {
    /// The input.
    pub input: String,
    /// Whether the correlation is significant at 99 % over all lags. With a controller
    /// running only lags >= 0 count.
    pub significant: bool,
    /// Lag of the largest correlation, samples.
    pub lag: i64,
    /// The largest correlation.
    pub value: f64,
    /// The correlation at all lags.
    pub correlation: CrossCorrelation,
}

/// Innovations over their predicted deviations, by component.
pub(super) struct Innovations {
    of: BTreeMap<Component, Vec<f64>>,
    /// Instants of the first component \[s\].
    first_s: Vec<f64>,
    first: Option<Component>,
    span_s: f64,
}

impl Innovations {
    pub fn new(case: &Prepared<'_>) -> Self {
        Self { of: BTreeMap::new(), first_s: Vec::new(), first: None, span_s: case.recording().duration_s() }
    }

    pub fn add(&mut self, innovation: &Innovation) {
        let first = *self.first.get_or_insert(innovation.component);
        if innovation.component == first {
            self.first_s.push(innovation.time_s);
        }
        self.of.entry(innovation.component).or_default().push(innovation.normalised());
    }

    /// Whether they are white, every component that was read often enough.
    pub fn white(&self, case: &Prepared<'_>) -> Vec<White> {
        let wheels: Vec<&str> = case.model().wheels().iter().map(|wheel| wheel.name.as_str()).collect();
        let enough = self.of.iter().filter(|(_, values)| values.len() > 4 * LAGS);
        let white = |(component, values): (&Component, &Vec<f64>)| {
            let step_s = self.span_s / values.len().saturating_sub(1).max(1) as f64;
            White::of(component.name(&wheels), values, step_s)
        };
        enough.filter_map(white).collect()
    }

    /// Tests every component that was read often enough.
    pub fn tests(&self, case: &Prepared<'_>) -> Vec<Whiteness> {
        let (closed_loop, model) = (case.recording().closed_loop, case.model());
        let wheels: Vec<&str> = model.wheels().iter().map(|wheel| wheel.name.as_str()).collect();
        let inputs = case.commands().inputs(model, &self.first_s);
        let lags = u32::try_from(LAGS).unwrap_or(u32::MAX);
        let enough = self.of.iter().filter(|(_, values)| values.len() > 4 * LAGS);
        let test = |(component, values): (&Component, &Vec<f64>)| {
            let rate_hz = values.len().saturating_sub(1) as f64 / self.span_s.max(1e-9);
            let correlated = |(input, u): &(String, Vec<f64>)| {
                let correlation = cross_correlation(values, u, LAGS)?;
                let (lag, value) = correlation.largest(closed_loop)?;
                let significant = correlation.is_significant(closed_loop);
                Some(InputCorrelation { input: input.clone(), significant, lag, value, correlation })
            };
            let mut inputs: Vec<InputCorrelation> = inputs.iter().filter_map(correlated).collect();
            inputs.sort_by(|a, b| b.value.abs().total_cmp(&a.value.abs()));
            let squares: f64 = values.iter().map(|x| x * x).sum();
            Whiteness {
                channel: component.name(&wheels),
                rms: (squares / values.len() as f64).sqrt(),
                ljung_box: ljung_box(values, lags),
                periodogram: cumulative_periodogram(values, rate_hz),
                inputs,
            }
        };
        enough.map(test).collect()
    }
}
