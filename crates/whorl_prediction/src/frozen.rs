//! Innovations with gains that were made once: any gain makes a causal predictor, and near an optimum gains hardly change.

use nalgebra::DVector;
use whorl_math::lanes::{Gain, Sparse};

use crate::filter::{Filter, Likelihood, begun_about_known_biases};
use crate::innovations::{Innovation, Mean};
use crate::noise::Noise;
use crate::prepared::Prepared;
use crate::rows::Readings;
use crate::start::Start;
use crate::trail::Trail;

/// Gains of a filter with these levels of noise along the motion from a start; `None` where the motion is lost, or where they would fill
/// more than 384 MB.
#[must_use]
pub fn frozen_gains(case: &Prepared<'_>, noise: &Noise, start: &Start) -> Option<Trail> {
    let mut filter = Filter::new(case, noise, start).about_known_biases(start).keeping();
    filter.run(usize::MAX, &mut |_| {});
    filter.kept()
}

/// Innovations of a recording with gains that were made close by; `None` where other readings are due than there.
pub fn innovations(
    case: &Prepared<'_>,
    noise: &Noise,
    start: &Start,
    gains: &Trail,
    told: &mut dyn FnMut(&Innovation),
) -> Option<Likelihood> {
    Some(innovations_from(case, noise, start, gains, told)?.0)
}

/// The same, and how far from the start that was given it began: what was known of the biases before the run stays about none.
pub(crate) fn innovations_from(
    case: &Prepared<'_>,
    noise: &Noise,
    start: &Start,
    kept: &Trail,
    told: &mut dyn FnMut(&Innovation),
) -> Option<(Likelihood, DVector<f64>)> {
    let (begun, log_known) = begun_about_known_biases(case, start, &kept.known);
    let mut mean = Mean::new(case, noise, start);
    mean.change(&begun);
    let mut likelihood = Likelihood::begun(log_known);
    let (mut gain, mut at, mut readings) = (Gain::default(), [0; 3], Readings::default());
    // What the last step did to errors, and its length: by it motors move the plant.
    let (mut now, mut before, mut before_s) = (Sparse::default(), Sparse::default(), 0.0);
    let has_motors = !mean.layout.motors().is_empty();
    let mut instants = 0..kept.instants.len();
    while let Some(instant_ns) = mean.next_ns().filter(|_| !mean.lost) {
        let instant = instants.next()?;
        let (first, taken) = kept.before(instant);
        mean.set_out(instant_ns);
        for stride in &kept.strides[first..kept.instants[instant].strides] {
            if has_motors {
                kept.transitions.rows_to(kept.transition(*stride), &mut now);
            }
            mean.advance(stride.end_ns, (before_s > 0.0).then_some((&before, before_s)));
            mean.move_by_motors(&now, 1.0, stride.unseen_axis.as_ref());
            std::mem::swap(&mut now, &mut before);
            before_s = stride.step_s;
        }
        if mean.lost {
            break;
        }
        if mean.plant.now_ns() != instant_ns {
            return None;
        }
        mean.find_due(instant_ns);
        mean.read(None, &mut readings);
        let count = kept.instants[instant].readings - taken;
        if readings.rows.len() != count {
            return None;
        }
        let lists = [&kept.gains[..], &kept.couplings];
        gain.take_from(mean.layout.size(), count, lists, &kept.variances, &mut at);
        mean.take_in(&readings, &gain, &mut |innovation| {
            likelihood.add(innovation);
            told(innovation);
        });
    }
    likelihood.end(mean.lost);
    Some((likelihood, begun))
}
