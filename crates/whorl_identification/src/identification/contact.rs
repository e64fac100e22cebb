//! The bearing's stop: what is read there is left out, and a run is cut into the pieces between.
//! When and how hard a platform touches depends on fractions of a millimetre. A model that takes its stop for exact would learn of the
//! tilt what no sensor says: even with the predictor's error of a touch a product of inertia comes out eight deviations off.

use nalgebra::Vector3;
use whorl_dynamics::PlatformModel;
use whorl_estimation::sequential::{CONTACT_LASTS_S, touches};
use whorl_recording::{Recording, Series, stretch};

/// Specific forces are averaged over so long before they are judged \[s\]: motion is slow against it, and noise is not.
const AVERAGED_S: f64 = 0.1;
/// Pieces that are shorter tell of their own start and of little else \[s\].
const SHORTEST_S: f64 = 3.0;

/// The model of a platform that is away from its stop: where a start that is not known exactly reaches the stop, a touch would come and go
/// with the parameters though there was none.
pub(super) fn away_from_stop(model: &PlatformModel) -> PlatformModel {
    // No tilt is larger.
    PlatformModel { tilt_limit: model.tilt_limit.with_max_rad(std::f64::consts::PI), ..model.clone() }
}

/// The pieces of a run between touches, and what was left out; the run itself where nothing touches.
pub(crate) fn between_touches(run: &Recording, model: &PlatformModel) -> (Vec<Recording>, Option<String>) {
    let touching = touching_s(&run.specific_force_b_m_s2, model);
    let times = &run.gyro_b_rad_s.time_s;
    let (Some(first), Some(last), false) = (times.first(), times.last(), touching.is_empty()) else {
        return (vec![run.clone()], None);
    };
    let (mut pieces, mut from_s) = (Vec::new(), *first);
    for (begins_s, ends_s) in touching.into_iter().chain([(*last, *last)]) {
        if begins_s - from_s >= SHORTEST_S {
            let name = format!("{}, {from_s:.1} s to {begins_s:.1} s", run.name);
            pieces.push(Recording { name, ..stretch(run, from_s, begins_s) });
        }
        from_s = ends_s.max(from_s);
    }
    let used_s: f64 = pieces.iter().map(Recording::duration_s).sum();
    let remark = format!(
        "{}: {:.1} s at the stop of the bearing, and moments too short between touches, were left out: swing less.",
        run.name,
        (last - first - used_s).max(0.0)
    );
    (pieces, Some(remark))
}

/// Times at which the specific force says that the platform touches, from and to, margins included \[s\].
fn touching_s(force: &Series<Vector3<f64>>, model: &PlatformModel) -> Vec<(f64, f64)> {
    let samples: Vec<_> =
        force.time_s.iter().zip(&force.value).filter(|_| model.tilt_limit.stops()).collect();
    let window = |t: &f64| (t / AVERAGED_S).floor();
    let mean = |block: &[(&f64, &Vector3<f64>)]| {
        block.iter().map(|(_, force)| *force).sum::<Vector3<f64>>() / block.len() as f64
    };
    let blocks = samples.chunk_by(|a, b| window(a.0) == window(b.0));
    let touching = blocks.filter(|block| touches(&mean(block), model.tilt_limit));
    touching.map(|of| (of[0].0 - CONTACT_LASTS_S, of[of.len() - 1].0 + CONTACT_LASTS_S)).collect()
}
