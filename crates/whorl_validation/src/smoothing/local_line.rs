//! A value from the straight line through its neighbourhood.

/// Value at `time_s` of the least-squares line through the samples within `half_width_s`; the mean where
/// all of them are at one time, `None` where there are none.
pub(crate) fn local_line<const N: usize>(
    times_s: &[f64],
    value: impl Fn(usize) -> [f64; N],
    time_s: f64,
    half_width_s: f64,
) -> Option<[f64; N]> {
    let first = times_s.partition_point(|t| *t < time_s - half_width_s);
    let end = times_s.partition_point(|t| *t <= time_s + half_width_s);
    let count = end.checked_sub(first).filter(|n| *n > 0)? as f64;
    let (mut s1, mut s2) = (0.0, 0.0);
    let (mut y0, mut y1) = ([0.0; N], [0.0; N]);
    for k in first..end {
        let x = times_s.get(k)? - time_s;
        s1 += x;
        s2 += x * x;
        for ((sum, moment), y) in y0.iter_mut().zip(&mut y1).zip(value(k)) {
            *sum += y;
            *moment += x * y;
        }
    }
    let determinant = count * s2 - s1 * s1;
    let mut result = [0.0; N];
    for ((out, sum), moment) in result.iter_mut().zip(y0).zip(y1) {
        *out = if determinant > 1e-9 * count * s2.max(1e-12) {
            (s2 * sum - s1 * moment) / determinant
        } else {
            sum / count
        };
    }
    Some(result)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_line_is_reproduced_also_at_the_ends() {
        let times: Vec<f64> = (0..100).map(|k| 0.01 * f64::from(k)).collect();
        for at in [0.0, 0.3, 0.99] {
            let [y, z] = local_line(&times, |k| [2.0 - 3.0 * times[k], 1.0], at, 0.1).unwrap();
            assert!((y - (2.0 - 3.0 * at)).abs() < 1e-9 && (z - 1.0).abs() < 1e-9, "{at}");
        }
        assert_eq!(local_line(&times, |_| [1.0], 5.0, 0.1), None);
    }
}
