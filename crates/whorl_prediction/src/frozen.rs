//! Innovations with gains that were made once: any gain makes a causal predictor, and near an optimum gains hardly change.

use nalgebra::DVector;

use crate::filter::{Filter, begun_about_known_biases};
use crate::innovations::{Innovation, Mean};
use crate::kept_gains::{FrozenGains, Recorder};
use crate::lanes::Gain;
use crate::likelihood::Likelihood;
use crate::noise::Noise;
use crate::prepared::Prepared;
use crate::rows::Readings;
use crate::start::Start;

/// Gains of a filter with these levels of noise along the motion from a start; `None` where the motion is lost, or where they would fill
/// more than 256 MB.
#[must_use]
pub fn frozen_gains(case: &Prepared<'_>, noise: &Noise, start: &Start) -> Option<FrozenGains> {
    let mut filter = Filter::new(case, noise, start).about_known_biases(start);
    filter.recorder = Some(Recorder::new(filter.begun().0.clone()));
    while filter.step(&mut |_| {}) {}
    let is_lost = filter.is_lost();
    filter.recorder.take().filter(|_| !is_lost).and_then(Recorder::end)
}

/// Innovations of a recording with gains that were made close by; `None` where other readings are due than there.
pub fn innovations(
    case: &Prepared<'_>,
    noise: &Noise,
    start: &Start,
    gains: &FrozenGains,
    told: &mut dyn FnMut(&Innovation),
) -> Option<Likelihood> {
    let mut pass = FrozenPass::new(case, noise, start, gains);
    let mut likelihood = Likelihood::begun(pass.log_known);
    while pass.step(&mut |innovation| {
        likelihood.add(innovation);
        told(innovation);
    }) {}
    likelihood.lost = pass.mean.lost;
    (!pass.is_other).then_some(likelihood)
}

/// A pass of the mean alone with gains that were kept.
pub(crate) struct FrozenPass<'a> {
    pub mean: Mean<'a>,
    kept: &'a FrozenGains,
    pub log_known: f64,
    pub begun: DVector<f64>,
    gain: Gain,
    readings: Readings,
    /// Next of each list.
    stride: usize,
    /// What motors moved over the step before, and its length \[s\].
    before: Option<(usize, f64)>,
    instant: usize,
    at: [usize; 3],
    /// Readings are others than those of which gains were kept.
    pub is_other: bool,
}

impl<'a> FrozenPass<'a> {
    /// From a start, about which what was known of the biases before the run stays about none.
    pub fn new(case: &'a Prepared<'a>, noise: &'a Noise, start: &Start, kept: &'a FrozenGains) -> Self {
        let (begun, log_known) = begun_about_known_biases(case, start, kept.known());
        let mut mean = Mean::new(case, noise, start);
        mean.change(&begun);
        Self {
            mean,
            kept,
            log_known,
            begun,
            gain: Gain::default(),
            readings: Readings::default(),
            stride: 0,
            before: None,
            instant: 0,
            at: [0; 3],
            is_other: false,
        }
    }

    /// As [`crate::filter::Filter::step`].
    pub fn step(&mut self, told: &mut dyn FnMut(&Innovation)) -> bool {
        let mean = &mut self.mean;
        let Some(instant_ns) = mean.next_ns() else { return false };
        mean.set_out(instant_ns);
        while mean.plant.now_ns() < instant_ns && !mean.lost {
            let stride = self.kept.strides.get(self.stride);
            let Some(stride) = stride.filter(|stride| stride.end_ns <= instant_ns) else {
                self.is_other = true;
                return false;
            };
            let step_s = (stride.end_ns - mean.plant.now_ns()) as f64 * 1e-9;
            let transitions = &self.kept.transitions;
            mean.advance(stride.end_ns, self.before.map(|(before, step_s)| (&transitions[before], step_s)));
            mean.follow_motors(&transitions[stride.transition], stride.unseen_axis.as_ref());
            self.before = Some((stride.transition, step_s));
            self.stride += 1;
        }
        mean.find_due(instant_ns);
        if mean.lost {
            return false;
        }
        mean.read(None, &mut self.readings);
        let count = self.kept.counts.get(self.instant).copied().unwrap_or(0) as usize;
        self.instant += 1;
        if self.readings.rows.len() != count {
            self.is_other = true;
            return false;
        }
        let size = mean.layout.size();
        let kept = self.kept;
        self.gain.take_from(size, count, [&kept.gains, &kept.couplings], &kept.variances, &mut self.at);
        mean.take_in(&self.readings, &self.gain, told);
        !mean.lost
    }
}
