//! The numbers of one run.

use std::io;

use whorl_msgs::whorl::FormationState;
use whorl_report::{RunData, Summary};

/// Relative errors below this count as settled \[rad\]: five times the estimators' error.
const SETTLED_RAD: f64 = 0.25 * std::f64::consts::PI / 180.0;

/// Names of the metrics, in the order of the table.
pub const METRICS: [&str; 16] = [
    "simulated_s",
    "relative_error_rms_deg",
    "relative_error_max_deg",
    "control_error_rms_deg",
    "estimator_error_rms_deg",
    "manoeuvre_error_max_deg",
    "settling_s",
    "pointing_error_rms_deg",
    "gas_used_g",
    "gas_evenness",
    "wheel_speed_max_rad_s",
    "alpha_min",
    "not_tracking_s",
    "link_age_max_s",
    "link_messages_per_s",
    "broadcasts_per_s",
];

/// Description of each of [`METRICS`].
pub const MEANINGS: [&str; METRICS.len()] = [
    "simulated time [s]",
    "relative pointing error in hold, RMS, of the worst pair [deg]",
    "relative pointing error in hold, largest [deg]",
    "the control's share of the relative error in hold, RMS [deg]",
    "the estimators' share of the relative error in hold, RMS [deg]",
    "relative error while the formation moves, largest, by the estimates [deg]",
    "longest time from the beginning of a movement until relative errors stay below 0.25 deg [s]",
    "pointing error to its own reference in hold, RMS, of the worst platform [deg]",
    "gas used by all platforms together [g]",
    "how evenly gas was used: 1 equally by all platforms, 0 by one alone",
    "largest wheel speed [rad/s]",
    "smallest attainable share of the requested torque",
    "time not tracking, of all platforms together [s]",
    "largest age of an estimate at the coordinator [s]",
    "messages from one computer to another, each receiver counted [1/s]",
    "broadcasts of platforms that the law triggers, where it counts them [1/s]",
];

/// A row of the table.
#[derive(Debug, Clone, PartialEq)]
pub struct Row {
    /// Number of the run.
    pub index: u64,
    /// Its experiment.
    pub experiment: String,
    /// Its seed.
    pub seed: u64,
    /// Its label on each axis.
    pub labels: Vec<String>,
    /// Finished, aborted, the phase at the end; or `refused` or `failed`.
    pub outcome: String,
    /// Why it was refused, failed or aborted; empty when it finished.
    pub reason: String,
    /// Values of [`METRICS`]; NaN where not available.
    pub metrics: Vec<f64>,
}

/// Traffic over the links of a run.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Traffic {
    /// Messages that were sent from one computer to another.
    pub link_messages: u64,
    /// Broadcasts of platforms to their neighbours, where the law counts them.
    pub broadcasts: Option<u64>,
}

/// The metrics of a finished run.
#[must_use]
pub fn metrics(data: &RunData, summary: &Summary, simulated_s: f64, traffic: &Traffic) -> Vec<f64> {
    let worst =
        |values: &mut dyn Iterator<Item = f64>| values.filter(|v| v.is_finite()).fold(f64::NAN, f64::max);
    let pairs = || summary.pairs.iter();
    let platforms = || summary.platforms.iter();
    let gas: Vec<f64> = platforms().map(|p| p.gas_used_kg).collect();
    let (settling_s, manoeuvre_rad) = settling(data);
    vec![
        simulated_s,
        worst(&mut pairs().map(|p| p.relative_error_rms_rad)).to_degrees(),
        worst(&mut pairs().map(|p| p.relative_error_max_rad)).to_degrees(),
        worst(&mut pairs().map(|p| p.control_error_rms_rad)).to_degrees(),
        worst(&mut pairs().map(|p| p.estimator_error_rms_rad)).to_degrees(),
        manoeuvre_rad.to_degrees(),
        settling_s,
        worst(&mut platforms().map(|p| p.pointing_error_rms_rad)).to_degrees(),
        gas.iter().sum::<f64>() * 1e3,
        evenness(&gas),
        worst(&mut platforms().map(|p| p.wheel_speed_max_rad_s)),
        platforms().map(|p| p.alpha_min).filter(|a| a.is_finite()).fold(f64::NAN, f64::min),
        platforms().map(|p| p.not_tracking_s).sum(),
        worst(&mut platforms().map(|p| p.link_age_max_s)),
        traffic.link_messages as f64 / simulated_s.max(1e-9),
        traffic.broadcasts.map_or(f64::NAN, |b| b as f64 / simulated_s.max(1e-9)),
    ]
}

