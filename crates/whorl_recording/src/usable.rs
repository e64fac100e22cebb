//! Readings that say nothing, left out before all else: at the end of a range, single ones that stand out, those that smoothing made of others.

use std::borrow::Cow;

use nalgebra::Vector3;
use whorl_dynamics::PlatformModel;
use whorl_math::noise::{samples_together, second_differences, typical_step_s};
use whorl_math::statistics::median;

use crate::digits::{AT_END, digits_of_gyro};
use crate::recording::Recording;
use crate::series::{ChannelSeries, Series};

/// Share of a sensor's range from which a sample counts as clipped.
const CLIPPED: f64 = 0.999;
/// So often must three readings in a row be the largest of all to show an end of the range, ...
pub(crate) const PLATEAU_SAMPLES: usize = 5;
/// ... in a signal whose noise is at least this share of it (a noiseless one may well stay constant).
const NOISY: f64 = 3e-4;
/// A reading stands out when both neighbours are further away than so many median second differences, 16 deviations of white noise, ...
const STANDS_OUT: f64 = 10.0;
/// ... and the neighbours are closer to each other than this share of it.
const NEIGHBOURS_AGREE: f64 = 0.5;
/// What stands out more often than this is no accident of single readings.
const LARGEST_SHARE: f64 = 0.01;

/// A recording without readings that say nothing of the motion, and what was left out, in sentences. Of a body that is held gyro and accelerometer
/// all say the same, and nothing of theirs is left out.
#[must_use]
pub fn usable_readings<'a>(run: &'a Recording, model: &PlatformModel) -> (Cow<'a, Recording>, Vec<String>) {
    let (mut usable, name, mut remarks) = (run.clone(), &run.name, Vec::new());
    if !run.is_clamped(model) {
        let sensors = &model.sensors;
        let piles_up_at = digits_of_gyro(run, model).clips_at_rad_s.unwrap_or(f64::INFINITY);
        let of_gyro = (CLIPPED * sensors.gyro.errors.range).min(piles_up_at * (1.0 - AT_END));
        let of_force = CLIPPED * sensors.accelerometer.errors.range;
        for (series, what, end) in [
            (&mut usable.gyro_b_rad_s, "gyro", of_gyro),
            (&mut usable.specific_force_b_m_s2, "accelerometer", of_force),
        ] {
            let all = series.len() as f64;
            let mut leave_out = |kept: Vec<bool>, series: &mut Series<_>, of: &str, hint: &str| {
                let lost = keep(series, |k| kept.get(k) != Some(&false));
                let percent = 100.0 * lost as f64 / all;
                let text = format!("{name}: {lost} {of} were left out ({percent:.2} % of the run): {hint}.");
                remarks.extend((lost > 0).then_some(text));
            };
            let at_end = format!("{what} samples at the end of the sensor's range");
            leave_out(within(&series.value, end), series, &at_end, "move more gently");
            let far = format!("single {what} samples far from those before and after");
            leave_out(ordinary(&series.value), series, &far, "look for a loose connection or lost bits");
            thin(series, what, name, &mut remarks);
        }
    }
    thin(&mut usable.wheel_speed_rad_s, "wheel speed", name, &mut remarks);
    (if remarks.is_empty() { Cow::Borrowed(run) } else { Cow::Owned(usable) }, remarks)
}

/// Of a series that its maker smoothed keeps one sample in so many: taken as independent, all of them would claim to know what none does.
fn thin<T>(series: &mut Series<T>, what: &str, run: &str, remarks: &mut Vec<String>)
where
    Series<T>: ChannelSeries,
{
    let part = |i: usize| (0..series.len()).map(|k| series.number(k, i)).collect::<Option<Vec<f64>>>();
    let moving = (0..).map_while(|i| part(i).filter(|x| !x.is_empty())).filter(|x| !typical_bend(x).is_nan());
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
pub(crate) fn within(values: &[Vector3<f64>], end: f64) -> Vec<bool> {
    let ends = [0, 1, 2].map(|axis| ends(values, axis));
    let is_between = |(x, (low, high)): (&f64, (f64, f64))| low < *x && *x < high;
    values.iter().map(|v| v.amax() < end && v.iter().zip(ends).all(is_between)).collect()
}

/// Ends of an axis's range where the readings themselves show one: a noisy signal that stays at its largest or smallest
/// value exactly, again and again, is clipped, whatever the model says of the range. Infinite where nothing shows.
pub(crate) fn ends(values: &[Vector3<f64>], axis: usize) -> (f64, f64) {
    let x: Vec<f64> = values.iter().map(|v| v[axis]).collect();
    let noise = typical_bend(&x);
    let end = |sign: f64| {
        let extreme = x.iter().map(|v| sign * v).fold(f64::NEG_INFINITY, f64::max);
        let stays = x.windows(3).filter(|w| w.iter().all(|v| sign * v == extreme)).count();
        let noisy = noise > NOISY * extreme.abs() && extreme.abs() > 5.0 * noise;
        // Coarse steps repeat themselves as well; but of noise the largest is the rarest.
        let from = |least: f64| x.iter().filter(|v| sign * **v >= least).count();
        let piles_up = 2 * from(extreme) > from(extreme - 3.0 * noise);
        if noisy && piles_up && stays >= PLATEAU_SAMPLES { extreme } else { f64::INFINITY }
    };
    (-end(-1.0), end(1.0))
}

/// Which readings do not stand out from both neighbours; all where many do.
pub(crate) fn ordinary(values: &[Vector3<f64>]) -> Vec<bool> {
    let mut ordinary = vec![true; values.len()];
    for axis in 0..3 {
        let x: Vec<f64> = values.iter().map(|v| v[axis]).collect();
        let most = STANDS_OUT * typical_bend(&x);
        for (w, ordinary) in x.windows(3).zip(ordinary.iter_mut().skip(1)) {
            let (up, down) = (w[1] - w[0], w[1] - w[2]);
            let least = up.abs().min(down.abs());
            // Not where nothing bends: then it is NaN.
            *ordinary &= !(up * down > 0.0 && least > most && (w[2] - w[0]).abs() < NEIGHBOURS_AGREE * least);
        }
    }
    let out = ordinary.iter().filter(|ordinary| !**ordinary).count();
    if out as f64 > LARGEST_SHARE * values.len() as f64 { vec![true; values.len()] } else { ordinary }
}

/// Median of the second differences that are not zero; NaN where there are none.
fn typical_bend(values: &[f64]) -> f64 {
    median(second_differences(values).filter(|bend| *bend > 0.0))
}
