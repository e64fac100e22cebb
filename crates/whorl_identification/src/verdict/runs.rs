//! What runs need to be explained, one against the other: their noise, and whether one disagrees with the others.

use nalgebra::DVector;
use whorl_math::statistics::median;
use whorl_prediction::{Followed, Hints, Noise, Prepared};
use whorl_recording::{Channel, Component};

use crate::fitting::normal_equations::{Estimate, Normal};
use crate::selection::{Evaluated, Runs};
use crate::verdict::diagnosis::{NoiseScale, Unknown};
use crate::{DiagnosisError, Settings};

/// Noise of each channel of each training run over what the model states.
pub(super) fn noise_scales(runs: &Runs<'_>, set: &Evaluated) -> Result<Vec<NoiseScale>, DiagnosisError> {
    let refit = set.refit(runs.reference);
    let model = refit.model_at(&set.fitted.at).ok_or(whorl_prediction::PredictionError::NoModel)?;
    let mut scales = Vec::new();
    for (recording, followed) in runs.training.iter().zip(&set.fitted.followed) {
        let case = Prepared::new(recording, &model, runs.prediction())?;
        let stated = Noise::stated(&case)?;
        let mut sensors: Vec<(Channel, usize, Vec<f64>)> = Vec::new();
        for component in case.components() {
            let ratio = followed.noise.of(component) / stated.of(component);
            match sensors.iter_mut().find(|(c, s, _)| (*c, *s) == (component.channel, component.sensor())) {
                Some((.., ratios)) => ratios.push(ratio),
                None => sensors.push((component.channel, component.sensor(), vec![ratio])),
            }
        }
        scales.extend(sensors.into_iter().map(|(channel, _, ratios)| NoiseScale {
            run: recording.name.clone(),
            channel: channel.info().key.to_owned(),
            scale: ratios.iter().sum::<f64>() / ratios.len().max(1) as f64,
        }));
    }
    Ok(scales)
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

/// Runs that disagree with the others: a fit to the others does not predict them, or they need a noise far from what
/// is stated and from what the others need.
pub(super) fn odd_runs(
    runs: &Runs<'_>,
    set: &Evaluated,
    by_run: &[Hints],
    noise: &[NoiseScale],
) -> Vec<String> {
    let settings = &runs.reference.settings;
    let count = runs.training.len();
    if count < 3 || by_run.len() != count {
        return Vec::new();
    }
    let own = set.columns.len();
    let all: Vec<usize> = (0..own).collect();
    let variance = |i: usize| set.stddevs[i].powi(2);
    let prior = DVector::from_fn(own, |i, _| set.fitted.at[i] / variance(i));
    let normals: Vec<Normal> = by_run
        .iter()
        .map(|of| Normal {
            matrix: of.information.view((0, 0), (own, own)).into_owned(),
            vector: of.slope.rows(0, own).into_owned(),
        })
        .collect();
    let mut total = Normal::zeros(own);
    normals.iter().for_each(|of_run| total.add(of_run, 1.0));
    let mut odd = Vec::new();
    for (recording, of_run) in runs.training.iter().zip(&normals) {
        // Fitted without the run, does the model predict it as well as a fit that has seen it?
        let mut others = total.clone();
        others.add(of_run, -1.0);
        let drop = |normal: &Normal| {
            let mut normal = normal.clone();
            normal.vector -= &prior;
            Estimate::new(&normal, &all, variance).map(|estimate| estimate.drop)
        };
        let (Some(of_all), Some(of_others), Some(of_own)) = (drop(&total), drop(&others), drop(of_run))
        else {
            continue;
        };
        // What is known from the others counts as far as it is known.
        let disagreement = of_others + of_own - of_all;
        let of_noise = noise
            .iter()
            .filter(|n| n.run == recording.name)
            .map(|n| {
                let others = noise.iter().filter(|o| o.channel == n.channel && o.run != n.run);
                let usual = median(others.map(|o| o.scale.ln())).max(0.0);
                (n.scale.ln() - usual) / settings.noise_factor.ln()
            })
            .fold(0.0, f64::max);
        if disagreement > 2.0 * (own as f64 + settings.clear_misfit) || of_noise > settings.noticed_stddevs {
            odd.push((disagreement.max(of_noise), recording.name.clone()));
        }
    }
    // If most runs disagree, none of them is the odd one.
    if odd.len() * 2 >= count {
        odd.sort_by(|a, b| b.0.total_cmp(&a.0));
        let strongest = odd.first().cloned();
        let second = odd.get(1).map_or(0.0, |o| o.0);
        odd = strongest.filter(|s| s.0 > 3.0 * second).into_iter().collect();
    }
    odd.into_iter().map(|(_, name)| name).collect()
}

/// Accelerometer or vector sensors against the gyro, if no motion at all fits both: with a torque that may do anything these sensors
/// need a noise far above what their own samples scatter by.
pub(super) fn contradiction(runs: &Runs<'_>, set: &Evaluated) -> Option<Unknown> {
    let model = set.refit(runs.reference).model_at(&set.fitted.at)?;
    let mut powers: Vec<f64> = Vec::new();
    for (recording, followed) in runs.training.iter().zip(&set.fitted.followed) {
        let case = Prepared::new(recording, &model, runs.prediction()).ok()?;
        let stated = Noise::stated(&case).ok()?;
        let power = power_of_attitude(&case, followed, &stated);
        powers.extend(power);
    }
    let power = median(powers);
    (power > runs.reference.settings.contradiction_power).then(|| Unknown::contradiction(power))
}

/// Noise that accelerometer and vector sensors need over the larger of what is stated and what neighbouring samples show, as a power;
/// `None` where neither is there.
fn power_of_attitude(case: &Prepared<'_>, followed: &Followed, stated: &Noise) -> Option<f64> {
    let tells = |component: &Component| matches!(component.channel, Channel::Accelerometer | Channel::Vector);
    let powers: Vec<f64> = case
        .components()
        .filter(tells)
        .map(|component| {
            let known = stated.of(component).max(scatter(case, component));
            (followed.noise.of(component) / known).powi(2)
        })
        .collect();
    (!powers.is_empty()).then(|| powers.iter().sum::<f64>() / powers.len() as f64)
}

/// Noise of one component by second differences of neighbouring samples; 0 where there are too few.
fn scatter(case: &Prepared<'_>, component: Component) -> f64 {
    use whorl_math::noise::from_second_differences;
    let recording = case.recording();
    let index = component.index();
    match component.channel {
        Channel::Accelerometer => {
            let values: Vec<f64> =
                recording.specific_force_b_m_s2.value.iter().filter_map(|f| f.get(index).copied()).collect();
            from_second_differences(&values).unwrap_or(0.0)
        }
        Channel::Vector => {
            let Some(vector) = recording.vectors.get(component.sensor()) else { return 0.0 };
            let axis = |i: usize| -> Vec<f64> { vector.direction_b.value.iter().map(|v| v[i]).collect() };
            // Three components share the noise of two directions.
            let squares = (0..3).filter_map(|i| from_second_differences(&axis(i))).map(|s| s * s);
            (squares.sum::<f64>() / 2.0).sqrt()
        }
        _ => 0.0,
    }
}
