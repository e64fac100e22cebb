//! The noise that runs show, and sensors that contradict each other.

use std::collections::BTreeMap;

use nalgebra::Vector3;
use whorl_math::noise::from_second_differences;
use whorl_math::statistics::median;
use whorl_prediction::{Noise, Prepared};
use whorl_recording::{Channel, Component, Series};

use crate::selection::{Evaluated, Runs};
use crate::verdict::diagnosis::{NoiseScale, Unknown};
use crate::{Outcome, Settings};

/// Noise of each channel of each training run over what the model states. And accelerometer or vector sensors against the gyro, if no motion at
/// all fits both: with a torque that may do anything these sensors need a noise far above what their own samples scatter by.
pub(super) fn noise_of(runs: &Runs<'_>, set: &Evaluated) -> Outcome<(Vec<NoiseScale>, Option<Unknown>)> {
    let model = set.model(runs.reference)?;
    let mean = |all: &[f64]| all.iter().sum::<f64>() / all.len().max(1) as f64;
    let (mut scales, mut powers_of_runs) = (Vec::new(), Vec::new());
    for (recording, followed) in runs.training.iter().zip(&set.fitted.followed) {
        let case = Prepared::new(recording, &model, runs.prediction())?;
        let stated = Noise::stated(&case)?;
        let mut sensors: BTreeMap<(Channel, usize), Vec<f64>> = BTreeMap::new();
        let mut powers: Vec<f64> = Vec::new();
        for component in case.components() {
            let (noise, stated) = (followed.noise.of(component), stated.of(component));
            sensors.entry((component.channel, component.sensor())).or_default().push(noise / stated);
            if matches!(component.channel, Channel::Accelerometer | Channel::Vector) {
                powers.push((noise / stated.max(scatter(&case, component))).powi(2));
            }
        }
        powers_of_runs.extend((!powers.is_empty()).then(|| mean(&powers)));
        scales.extend(sensors.iter().map(|((channel, _), ratios)| NoiseScale {
            run: recording.name.clone(),
            channel: channel.info().key.to_owned(),
            scale: mean(ratios),
        }));
    }
    let power = median(powers_of_runs);
    let is_contradiction = power > runs.reference.settings.contradiction_power;
    Ok((scales, is_contradiction.then(|| Unknown::contradiction(power))))
}

/// Noise of one component by second differences of neighbouring samples; 0 where there are too few.
fn scatter(case: &Prepared<'_>, component: Component) -> f64 {
    let of_axis = |series: &Series<Vector3<f64>>, i: usize| {
        let values: Vec<f64> = series.value.iter().map(|v| v[i]).collect();
        from_second_differences(&values).unwrap_or(0.0)
    };
    if component.channel == Channel::Accelerometer {
        return of_axis(&case.recording().specific_force_b_m_s2, component.index());
    }
    let Some(vector) = case.recording().vectors.get(component.sensor()) else { return 0.0 };
    // Three components share the noise of two directions.
    ((0..3).map(|i| of_axis(&vector.direction_b, i).powi(2)).sum::<f64>() / 2.0).sqrt()
}

/// A sentence for each sensor whose noise is not the model's.
pub(super) fn noise_remarks(scales: &[NoiseScale], settings: &Settings) -> Vec<String> {
    let usual = settings.noise_factor.recip()..=settings.noise_factor;
    let is_odd = |scale: &&NoiseScale| scale.scale.is_finite() && !usual.contains(&scale.scale);
    let sentence = |of: &NoiseScale| {
        format!(
            "{}: the {}'s noise is {:.2} times the model's; the measured level is used",
            of.run,
            of.channel.replace('_', " "),
            of.scale
        )
    };
    scales.iter().filter(is_odd).map(sentence).collect()
}
