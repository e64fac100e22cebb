//! A verdict is held against the error that remains.

use crate::verdict::answer::{advice, merge};
use crate::{Diagnosis, Settings, Unknown, Verdict};

impl Diagnosis {
    /// The same, held against errors of predictions of the model with its effects on training and held-out runs, times the noise. Far from it on either
    /// something is missing, beside what has a name; at the noise on runs that took no part, if there are any, nothing without a name is.
    pub fn held_against(mut self, training: Option<f64>, held_out: Option<f64>, settings: &Settings) -> Self {
        let Some(error) = held_out.or(training) else { return self };
        let largest = error.max(training.unwrap_or(error));
        let is_withheld = self.explanations.is_empty();
        let is_good = error <= settings.at_the_noise && largest <= settings.above_the_noise;
        // Sensors that contradict each other, which has no size, do so at any error: it is taken in units of noise that they show.
        let is_law = |unknown: &mut Unknown| unknown.variable != "gyro_rate" || unknown.size != 0.0;
        if let Some(unknown) = self.unknown.take_if(|unknown| is_good && is_law(unknown)) {
            self.remarks.push(format!(
                "A law of {} explains a little more, but the model predicts to within {:.0} % of what noise allows without it.",
                unknown.variable,
                (100.0 * (error - 1.0)).ceil().max(1.0)
            ));
            let silent =
                if self.would_have_shown { Verdict::NothingMissing } else { Verdict::NotEnoughInformation };
            self.verdict = if self.verdict == Verdict::Unknown { silent } else { self.verdict };
        } else if largest > settings.above_the_noise && self.unknown.is_none() && !is_withheld {
            self.remarks
                .push(format!("Predictions err by {largest:.1} times the noise with all that has a name."));
            // The likeliest law beside the effects that are named.
            let laws =
                self.fitted.iter().filter(|set| set.effects == self.effects && set.termination.is_none());
            let law = laws.max_by(|a, b| a.log_posterior.total_cmp(&b.log_posterior));
            let nothing_known = || Unknown { share: 0.0, ..Unknown::torque_in_time(0.0) };
            self.unknown = Some(law.and_then(|law| law.unmodelled.clone()).unwrap_or_else(nothing_known));
            self.verdict = if self.effects.is_empty() { Verdict::Unknown } else { self.verdict };
        } else {
            return self;
        }
        let with_unknown = self.unknown.is_some();
        self.explanations.iter_mut().for_each(|explanation| explanation.with_unknown = with_unknown);
        merge(&mut self.explanations);
        if self.effects.is_empty() {
            self.next = advice(self.verdict, &self.candidates);
        }
        self
    }
}

#[cfg(test)]
mod tests;
