//! Thrust that builds up and tails off.

use super::named::{Named as _, parameters};
use super::{Effect, EffectInfo, EffectKind, Evidence, Grouping, Need, ParameterSpec, Regressed};
use crate::PlatformModel;

#[derive(Debug)]
pub(super) struct ThrusterRise;

static INFO: EffectInfo = EffectInfo {
    id: "thruster_rise",
    title: "gradual build-up and tail-off of thrust",
    explanation: "The volume behind the nozzle fills through the valve and empties through the nozzle, so thrust follows the valve with a lag of its own either way: a tail after each edge, and more or less impulse as emptying takes longer or shorter than filling.",
    equation: "open: tau df/dt = 1 - f; shut: (2 - n) r tau df/dt = -f^n, r = tail_ratio, n = tail_exponent; F = F_nominal f",
    source: "gas in a small volume behind a choked nozzle: dp/dt ~ -p sqrt(T), T ~ p^((gamma-1)/gamma) when isentropic, so n = 1 + (gamma-1)/(2 gamma): 8/7 for nitrogen, 6/5 for helium, 1 when walls keep the gas warm (Shapiro, The Dynamics and Thermodynamics of Compressible Fluid Flow, blow-down of a vessel); r tau F is the impulse of the whole tail; solved in closed form between valve edges",
    kind: EffectKind::Actuator,
    confusable_with: &["thruster_delay", "thruster_strength"],
    separated_by: "one jet alone, two pulse lengths, the shorter no longer than the lag",
    is_passive: false,
};

parameters! {
    Lag(_model: PlatformModel) {
        tau_s: f64 = ParameterSpec::new("tau_s", "s", (0.0, 0.5), 0.01, "Time constant of build-up, all jets."),
        // While the supply is choked in the valve, filling and emptying both take the volume over the nozzle's
        // flow; as far as it is not, they differ.
        tail_ratio: f64 = ParameterSpec::new(
            "tail_ratio",
            "1",
            (0.5, 2.0),
            0.15,
            "Time of tail-off (impulse of the tail over full thrust) over that of build-up.",
        )
        .with_neutral(1.0)
        .shape()
        .regressed(Regressed::WithAmplitude),
        tail_exponent: f64 = ParameterSpec::new(
            "tail_exponent",
            "1",
            (1.0, 1.2),
            0.1,
            "Exponent of the tail-off: 1 isothermal, 8/7 isentropic nitrogen, 6/5 a monatomic gas.",
        )
        .with_neutral(1.0)
        .shape()
        .regressed(Regressed::WithAmplitude),
    }
}

impl Effect for ThrusterRise {
    fn info(&self) -> &'static EffectInfo {
        &INFO
    }

    fn parameters(&self, model: &PlatformModel) -> Vec<ParameterSpec> {
        Lag::specs(model)
    }

    fn thrust_lag(&self, values: &[f64]) -> ThrustLag {
        let lag = Lag::of(values);
        ThrustLag {
            rise_s: lag.tau_s,
            tail_s: lag.tau_s * lag.tail_ratio,
            tail_exponent: lag.tail_exponent,
        }
    }

    fn evidence(&self) -> Evidence {
        &[&[Need::Jets]]
    }

    fn grouping(&self) -> Grouping {
        // The shape of a tail has no meaning by itself.
        Grouping::All
    }
}

/// Lag of a jet's thrust behind its valve: while the valve is open the share f of full thrust follows
/// rise df/dt = 1 - f, while it is shut (2 - n) tail df/dt = -f^n. Times in seconds; 0 = immediate.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ThrustLag {
    /// Time constant of the build-up \[s\].
    pub rise_s: f64,
    /// Impulse of the whole tail over full thrust \[s\]; with n = 1 the time constant of the tail-off.
    pub tail_s: f64,
    /// Exponent n of the tail-off, 1 <= n < 2.
    pub tail_exponent: f64,
}

impl Default for ThrustLag {
    fn default() -> Self {
        Self { rise_s: 0.0, tail_s: 0.0, tail_exponent: 1.0 }
    }
}

impl ThrustLag {
    /// Thrust follows the valve at once.
    #[must_use]
    pub fn is_none(&self) -> bool {
        self.rise_s <= 0.0 && self.tail_s <= 0.0
    }

    /// Share of full thrust `elapsed_s` after an edge at which it was `start`.
    #[must_use]
    pub fn fraction(&self, start: f64, is_open: bool, elapsed_s: f64) -> f64 {
        let tau_s = if is_open { self.rise_s } else { self.tail_s * (2.0 - self.tail_exponent) };
        let target = f64::from(u8::from(is_open));
        if tau_s <= 0.0 {
            return target;
        }
        let x = elapsed_s / tau_s;
        if is_open {
            return 1.0 - (1.0 - start) * (-x).exp();
        }
        if start <= 0.0 {
            return 0.0;
        }
        // f^(1-n) grows by (n - 1) x; in logarithms, so that n = 1 is its own limit.
        let over = self.tail_exponent - 1.0;
        let y = x * start.powf(over);
        start * (-(if over > 1e-9 { (over * y).ln_1p() / over } else { y })).exp()
    }

