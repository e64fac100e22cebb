//! A cable from the platform to its base.

use std::f64::consts::PI;

use nalgebra::Vector3;
use whorl_math::wrap_angle_rad;

use super::parameter::value;
use super::{Effect, EffectInfo, EffectKind, ParameterSpec};
use crate::{Environment, PlatformModel};

#[derive(Debug)]
pub(super) struct HarnessSpring;

static INFO: EffectInfo = EffectInfo {
    id: "harness_spring",
    title: "cable to the base",
    explanation: "A cable or hose to the base twists like a spring and pulls the platform back to one heading.",
    equation: "g = -(k wrap(yaw - yaw0) + c w.k_b) k_b, wrap to -pi..pi",
    source: "electrical wire to base of Schwartz 2004, Table 3.1; linear torsion spring about the vertical",
    kind: EffectKind::Torque,
    confusable_with: &["bearing_viscous_friction", "air_current"],
    separated_by: "release from two yaw angles",
    is_passive: false,
};

impl Effect for HarnessSpring {
    fn info(&self) -> &'static EffectInfo {
        &INFO
    }

    fn parameters(&self, _model: &PlatformModel) -> Vec<ParameterSpec> {
        vec![
            ParameterSpec::new("k_n_m_rad", "N m/rad", (0.0, 5.0), 0.01, "Stiffness."),
            ParameterSpec::new("yaw0_rad", "rad", (-PI, PI), PI, "Heading at which the cable is relaxed."),
            ParameterSpec::new("c_n_m_s", "N m s", (0.0, 5.0), 0.01, "Damping about the vertical."),
        ]
    }

    fn torque_b_n_m(&self, values: &[f64], environment: &Environment<'_>, _hidden: &[f64]) -> Vector3<f64> {
        let twist_rad = wrap_angle_rad(environment.yaw_rad() - value(values, 1));
        let twist_rate_rad_s = environment.omega_wb_b_rad_s.dot(&environment.vertical_b);
        -(value(values, 0) * twist_rad + value(values, 2) * twist_rate_rad_s) * environment.vertical_b
    }
}
