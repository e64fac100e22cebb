//! Stretches of a recording of which something is to be said.

use whorl_math::noise::typical_step_s;

use crate::api::Mark;

/// Usual intervals between readings beyond which one is a gap: as `Recording::gaps`.
const GAP_STEPS: f64 = 8.0;
/// Readings in a row that are the same to the last digit in all components, of a sensor with noise: it did not measure.
const HELD: usize = 10;
/// A stretch rests when nothing scatters by more than so many times its noise \[1\] ...
const REST_TIMES: f64 = 1.5;
/// ... over so long \[s\].
const REST_S: f64 = 1.0;
/// Marks of a kind that are listed.
const MOST_MARKS: usize = 200;

fn mark(kind: &str, group: &str, from_s: f64, to_s: f64) -> Mark {
    Mark { kind: kind.to_owned(), group: group.to_owned(), from_s, to_s }
}

/// Times between readings that are much longer than usual.
pub fn gaps(time_s: &[f64], group: &str) -> Vec<Mark> {
    if time_s.len() < 3 {
        return Vec::new();
    }
    let usual_s = typical_step_s(time_s);
    let wide = time_s.windows(2).filter_map(|two| match two {
        [a, b] if b - a > GAP_STEPS * usual_s => Some(mark("gap", group, *a, *b)),
        _ => None,
    });
    wide.take(MOST_MARKS).collect()
}

/// Stretches of indices over which something holds, at least so many of them.
fn stretches(count: usize, least: usize, holds: impl Fn(usize) -> bool) -> Vec<[usize; 2]> {
    let (mut found, mut since) = (Vec::new(), None);
    for k in 0..=count {
        match (k < count && holds(k), since) {
            (true, None) => since = Some(k),
            (false, Some(start)) => {
                if k - start >= least {
                    found.push([start, k - 1]);
                }
                since = None;
            }
            _ => {}
        }
    }
    found.truncate(MOST_MARKS);
    found
}

/// Readings that repeat to the last digit, of sensors that have noise.
pub fn held(time_s: &[f64], values: &[Vec<f64>], noise: &[Option<f64>], group: &str) -> Vec<Mark> {
    if values.is_empty() || !noise.iter().any(Option::is_some) {
        return Vec::new();
    }
    let repeats = |k: usize| k > 0 && values.iter().all(|v| v.get(k) == v.get(k - 1));
    let at = |k: usize| time_s.get(k).copied().unwrap_or(0.0);
    let found = stretches(time_s.len(), HELD, repeats);
    found.into_iter().map(|[from, to]| mark("held", group, at(from.saturating_sub(1)), at(to))).collect()
}

/// Readings that fits leave out, of which those at the times `used` are left.
pub fn left_out(time_s: &[f64], used: &[f64], group: &str) -> Vec<Mark> {
    let mut used = used.iter().peekable();
    let is_out: Vec<bool> = time_s.iter().map(|t| used.next_if_eq(&t).is_none()).collect();
    let at = |k: usize| time_s.get(k).copied().unwrap_or(0.0);
    let found = stretches(time_s.len(), 1, |k| is_out.get(k) == Some(&true));
    found.into_iter().map(|[from, to]| mark("left_out", group, at(from), at(to))).collect()
}

/// Stretches in which the gyro shows nothing but its noise.
pub fn rests(time_s: &[f64], values: &[Vec<f64>], noise: &[Option<f64>]) -> Vec<Mark> {
    let step_s = typical_step_s(time_s);
    let length = (REST_S / step_s).round().max(4.0) as usize;
    let windows = time_s.len() / length;
    let is_quiet = |w: usize| {
        values.iter().zip(noise).all(|(values, noise)| {
            let part = values.get(w * length..(w + 1) * length).unwrap_or(&[]);
            let mean = part.iter().sum::<f64>() / part.len() as f64;
            let scatter = (part.iter().map(|v| (v - mean).powi(2)).sum::<f64>() / part.len() as f64).sqrt();
            scatter <= REST_TIMES * noise.unwrap_or(0.0)
        })
    };
    let quiet: Vec<bool> = (0..windows).map(is_quiet).collect();
    let at = |k: usize| time_s.get(k.min(time_s.len().saturating_sub(1))).copied().unwrap_or(0.0);
    let found = stretches(windows, 1, |w| quiet.get(w) == Some(&true));
    found.into_iter().map(|[from, to]| mark("rest", "", at(from * length), at((to + 1) * length))).collect()
}

#[cfg(test)]
mod tests {
    use whorl_math::noise::from_second_differences;

    use super::*;

    #[test]
    fn stretches_are_told_by_what_is_wrong_with_them() {
        // 100 Hz of noise (a regular sequence without pattern), a gap, a sensor that stands still, readings that are left out.
        let noise = |k: usize| ((k * 7_919) % 101) as f64 / 101.0 - 0.5;
        let time_s: Vec<f64> =
            (0..1_000).map(|k| k as f64 * 0.01 + if k >= 500 { 2.0 } else { 0.0 }).collect();
        let mut value: Vec<f64> = (0..1_000).map(noise).collect();
        value[700..720].fill(0.123);
        let found = gaps(&time_s, "gyro");
        assert_eq!(found.len(), 1);
        assert!((found[0].from_s - 4.99).abs() < 1e-9 && (found[0].to_s - 7.0).abs() < 1e-9);
        let (values, deviation) = ([value.clone()], [from_second_differences(&value)]);
        let spans: Vec<(f64, f64)> =
            held(&time_s, &values, &deviation, "gyro").iter().map(|m| (m.from_s, m.to_s)).collect();
        assert_eq!(spans, [(time_s[700], time_s[719])]);
        let used: Vec<f64> =
            time_s.iter().enumerate().filter(|(k, _)| !(800..810).contains(k)).map(|(_, t)| *t).collect();
        let found = left_out(&time_s, &used, "gyro");
        assert_eq!((found.len(), found[0].from_s, found[0].to_s), (1, time_s[800], time_s[809]));
        // It rests, but for the second in which it does not.
        let mut moving: Vec<f64> = (0..1_000).map(noise).collect();
        moving.iter_mut().skip(300).take(100).enumerate().for_each(|(k, v)| *v += k as f64);
        let regular: Vec<f64> = (0..1_000).map(|k| f64::from(k) * 0.01).collect();
        let found = rests(&regular, &[moving.clone()], &[from_second_differences(&moving)]);
        let spans: Vec<(f64, f64)> = found.iter().map(|m| (m.from_s, m.to_s)).collect();
        assert_eq!(spans, [(0.0, 3.0), (4.0, 9.99)]);
    }
}
