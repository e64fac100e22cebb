//! The radio link between hosts: delay, jitter, loss, cuts.

use std::time::Duration;

use rand_pcg::Pcg64Mcg;
use rand_pcg::rand_core::{Rng, SeedableRng};
use whorl_msgs::topics::PlatformId;
use whorl_node::Timestamp;
use whorl_params::Span;

/// Where a node runs. Messages between nodes of one host take the local delay; all others cross
/// the radio link.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum Host {
    /// On a platform's own computer.
    Platform(PlatformId),
    /// On the ground computer: coordinator.
    Ground,
}

/// A time in which nothing passes.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Cut {
    /// When, from the start of the run.
    pub span: Span,
    /// The platform whose computer is cut off from all others; `None`: every link is cut.
    pub platform: Option<PlatformId>,
}

/// How the link behaves.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct LinkParameters {
    /// Delay of every message \[s\], >= 0.
    pub delay_s: f64,
    /// Further delay, uniformly distributed from 0 to this \[s\], >= 0. Messages may overtake.
    pub jitter_s: f64,
    /// Probability that a message is lost, 0..=1.
    pub loss: f64,
    /// Times in which nothing passes.
    pub cuts: Vec<Cut>,
}

/// The link's state.
#[derive(Debug, Clone)]
pub(crate) struct Link {
    parameters: LinkParameters,
    start: Timestamp,
    rng: Pcg64Mcg,
}

impl Link {
    pub(crate) fn new(parameters: LinkParameters, start: Timestamp, seed: u64) -> Self {
        Self { parameters, start, rng: Pcg64Mcg::seed_from_u64(seed) }
    }

    /// Delay of a message sent now between these computers; `None` when it is lost.
    pub(crate) fn delay(&mut self, now: Timestamp, ends: [Host; 2]) -> Option<Duration> {
        // Both numbers are drawn for every message, so that a parameter that is zero does not
        // change the sequence of the other.
        let (loss, jitter) = (self.uniform(), self.uniform());
        let elapsed_s = now.seconds_since(self.start);
        let cut = self.parameters.cuts.iter().any(|c| {
            c.span.contains(elapsed_s)
                && c.platform.is_none_or(|platform| ends.contains(&Host::Platform(platform)))
        });
        let delay_s = self.parameters.delay_s + jitter * self.parameters.jitter_s;
        (!cut && loss >= self.parameters.loss).then(|| Duration::from_nanos((delay_s * 1e9) as u64))
    }

    /// Uniform in [0, 1), 53 bits.
    fn uniform(&mut self) -> f64 {
        (self.rng.next_u64() >> 11) as f64 * (0.5f64).powi(53)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const ENDS: [Host; 2] = [Host::Platform(PlatformId(0)), Host::Ground];

    #[test]
    fn one_platform_can_be_cut_off_alone() {
        let cuts = vec![Cut { span: Span { start_s: 0.0, length_s: 1.0 }, platform: Some(PlatformId(1)) }];
        let mut link = Link::new(LinkParameters { cuts, ..Default::default() }, Timestamp(0), 7);
        let mut passes = |from, to| link.delay(Timestamp(0), [from, to]).is_some();
        let [one, two] = [0, 1].map(|id| Host::Platform(PlatformId(id)));
        assert!(passes(one, Host::Ground) && passes(Host::Ground, one));
        assert!(!passes(two, Host::Ground) && !passes(one, two));
    }

    #[test]
    fn loses_the_stated_share_and_delays_within_the_stated_range() {
        let parameters = LinkParameters { delay_s: 0.02, jitter_s: 0.01, loss: 0.2, cuts: vec![] };
        let mut link = Link::new(parameters, Timestamp(0), 7);
        let delays: Vec<f64> =
            (0..100_000).filter_map(|_| link.delay(Timestamp(0), ENDS)).map(|d| d.as_secs_f64()).collect();
        let share = delays.len() as f64 / 1e5;
        // Five standard deviations of a binomial count.
        assert!((share - 0.8).abs() < 5.0 * (0.2f64 * 0.8 / 1e5).sqrt(), "{share}");
        assert!(delays.iter().all(|d| (0.02..=0.03).contains(d)));
        let mean = delays.iter().sum::<f64>() / delays.len() as f64;
        assert!((mean - 0.025).abs() < 5.0 * 0.01 / (12.0f64 * 8e4).sqrt(), "{mean}");
    }

    #[test]
    fn nothing_passes_in_a_cut() {
        let cuts = vec![Cut { span: Span { start_s: 1.0, length_s: 2.0 }, platform: None }];
        let mut link =
            Link::new(LinkParameters { cuts, ..Default::default() }, Timestamp::from_seconds(10.0), 7);
        let mut passes = |t: f64| link.delay(Timestamp::from_seconds(10.0 + t), ENDS).is_some();
        assert_eq!([0.999, 1.0, 2.999, 3.0].map(&mut passes), [true, false, false, true]);
    }
}
