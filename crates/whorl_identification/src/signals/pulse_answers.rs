//! What the periodic pulses of the valves leave in fast samples.
//!
//! Pulses of jets come in slots, with all the harmonics of a slot, and sensors with filters, valves with delays and bodies
//! that ring respond to them a little differently from the model. All of that is a response to a known input and no vibration:
//! it is coherent with the pulses. So the part of a channel that a short linear filter of the pulses' torque explains is
//! subtracted before lines are looked for (the coherent part; Bendat and Piersol 2010, section 6.2).

use nalgebra::{DMatrix, DVector, Vector3};
use whorl_dynamics::PlatformModel;
use whorl_recording::Recording;

use super::fast::Fast;

/// Samples by which an answer may lag behind the pulses.
const LAGS: usize = 4;

/// Mean torque of the pulses over every sample's interval, body axes [N m].
fn pulse_torque(fast: &Fast<'_>, run: &Recording, model: &PlatformModel) -> Vec<Vector3<f64>> {
    let mut torque = vec![Vector3::zeros(); fast.len()];
    for (jet, pulses) in model.jets().iter().zip(&run.jet_pulses) {
        let own = jet.torque_b_n_m();
        for pulse in pulses {
            let at = |time_s: f64| (time_s - fast.start_s) / fast.step_s;
            let (on, off) = (at(pulse.on_s + jet.opening_delay_s), at(pulse.off_s + jet.closing_delay_s));
            let last = (off.ceil().max(0.0) as usize).min(torque.len().saturating_sub(1));
            for (index, slot) in torque.iter_mut().enumerate().take(last + 1).skip(on.max(0.0) as usize) {
                // The interval that ends with the sample.
                let end = index as f64;
                *slot += own * (end.min(off) - (end - 1.0).max(on)).clamp(0.0, 1.0);
            }
        }
    }
    torque
}

/// Takes off every channel what follows from the pulses.
pub(super) fn take_off(fast: &mut Fast<'_>, model: &PlatformModel) {
    if fast.run.recording.jet_pulses.iter().all(Vec::is_empty) {
        return;
    }
    let torque = pulse_torque(fast, fast.run.recording, model);
    // Accelerations, and the rates that they add up to.
    let mut inputs: Vec<Vec<f64>> = Vec::new();
    for axis in 0..3 {
        let along: Vec<f64> = torque.iter().map(|t| t[axis]).collect();
        let mut sum = 0.0;
        let integral: Vec<f64> = along
            .iter()
            .map(|x| {
                sum += x;
                sum
            })
            .collect();
        for series in [along, integral] {
            for lag in 0..LAGS {
                let delayed: Vec<f64> =
                    (0..series.len()).map(|i| i.checked_sub(lag).map_or(0.0, |at| series[at])).collect();
                inputs.push(delayed);
            }
        }
    }
    for sensor in 0..2 {
        let columns: Vec<Vec<f64>> = inputs
            .iter()
            .map(|input| {
                let mut column = input.clone();
                fast.fast_part(&mut column, sensor, 0);
                column
            })
            .collect();
        let size = columns.len();
        let mut normal = DMatrix::<f64>::zeros(size, size);
        for (i, a) in columns.iter().enumerate() {
            for (j, b) in columns.iter().enumerate().take(i + 1) {
                let product: f64 = a.iter().zip(b).map(|(x, y)| x * y).sum();
                (normal[(i, j)], normal[(j, i)]) = (product, product);
            }
        }
        // Columns that hold the same are not told apart, nor need they be.
        let scale = normal.diagonal().amax();
        if scale <= 0.0 {
            continue;
        }
        let Some(factor) = (normal + DMatrix::identity(size, size) * (1e-9 * scale)).cholesky() else {
            continue;
        };
        for channel in &mut fast.channel[3 * sensor..3 * sensor + 3] {
            let vector = DVector::from_iterator(
                size,
                columns.iter().map(|a| a.iter().zip(channel.iter()).map(|(x, y)| x * y).sum::<f64>()),
            );
            let answer = factor.solve(&vector);
            for (column, amount) in columns.iter().zip(answer.iter()) {
                for (y, x) in channel.iter_mut().zip(column) {
                    *y -= amount * x;
                }
            }
        }
    }
}
