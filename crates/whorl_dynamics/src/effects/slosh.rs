//! Liquid, or a loose mass, that swings inside the platform.

use std::f64::consts::TAU;

use nalgebra::{Matrix3, Vector3};
use whorl_math::{GRAVITY_M_S2, skew};

use super::parameter::value;
use super::{Effect, EffectInfo, EffectKind, ParameterSpec};
use crate::{Environment, PlatformModel};

#[derive(Debug)]
pub(super) struct Slosh;

static INFO: EffectInfo = EffectInfo {
    id: "slosh",
    title: "sloshing mass",
    explanation: "A mass that swings across body z inside the platform: a resonance that motion excites and that goes on after it.",
    equation: "s'' + 2 zeta W s' + W^2 s = -[dw/dt x r + w x (w x r) + g k_b]_xy, g = -m (r x s'' + g s x k_b), s = deflection, r = (0, 0, h), W = 2 pi f",
    source: "equivalent pendulum of NASA SP-106 (Abramson 1966), small deflections, written about the centre of rotation; the mass at rest is part of the platform's inertia and gravity offset",
    kind: EffectKind::HiddenState,
    confusable_with: &["flexible_mode", "air_current_periodic"],
    separated_by: "a sharp start and stop, then rest",
    is_passive: false,
};

/// Mass, frequency, damping and height of the sloshing mass.
struct Pendulum {
    mass_kg: f64,
    omega_rad_s: f64,
    damping_ratio: f64,
    r_b_m: Vector3<f64>,
}

impl Pendulum {
    fn new(values: &[f64], model: &PlatformModel) -> Self {
        Self {
            mass_kg: value(values, 0) * model.mass_properties.mass_kg(),
            omega_rad_s: TAU * value(values, 1),
            damping_ratio: value(values, 2),
            r_b_m: Vector3::z() * value(values, 3),
        }
    }

    /// Acceleration of the deflection without the share of dw/dt [m/s^2].
    fn acceleration_m_s2(&self, environment: &Environment<'_>, hidden: &[f64]) -> Vector3<f64> {
        let omega = environment.omega_wb_b_rad_s;
        let drive = omega.cross(&omega.cross(&self.r_b_m)) + GRAVITY_M_S2 * environment.vertical_b;
        let (s, s_rate) = (
            Vector3::new(value(hidden, 0), value(hidden, 1), 0.0),
            Vector3::new(value(hidden, 2), value(hidden, 3), 0.0),
        );
        -2.0 * self.damping_ratio * self.omega_rad_s * s_rate
            - self.omega_rad_s.powi(2) * s
            - across(&drive)
    }
}

/// The part across body z.
fn across(v: &Vector3<f64>) -> Vector3<f64> {
    Vector3::new(v.x, v.y, 0.0)
}

impl Effect for Slosh {
    fn info(&self) -> &'static EffectInfo {
        &INFO
    }

    fn parameters(&self, _model: &PlatformModel) -> Vec<ParameterSpec> {
        vec![
            ParameterSpec::new("mass_ratio", "1", (0.0, 0.3), 0.01, "Sloshing mass over the platform's mass."),
            ParameterSpec::new("frequency_hz", "Hz", (0.05, 20.0), 0.5, "Frequency with the body held.").with_neutral(1.0),
            ParameterSpec::new("damping_ratio", "1", (0.0, 1.0), 0.02, "Damping over critical.").with_neutral(0.02),
            ParameterSpec::new("height_m", "m", (-2.0, 2.0), 0.1, "Height of the mass above the centre of rotation, body z.")
                .with_neutral(0.2),
        ]
    }

    fn hidden_states(&self, _model: &PlatformModel) -> usize {
        // Deflections along body x and y [m] and their rates [m/s].
        4
    }

    fn hidden_derivative(
        &self,
        values: &[f64],
        environment: &Environment<'_>,
        hidden: &[f64],
        derivative: &mut [f64],
    ) {
        let pendulum = Pendulum::new(values, environment.model);
        let tangential = across(&environment.omega_dot_wb_b_rad_s2.cross(&pendulum.r_b_m));
        let acceleration = pendulum.acceleration_m_s2(environment, hidden) - tangential;
        if let [x, y, x_rate, y_rate] = derivative {
            (*x, *y) = (value(hidden, 2), value(hidden, 3));
            (*x_rate, *y_rate) = (acceleration.x, acceleration.y);
        }
    }

    fn torque_b_n_m(&self, values: &[f64], environment: &Environment<'_>, hidden: &[f64]) -> Vector3<f64> {
        let pendulum = Pendulum::new(values, environment.model);
        // `reaction_inertia_b_kg_m2` carries the share of dw/dt.
        let acceleration = pendulum.acceleration_m_s2(environment, hidden);
        let deflection = Vector3::new(value(hidden, 0), value(hidden, 1), 0.0);
        -pendulum.mass_kg
            * (pendulum.r_b_m.cross(&acceleration) + GRAVITY_M_S2 * deflection.cross(&environment.vertical_b))
    }

    fn reaction_inertia_b_kg_m2(&self, values: &[f64], model: &PlatformModel) -> Matrix3<f64> {
        let pendulum = Pendulum::new(values, model);
        let r = skew(&pendulum.r_b_m);
        let across_z = Matrix3::from_diagonal(&Vector3::new(1.0, 1.0, 0.0));
        pendulum.mass_kg * r * across_z * r.transpose()
    }
}