    /// Integral of [`Self::fraction`] over the time since the edge: seconds of full thrust.
    #[must_use]
    pub fn impulse_s(&self, start: f64, is_open: bool, elapsed_s: f64) -> f64 {
        let now = self.fraction(start, is_open, elapsed_s);
        if is_open {
            return elapsed_s - self.rise_s.max(0.0) * (now - start).max(0.0);
        }
        self.tail_impulse_s(start) - self.tail_impulse_s(now)
    }

    /// Impulse of the whole tail from this share of full thrust, in seconds of full thrust.
    fn tail_impulse_s(&self, share: f64) -> f64 {
        self.tail_s.max(0.0) * share.max(0.0).powf(2.0 - self.tail_exponent)
    }

    /// Impulse of one pulse from rest with its whole tail, in seconds of full thrust, for a valve that is
    /// open for `open_s`.
    #[must_use]
    pub fn pulse_impulse_s(&self, open_s: f64) -> f64 {
        if open_s <= 0.0 {
            return 0.0;
        }
        let reached = self.fraction(0.0, true, open_s);
        self.impulse_s(0.0, true, open_s) + self.tail_impulse_s(reached)
    }

    /// How long the valve must be open for [`Self::pulse_impulse_s`] to be `impulse_s`.
    #[must_use]
    pub fn open_for_impulse_s(&self, impulse_s: f64) -> f64 {
        if impulse_s <= 0.0 || self.is_none() {
            return impulse_s.max(0.0);
        }
        // The impulse grows with the open time; the rise costs its time constant at most, and the tail gives
        // its whole at most: the answer lies between these two, and 60 halvings are exact to rounding.
        let (mut low, mut high) = ((impulse_s - self.tail_s).max(0.0), impulse_s + self.rise_s);
        for _ in 0..60 {
            let middle = 0.5 * (low + high);
            if self.pulse_impulse_s(middle) < impulse_s {
                low = middle;
            } else {
                high = middle;
            }
        }
        0.5 * (low + high)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Impulse of one pulse by small steps of the differential equation.
    fn stepped(lag: ThrustLag, open_s: f64) -> f64 {
        let step_s = 1e-6;
        let (mut flow, mut impulse_s) = (0.0_f64, 0.0);
        for k in 0..((open_s + 2.0) / step_s) as usize {
            let is_open = (k as f64 + 0.5) * step_s < open_s;
            let rate = if is_open {
                (1.0 - flow) / lag.rise_s
            } else {
                -flow.max(0.0).powf(lag.tail_exponent) / (lag.tail_s * (2.0 - lag.tail_exponent))
            };
            impulse_s += (flow + 0.5 * rate * step_s) * step_s;
            flow += rate * step_s;
        }
        impulse_s
    }

    #[test]
    fn a_pulse_has_the_impulse_of_its_differential_equation_and_finds_its_open_time_back() {
        for (rise_s, tail_s, tail_exponent) in
            [(0.01, 0.04, 1.0), (0.03, 0.01, 8.0 / 7.0), (0.02, 0.02, 1.2), (0.02, 0.02, 1.0)]
        {
            let lag = ThrustLag { rise_s, tail_s, tail_exponent };
            for open_s in [0.004, 0.02, 0.2] {
                let impulse_s = lag.pulse_impulse_s(open_s);
                assert!((impulse_s - stepped(lag, open_s)).abs() < 2e-6, "{lag:?} {open_s}");
                assert!((lag.open_for_impulse_s(impulse_s) - open_s).abs() < 1e-12);
            }
        }
        // Long pulses differ by the difference of the times; without a lag nothing changes.
        let lag = ThrustLag { rise_s: 0.01, tail_s: 0.04, ..ThrustLag::default() };
        assert!((lag.pulse_impulse_s(1.0) - 1.03).abs() < 1e-12);
        assert_eq!(ThrustLag::default().pulse_impulse_s(0.1), 0.1);
        assert_eq!(ThrustLag::default().open_for_impulse_s(0.1), 0.1);
        assert_eq!(lag.pulse_impulse_s(-0.1), 0.0);
    }

    /// Isentropic nitrogen: p = (1 + (gamma - 1)/2 t/t0)^(-2 gamma/(gamma - 1)) from full pressure, the printed
    /// blow-down of a vessel; its integral is t0/1.2.
    #[test]
    fn the_tail_is_the_blow_down_of_a_vessel() {
        let (gamma, t0_s) = (1.4, 0.03);
        let lag = ThrustLag { rise_s: 0.0, tail_s: t0_s / 1.2, tail_exponent: 8.0 / 7.0 };
        for time_s in [0.0, 0.01, 0.05, 0.3] {
            let printed = (1.0 + 0.5 * (gamma - 1.0) * time_s / t0_s).powf(-2.0 * gamma / (gamma - 1.0));
            assert!((lag.fraction(1.0, false, time_s) - printed).abs() < 1e-12, "{time_s}");
        }
    }
}
