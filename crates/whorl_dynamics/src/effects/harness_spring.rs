//! A cable from the platform to its base.

use std::f64::consts::{PI, TAU};

use nalgebra::Vector3;
use whorl_math::wrap_angle_rad;

use super::named::{Named as _, parameters};
use super::{Aid, Clues, Effect, EffectInfo, EffectKind, ParameterSpec, Start, Starter};
use crate::{Environment, PlatformModel};

#[derive(Debug)]
pub(super) struct HarnessSpring;

static INFO: EffectInfo = EffectInfo {
    id: "harness_spring",
    title: "cable to the base",
    explanation: "A cable or hose to the base twists like a spring and pulls the platform back to one heading.",
    equation: "g = -(k f(yaw - yaw0) + c w.k_b) k_b, f(x) = x within half a turn; over the last 0.05 rad before half a turn it falls to zero, where the cable goes over to the other side",
    source: "electrical wire to base of Schwartz 2004, Table 3.1; linear torsion spring about the vertical",
    kind: EffectKind::Torque,
    confusable_with: &["bearing_viscous_friction", "air_current"],
    separated_by: "release from two yaw angles",
    is_passive: false,
};

parameters! {
    Spring(_model: PlatformModel) {
        // Without its stiffness the cable's damping cannot be distinguished from friction.
        k_n_m_rad: f64 = ParameterSpec::new(K, "N m/rad", (0.0, 5.0), 0.01, "Stiffness.").essential(),
        yaw0_rad: f64 = ParameterSpec::new(YAW0, "rad", (-PI, PI), PI, "Heading at which the cable is relaxed.")
            .floating_shape()
            .angle(),
        c_n_m_s: f64 = ParameterSpec::new(C, "N m s", (0.0, 5.0), 0.01, "Damping about the vertical."),
    }
}

const K: &str = "k_n_m_rad";
const YAW0: &str = "yaw0_rad";
const C: &str = "c_n_m_s";

/// Before half a turn the torque falls from its largest to zero over this angle \[rad\]: a torque that jumped there would be
/// no force of nature, and no integrator could follow it.
const GOING_OVER_RAD: f64 = 0.05;

/// Twist that counts, of a heading `angle_rad` from the relaxed one: continuous and of period 2 pi.
fn twist_rad(angle_rad: f64) -> f64 {
    let angle_rad = wrap_angle_rad(angle_rad);
    let left_rad = PI - angle_rad.abs();
    if left_rad >= GOING_OVER_RAD {
        return angle_rad;
    }
    (PI - GOING_OVER_RAD) * (left_rad / GOING_OVER_RAD) * angle_rad.signum()
}

/// Relaxed headings that are tried.
const HEADINGS: u32 = 8;

impl Effect for HarnessSpring {
    fn info(&self) -> &'static EffectInfo {
        &INFO
    }

    fn parameters(&self, model: &PlatformModel) -> Vec<ParameterSpec> {
        Spring::specs(model)
    }

    fn torque_b_n_m(&self, values: &[f64], environment: &Environment<'_>, _hidden: &[f64]) -> Vector3<f64> {
        let spring = Spring::of(values);
        let twist_rad = twist_rad(environment.yaw_rad() - spring.yaw0_rad);
        let twist_rate_rad_s = environment.omega_wb_b_rad_s.dot(&environment.vertical_b);
        -(spring.k_n_m_rad * twist_rad + spring.c_n_m_s * twist_rate_rad_s) * environment.vertical_b
    }

    fn starts(&self, model: &PlatformModel, _clues: &Clues<'_>) -> Option<Vec<Start>> {
        let starter = Starter::new(self, model);
        let heading = |i: u32| -PI + TAU * (f64::from(i) + 0.5) / f64::from(HEADINGS);
        let starts = (0..HEADINGS).flat_map(|i| {
            let origin = starter.at(&[(YAW0, heading(i))]);
            let stiffness = starter.along(&origin, K);
            [vec![stiffness.clone()], vec![stiffness, starter.along(&origin, C)]]
        });
        Some(starts.collect())
    }

    fn aids(&self) -> &'static [Aid] {
        &[Aid::Heading]
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_twist_is_linear_and_goes_over_without_a_jump() {
        for angle in [-3.0, -0.5, 0.0, 1.0, 3.09] {
            assert_eq!(twist_rad(angle), angle);
        }
        assert!((twist_rad(PI - 0.025) - 0.5 * (PI - 0.05)).abs() < 1e-12);
        assert!(twist_rad(PI - 1e-9).abs() < 1e-6 && twist_rad(PI + 1e-9).abs() < 1e-6);
        let step = 1e-4;
        let slope = (PI - GOING_OVER_RAD) / GOING_OVER_RAD;
        for k in 0..100_000 {
            let angle = step * f64::from(k);
            let change = (twist_rad(angle + step) - twist_rad(angle)).abs();
            assert!(change <= slope * step * 1.001, "{angle}: {change}");
            assert!((twist_rad(angle + TAU) - twist_rad(angle)).abs() < 1e-9);
        }
    }
}
