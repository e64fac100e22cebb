//! Readings that say nothing, left out before everything else: those at the end of a sensor's range, single ones that stand out, and those that
//! smoothing made of others.

use std::borrow::Cow;

use nalgebra::Vector3;
use whorl_dynamics::PlatformModel;
use whorl_math::noise::{samples_together, second_differences, typical_step_s};
use whorl_math::statistics::median;
use whorl_recording::{Recording, Series};

use crate::signals::digits::{AT_END, digits_of_gyro};
use crate::signals::is_clamped;

/// Share of a sensor's range from which a sample counts as clipped.
const CLIPPED: f64 = 0.999;
/// So often must three readings in a row be the largest of all to show an end of the range, ...
const PLATEAU_SAMPLES: usize = 5;
/// ... in a signal whose noise is at least this share of it (a noiseless one may well stay constant).
const NOISY: f64 = 3e-4;
/// A reading stands out when both neighbours are further away than this many median second differences, some 16 standard
/// deviations of white noise: none of a billion does, ...
const STANDS_OUT: f64 = 10.0;
/// ... and the neighbours are closer to each other than this share of it.
const NEIGHBOURS_AGREE: f64 = 0.5;
/// What stands out more often than this is no accident of single readings.
const LARGEST_SHARE: f64 = 0.01;

/// A recording without readings that say nothing of the motion, and what was left out, in sentences. Of a body that is held gyro and accelerometer
/// all say the same, and nothing of theirs is left out.
#[must_use]
pub fn usable_readings<'a>(run: &'a Recording, model: &PlatformModel) -> (Cow<'a, Recording>, Vec<String>) {
    let (sensors, name, mut remarks) = (&model.sensors, &run.name, Vec::new());
    let (mut gyro, mut force, mut speed) =
        (run.gyro_b_rad_s.clone(), run.specific_force_b_m_s2.clone(), run.wheel_speed_rad_s.clone());
    if !is_clamped(run, model) {
        let piles_up_at = digits_of_gyro(run, model).clips_at_rad_s.unwrap_or(f64::INFINITY);
        let gyro_end = (CLIPPED * sensors.gyro.errors.range).min(piles_up_at * (1.0 - AT_END));
        let force_end = CLIPPED * sensors.accelerometer.errors.range;
        for (series, what, end) in [(&mut gyro, "gyro", gyro_end), (&mut force, "accelerometer", force_end)] {
            let all = series.len() as f64;
            let end = |values: &[Vector3<f64>]| within(values, end);
            let checks = [
                ("", "at the end of the sensor's range", "move more gently"),
                ("single ", "far from those before and after", "look for a loose connection or lost bits"),
            ];
            for (single, place, advice) in checks {
                let kept = if single.is_empty() { end(&series.value) } else { ordinary(&series.value) };
                let count = keep(series, |k| kept.get(k) != Some(&false));
                let percent = 100.0 * count as f64 / all;
                remarks.extend((count > 0).then(|| {
                    format!("{name}: {count} {single}{what} samples {place} were left out ({percent:.2} % of the run): {advice}.")
                }));
            }
            thin(series, |v, i| v.get(i).copied(), what, name, &mut remarks);
        }
    }
    thin(&mut speed, |v, i| v.get(i).copied(), "wheel speed", name, &mut remarks);
    if remarks.is_empty() {
        return (Cow::Borrowed(run), remarks);
    }
    let usable = Recording {
        gyro_b_rad_s: gyro,
        specific_force_b_m_s2: force,
        wheel_speed_rad_s: speed,
        ..run.clone()
    };
    (Cow::Owned(usable), remarks)
}

/// The same of all recordings.
pub(crate) fn usable(recordings: &[Recording], model: &PlatformModel) -> (Vec<Recording>, Vec<String>) {
    let (usable, remarks): (Vec<_>, Vec<_>) =
        recordings.iter().map(|run| usable_readings(run, model)).unzip();
    (usable.into_iter().map(Cow::into_owned).collect(), remarks.concat())
}

/// Of a series whose noise hangs together over some samples, as it does where its maker smoothed it, keeps one in so many: taken as independent,
/// all of them would claim to know what none of them does. `number`: of a sample, of one of its components.
fn thin<T>(
    series: &mut Series<T>,
    number: impl Fn(&T, usize) -> Option<f64>,
    what: &str,
    run: &str,
    remarks: &mut Vec<String>,
) {
    let component = |i: usize| series.value.iter().map(|v| number(v, i)).collect::<Option<Vec<f64>>>();
    let moving =
        (0..).map_while(|i| component(i).filter(|x| !x.is_empty())).filter(|x| !typical_bend(x).is_nan());
    let together = moving.map(|x| samples_together(&x)).min().unwrap_or(1);
    if together > 1 {
        let together_s = together as f64 * typical_step_s(&series.time_s);
        keep(series, |k| k % together == 0);
        remarks.push(format!(
            "{run}: the noise of the {what} hangs together over {together_s:.2} s: it was smoothed before it was recorded. One sample in {together} \
             was used, as the others say nothing of their own."
        ));
    }
}

/// Keeps these samples; how many were not kept.
fn keep<T>(series: &mut Series<T>, is_kept: impl Fn(usize) -> bool) -> usize {
    let (mut of_times, mut of_values) = (0.., 0..);
    let before = series.len();
    series.time_s.retain(|_| of_times.next().is_none_or(&is_kept));
    series.value.retain(|_| of_values.next().is_none_or(&is_kept));
    before - series.len()
}

