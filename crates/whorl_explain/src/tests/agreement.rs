//! The same name means the same statistic: comparison, diagnosis and adoption of the same runs.

use std::collections::BTreeMap;

use whorl_dynamics::ModelPrior;
use whorl_identification::Options;

use super::generator::{Manoeuvre, platform, record, turning};
use crate::{Case, adopt, compare, diagnose, prediction_error};

const EFFECT: &str = "bearing_viscous_friction";

#[test]
#[ignore = "slow: a comparison, a diagnosis and an adoption of three runs"]
fn the_prediction_error_is_the_same_in_comparison_diagnosis_and_adoption() {
    let model = platform();
    let mut truth = model.clone();
    truth.effects.insert(EFFECT.to_owned(), BTreeMap::from([("c_n_m_s".to_owned(), 0.3)]));
    let run = |seed, duration_s| record(&truth, &Manoeuvre { seed, duration_s, ..turning() });
    let (training, held_out) = ([run(1, 60.0), run(2, 40.0)], [run(3, 40.0)]);
    let prior = ModelPrior::typical(&model);
    let case = Case { training: &training, held_out: &held_out, model: &model, prior: &prior };

    let compared = compare(&case, &mut |_, _| {}).unwrap();
    let found = diagnose(&case, &Options::default(), &mut |_, _| {}).unwrap();
    assert_eq!(found.diagnosis.effects, [EFFECT]);
    let adoption = adopt(&case, &[vec![EFFECT.to_owned()]], &Options::default(), &mut |_, _| {}).unwrap();

    for held_out in [false, true] {
        let given = prediction_error(&compared, held_out).unwrap();
        let names = |versions: &[crate::Version]| -> Vec<String> {
            versions.iter().map(|v| v.name.clone()).collect()
        };
        assert_eq!(names(&found.versions), names(&adoption.versions));
        // One statistic, of values that adoption fits by the likelihood and a diagnosis in less time.
        for (diagnosed, adopted) in found.versions.iter().zip(&adoption.versions) {
            let [of_diagnosis, of_adoption] =
                [diagnosed, adopted].map(|version| version.prediction_error(held_out).unwrap());
            assert!((of_diagnosis / of_adoption - 1.0).abs() < 2e-3, "{}: {of_diagnosis}", diagnosed.name);
            let again = compare(
                &Case { model: diagnosed.fit.as_ref().map_or(&model, |fit| &fit.model), ..case },
                &mut |_, _| {},
            );
            assert_eq!(Some(of_diagnosis), prediction_error(&again.unwrap(), held_out));
        }
        assert_eq!(found.versions[0].prediction_error(held_out), Some(given));
        // Only with the effect is the residual pure noise.
        let with = found.versions[2].prediction_error(held_out).unwrap();
        assert!(given > 1.1 && with < 1.02, "{given} {with}");
    }
    // Pooled over runs by their numbers, not a mean of means.
    let errors: Vec<_> = compared.iter().take(2).map(|r| r.comparison.prediction.unwrap()).collect();
    let squares: f64 = errors.iter().map(|e| e.squares).sum();
    let numbers: usize = errors.iter().map(|e| e.numbers).sum();
    let pooled = prediction_error(&compared, false).unwrap();
    assert!((pooled - (squares / numbers as f64).sqrt()).abs() < 1e-12);
    // The sentences state the same number.
    let number = format!("{pooled:.2}");
    assert!(found.answer().iter().any(|s| s.contains(&format!("as given {number}"))), "{:?}", found.answer());
    assert!(adoption.answer()[0].contains(&format!("as given {number}")), "{:?}", adoption.answer());
    assert_eq!(adoption.objection(), None);
}
