//! A cyclic machine that stands on the platform.

use std::f64::consts::TAU;

use nalgebra::Vector3;

use super::named::{Named as _, parameters};
use super::parameter::USUAL_TORQUE_N_M;
use super::{Clues, Effect, EffectInfo, EffectKind, ParameterSpec, Periodicity, Start, Starter};
use crate::{Environment, PlatformModel};

#[derive(Debug)]
pub(super) struct PeriodicTorque;

static INFO: EffectInfo = EffectInfo {
    id: "periodic_torque",
    title: "periodic torque fixed in the body",
    explanation: "A pump, a fan or a rocking part on the platform pushes at one frequency with an amplitude and a phase of its own about each body axis: a line in the spectrum that yaws with the platform.",
    equation: "g_i = s_i sin(2 pi f t) + c_i cos(2 pi f t) about each body axis i",
    source: "Fourier series of a periodic torque, first harmonic",
    kind: EffectKind::Torque,
    confusable_with: &["air_current_periodic", "slosh", "flexible_mode"],
    separated_by: "hold still at two headings: what is fixed in the room changes its axes, what is fixed in the body does not",
    is_passive: false,
};

parameters! {
    Cycle(model: PlatformModel) {
        sine_b_n_m: Vector3<f64> = SINES.map(|name| amplitude(name, "Sine about this body axis, time from the start of the run.")),
        cosine_b_n_m: Vector3<f64> = COSINES.map(|name| amplitude(name, "Cosine about this body axis.")),
        frequency_hz: f64 =
            ParameterSpec::new(FREQUENCY, "Hz", (0.0, 10.0), 0.1, "Frequency.").with_neutral(0.1).floating_shape(),
    }
}

const SINES: [&str; 3] = ["sine_x_n_m", "sine_y_n_m", "sine_z_n_m"];
const COSINES: [&str; 3] = ["cosine_x_n_m", "cosine_y_n_m", "cosine_z_n_m"];
const FREQUENCY: &str = "frequency_hz";

fn amplitude(name: &str, doc: &'static str) -> ParameterSpec {
    let usual = USUAL_TORQUE_N_M;
    ParameterSpec::new(name, "N m", (-100.0 * usual, 100.0 * usual), usual, doc)
}

impl Effect for PeriodicTorque {
    fn info(&self) -> &'static EffectInfo {
        &INFO
    }

    fn parameters(&self, model: &PlatformModel) -> Vec<ParameterSpec> {
        Cycle::specs(model)
    }

    fn torque_b_n_m(&self, values: &[f64], environment: &Environment<'_>, _hidden: &[f64]) -> Vector3<f64> {
        let cycle = Cycle::of(values);
        let (sine, cosine) = (TAU * cycle.frequency_hz * environment.time_s).sin_cos();
        cycle.sine_b_n_m * sine + cycle.cosine_b_n_m * cosine
    }

    fn is_fed_forward(&self, _model: &PlatformModel) -> bool {
        // Its phase is another in every run.
        false
    }

    /// Of every line all axes together, and each axis alone.
    fn starts(&self, model: &PlatformModel, clues: &Clues<'_>) -> Option<Vec<Start>> {
        let starter = Starter::new(self, model);
        let of_line = |hz: &f64| {
            let origin = starter.at(&[(FREQUENCY, *hz)]);
            let along = |name: &str| starter.along(&origin, name);
            let of_axis: Vec<Start> =
                SINES.into_iter().zip(COSINES).map(|(s, c)| vec![along(s), along(c)]).collect();
            std::iter::once(of_axis.concat()).chain(of_axis).collect::<Vec<Start>>()
        };
        Some(clues.torque_lines_hz.iter().flat_map(of_line).collect())
    }

    fn periodicity(&self) -> Option<Periodicity> {
        Some(Periodicity::Torque)
    }

    fn imposed_hz(&self, values: &[f64]) -> Option<f64> {
        Some(Cycle::of(values).frequency_hz)
    }
}
