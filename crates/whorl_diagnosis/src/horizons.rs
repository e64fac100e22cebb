//! Prediction errors in physical units.

use nalgebra::Vector3;

use crate::columns::predict;
use crate::diagnosis::ChannelError;
use crate::mechanics::Mechanics;
use crate::search::Search;
use crate::step::point_of;

const HORIZONS_S: [f64; 3] = [0.1, 1.0, 10.0];

/// RMS error of the predicted rate about each axis, ahead from the smoothed motion. The model is driven
/// along the motion as it was, so that errors add up but do not feed back.
pub(crate) fn channel_errors(search: &Search<'_>) -> Vec<ChannelError> {
    let mut found = Vec::new();
    let models = [&search.base, &search.best]
        .map(|h| point_of(search.problem, &search.layout, &search.point, h))
        .map(|mut point| {
            if search.best.members.is_empty() {
                point.effects.retain(|id, _| crate::parameters::is_base(id));
            }
            search.problem.reference.model_at(&point).ok().and_then(|m| Mechanics::new(&m).ok())
        });
    let [Some(before), Some(after)] = models else { return found };
    // Squared errors: horizon, axis, (before, after), count.
    let mut sums = [[[0.0; 2]; 3]; HORIZONS_S.len()];
    let mut counts = [0.0; HORIZONS_S.len()];
    let mut noise = Vector3::zeros();
    for (run, motion) in search.problem.runs.iter().zip(&search.problem.motions) {
        if run.clamped {
            continue;
        }
        noise = run.noise.gyro;
        for (which, mechanics) in [&before, &after].into_iter().enumerate() {
            let (_, prediction) = predict(mechanics, run, motion);
            let nodes = run.nodes();
            let mut integral = vec![Vector3::zeros(); nodes];
            for k in 1..nodes {
                integral[k] = integral[k - 1] + prediction.omega_dot[k - 1] * run.length(k - 1);
            }
            for (h, horizon_s) in HORIZONS_S.iter().enumerate() {
                let ahead = (horizon_s / run.length(0).max(1e-4)).round().max(1.0) as usize;
                let mut k = 0;
                while k + ahead < nodes {
                    let predicted = motion.omega[k] + integral[k + ahead] - integral[k];
                    let error = predicted - motion.omega[k + ahead];
                    for axis in 0..3 {
                        sums[h][axis][which] += error[axis] * error[axis];
                    }
                    if which == 0 {
                        counts[h] += 1.0;
                    }
                    k += ahead.div_ceil(2);
                }
            }
        }
    }
    for (h, horizon_s) in HORIZONS_S.iter().enumerate() {
        for (axis, name) in ["gyro_x", "gyro_y", "gyro_z"].into_iter().enumerate() {
            if counts[h] > 0.0 {
                let rms = |which: usize| (sums[h][axis][which] / counts[h] + noise[axis].powi(2)).sqrt();
                found.push(ChannelError {
                    channel: name.to_owned(),
                    unit: "rad/s".to_owned(),
                    horizon_s: *horizon_s,
                    before: rms(0),
                    after: rms(1),
                    noise_floor: noise[axis],
                });
            }
        }
    }
    found
}
