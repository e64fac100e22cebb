//! Parameters of effects that recordings do not tell apart.

use nalgebra::DMatrix;
use whorl_dynamics::effects::find;
use whorl_dynamics::{ModelPrior, PlatformModel};
use whorl_math::three_digits;

use crate::parameter_space::Column;

/// A ratio this close to one, or to minus one, goes without saying.
const SAME: f64 = 0.02;

/// Deviations of both parameters of a tie are at least so many times that of their combination.
const TIED: f64 = 10.0;

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
    #[must_use]
    pub fn combination(&self) -> String {
        let [(effect, first), (other, second)] = &self.parameters;
        let sign = if self.ratio < 0.0 { "-" } else { "+" };
        let size = self.ratio.abs();
        let times =
            if (size - 1.0).abs() < SAME { String::new() } else { format!("{} ", three_digits(size)) };
        let of = if other == effect { String::new() } else { format!("{other}.") };
        format!("{first} {sign} {times}{of}{second}")
    }
}

/// Pairs of fitted parameters, of those that `is_asked` chooses, of which a combination is known at least [`TIED`] times as well as
/// either, as the covariance says. `at` are the values in units; parameters behind them took no part in the fit.
pub(crate) fn ties(
    columns: &[Column],
    at: &[f64],
    covariance: &DMatrix<f64>,
    is_asked: impl Fn(&Column) -> bool,
) -> Vec<Tie> {
    let asked: Vec<(usize, &Column)> = columns.iter().enumerate().filter(|(_, of)| is_asked(of)).collect();
    let estimate = |(i, of): (usize, &Column)| at.get(i).copied().unwrap_or(0.0) * of.scale;
    let in_units =
        |(i, a): (usize, &Column), (j, b): (usize, &Column)| covariance[(i, j)] * a.scale * b.scale;
    let mut ties = Vec::new();
    for (k, &first) in asked.iter().enumerate() {
        for &second in &asked[k + 1..] {
            let variances = [in_units(first, first), in_units(second, second)];
            let ratio = -in_units(first, second) / variances[1];
            let variance = (variances[0] + ratio * in_units(first, second)).max(0.0);
            let least = TIED * TIED * variance;
            if variances[0] > least && ratio * ratio * variances[1] > least {
                ties.push(Tie {
                    parameters: [first, second].map(|(_, of)| (of.group.to_owned(), of.name.clone())),
                    unit: first.1.unit.to_owned(),
                    ratio,
                    value: estimate(first) + ratio * estimate(second),
                    stddev: variance.sqrt(),
                    stddevs: variances.map(f64::sqrt),
                });
            }
        }
    }
    ties
}

/// What is not told apart is left open: of each of the two no more is known than that, also for a fit that comes after, and the
/// second is in the model, if only with its neutral value.
pub(crate) fn leave_open(ties: &[Tie], model: &mut PlatformModel, prior: &mut ModelPrior) {
    for tie in ties {
        for ((effect, name), stddev) in tie.parameters.iter().zip(tie.stddevs) {
            let specs = find(effect).map(|of| of.parameters(model)).unwrap_or_default();
            let neutral = specs.iter().find(|spec| spec.name == *name).map_or(0.0, |spec| spec.neutral);
            model.effects.entry(effect.clone()).or_default().entry(name.clone()).or_insert(neutral);
            let known = prior.effects.entry(effect.clone()).or_default().entry(name.clone());
            known.and_modify(|known| *known = known.max(stddev)).or_insert(stddev);
        }
    }
}
