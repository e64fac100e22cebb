//! First-order low-pass of a sensor's input.

use nalgebra::Vector3;

/// Output of tau dy/dt = x - y after `elapsed_s`, for an input x that goes along a straight line from `from` to `to`
/// (exact, and stable for any step); `output` is that at the start. Without a time constant the output is the input.
///
/// An averaging window of length T has the same delay as tau = T/2 and attenuates slow motion a third as much:
/// 1 - (w T/2)^2/6 against 1 - (w tau)^2/2.
#[must_use]
pub fn low_passed(
    output: &Vector3<f64>,
    from: &Vector3<f64>,
    to: &Vector3<f64>,
    elapsed_s: f64,
    tau_s: f64,
) -> Vector3<f64> {
    if tau_s <= 0.0 {
        return *to;
    }
    if elapsed_s <= 0.0 {
        return *output;
    }
    // On a straight line the output follows the input by tau times its slope.
    let behind = (to - from) * (tau_s / elapsed_s);
    to - behind + (output - from + behind) * (-elapsed_s / tau_s).exp()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_step_and_a_ramp_are_followed_as_printed() {
        let (zero, one) = (Vector3::zeros(), Vector3::repeat(1.0));
        for tau_s in [1e-4, 0.01, 0.3] {
            // Step response 1 - exp(-t/tau), in one step or in many.
            let whole = low_passed(&zero, &one, &one, 0.02, tau_s);
            assert!((whole.x - (1.0 - f64::exp(-0.02 / tau_s))).abs() < 1e-15);
            let many = (0..20).fold(zero, |y, _| low_passed(&y, &one, &one, 1e-3, tau_s));
            assert!((many - whole).norm() < 1e-14);
            // A ramp from rest: t - tau + tau exp(-t/tau).
            let ramp = low_passed(&zero, &zero, &(one * 0.02), 0.02, tau_s);
            assert!((ramp.y - (0.02 - tau_s + tau_s * f64::exp(-0.02 / tau_s))).abs() < 1e-15);
        }
        assert_eq!(low_passed(&zero, &zero, &one, 0.02, 0.0), one);
        assert_eq!(low_passed(&zero, &one, &one, 0.0, 0.1), zero);
    }
}
