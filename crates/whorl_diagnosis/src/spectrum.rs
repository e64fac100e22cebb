//! Lines in the spectrum of what the base model leaves.

use nalgebra::Vector3;

use crate::candidates::Lines;
use crate::search::Search;

/// Lines looked at, strongest first.
const MOST_LINES: usize = 2;

/// Power of a line over the mean power at which chance is ruled out (of some 10^4 frequencies, 1e-4).
const LINE: f64 = 18.0;

/// Finds lines in the whitened residual of the gyro: seen in the room's axes they are torques that do not
/// turn with the body, or vibration.
pub(crate) fn lines(search: &Search<'_>) -> Lines {
    let estimate = search.base.estimate.spread(search.layout.columns.len());
    let mut found: Vec<(f64, f64)> = Vec::new();
    for ((run, motion), whitened) in
        search.problem.runs.iter().zip(&search.problem.motions).zip(&search.data.whitened)
    {
        if run.clamped || run.nodes() < 64 {
            continue;
        }
        let residual = whitened.residual(&estimate);
        let mut series = vec![Vector3::zeros(); run.nodes()];
        for ((e, channel), node) in residual.iter().zip(&whitened.channel).zip(&whitened.node) {
            if *channel < 3
                && let Some(slot) = series.get_mut(*node as usize)
            {
                slot[usize::from(*channel)] = e.clamp(-6.0, 6.0);
            }
        }
        let turned: Vec<Vector3<f64>> =
            series.iter().zip(&motion.q).map(|(e, q)| q.transform_vector(e)).collect();
        let length_s = run.time(run.nodes() - 1) - run.time(0);
        let step_s = length_s / (run.nodes() - 1) as f64;
        let power = power_spectrum(&turned);
        // The residual is white where nothing is missing; a line stands out from its neighbours.
        for m in 2..power.len().saturating_sub(2) {
            let here = power[m];
            if here < power[m - 1] || here < power[m + 1] {
                continue;
            }
            let (from, to) = (m.saturating_sub(30).max(1), (m + 31).min(power.len()));
            let mut around: Vec<f64> = power[from..to].to_vec();
            let middle = around.len() / 2;
            let median = *around.select_nth_unstable_by(middle, f64::total_cmp).1;
            if here > LINE / 6.0 * median.max(1e-12) * 3.0 {
                // Between two bins the line is where their amplitudes balance.
                let (left, right) = (power[m - 1].sqrt(), power[m + 1].sqrt());
                let shift =
                    if right > left { right / (right + here.sqrt()) } else { -left / (left + here.sqrt()) };
                let hz = (m as f64 + shift) / (power.len() as f64 * 2.0 * step_s);
                found.push((here / median.max(1e-12), hz));
            }
        }
    }
    found.sort_by(|a, b| b.0.total_cmp(&a.0));
    let mut chosen: Vec<f64> = Vec::new();
    for (_, hz) in found {
        if chosen.len() < MOST_LINES && chosen.iter().all(|c| (c - hz).abs() > 0.03 * hz) {
            chosen.push(hz);
        }
    }
    Lines { torque_hz: chosen.clone(), sensor_hz: chosen }
}

/// Power of the three axes at frequencies m / (padded length), zero-padded to a power of two.
fn power_spectrum(series: &[Vector3<f64>]) -> Vec<f64> {
    let size = series.len().next_power_of_two() * 2;
    let mut power = vec![0.0; size / 2];
    for axis in 0..3 {
        let mut re: Vec<f64> = series.iter().map(|v| v[axis]).collect();
        re.resize(size, 0.0);
        let mut im = vec![0.0; size];
        transform(&mut re, &mut im);
        for (slot, (a, b)) in power.iter_mut().zip(re.iter().zip(&im)) {
            *slot += (a * a + b * b) / series.len() as f64;
        }
    }
    power
}

/// Fast Fourier transform in place, radix two.
fn transform(re: &mut [f64], im: &mut [f64]) {
    let n = re.len();
    let mut j = 0;
    for i in 1..n {
        let mut bit = n >> 1;
        while j & bit != 0 {
            j ^= bit;
            bit >>= 1;
        }
        j |= bit;
        if i < j {
            re.swap(i, j);
            im.swap(i, j);
        }
    }
    let mut length = 2;
    while length <= n {
        let angle = -std::f64::consts::TAU / length as f64;
        for start in (0..n).step_by(length) {
            for k in 0..length / 2 {
                let (s, c) = (angle * k as f64).sin_cos();
                let (a, b) = (start + k, start + k + length / 2);
                let (x, y) = (re[b] * c - im[b] * s, re[b] * s + im[b] * c);
                (re[b], im[b]) = (re[a] - x, im[a] - y);
                re[a] += x;
                im[a] += y;
            }
        }
        length *= 2;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_sine_has_one_line() {
        let series: Vec<Vector3<f64>> =
            (0..1000).map(|k| Vector3::x() * (std::f64::consts::TAU * 0.1 * f64::from(k)).sin()).collect();
        let power = power_spectrum(&series);
        let (peak, _) = power.iter().enumerate().max_by(|a, b| a.1.total_cmp(b.1)).unwrap();
        assert!((peak as f64 / (2.0 * power.len() as f64) - 0.1).abs() < 1e-3);
    }
}
