//! The bearing's stop: what is read there is left out, and a run is cut into the pieces between.
//!
//! When and how hard a platform touches depends on the stop to fractions of a millimetre. A model that takes its stop for exact would
//! learn of the tilt from every touch what no sensor says: also with the error of a touch that the predictor has, a product of inertia
//! comes out eight of its deviations off where the wheels' axes are uncertain.

use nalgebra::Vector3;
use whorl_dynamics::PlatformModel;
use whorl_recording::{Recording, Series};

use whorl_estimation::sequential::{CONTACT_LASTS_S, touches};

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
pub(super) fn between_touches(
    run: &Recording,
    model: &PlatformModel,
    remarks: &mut Vec<String>,
) -> Vec<Recording> {
    let touching = touching_s(&run.specific_force_b_m_s2, model);
    let times = &run.gyro_b_rad_s.time_s;
    let (Some(first), Some(last), false) = (times.first(), times.last(), touching.is_empty()) else {
        return vec![run.clone()];
    };
    let (mut pieces, mut from_s) = (Vec::new(), *first);
    for (begins_s, ends_s) in touching.into_iter().chain([(*last, *last)]) {
        if begins_s - from_s >= SHORTEST_S {
            pieces.push(piece(run, from_s, begins_s));
        }
        from_s = ends_s.max(from_s);
    }
    let used_s: f64 = pieces.iter().map(Recording::duration_s).sum();
    remarks.push(format!(
        "{}: {:.1} s at the stop of the bearing, and moments too short between touches, were left out: swing less.",
        run.name,
        (last - first - used_s).max(0.0)
    ));
    pieces
}

/// Times at which the specific force says that the platform touches, from and to, margins included \[s\].
fn touching_s(force: &Series<Vector3<f64>>, model: &PlatformModel) -> Vec<(f64, f64)> {
    let mut found: Vec<(f64, f64)> = Vec::new();
    if !model.tilt_limit.stops() {
        return found;
    }
    let samples: Vec<(&f64, &Vector3<f64>)> = force.time_s.iter().zip(&force.value).collect();
    let window = |t: &f64| (t / AVERAGED_S).floor();
    for block in samples.chunk_by(|a, b| window(a.0) == window(b.0)) {
        let mean = block.iter().map(|(_, force)| *force).sum::<Vector3<f64>>() / block.len() as f64;
        let ([(from, _), ..], [.., (to, _)]) = (block, block) else { continue };
        let (from_s, to_s) = (*from - CONTACT_LASTS_S, *to + CONTACT_LASTS_S);
        match found.last_mut() {
            _ if !touches(&mean, model.tilt_limit) => {}
            Some(last) if from_s <= last.1 => last.1 = to_s,
            _ => found.push((from_s, to_s)),
        }
    }
    found
}

/// What was measured of a run from one time to another, with everything that was commanded; of wheels the command that holds at the
/// start, so that nothing has to be known of the motion before.
fn piece(run: &Recording, from_s: f64, to_s: f64) -> Recording {
    let commands = &run.wheel_torque_command_n_m;
    let held = commands.time_s.iter().rfind(|t| **t <= from_s);
    let mut piece = Recording {
        name: format!("{}, {from_s:.1} s to {to_s:.1} s", run.name),
        gyro_b_rad_s: within(&run.gyro_b_rad_s, from_s, to_s),
        specific_force_b_m_s2: within(&run.specific_force_b_m_s2, from_s, to_s),
        wheel_speed_rad_s: within(&run.wheel_speed_rad_s, from_s, to_s),
        wheel_torque_command_n_m: within(commands, held.copied().unwrap_or(from_s), f64::INFINITY),
        ..run.clone()
    };
    for vector in &mut piece.vectors {
        vector.direction_b = within(&vector.direction_b, from_s, to_s);
    }
    piece
}

fn within<T: Clone>(series: &Series<T>, from_s: f64, to_s: f64) -> Series<T> {
    let pairs = series.time_s.iter().copied().zip(series.value.iter().cloned());
    pairs.filter(|(t, _)| (from_s..to_s).contains(t)).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Hanging still but for a touch from 40 s to 41 s.
    #[test]
    fn a_touch_is_left_out_with_its_margins() {
        let model = PlatformModel::whorl_1_reference();
        let mut run = Recording { name: "run".to_owned(), ..Recording::default() };
        for k in 0..10_000 {
            let t = f64::from(k) * 0.01;
            let tilt_rad: f64 = if (40.0..41.0).contains(&t) { 0.0875 } else { 0.02 };
            run.gyro_b_rad_s.time_s.push(t);
            run.gyro_b_rad_s.value.push(Vector3::zeros());
            run.specific_force_b_m_s2.time_s.push(t);
            run.specific_force_b_m_s2.value.push(Vector3::new(tilt_rad.sin(), 0.0, tilt_rad.cos()) * 9.81);
            run.wheel_torque_command_n_m.time_s.push(t);
            run.wheel_torque_command_n_m.value.push(vec![t, 0.0, 0.0]);
        }
        let mut remarks = Vec::new();
        let pieces = between_touches(&run, &model, &mut remarks);
        let ends = |run: &Recording| {
            let times = &run.gyro_b_rad_s.time_s;
            (times[0], times[times.len() - 1])
        };
        let ends: Vec<(f64, f64)> = pieces.iter().map(ends).collect();
        assert_eq!(ends.len(), 2, "{ends:?}");
        assert!((ends[0].1 - 39.7).abs() < 0.02 && (ends[1].0 - 41.3).abs() < 0.02, "{ends:?}");
        assert!(remarks[0].contains("1.6 s at the stop"), "{remarks:?}");
        // The command that holds when the second piece begins is its first.
        let held = pieces[1].wheel_torque_command_n_m.value[0][0];
        assert!((held - 41.3).abs() < 0.02, "{held}");
        // A rig without a stop is not cut.
        let mut free = model.clone();
        free.tilt_limit = whorl_dynamics::platform::TiltLimit::NONE;
        assert_eq!(between_touches(&run, &free, &mut remarks), [run.clone()]);
    }
}
