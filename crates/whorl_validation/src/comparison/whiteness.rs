//! Is anything left? Innovations of the true model are white, and follow no input.

use std::collections::BTreeMap;

use serde::Serialize;
use whorl_prediction::{Innovation, Prepared};
use whorl_recording::Component;

use crate::statistics::{
    CrossCorrelation, CumulativePeriodogram, LjungBox, NORMAL_99, autocorrelations, cross_correlation,
    cumulative_periodogram, ljung_box,
};

/// Lags of the tests, and the fewest readings of a component that is tested.
const LAGS: u32 = 25;
pub(super) const FEWEST: usize = 4 * LAGS as usize;
/// Longest lag that is looked at to say over which time innovations are correlated.
const LONGEST: usize = 1000;

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

/// Whiteness of one channel's innovations with the model alone.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct White {
    /// Channel.
    pub channel: String,
    /// The portmanteau test of Ljung and Box of their first autocorrelations.
    pub ljung_box: LjungBox,
    /// Time over which they are correlated: to the first lag whose autocorrelation is within its 99 % band \[s\]; zero for white ones.
    pub correlated_over_s: f64,
}

/// Innovations over their predicted deviations, by component, as the filter of a run makes them.
pub(super) struct Innovations<'a, 'r> {
    case: &'a Prepared<'r>,
    of: BTreeMap<Component, Vec<f64>>,
    /// Instants of the first component \[s\].
    first_s: Vec<f64>,
    first: Option<Component>,
}

impl<'a, 'r> Innovations<'a, 'r> {
    pub fn new(case: &'a Prepared<'r>) -> Self {
        Self { case, of: BTreeMap::new(), first_s: Vec::new(), first: None }
    }

    pub fn add(&mut self, innovation: &Innovation) {
        let first = *self.first.get_or_insert(innovation.component);
        if innovation.component == first {
            self.first_s.push(innovation.time_s);
        }
        self.of.entry(innovation.component).or_default().push(innovation.normalised());
    }

    /// Name, innovations and the time between them \[s\] of every component that was read often enough.
    fn often(&self) -> impl Iterator<Item = (String, &[f64], f64)> {
        let wheels: Vec<&str> = self.case.model().wheels().iter().map(|wheel| wheel.name.as_str()).collect();
        let span_s = self.case.recording().duration_s().max(1e-9);
        let enough = self.of.iter().filter(|(_, values)| values.len() > FEWEST);
        enough.map(move |(component, values)| {
            (component.name(&wheels), values.as_slice(), span_s / (values.len() - 1) as f64)
        })
    }

    /// Whether they are white.
    pub fn white(&self) -> Vec<White> {
        let white = |(channel, values, step_s): (String, &[f64], f64)| {
            let ljung_box = ljung_box(values, LAGS)?;
            let band = NORMAL_99 / (values.len() as f64).sqrt();
            let beyond = autocorrelations(values)?.take(LONGEST.min(values.len() / 4) + 1).skip(1);
            let lags = beyond.take_while(|r| r.abs() > band).count().max(1);
            let correlated_over_s = if ljung_box.is_white() { 0.0 } else { lags as f64 * step_s };
            Some(White { channel, ljung_box, correlated_over_s })
        };
        self.often().filter_map(white).collect()
    }

    /// All tests.
    pub fn tests(&self) -> Vec<Whiteness> {
        let closed_loop = self.case.recording().closed_loop;
        let inputs = self.case.commands().inputs(self.case.model(), &self.first_s);
        let test = |(channel, values, step_s): (String, &[f64], f64)| {
            let correlated = |(input, u): &(String, Vec<f64>)| {
                let correlation = cross_correlation(values, u, LAGS as usize)?;
                let (lag, value) = correlation.largest(closed_loop)?;
                let significant = correlation.is_significant(closed_loop);
                Some(InputCorrelation { input: input.clone(), significant, lag, value, correlation })
            };
            let mut inputs: Vec<InputCorrelation> = inputs.iter().filter_map(correlated).collect();
            inputs.sort_by(|a, b| b.value.abs().total_cmp(&a.value.abs()));
            let squares: f64 = values.iter().map(|x| x * x).sum();
            Whiteness {
                channel,
                rms: (squares / values.len() as f64).sqrt(),
                ljung_box: ljung_box(values, LAGS),
                periodogram: cumulative_periodogram(values, step_s.recip()),
                inputs,
            }
        };
        self.often().map(test).collect()
    }
}
