use super::*;
use crate::Explanation;

fn with(verdict: Verdict, effects: &[&str], unknown: bool) -> Diagnosis {
    let effects: Vec<String> = effects.iter().map(|id| (*id).to_owned()).collect();
    let of = |with_unknown, probability| Explanation { effects: effects.clone(), with_unknown, probability };
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
    assert!((silent.explanations[0].probability - 1.0).abs() < 1e-12 && !silent.explanations[0].with_unknown);
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
    assert_eq!(contradicting.held_against(Some(1.02), None, &Settings::default()).verdict, Verdict::Unknown);
    let unknown = with(Verdict::Unknown, &[], true);
    assert_eq!(
        unknown.clone().held_against(Some(1.58), Some(1.06), &Settings::default()).verdict,
        Verdict::Unknown
    );
    assert_eq!(unknown.clone().held_against(Some(1.3), None, &Settings::default()).verdict, Verdict::Unknown);
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
    let named =
        with(Verdict::Named, &["wheel_friction"], false).held_against(Some(9.3), None, &Settings::default());
    assert_eq!((named.verdict, named.effects.len()), (Verdict::Named, 1));
    let said = named.answer().join(" ");
    assert!(said.contains("Something else is missing beside that"), "{said}");
    assert_eq!(
        Diagnosis::not_enough_information().held_against(Some(53.0), None, &Settings::default()).verdict,
        Verdict::NotEnoughInformation
    );
}
