//! What Figures 4.10-4.20 show, said from their curves: no sentence is fixed.

/// Numbers of one run's curves.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Measures {
    /// Largest attitude error about any axis \[deg\].
    pub attitude_deg: f64,
    /// Largest error of any rate \[deg/s\].
    pub rate_deg_s: f64,
    /// Share of attitude errors inside three standard deviations \[1\].
    pub inside: f64,
    /// Largest error of the out-of-plane angle \[deg\].
    pub tilt_deg: f64,
    /// Largest out-of-plane angle \[deg\].
    pub deflection_deg: f64,
    /// Mean size of the clocking error over the first ten seconds \[deg\].
    pub clocking_begin_deg: f64,
    /// The same over the last ten.
    pub clocking_end_deg: f64,
    /// Length \[s\].
    pub seconds: f64,
}

impl Measures {
    /// Whether the clocking error grows: well beyond its begin, and beyond what could be scatter.
    fn drifts(&self) -> bool {
        self.clocking_end_deg > 2.0 * self.clocking_begin_deg && self.clocking_end_deg > 0.5
    }

    fn clocking(&self) -> String {
        format!(
            "the clocking error {} ({:.2} deg in the first ten seconds, {:.2} deg in the last of {:.0})",
            if self.drifts() { "drifts" } else { "does not drift" },
            self.clocking_begin_deg,
            self.clocking_end_deg,
            self.seconds
        )
    }
}

/// "As printed" or not, then what was found.
fn verdict(agrees: bool, printed: &str, found: &str) -> String {
    if agrees { format!("As printed: {found}.") } else { format!("Printed: {printed}. Here {found}.") }
}

/// The sentences of a figure; `runs` in the order of its parts.
pub fn of(name: &str, runs: &[Measures]) -> Vec<String> {
    let (Some(a), Some(b)) = (runs.first(), runs.last()) else { return Vec::new() };
    let tilt = format!("the out-of-plane angle is right to {:.3} deg", a.tilt_deg);
    let first = match name {
        "fig_4_10" => verdict(
            a.attitude_deg < 1.0 && a.rate_deg_s < 1.0,
            "estimates and truth cannot be told apart",
            &format!(
                "estimates differ from the truth by at most {:.2} deg and {:.2} deg/s",
                a.attitude_deg, a.rate_deg_s
            ),
        ),
        "fig_4_11" => verdict(
            a.inside > 0.98,
            "the three-sigma envelope holds the errors",
            &format!("the three-sigma envelope holds {:.1} % of the errors", 100.0 * a.inside),
        ),
        "fig_4_13" => verdict(
            a.deflection_deg > 1.0,
            "the out-of-plane angle swings by some degrees while the clocking angle grows",
            &format!(
                "the out-of-plane angle swings by up to {:.1} deg; the clocking angle is shown within +-180 deg",
                a.deflection_deg
            ),
        ),
        "fig_4_14" => verdict(!a.drifts(), "scatter without drift", &a.clocking()),
        "fig_4_15" => verdict(
            !a.drifts() && b.drifts(),
            "a poor second vector costs scatter, none at all lets the clocking angle drift",
            &format!("with a poor second vector {}; with none {}", a.clocking(), b.clocking()),
        ),
        "fig_4_16" => verdict(
            a.drifts() && b.clocking_end_deg > 1.3 * a.clocking_end_deg,
            "the clocking angle drifts by some degrees within 60 s, faster with the spin",
            &format!("{}; at twice the spin {}", a.clocking(), b.clocking()),
        ),
        "fig_4_17" => verdict(
            a.tilt_deg < 0.1 && a.clocking_end_deg < 0.5 * b.clocking_end_deg,
            "the out-of-plane angle is right at any deflection and clocking errs less than in the flat spin of Figure 4.16a",
            &format!("{tilt}, and {}, where in the flat spin {}", a.clocking(), b.clocking()),
        ),
        "fig_4_18" => verdict(
            a.clocking_end_deg > 30.0 && !b.drifts(),
            "the clocking angle of Whorl-I drifts by 90 deg in 60 s, that of Whorl-II does not",
            &format!("for Whorl-I {}, for Whorl-II {}", a.clocking(), b.clocking()),
        ),
        "fig_4_19" => verdict(
            a.drifts(),
            "clocking begins to drift after 60 s, from the gyro's bias about the vertical, which nothing observes",
            &format!("{tilt} and {}", a.clocking()),
        ),
        "fig_4_20" => verdict(
            a.tilt_deg < 0.1 && a.drifts(),
            "out-of-plane motion is followed and the spin estimate drifts",
            &format!("{tilt} and {}", a.clocking()),
        ),
        _ => return Vec::new(),
    };
    let conditions = match name {
        "fig_4_16" => Some(
            "Drift is the gyro's scale error times the rate of spin: 0.1 % is assumed; the dissertation does not say what its simulated sensors had.",
        ),
        "fig_4_18" => Some(
            "Clocking of a swing that passes through zero deflection jumps there: errors are of instants with a deflection of at least 1 deg. The filter keeps the gyro's bias apart. Whorl-II swings about its pitch axis with the inertia that params/whorl_2.yaml assumes (the dissertation prints none) and the same stiffness of 2 N m.",
        ),
        "fig_4_19" => Some("The printed data were measured; these are simulated."),
        "fig_4_20" => Some("The printed data were measured by hand; these are simulated."),
        _ => None,
    };
    std::iter::once(first).chain(conditions.map(str::to_owned)).collect()
}
