//! Noise from stamps that jitter: a change of a command has an impulse that is uncertain by the jitter.

use whorl_dynamics::gyrostat::MAX_WHEELS;
use whorl_recording::{OnInterval, Series};

/// Noise that the jitter of the stamps makes of a command that changes [N m sqrt(s)], for each wheel.
pub(crate) fn command_jitter(commands: &Series<Vec<f64>>, jitter_s: f64) -> [f64; MAX_WHEELS] {
    let mut squares = [0.0; MAX_WHEELS];
    for pair in commands.value.windows(2) {
        let [before, after] = pair else { continue };
        for ((slot, a), b) in squares.iter_mut().zip(before).zip(after) {
            *slot += (b - a).powi(2);
        }
    }
    let span_s = match (commands.time_s.first(), commands.time_s.last()) {
        (Some(first), Some(last)) => (last - first).max(1e-3),
        _ => return [0.0; MAX_WHEELS],
    };
    squares.map(|x| jitter_s * (x / span_s).sqrt())
}

/// Times of all edges of all pulses, in order, with the jet of each \[s\].
pub(crate) fn edges(pulses: &[Vec<OnInterval>]) -> Vec<(f64, usize)> {
    let mut edges: Vec<(f64, usize)> = pulses
        .iter()
        .enumerate()
        .flat_map(|(j, list)| list.iter().flat_map(move |p| [(p.on_s, j), (p.off_s, j)]))
        .collect();
    edges.sort_by(|a, b| a.0.total_cmp(&b.0));
    edges
}

#[cfg(test)]
mod tests {
    use whorl_recording::Series;

    use super::command_jitter;

    #[test]
    fn a_command_that_steps_each_sample_has_an_impulse_as_uncertain_as_its_stamps() {
        // Steps of 0.01 N m a hundred times a second, 1 ms of jitter: sqrt(100) * 0.01 * 1e-3.
        let value = (0..1001).map(|i| vec![if i % 2 == 0 { 0.0 } else { 0.01 }]).collect();
        let commands = Series { time_s: (0..1001).map(|i| 0.01 * f64::from(i)).collect(), value };
        assert!((command_jitter(&commands, 1e-3)[0] - 1e-4).abs() < 1e-9);
    }
}
