//! Recordings that cannot be explained give a sentence, never a verdict.

use nalgebra::Vector3;
use whorl_dynamics::{MassProperties, ModelPrior, PlatformModel};
use whorl_recording::{Recording, Refusal, Series, Why};

use super::generator::record;
use crate::{DiagnosisError, Options, diagnose};

fn error_of(recording: Recording, model: &PlatformModel) -> DiagnosisError {
    let prior = ModelPrior::typical(model);
    diagnose(&[recording], &[], model, &prior, &Options::default(), &mut |_| {}).unwrap_err()
}

#[test]
fn each_says_what_is_wrong() {
    let model = PlatformModel::whorl_1_reference();
    let good = record(&model, 5, 12.0, None);
    let nothing = diagnose(&[], &[], &model, &ModelPrior::typical(&model), &Options::default(), &mut |_| {});
    assert_eq!(nothing.unwrap_err(), DiagnosisError::NoRecording);
    let short = record(&model, 5, 0.3, None);
    let refused = error_of(short, &model);
    assert!(matches!(refused, DiagnosisError::Refused(Refusal { why: Why::TooShort(..), .. })), "{refused}");
    let silent = Recording { gyro_b_rad_s: Series::default(), ..good.clone() };
    assert!(matches!(
        error_of(silent, &model),
        DiagnosisError::Refused(Refusal { why: Why::Missing("gyro", _), .. })
    ));
    let mut frozen = good.clone();
    frozen.gyro_b_rad_s.value.iter_mut().for_each(|w| w.y = 0.1);
    assert!(matches!(
        error_of(frozen, &model),
        DiagnosisError::Refused(Refusal { why: Why::Constant(..), .. })
    ));
    let mut in_g = good.clone();
    in_g.specific_force_b_m_s2.value.iter_mut().for_each(|f: &mut Vector3<f64>| *f /= 9.81);
    assert!(error_of(in_g, &model).to_string().contains("unit"));
    let mut other = model.clone();
    other.wheels_mut().pop();
    let error = error_of(good.clone(), &other);
    assert!(
        matches!(error, DiagnosisError::Refused(Refusal { why: Why::Count("wheels", ..), .. })),
        "{error}"
    );
    let inertia = model.mass_properties.inertia_b_kg_m2() + nalgebra::Matrix3::from_diagonal_element(5.0);
    let offset = *model.mass_properties.gravity_offset_b_n_m();
    let mut other = model.clone();
    other.mass_properties = MassProperties::new(inertia, offset, model.mass_properties.mass_kg()).unwrap();
    let text = error_of(record(&model, 5, 60.0, None), &other).to_string();
    assert!(text.contains("moment of inertia") && text.contains("different platforms"), "{text}");
    let unknown = Options { exclude: vec!["no_such_effect".to_owned()], ..Options::default() };
    let result = diagnose(&[good], &[], &model, &ModelPrior::typical(&model), &unknown, &mut |_| {});
    assert!(matches!(result.unwrap_err(), DiagnosisError::UnknownEffect(_)));
}
