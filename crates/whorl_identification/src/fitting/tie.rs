//! Parameters that recordings do not tell apart.

use whorl_math::three_digits;

/// A ratio this close to one, or to minus one, goes without saying.
const SAME: f64 = 0.02;

/// Two parameters of which a combination is known and neither by itself.
#[derive(Debug, Clone, PartialEq)]
pub struct Tie {
    /// Effect and name of each; the second may have taken no part in the fit.
    pub parameters: [(String, String); 2],
    /// Unit of the first and of the combination; that of the ratio is it over the second's.
    pub unit: String,
    /// The combination is the first plus so many times the second.
    pub ratio: f64,
    /// Its value.
    pub value: f64,
    /// Its standard deviation.
    pub stddev: f64,
    /// Standard deviations of the two, whatever the other is.
    pub stddevs: [f64; 2],
}

impl Tie {
    /// `body_z_n_m + vertical_n_m`; the second with its effect where that is another.
    pub fn combination(&self) -> String {
        let [(effect, first), (other, second)] = &self.parameters;
        let sign = if self.ratio < 0.0 { "-" } else { "+" };
        let size = self.ratio.abs();
        let by = if (size - 1.0).abs() < SAME { String::new() } else { format!("{} ", three_digits(size)) };
        let of = if other == effect { String::new() } else { format!("{other}.") };
        format!("{first} {sign} {by}{of}{second}")
    }
}
