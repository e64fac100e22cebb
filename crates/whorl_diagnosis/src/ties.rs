//! Parameters of effects that recordings do not tell apart.

use whorl_dynamics::Effect;
use whorl_dynamics::effects::{Role, find};
use whorl_math::three_digits;
use whorl_prediction::{Fitted, Rival, Settings};
use whorl_recording::Recording;

use crate::parameters::Column;
use crate::refit::{Fit, Refit};
use crate::{DiagnosisError, Options};

/// A ratio this close to one, or to minus one, goes without saying.
const SAME: f64 = 0.02;

/// Deviations of both parameters of a tie are at least so many times that of their combination.
const TIED: f64 = 5.0;

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

impl Fit {
    /// What is not told apart is left open: of each of the two no more is known than that, also for a fit that comes after, and the
    /// second is in the model, if only with its neutral value.
    pub(crate) fn take_ties(&mut self, ties: Vec<Tie>) {
        for tie in &ties {
            for ((effect, name), stddev) in tie.parameters.iter().zip(tie.stddevs) {
                let specs = find(effect).map(|of| of.parameters(&self.model)).unwrap_or_default();
                let neutral = specs.iter().find(|spec| spec.name == *name).map_or(0.0, |spec| spec.neutral);
                self.model.effects.entry(effect.clone()).or_default().entry(name.clone()).or_insert(neutral);
                let known = self.prior.effects.entry(effect.clone()).or_default().entry(name.clone());
                known.and_modify(|known| *known = known.max(stddev)).or_insert(stddev);
            }
        }
        self.ties = ties;
    }
}

impl Refit<'_> {
    /// Pairs of parameters of these effects of which a combination is known at least [`TIED`] times as well as either, as the
    /// covariance of fitted values says. Amplitudes of an effect that took no part in the fit are asked about as well: that they
    /// were not needed does not mean that they are zero.
    pub fn ties(
        &self,
        recordings: &[Recording],
        fitted: &Fitted,
        effects: &[&'static dyn Effect],
        options: &Options,
    ) -> Result<Vec<Tie>, DiagnosisError> {
        let mut wide =
            Refit { reference: self.reference, columns: self.columns.clone(), stddevs: self.stddevs.clone() };
        // Constants of the platform are not effects of the model.
        let effects = || effects.iter().filter(|effect| !effect.is_base());
        effects().for_each(|effect| wide.add_amplitudes(*effect));
        let is_of_effect = |column: &Column| effects().any(|effect| effect.info().id == column.group);
        let of_effects: Vec<usize> =
            (0..wide.columns.len()).filter(|i| is_of_effect(&wide.columns[*i])).collect();
        let covariance = if wide.columns.len() == self.columns.len() {
            fitted.covariance.clone()
        } else {
            let mut start = fitted.at.clone();
            start.resize(wide.columns.len(), 0.0);
            let settings = Settings { threads: options.threads, ..Settings::default() };
            wide.likeliest(recordings, &[start], Rival::NONE, &settings)?.covariance
        };
        let estimate = |i: usize| fitted.at.get(i).copied().unwrap_or(0.0) * wide.columns[i].scale;
        let mut ties = Vec::new();
        for (k, &i) in of_effects.iter().enumerate() {
            for &j in &of_effects[k + 1..] {
                let (first, second) = (&wide.columns[i], &wide.columns[j]);
                let in_units =
                    |a: usize, b: usize| covariance[(a, b)] * wide.columns[a].scale * wide.columns[b].scale;
                let variances = [in_units(i, i), in_units(j, j)];
                let ratio = -in_units(i, j) / variances[1];
                let variance = (variances[0] + ratio * in_units(i, j)).max(0.0);
                let is_tied = variances[0] > TIED * TIED * variance
                    && ratio * ratio * variances[1] > TIED * TIED * variance;
                if is_tied {
                    ties.push(Tie {
                        parameters: [first, second].map(|c| (c.group.to_owned(), c.name.clone())),
                        unit: first.unit.to_owned(),
                        ratio,
                        value: estimate(i) + ratio * estimate(j),
                        stddev: variance.sqrt(),
                        stddevs: variances.map(f64::sqrt),
                    });
                }
            }
        }
        Ok(ties)
    }

    /// Adds the amplitudes of an effect that are not among the parameters, as large as those that are.
    fn add_amplitudes(&mut self, effect: &'static dyn Effect) {
        let specs = effect.parameters(&self.reference.model);
        let own = |column: &Column| column.group == effect.info().id;
        let sizes = self.columns.iter().zip(&self.stddevs).filter(|(column, _)| own(column));
        let size = sizes.map(|(column, stddev)| stddev / column.catalogue_stddev).fold(1.0, f64::max);
        for column in self.reference.parameter_columns(effect) {
            let is_amplitude = specs.get(column.index).is_some_and(|spec| spec.role == Role::Amplitude);
            if is_amplitude && !self.columns.iter().any(|c| own(c) && c.index == column.index) {
                self.stddevs.push(size * column.catalogue_stddev);
                self.columns.push(column);
            }
        }
    }
}
