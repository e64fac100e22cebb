//! Gains that were made once, and innovations with them: any gain makes a causal predictor, and near an optimum gains hardly change.

use nalgebra::{DMatrix, DVector, Vector3};

use crate::filter::{Filter, begun_about_known_biases};
use crate::gains::Gains;
use crate::innovations::{Innovation, Mean};
use crate::lanes::{Gain, Sparse};
use crate::layout::Layout;
use crate::likelihood::Likelihood;
use crate::noise::Noise;
use crate::prepared::Prepared;
use crate::rows::Readings;
use crate::start::Start;

/// Memory for the gains of a recording at most \[bytes\]: half an hour of three sensors at 100 Hz.
const MOST_BYTES: usize = 256 << 20;

/// A step of the mean.
#[derive(Debug, Clone, Copy)]
struct Stride {
    end_ns: i64,
    /// Of the motors' columns.
    transition: usize,
    /// Turns about it are of no consequence.
    unseen_axis: Option<Vector3<f64>>,
}

/// Gains of a recording along a motion, kept for passes close by.
#[derive(Debug, Clone, Default)]
pub struct FrozenGains {
    known: DMatrix<f64>,
    strides: Vec<Stride>,
    /// Columns of F that say what the motors' disturbances move.
    transitions: Vec<Sparse>,
    /// How many readings were taken in at each instant,
    counts: Vec<u32>,
    /// and of all of them one after the other, gains and couplings, of which seven digits are enough, and variances.
    gains: Vec<f32>,
    couplings: Vec<f32>,
    variances: Vec<f64>,
}

impl FrozenGains {
    /// Of a filter with these levels of noise along the motion from a start; `None` where the motion is lost, or where they would fill more
    /// than 256 MB.
    #[must_use]
    pub fn along(case: &Prepared<'_>, noise: &Noise, start: &Start) -> Option<Self> {
        let mut filter = Filter::new(case, noise, start).about_known_biases(start);
        filter.recorder = Some(Recorder::new(filter.begun().0.clone()));
        while filter.step(&mut |_| {}) {}
        let is_lost = filter.is_lost();
        filter.recorder.take().filter(|_| !is_lost).and_then(Recorder::end)
    }

    /// Covariance with which the filter began.
    pub fn known(&self) -> &DMatrix<f64> {
        &self.known
    }
}

/// Keeps the gains of a filter on its way.
pub(crate) struct Recorder {
    kept: FrozenGains,
    is_full: bool,
}

impl Recorder {
    /// Of a filter that begins with this covariance.
    pub fn new(known: DMatrix<f64>) -> Self {
        Self { kept: FrozenGains { known, ..FrozenGains::default() }, is_full: false }
    }

    /// A step has ended.
    pub fn step(&mut self, end_ns: i64, gains: &Gains<'_>, layout: Layout) {
        let motors = layout.motors();
        if !motors.is_empty() && gains.has_new_step || self.kept.transitions.is_empty() {
            let mut columns = Sparse::default();
            for row in gains.step.transition.rows().take(layout.plant.size()) {
                row.iter().filter(|(k, _)| motors.contains(k)).for_each(|(k, x)| columns.set(*k, *x));
                columns.end_row();
            }
            self.kept.transitions.push(columns);
        }
        let transition = self.kept.transitions.len() - 1;
        self.kept.strides.push(Stride { end_ns, transition, unseen_axis: gains.unseen_axis });
    }

    /// Readings of an instant.
    pub fn take_in(&mut self, gain: &Gain) {
        self.is_full |= self.kept.gains.len() * 4 > MOST_BYTES;
        if !self.is_full {
            self.kept.counts.push(gain.count() as u32);
            gain.append_to(&mut self.kept.gains, &mut self.kept.couplings, &mut self.kept.variances);
        }
    }

    /// What was kept; `None`: it would have been too much.
    pub fn end(self) -> Option<FrozenGains> {
        (!self.is_full).then_some(self.kept)
    }
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
    instant: usize,
    at: [usize; 3],
    /// Readings are others than those of which gains were kept.
    pub is_other: bool,
}

impl<'a> FrozenPass<'a> {
    /// From a start, about which what was known of the biases before the run stays about none.
    pub fn new(case: &'a Prepared<'a>, noise: &'a Noise, start: &Start, kept: &'a FrozenGains) -> Self {
        let (begun, log_known) = begun_about_known_biases(case, start, &kept.known);
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
            mean.advance(stride.end_ns);
            mean.fade(&self.kept.transitions[stride.transition], stride.unseen_axis.as_ref(), step_s);
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
