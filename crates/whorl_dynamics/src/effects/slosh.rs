//! Liquid, or a loose mass, that swings inside the platform.

use std::f64::consts::TAU;

use nalgebra::{Matrix3, Vector3};
use whorl_math::{GRAVITY_M_S2, skew};

use super::named::{Named as _, Value as _, parameters};
use super::search::geometric;
use super::{Clues, Effect, EffectInfo, EffectKind, ParameterSpec, Start, Starter};
use crate::{Environment, PlatformModel};

#[derive(Debug)]
pub(super) struct Slosh;

static INFO: EffectInfo = EffectInfo {
    id: "slosh",
    title: "sloshing mass",
    explanation: "A mass that swings across body z inside the platform: a resonance that motion excites and that goes on after it.",
    equation: "s'' + 2 zeta W s' + W^2 s = -[dw/dt x r + w x (w x r) + a]_xy, g = -m (r x s'' + s x a), s = deflection, r = (0, 0, h), W = 2 pi f, a = g k_b, in free fall the thrust over the mass",
    source: "equivalent pendulum of NASA SP-106 (Abramson 1966), small deflections, written about the centre of rotation; the mass at rest is part of the platform's inertia and gravity offset. In free fall (Lagrange's equations about the centre of mass) the mass ratio is that to the rest of the platform, and f the frequency of a body that does not turn but gives way",
    kind: EffectKind::HiddenState,
    confusable_with: &["flexible_mode", "air_current_periodic"],
    separated_by: "a sharp start and stop, then rest",
    is_passive: false,
};

parameters! {
    Liquid(_model: PlatformModel) {
        mass_ratio: f64 =
            ParameterSpec::new(MASS_RATIO, "1", (0.0, 0.3), 0.01, "Sloshing mass over the platform's mass."),
        frequency_hz: f64 =
            ParameterSpec::new(FREQUENCY, "Hz", (0.05, 20.0), 0.5, "Frequency with the body held.")
                .with_neutral(1.0)
                .floating_shape(),
        damping_ratio: f64 =
            ParameterSpec::new(DAMPING, "1", (0.0, 1.0), 0.02, "Damping over critical.").with_neutral(0.02).shape(),
        height_m: f64 = ParameterSpec::new(
            HEIGHT,
            "m",
            (-2.0, 2.0),
            0.1,
            "Height of the mass above the centre of rotation, body z.",
        )
        .with_neutral(0.2)
        .shape(),
    }
}

const MASS_RATIO: &str = "mass_ratio";
const FREQUENCY: &str = "frequency_hz";
const DAMPING: &str = "damping_ratio";
const HEIGHT: &str = "height_m";

/// Mass, frequency, damping and height of the sloshing mass.
struct Pendulum {
    mass_kg: f64,
    omega_rad_s: f64,
    damping_ratio: f64,
    r_b_m: Vector3<f64>,
}

impl Pendulum {
    fn new(values: &[f64], model: &PlatformModel) -> Self {
        let liquid = Liquid::of(values);
        Self {
            mass_kg: liquid.mass_ratio * model.mass_properties.mass_kg(),
            omega_rad_s: TAU * liquid.frequency_hz,
            damping_ratio: liquid.damping_ratio,
            r_b_m: Vector3::z() * liquid.height_m,
        }
    }

    /// Acceleration of the deflection without the share of dw/dt [m/s^2].
    fn acceleration_m_s2(&self, environment: &Environment<'_>, hidden: &[f64]) -> Vector3<f64> {
        let omega = environment.omega_wb_b_rad_s;
        let drive = omega.cross(&omega.cross(&self.r_b_m)) + environment.specific_force_b_m_s2();
        let [x, y, x_rate, y_rate] = <[f64; 4]>::read(hidden);
        let (s, s_rate) = (Vector3::new(x, y, 0.0), Vector3::new(x_rate, y_rate, 0.0));
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

    fn parameters(&self, model: &PlatformModel) -> Vec<ParameterSpec> {
        Liquid::specs(model)
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
        let [_, _, x_rate, y_rate] = <[f64; 4]>::read(hidden);
        if let [x, y, x_rate_dot, y_rate_dot] = derivative {
            (*x, *y) = (x_rate, y_rate);
            (*x_rate_dot, *y_rate_dot) = (acceleration.x, acceleration.y);
        }
    }

    fn hidden_start_stddev(
        &self,
        values: &[f64],
        model: &PlatformModel,
        torque_n_m: f64,
        stddev: &mut [f64],
    ) {
        let pendulum = Pendulum::new(values, model);
        // A deflection pushes by its spring at the height, and by its weight.
        let weight_m_s2 = if model.freedom.has_weight() { GRAVITY_M_S2 } else { 0.0 };
        let lever = pendulum.omega_rad_s.powi(2) * pendulum.r_b_m.z.abs() + weight_m_s2;
        let deflected = torque_n_m / (pendulum.mass_kg * lever);
        if let ([x, y, x_rate, y_rate], true) = (stddev, deflected.is_finite()) {
            (*x, *y) = (deflected, deflected);
            (*x_rate, *y_rate) = (deflected * pendulum.omega_rad_s, deflected * pendulum.omega_rad_s);
        }
    }

    fn torque_b_n_m(&self, values: &[f64], environment: &Environment<'_>, hidden: &[f64]) -> Vector3<f64> {
        let pendulum = Pendulum::new(values, environment.model);
        // `reaction_inertia_b_kg_m2` carries the share of dw/dt.
        let acceleration = pendulum.acceleration_m_s2(environment, hidden);
        let [x, y, ..] = <[f64; 4]>::read(hidden);
        let deflection = Vector3::new(x, y, 0.0);
        -pendulum.mass_kg
            * (pendulum.r_b_m.cross(&acceleration) + deflection.cross(&environment.specific_force_b_m_s2()))
    }

    fn reaction_inertia_b_kg_m2(&self, values: &[f64], model: &PlatformModel) -> Matrix3<f64> {
        let pendulum = Pendulum::new(values, model);
        let r = skew(&pendulum.r_b_m);
        let across_z = Matrix3::from_diagonal(&Vector3::new(1.0, 1.0, 0.0));
        pendulum.mass_kg * r * across_z * r.transpose()
    }

    fn starts(&self, model: &PlatformModel, clues: &Clues<'_>) -> Option<Vec<Start>> {
        let starter = Starter::new(self, model);
        let fastest_hz = (0.3 / clues.bin_s).min(5.0);
        let coarse = geometric(0.1, fastest_hz, 7).into_iter().flat_map(|hz| [(hz, 0.02), (hz, 0.15)]);
        let usual_m = Liquid::specs(model).iter().find(|s| s.name == HEIGHT).map_or(0.0, |s| s.neutral);
        let seen = clues.resonances.iter().map(|r| (r.hz, r.damping_ratio));
        let starts = coarse.chain(seen).flat_map(|(hz, damping)| {
            // Above the centre and below it.
            [-1.5, 1.5].map(|share| {
                let height_m = share * usual_m;
                let origin = starter.at(&[(FREQUENCY, hz), (DAMPING, damping), (HEIGHT, height_m)]);
                vec![starter.along(&origin, MASS_RATIO)]
            })
        });
        Some(starts.collect())
    }
}
