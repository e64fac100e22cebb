//! Draught of a climate control that cycles.

use std::f64::consts::{PI, TAU};

use nalgebra::Vector3;

use super::named::{Named as _, parameters};
use super::{Clues, Contribution, Effect, EffectInfo, EffectKind, ParameterSpec, Regressed, Periodicity, Start, Starter};
use crate::{Environment, PlatformModel};

#[derive(Debug)]
pub(super) struct AirCurrentPeriodic;

static INFO: EffectInfo = EffectInfo {
    id: "air_current_periodic",
    title: "periodic air current",
    explanation: "The building's climate control pushes back and forth with a torque fixed in the room: a line in the spectrum that has nothing to do with the motion.",
    equation: "g = R^T a_world sin(2 pi f t + phase)",
    source: "climate control of Schwartz 2004, section 4.3",
    kind: EffectKind::Torque,
    confusable_with: &["slosh", "air_current"],
    separated_by: "hold still: the line stays although nothing excites it",
    is_passive: false,
};

parameters! {
    Draught(_model: PlatformModel) {
        amplitude_w_n_m: Vector3<f64> = AMPLITUDES.map(|name| {
            ParameterSpec::new(name, "N m", (-0.5, 0.5), 0.005, "Amplitude about this world axis.")
                .regressed(Regressed::UnlessZero)
        }),
        frequency_hz: f64 =
            ParameterSpec::new(FREQUENCY, "Hz", (0.0, 10.0), 0.1, "Frequency.").with_neutral(0.1).floating_shape(),
        phase_rad: f64 = ParameterSpec::new(PHASE, "rad", (-PI, PI), PI, "Phase at the start of the run.")
            .floating_shape()
            .angle(),
    }
}

const AMPLITUDES: [&str; 3] = ["amplitude_x_n_m", "amplitude_y_n_m", "amplitude_z_n_m"];
const FREQUENCY: &str = "frequency_hz";
const PHASE: &str = "phase_rad";

impl Effect for AirCurrentPeriodic {
    fn info(&self) -> &'static EffectInfo {
        &INFO
    }

    fn parameters(&self, model: &PlatformModel) -> Vec<ParameterSpec> {
        Draught::specs(model)
    }

    fn torque_b_n_m(&self, values: &[f64], environment: &Environment<'_>, _hidden: &[f64]) -> Vector3<f64> {
        let draught = Draught::of(values);
        let phase = TAU * draught.frequency_hz * environment.time_s + draught.phase_rad;
        environment.to_body(&draught.amplitude_w_n_m) * phase.sin()
    }

    fn is_fed_forward(&self, _model: &PlatformModel) -> bool {
        // Its phase is another in every run.
        false
    }

    fn starts(&self, model: &PlatformModel, clues: &Clues<'_>) -> Option<Vec<Start>> {
        let starter = Starter::new(self, model);
        let start = |hz: &f64| {
            let at_phase = |phase_rad: f64| starter.at(&[(FREQUENCY, *hz), (PHASE, phase_rad)]);
            let (sine, cosine) = (at_phase(0.0), at_phase(0.5 * PI));
            let of_axis = |name: &str| [starter.along(&sine, name), starter.along(&cosine, name)];
            AMPLITUDES.into_iter().flat_map(of_axis).collect()
        };
        Some(clues.torque_lines_hz.iter().map(start).collect())
    }

    /// Of a sine and a cosine about each axis the one phase with which most of both remains.
    fn joined(&self, contributions: &[Contribution<'_>]) -> Option<Vec<f64>> {
        let mut parts = [[0.0; 2]; 3];
        for part in contributions {
            let axis = AMPLITUDES.iter().position(|name| *name == part.name)?;
            let is_cosine = Draught::of(part.origin).phase_rad > 0.0;
            parts[axis][usize::from(is_cosine)] += part.amount;
        }
        let (mut across, mut along) = (0.0, 0.0);
        for [sine, cosine] in parts {
            across += 2.0 * sine * cosine;
            along += sine * sine - cosine * cosine;
        }
        let phase_rad = 0.5 * f64::atan2(across, along);
        let amplitude = parts.map(|[sine, cosine]| sine * phase_rad.cos() + cosine * phase_rad.sin());
        let frequency_hz = Draught::of(contributions.first()?.origin).frequency_hz;
        Some(Draught { amplitude_w_n_m: amplitude.into(), frequency_hz, phase_rad }.values())
    }

    fn periodicity(&self) -> Option<Periodicity> {
        Some(Periodicity::Torque)
    }

    fn imposed_hz(&self, values: &[f64]) -> Option<f64> {
        Some(Draught::of(values).frequency_hz)
    }
}
