//! A part of a recording.

use crate::{Recording, Series};

/// What was measured of a run from one time to before another, with everything that was commanded; of wheels the command that holds at the
/// start, so that nothing has to be known of the motion before.
pub fn stretch(run: &Recording, from_s: f64, to_s: f64) -> Recording {
    fn cut<T: Clone>(series: &Series<T>, from_s: f64, to_s: f64) -> Series<T> {
        let pairs = series.time_s.iter().copied().zip(series.value.iter().cloned());
        pairs.filter(|(t, _)| (from_s..to_s).contains(t)).collect()
    }
    let commands = &run.wheel_torque_command_n_m;
    let held_s = commands.time_s.iter().rfind(|t| **t <= from_s).copied().unwrap_or(from_s);
    let mut part = Recording {
        gyro_b_rad_s: cut(&run.gyro_b_rad_s, from_s, to_s),
        specific_force_b_m_s2: cut(&run.specific_force_b_m_s2, from_s, to_s),
        wheel_speed_rad_s: cut(&run.wheel_speed_rad_s, from_s, to_s),
        wheel_torque_command_n_m: cut(commands, held_s, f64::INFINITY),
        ..run.clone()
    };
    part.vectors.iter_mut().for_each(|of| of.direction_b = cut(&of.direction_b, from_s, to_s));
    part
}