/// Which readings are within the sensor's range: below `end`, and within the ends that the readings show.
fn within(values: &[Vector3<f64>], end: f64) -> Vec<bool> {
    let ends = [0, 1, 2].map(|axis| ends(values, axis));
    let inside = |v: &Vector3<f64>| {
        let between = |(x, (low, high)): (&f64, &(f64, f64))| low < x && x < high;
        v.amax() < end && v.iter().zip(&ends).all(between)
    };
    values.iter().map(inside).collect()
}

/// Ends of an axis's range where the readings themselves show one: a noisy signal that stays at its largest or smallest
/// value exactly, again and again, is clipped, whatever the model says of the range. Infinite where nothing shows.
fn ends(values: &[Vector3<f64>], axis: usize) -> (f64, f64) {
    let x: Vec<f64> = values.iter().map(|v| v[axis]).collect();
    let noise = typical_bend(&x);
    let end = |sign: f64| {
        let extreme = x.iter().map(|v| sign * v).fold(f64::NEG_INFINITY, f64::max);
        let stays = x.windows(3).filter(|w| w.iter().all(|v| sign * v == extreme)).count();
        let noisy = noise > NOISY * extreme.abs() && extreme.abs() > 5.0 * noise;
        // Coarse steps repeat themselves as well; but of noise the largest is the rarest.
        let at_extreme = x.iter().filter(|v| sign * **v == extreme).count();
        let near = x.iter().filter(|v| sign * **v >= extreme - 3.0 * noise).count();
        let piles_up = 2 * at_extreme > near;
        if noisy && piles_up && stays >= PLATEAU_SAMPLES { extreme } else { f64::INFINITY }
    };
    (-end(-1.0), end(1.0))
}

/// Which readings do not stand out from both neighbours; all where many do.
fn ordinary(values: &[Vector3<f64>]) -> Vec<bool> {
    let mut ordinary = vec![true; values.len()];
    for axis in 0..3 {
        let x: Vec<f64> = values.iter().map(|v| v[axis]).collect();
        let most = STANDS_OUT * typical_bend(&x);
        // Not where nothing bends: then it is NaN.
        let stands_out = |w: &[f64]| {
            let [before, at, after] = w else { return false };
            let (up, down) = (at - before, at - after);
            let least = up.abs().min(down.abs());
            up * down > 0.0 && least > most && (after - before).abs() < NEIGHBOURS_AGREE * least
        };
        for (k, _) in x.windows(3).enumerate().filter(|(_, w)| stands_out(w)) {
            if let Some(slot) = ordinary.get_mut(k + 1) {
                *slot = false;
            }
        }
    }
    let out = ordinary.iter().filter(|ordinary| !**ordinary).count();
    if out as f64 > LARGEST_SHARE * values.len() as f64 { vec![true; values.len()] } else { ordinary }
}

/// Median of the second differences that are not zero; NaN where there are none.
fn typical_bend(values: &[f64]) -> f64 {
    median(second_differences(values).filter(|bend| *bend > 0.0))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn noisy(n: usize) -> Vec<Vector3<f64>> {
        // A linear congruential generator serves: only scatter is wanted.
        let mut state = 1_u64;
        let mut draw = move || {
            state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
            (state >> 11) as f64 / (1_u64 << 53) as f64 - 0.5
        };
        (0..n)
            .map(|k| Vector3::new((0.02 * k as f64).sin() + 0.01 * draw(), 0.01 * draw(), 0.01 * draw()))
            .collect()
    }

    #[test]
    fn single_readings_that_stand_out_are_found_and_steps_and_bursts_are_not() {
        let mut values = noisy(2000);
        assert!(ordinary(&values).iter().all(|x| *x));
        values[700].y += 0.3;
        values[900].x -= 0.5;
        // A step, and a pulse of several samples, are motion.
        values.iter_mut().skip(1200).for_each(|v| v.z += 0.4);
        values.iter_mut().skip(1500).take(4).for_each(|v| v.y += 0.4);
        let found = ordinary(&values);
        let out: Vec<usize> = (0..found.len()).filter(|k| !found[*k]).collect();
        assert_eq!(out, [700, 900]);
        // One in fifty is how this sensor is.
        values.iter_mut().step_by(50).for_each(|v| v.y += 0.3);
        assert!(ordinary(&values).iter().all(|x| *x));
    }

    #[test]
    fn ends_of_a_range_show_by_themselves() {
        let mut values = noisy(2000);
        for v in &mut values {
            v.x = v.x.clamp(-0.8, 0.9);
        }
        assert_eq!(ends(&values, 0), (-0.8, 0.9));
        assert_eq!(ends(&values, 1), (f64::NEG_INFINITY, f64::INFINITY));
        let kept = within(&values, f64::INFINITY);
        assert!(kept.iter().zip(&values).all(|(kept, v)| *kept == (v.x > -0.8 && v.x < 0.9)));
        // Weight at rest, read in steps as wide as its noise: the largest number is read again and again, and is none.
        let steps: Vec<Vector3<f64>> =
            noisy(20_000).iter().map(|v| Vector3::z() * (9.81 + 0.01 * (200.0 * v.y).round())).collect();
        assert!(steps.windows(3).filter(|w| w.iter().all(|v| v.z == 9.82)).count() > PLATEAU_SAMPLES);
        assert_eq!(ends(&steps, 2), (f64::NEG_INFINITY, f64::INFINITY));
    }
}
