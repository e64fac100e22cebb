//! Gyro with a smaller range and coarser steps than the model says.

use super::named::{Named as _, parameters};
use super::{Clues, Effect, EffectError, EffectInfo, EffectKind, Evidence, Need, ParameterSpec, Regressed, Signature, Start, Starter};
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

parameters! {
    Digits(model: PlatformModel) {
        range_rad_s: f64 = ParameterSpec::new(
            RANGE,
            "rad/s",
            (1e-3, model.sensors.gyro.errors.range),
            0.3 * model.sensors.gyro.errors.range,
            "Largest rate it can read.",
        )
        .with_neutral(model.sensors.gyro.errors.range),
        step_rad_s: f64 = ParameterSpec::new(STEP, "rad/s", (0.0, 0.1), 1e-3, "Step of its output.")
            .with_neutral(model.sensors.gyro.errors.quantum)
            .regressed(Regressed::Never),
    }
}

const RANGE: &str = "range_rad_s";
const STEP: &str = "step_rad_s";

/// Ranges that are tried, over the largest rate that lasted. Readings that are cut off never lasted at the range
/// itself: noise pulls their mean below it.
const RANGES: [f64; 16] =
    [1.03, 1.02, 1.013, 1.008, 1.004, 1.0, 0.995, 0.99, 0.985, 0.98, 0.97, 0.96, 0.945, 0.92, 0.88, 0.83];

impl Effect for GyroSaturation {
    fn info(&self) -> &'static EffectInfo {
        &INFO
    }

    fn parameters(&self, model: &PlatformModel) -> Vec<ParameterSpec> {
        Digits::specs(model)
    }

    fn is_correction(&self) -> bool {
        true
    }

    fn adjust(&self, values: &[f64], model: &mut PlatformModel) -> Result<(), EffectError> {
        let errors = &mut model.sensors.gyro.errors;
        let digits = Digits::of(values);
        errors.range = digits.range_rad_s;
        errors.quantum = digits.step_rad_s;
        Ok(())
    }

    fn evidence(&self) -> Evidence {
        &[&[Need::FreeBody, Need::UnclippedGyro]]
    }

    fn starts(&self, model: &PlatformModel, clues: &Clues<'_>) -> Option<Vec<Start>> {
        let starter = Starter::new(self, model);
        let start = |share: f64| {
            // What is cut off at this range: all of it or nothing.
            vec![starter.place(&starter.at(&[(RANGE, share * clues.largest_rate_rad_s)]), RANGE)]
        };
        Some(RANGES.into_iter().map(start).collect())
    }

    fn signature(&self) -> Option<Signature> {
        Some(Signature::GyroDigits { range: RANGE, step: STEP })
    }
}
