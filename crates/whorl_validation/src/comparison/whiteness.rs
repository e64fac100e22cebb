//! Is anything left? Innovations of the true model are white.

use std::collections::BTreeMap;

use serde::Serialize;
use whorl_prediction::{Innovation, Prepared};
use whorl_recording::Component;

use crate::statistics::{LjungBox, NORMAL_99, autocorrelations, ljung_box};

/// Lags of the test, and the fewest readings of a component that is tested.
const LAGS: u32 = 25;
pub(super) const FEWEST: usize = 4 * LAGS as usize;
/// Longest lag that is looked at to say over which time innovations are correlated.
const LONGEST: usize = 1000;

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
            let ljung_box = ljung_box(values, LAGS)?;
            let beyond = autocorrelations(values)?.take(LONGEST.min(values.len() / 4) + 1).skip(1);
            let lags = beyond.take_while(|r| r.abs() > NORMAL_99 / count.sqrt()).count().max(1);
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