/// How evenly something is spread: the entropy of its shares over that of equal shares (R. W. Beard, F. Y.
/// Hadaegh). 1: even; 0: one has everything; NaN: the total is zero.
#[must_use]
pub fn evenness(amounts: &[f64]) -> f64 {
    let total: f64 = amounts.iter().sum();
    if total.is_nan() || total <= 0.0 || amounts.len() < 2 {
        return f64::NAN;
    }
    let entropy: f64 = amounts.iter().map(|a| a / total).filter(|p| *p > 0.0).map(|p| -p * p.ln()).sum();
    entropy / (amounts.len() as f64).ln()
}

/// Longest time from the beginning of a movement until all relative errors stay settled \[s\], and the
/// largest relative error of movements after the first settling \[rad\]; from the estimates.
fn settling(data: &RunData) -> (f64, f64) {
    let (mut longest_s, mut largest_rad) = (f64::NAN, f64::NAN);
    let (mut began_s, mut before) = (f64::NAN, FormationState::PHASE_READY);
    for state in &data.formation {
        let m = &state.message;
        let moving = matches!(m.phase, FormationState::PHASE_SETTLE | FormationState::PHASE_MANOEUVRE);
        let running = moving || m.phase == FormationState::PHASE_HOLD;
        if moving && before != m.phase {
            began_s = state.stamp_s;
        }
        before = m.phase;
        if !running {
            continue;
        }
        let followers = m.relative_error_rad.iter().zip(&m.leader).filter(|(_, leader)| **leader >= 0);
        let error = followers
            .map(|(e, _)| nalgebra::Vector3::from(*e).norm())
            .filter(|e| e.is_finite())
            .fold(0.0, f64::max);
        if error > SETTLED_RAD {
            longest_s = longest_s.max(state.stamp_s - began_s);
        } else if longest_s.is_nan() {
            longest_s = 0.0;
        }
        if m.phase == FormationState::PHASE_MANOEUVRE {
            largest_rad = largest_rad.max(error);
        }
    }
    (longest_s, largest_rad)
}

fn csv_error(error: impl std::fmt::Display) -> io::Error {
    io::Error::other(error.to_string())
}

/// A row as a line of CSV.
pub(crate) fn row_text(row: &Row) -> String {
    let mut writer = csv::Writer::from_writer(Vec::new());
    // Writing to memory cannot fail.
    let _ = writer.write_record(record(row));
    let bytes = writer.into_inner().unwrap_or_default();
    String::from_utf8(bytes).unwrap_or_default()
}

pub(crate) fn record(row: &Row) -> Vec<String> {
    let head = [row.index.to_string(), row.experiment.clone(), row.seed.to_string()];
    let outcome = [row.outcome.clone(), row.reason.clone()];
    // Shortest text that reads back to the same number; empty for NaN.
    let number = |v: &f64| if v.is_nan() { String::new() } else { format!("{v:?}") };
    head.into_iter()
        .chain(row.labels.iter().cloned())
        .chain(outcome)
        .chain(row.metrics.iter().map(number))
        .collect()
}

/// A row of a line of CSV of a campaign with so many axes.
pub(crate) fn parse_row(text: &str, axes: usize) -> io::Result<Row> {
    let mut reader = csv::ReaderBuilder::new().has_headers(false).from_reader(text.as_bytes());
    let record = reader.records().next().ok_or_else(|| csv_error("an empty row"))?.map_err(csv_error)?;
    let field = |k: usize| record.get(k).unwrap_or_default();
    if record.len() != 5 + axes + METRICS.len() {
        return Err(csv_error(format!(
            "a row with {} columns; the campaign has {}",
            record.len(),
            5 + axes + METRICS.len()
        )));
    }
    let number = |k: usize| match field(k) {
        "" => Ok(f64::NAN),
        text => text.parse().map_err(csv_error),
    };
    Ok(Row {
        index: field(0).parse().map_err(csv_error)?,
        experiment: field(1).to_owned(),
        seed: field(2).parse().map_err(csv_error)?,
        labels: (0..axes).map(|k| field(3 + k).to_owned()).collect(),
        outcome: field(3 + axes).to_owned(),
        reason: field(4 + axes).to_owned(),
        metrics: (0..METRICS.len()).map(|k| number(5 + axes + k)).collect::<io::Result<_>>()?,
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn evenness_is_one_for_equal_shares_and_zero_for_one_alone() {
        assert!((evenness(&[2.0, 2.0, 2.0]) - 1.0).abs() < 1e-12);
        assert_eq!(evenness(&[0.0, 5.0]), 0.0);
        // Entropy of (1/4, 3/4) in bits.
        assert!((evenness(&[1.0, 3.0]) - 0.811_278_124_459_132_8).abs() < 1e-12);
        assert!(evenness(&[0.0, 0.0]).is_nan() && evenness(&[1.0]).is_nan());
    }
}
