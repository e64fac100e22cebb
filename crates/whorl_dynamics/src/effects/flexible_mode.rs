//! An appendage that vibrates.

use std::f64::consts::TAU;

use nalgebra::{Matrix3, Vector3};

use super::named::{Named as _, Value as _, parameters};
use super::search::geometric;
use super::{Clues, Effect, EffectInfo, EffectKind, ParameterSpec, Regressed, Periodicity, Start, Starter};
use crate::{Environment, PlatformModel};

#[derive(Debug)]
pub(super) struct FlexibleMode;

static INFO: EffectInfo = EffectInfo {
    id: "flexible_mode",
    title: "flexible appendage",
    explanation: "One vibration mode of a boom or panel: a narrow line that jets and wheels excite.",
    equation: "eta'' + 2 zeta W eta' + W^2 eta = -d . dw/dt, g = -d eta'', W = 2 pi f",
    source: "Likins 1970, hybrid coordinates, one mode, small deflections; the appendage at rest is part of the platform's inertia",
    kind: EffectKind::HiddenState,
    confusable_with: &["slosh", "vibration_alias"],
    separated_by: "single-jet pulses, then rest",
    is_passive: false,
};

parameters! {
    Mode(_model: PlatformModel) {
        participation_b_sqrt_kg_m: Vector3<f64> = PARTICIPATIONS.map(|name| {
            ParameterSpec::new(name, "sqrt(kg) m", (-2.0, 2.0), 0.1, "Participation of this body axis.")
                .regressed(Regressed::UnlessZero)
        }),
        frequency_hz: f64 =
            ParameterSpec::new(FREQUENCY, "Hz", (0.05, 50.0), 1.0, "Frequency with the body held.")
                .with_neutral(5.0)
                .floating_shape(),
        damping_ratio: f64 =
            ParameterSpec::new(DAMPING, "1", (0.0, 1.0), 0.01, "Damping over critical.").with_neutral(0.005).shape(),
    }
}

const PARTICIPATIONS: [&str; 3] =
    ["participation_x_sqrt_kg_m", "participation_y_sqrt_kg_m", "participation_z_sqrt_kg_m"];
const FREQUENCY: &str = "frequency_hz";
const DAMPING: &str = "damping_ratio";

/// Directions of participation that are tried.
const DIRECTIONS: [[f64; 3]; 5] =
    [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0], [0.707, 0.707, 0.0], [0.707, -0.707, 0.0]];

/// -2 zeta W eta' - W^2 eta.
fn restoring(mode: &Mode, [eta, eta_rate]: [f64; 2]) -> f64 {
    let omega_rad_s = TAU * mode.frequency_hz;
    -2.0 * mode.damping_ratio * omega_rad_s * eta_rate - omega_rad_s.powi(2) * eta
}

impl Effect for FlexibleMode {
    fn info(&self) -> &'static EffectInfo {
        &INFO
    }

    fn parameters(&self, model: &PlatformModel) -> Vec<ParameterSpec> {
        Mode::specs(model)
    }

    fn hidden_states(&self, _model: &PlatformModel) -> usize {
        // eta and its rate.
        2
    }

    fn hidden_derivative(
        &self,
        values: &[f64],
        environment: &Environment<'_>,
        hidden: &[f64],
        derivative: &mut [f64],
    ) {
        let (mode, [eta, eta_rate]) = (Mode::of(values), <[f64; 2]>::read(hidden));
        if let [position, rate] = derivative {
            *position = eta_rate;
            *rate = restoring(&mode, [eta, eta_rate])
                - mode.participation_b_sqrt_kg_m.dot(&environment.omega_dot_wb_b_rad_s2);
        }
    }

    fn hidden_start_stddev(
        &self,
        values: &[f64],
        _model: &PlatformModel,
        torque_n_m: f64,
        stddev: &mut [f64],
    ) {
        let mode = Mode::of(values);
        let omega_rad_s = TAU * mode.frequency_hz;
        let bent = torque_n_m / (omega_rad_s.powi(2) * mode.participation_b_sqrt_kg_m.norm());
        if let ([eta, eta_rate], true) = (stddev, bent.is_finite()) {
            (*eta, *eta_rate) = (bent, bent * omega_rad_s);
        }
    }

    fn torque_b_n_m(&self, values: &[f64], _environment: &Environment<'_>, hidden: &[f64]) -> Vector3<f64> {
        // eta'' without its share of dw/dt, which `reaction_inertia_b_kg_m2` carries.
        let mode = Mode::of(values);
        -restoring(&mode, <[f64; 2]>::read(hidden)) * mode.participation_b_sqrt_kg_m
    }

    fn reaction_inertia_b_kg_m2(&self, values: &[f64], _model: &PlatformModel) -> Matrix3<f64> {
        let d = Mode::of(values).participation_b_sqrt_kg_m;
        d * d.transpose()
    }

    fn starts(&self, model: &PlatformModel, clues: &Clues<'_>) -> Option<Vec<Start>> {
        let starter = Starter::new(self, model);
        let fastest_hz = (0.3 / clues.bin_s).min(15.0);
        let mut frequencies = geometric(0.3, fastest_hz, 6);
        frequencies.extend(clues.torque_lines_hz.iter().copied().filter(|hz| *hz > 0.2));
        let coarse = frequencies.into_iter().flat_map(|hz| DIRECTIONS.map(|d| (hz, 0.02, d)));
        let seen = clues.resonances.iter().flat_map(|r| {
            let own = std::iter::once(r.axis_b.into());
            own.chain(DIRECTIONS).map(move |d: [f64; 3]| (r.hz, r.damping_ratio, d))
        });
        let starts = coarse.chain(seen).map(|(hz, damping, direction)| {
            let origin = starter.at(&[(FREQUENCY, hz), (DAMPING, damping)]);
            let moves: Vec<(&str, f64)> = PARTICIPATIONS
                .into_iter()
                .zip(direction)
                .filter(|(_, d)| *d != 0.0)
                .map(|(name, d)| (name, d * starter.prior_stddev(name)))
                .collect();
            vec![starter.squared(&origin, "participation", &moves)]
        });
        Some(starts.collect())
    }

    fn periodicity(&self) -> Option<Periodicity> {
        Some(Periodicity::Ringing)
    }
}
