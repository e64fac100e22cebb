//! Whether residuals are as large as the noise says, and what that means for deviations.

use whorl_math::statistics::chi_squared_quantile;

use whorl_recording::Finding;

/// A fit is bad when residuals as large as these are as rare as this.
const RARE: f64 = 1e-3;

/// Sum of squared residuals over their variances, and the residuals that are free.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Misfit {
    /// Sum of squares \[1\].
    pub chi_squared: f64,
    /// Residuals less the unknowns that they determine \[1\].
    pub dof: f64,
}

impl Misfit {
    /// Residuals over what their noise explains, root mean square \[1\]; `None` where none are free.
    #[must_use]
    pub fn ratio(&self) -> Option<f64> {
        (self.dof > 0.5).then(|| (self.chi_squared / self.dof).sqrt())
    }

    /// By how much variances grow: never less than one.
    #[must_use]
    pub fn inflation(&self) -> f64 {
        self.ratio().map_or(1.0, |ratio| ratio.powi(2).max(1.0))
    }

    /// Whether the noise explains the residuals; `None` where none are free.
    #[must_use]
    pub fn fits(&self) -> Option<bool> {
        let dof = self.dof.round();
        (dof >= 1.0).then(|| self.chi_squared < chi_squared_quantile(1.0 - RARE, dof as u32))
    }
}

/// The test of the residuals in words; `what` describes them.
pub(super) fn said(sensor: &str, misfit: &Misfit, what: &str) -> Option<Finding> {
    let ratio = misfit.ratio()?;
    match misfit.fits() {
        Some(false) => Some(Finding::warning(format!(
            "The data do not fit the model of the {sensor}: it leaves {what} {ratio:.1} times what the noise explains ({:.0} degrees of \
             freedom). All its deviations were multiplied by {ratio:.1}. Was it touched or warmed while it lay, or is something else \
             wrong with it?",
            misfit.dof
        ))),
        _ => None,
    }
}
