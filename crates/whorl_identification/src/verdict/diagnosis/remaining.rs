//! A verdict is held against the error that remains.

use crate::verdict::answer::{advice, merge};
use crate::{Diagnosis, Settings, Unknown, Verdict};

impl Diagnosis {
    /// The same, held against the errors of predictions that the model with its effects leaves on training and held-out runs, times the noise. Far from the
    /// noise on either something is missing, beside what has a name; at the noise on runs that took no part, if there are any, nothing without a name is.
    #[must_use]
    pub fn held_against(mut self, training: Option<f64>, held_out: Option<f64>, settings: &Settings) -> Self {
        let Some(error) = held_out.or(training) else { return self };
        let largest = error.max(training.unwrap_or(error));
        let is_withheld = self.explanations.is_empty();
        let is_good = error <= settings.at_the_noise && largest <= settings.above_the_noise;
        // Sensors that contradict each other do so at any error: it is taken in units of noise that they show.
        let is_law = |unknown: &mut Unknown| !unknown.is_contradiction();
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
mod tests {
    use super::*;
    use crate::Explanation;

    fn with(verdict: Verdict, effects: &[&str], unknown: bool) -> Diagnosis {
        let effects: Vec<String> = effects.iter().map(|id| (*id).to_owned()).collect();
        let of =
            |with_unknown, probability| Explanation { effects: effects.clone(), with_unknown, probability };
        Diagnosis {
            verdict,
            explanations: vec![of(unknown, 0.9), of(!unknown, 0.1)],
            unknown: unknown.then(|| Unknown::torque_in_time(1e-3)),
            would_have_shown: true,
            effects: effects.clone(),
            ..Diagnosis::not_enough_information()
        }
    }

    #[test]
    fn nothing_is_missing_where_predictions_are_as_good_as_noise_allows() {
        let silent = with(Verdict::Unknown, &[], true).held_against(Some(1.02), None, &Settings::default());
        assert_eq!((silent.verdict, silent.unknown), (Verdict::NothingMissing, None));
        assert_eq!(silent.explanations.len(), 1);
        assert!(
            (silent.explanations[0].probability - 1.0).abs() < 1e-12 && !silent.explanations[0].with_unknown
        );
        // Where no effect would have shown, that says nothing.
        let blind = Diagnosis { would_have_shown: false, ..with(Verdict::Unknown, &[], true) };
        assert_eq!(
            blind.held_against(Some(1.02), None, &Settings::default()).verdict,
            Verdict::NotEnoughInformation
        );
        // A name stays; what was said beside it goes.
        let named = with(Verdict::Named, &["air_drag_quadratic"], true).held_against(
            Some(1.02),
            None,
            &Settings::default(),
        );
        assert_eq!((named.verdict, named.effects.len(), named.unknown), (Verdict::Named, 1, None));
        // Sensors that contradict each other are no law.
        let contradicting =
            Diagnosis { unknown: Some(Unknown::contradiction(4.0)), ..with(Verdict::Unknown, &[], true) };
        assert_eq!(
            contradicting.held_against(Some(1.02), None, &Settings::default()).verdict,
            Verdict::Unknown
        );
        let unknown = with(Verdict::Unknown, &[], true);
        assert_eq!(
            unknown.clone().held_against(Some(1.58), Some(1.06), &Settings::default()).verdict,
            Verdict::Unknown
        );
        assert_eq!(
            unknown.clone().held_against(Some(1.3), None, &Settings::default()).verdict,
            Verdict::Unknown
        );
    }

    #[test]
    fn something_is_missing_where_predictions_are_far_off() {
        for silent in [Verdict::NotEnoughInformation, Verdict::NothingMissing] {
            let found = with(silent, &[], false).held_against(Some(53.0), None, &Settings::default());
            assert_eq!(found.verdict, Verdict::Unknown);
            assert!(found.unknown.is_some() && found.explanations.iter().all(|e| e.with_unknown));
            assert_eq!(
                with(silent, &[], false).held_against(Some(1.3), None, &Settings::default()).verdict,
                silent
            );
        }
        let named = with(Verdict::Named, &["wheel_friction"], false).held_against(
            Some(9.3),
            None,
            &Settings::default(),
        );
        assert_eq!((named.verdict, named.effects.len()), (Verdict::Named, 1));
        let said = named.answer().join(" ");
        assert!(said.contains("Something else is missing beside that"), "{said}");
        // What was withheld for a reason of its own stays, with its advice.
        let withheld = Diagnosis::not_enough_information().withheld("no pulses".to_owned());
        let advised = withheld.next.clone();
        assert!(advised.is_some());
        assert_eq!(withheld.held_against(Some(53.0), None, &Settings::default()).next, advised);
        assert_eq!(
            Diagnosis::not_enough_information().held_against(Some(53.0), None, &Settings::default()).verdict,
            Verdict::NotEnoughInformation
        );
    }
}
