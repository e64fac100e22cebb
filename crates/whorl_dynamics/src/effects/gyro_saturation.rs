//! Gyro with a smaller range and coarser steps than the model says.

use super::parameter::value;
use super::{Effect, EffectError, EffectInfo, EffectKind, ParameterSpec};
use crate::PlatformModel;

#[derive(Debug)]
pub(super) struct GyroSaturation;

static INFO: EffectInfo = EffectInfo {
    id: "gyro_saturation",
    title: "gyro clipped and quantised",
    explanation: "The gyro's output stops at a range and moves in steps: flat tops that make the bias look dependent on rate.",
    equation: "y = step round(clip(w, -range, range) / step)",
    source: "definition; 16-bit conversion of Schwartz 2004, section 4.1.1",
    kind: EffectKind::Sensor,
    confusable_with: &["gyro_bias", "gyro_scale"],
    separated_by: "a spin beyond the suspected range",
    is_passive: false,
};

impl Effect for GyroSaturation {
    fn info(&self) -> &'static EffectInfo {
        &INFO
    }

    fn parameters(&self, model: &PlatformModel) -> Vec<ParameterSpec> {
        let errors = &model.sensors.gyro.errors;
        vec![
            ParameterSpec::new("range_rad_s", "rad/s", (1e-3, errors.range), 0.3 * errors.range, "Largest rate it can read.")
                .with_neutral(errors.range),
            ParameterSpec::new("step_rad_s", "rad/s", (0.0, 0.1), 1e-3, "Step of its output.")
                .with_neutral(errors.quantum),
        ]
    }

    fn adjust(&self, values: &[f64], model: &mut PlatformModel) -> Result<(), EffectError> {
        let errors = &mut model.sensors.gyro.errors;
        errors.range = value(values, 0);
        errors.quantum = value(values, 1);
        Ok(())
    }
}
