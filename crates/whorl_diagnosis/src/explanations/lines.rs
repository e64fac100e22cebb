//! Periodicities in the residual of a model, as they were found.

use nalgebra::Vector3;

/// A resonance that the motion drives.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Mode {
    pub hz: f64,
    pub damping_ratio: f64,
    /// Body axis that drives it and that it turns.
    pub axis_b: Vector3<f64>,
    /// Standard deviations by which it stands out.
    pub significance: f64,
}

/// Lines found in the spectrum of the residual \[Hz\].
#[derive(Debug, Clone, Default)]
pub(crate) struct Lines {
    pub torque_hz: Vec<f64>,
    pub sensor_hz: Vec<f64>,
    /// All that were noticed, the faint ones as well.
    pub faint_hz: Vec<f64>,
    /// Lines over the angle of a wheel: wheel, cycles per turn.
    pub orders: Vec<(usize, f64)>,
    /// Resonances that the motion drives.
    pub modes: Vec<Mode>,
    /// Standard deviations by which the strongest line stands out.
    pub strongest: f64,
}

/// Standard deviations of the normal law with the same tail as a sum of `degrees` exponential variates
/// (Wilson and Hilferty 1931).
pub(crate) fn gamma_significance(sum: f64, degrees: f64) -> f64 {
    let spread = 1.0 / (9.0 * degrees);
    ((sum / degrees).max(0.0).cbrt() - (1.0 - spread)) / spread.sqrt()
}
