//! How fast the torque changes that the model does not have: the correlation time with which a run is likeliest.

use crate::moments::{Moments, stands};
use crate::noise::{Disturbance, Noise};
use crate::prepared::Prepared;
use crate::start::Start;

/// Factors between times that are tried: to find the order of magnitude, and where that is known. Within the second the log likelihood
/// is a parabola of the time's logarithm as far as it matters.
const COARSE: f64 = 2.5;
const FINE: f64 = 1.5;
/// Passes in which the levels with a time are found.
const PASSES: usize = 3;

/// Levels with the correlation time with which the first part of a run is likeliest, beginning with that of this noise; `is_near`: it
/// is close already.
pub(crate) fn timed(
    case: &Prepared<'_>,
    stated: &Noise,
    noise: &Noise,
    start: &Start,
    is_near: bool,
) -> Noise {
    let settings = case.settings();
    let (least_s, most_s) = settings.disturbance_correlation_range_s;
    let most_s = most_s.min(duration_s(case) / 3.0).max(least_s);
    // The likeliest levels with a correlation time: which of them the readings show, the fast or the slow part, depends on the rig.
    let with_levels = |mut noise: Noise, part: usize| {
        let mut best = (f64::NEG_INFINITY, noise.clone());
        for _ in 0..PASSES {
            let moments = Moments::of(case, &noise, &start.with_disturbance(&noise), part);
            if moments.log.is_nan() || moments.log <= best.0 {
                break;
            }
            let next = moments.improved(case, &noise, stated);
            let is_last = stands(&noise, &next, settings.level_stands);
            best = (moments.log, std::mem::replace(&mut noise, next));
            if is_last {
                break;
            }
        }
        best
    };
    // First the likely order of magnitude, by the part of the run that gives the levels too.
    let stages = [(COARSE, settings.level_first_instants), (FINE, settings.level_timed_instants)];
    let mut likeliest = noise.clone();
    for (factor, part) in stages.into_iter().skip(usize::from(is_near)) {
        let mut best = with_levels(likeliest, part);
        let mut tried = vec![(best.1.disturbance.correlation_s, best.0)];
        for factor in [factor, factor.recip()] {
            let begun = tried.len();
            while let Some(other) = moved(&best.1, factor, least_s, most_s) {
                let found = with_levels(other, part);
                tried.push((found.1.disturbance.correlation_s, found.0));
                if found.0 <= best.0 {
                    break;
                }
                best = found;
            }
            // Likelier on one side, it is not on the other.
            if tried.len() > begun + 1 {
                break;
            }
        }
        likeliest = at(&best.1, vertex_s(tried).clamp(least_s, most_s));
    }
    likeliest
}

/// From the first reading to the last.
fn duration_s(case: &Prepared<'_>) -> f64 {
    let ends = case.tracks().iter().filter_map(|track| Some((*track.time_s.first()?, *track.time_s.last()?)));
    let (first_s, last_s) =
        ends.fold((f64::INFINITY, f64::NEG_INFINITY), |of, end| (of.0.min(end.0), of.1.max(end.1)));
    (last_s - first_s).max(0.0)
}

/// With a correlation time that is so many times as long; `None` where that is out of range.
fn moved(noise: &Noise, factor: f64, least_s: f64, most_s: f64) -> Option<Noise> {
    let wanted_s = noise.disturbance.correlation_s * factor;
    (least_s..=most_s).contains(&wanted_s).then(|| at(noise, wanted_s))
}

fn at(noise: &Noise, correlation_s: f64) -> Noise {
    let disturbance = Disturbance { correlation_s, ..noise.disturbance.clone() };
    Noise { disturbance, ..noise.clone() }
}

/// Where a parabola through the likeliest of these times and its neighbours is highest, times by their logarithms \[s\].
fn vertex_s(mut tried: Vec<(f64, f64)>) -> f64 {
    tried.sort_by(|a, b| a.0.total_cmp(&b.0));
    let best = (0..tried.len()).max_by(|a, b| tried[*a].1.total_cmp(&tried[*b].1)).unwrap_or(0);
    let around = best.checked_sub(1).and_then(|first| tried.get(first..first + 3));
    let Some(&[(before_s, before), (best_s, log), (after_s, after)]) = around else { return tried[best].0 };
    let (a, b) = ((before_s / best_s).ln(), (after_s / best_s).ln());
    let (u, v) = (before - log, after - log);
    let (slopes, bend) = (u * b * b - v * a * a, u * b - v * a);
    if bend.is_finite() && bend != 0.0 { best_s * (0.5 * slopes / bend).clamp(a, b).exp() } else { best_s }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_parabola_of_the_logarithm_has_its_vertex_found() {
        let log = |time_s: f64| 7.0 - 3.0 * (time_s / 2.7).ln().powi(2);
        let found = vertex_s([1.0, 6.25, 2.5].map(|time_s| (time_s, log(time_s))).to_vec());
        assert!((found - 2.7).abs() < 1e-9, "{found}");
        assert_eq!(vertex_s(vec![(1.0, 3.0), (2.5, 1.0)]), 1.0, "at an end the end");
    }
}
