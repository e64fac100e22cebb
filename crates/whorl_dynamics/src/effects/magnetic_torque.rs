//! A magnetised platform in the Earth's field.

use nalgebra::Vector3;

use super::named::{Named as _, parameters};
use super::parameter::per_axis;
use super::{Aid, Effect, EffectInfo, EffectKind, Grouping, ParameterSpec};
use crate::{Environment, PlatformModel};

#[derive(Debug)]
pub(super) struct MagneticTorque;

static INFO: EffectInfo = EffectInfo {
    id: "magnetic_torque",
    title: "magnetic dipole of the platform",
    explanation: "Steel parts and currents make the platform a compass needle: the torque changes with heading and with tilt.",
    equation: "g = m x (R^T B_world)",
    source: "magnetic fields of Schwartz 2004, Table 3.1; field of Blacksburg, Virginia, from the geomagnetic reference field, rounded",
    kind: EffectKind::Torque,
    confusable_with: &["air_current", "gravity_offset"],
    separated_by: "slow yaw by 90 and 180 degrees at fixed tilt, then a tilt change",
    is_passive: false,
};

parameters! {
    Magnet(_model: PlatformModel) {
        dipole_b_a_m2: Vector3<f64> =
            per_axis("dipole", "_a_m2", "A m^2", 1000.0, 30.0, "Dipole along this body axis."),
        // East, north, up: declination about 8 degrees west, inclination about 65 degrees down. Elsewhere, in a building of steel or where
        // the world's axes are not east and north, it is another: over the Earth horizontal parts reach 42e-6 T, and the vertical one
        // has either sign (IGRF-13, Alken et al. 2021).
        field_w_t: Vector3<f64> =
            [("field_x_t", -3.0e-6), ("field_y_t", 21.0e-6), ("field_z_t", -47.0e-6)].map(|(name, tesla)| {
                let doc = "Field along this world axis (east, north, up).";
                ParameterSpec::new(name, "T", (-1e-3, 1e-3), 20e-6, doc).with_neutral(tesla).shape()
            }),
    }
}

impl Effect for MagneticTorque {
    fn info(&self) -> &'static EffectInfo {
        &INFO
    }

    fn parameters(&self, model: &PlatformModel) -> Vec<ParameterSpec> {
        Magnet::specs(model)
    }

    fn torque_b_n_m(&self, values: &[f64], environment: &Environment<'_>, _hidden: &[f64]) -> Vector3<f64> {
        let magnet = Magnet::of(values);
        magnet.dipole_b_a_m2.cross(&environment.to_body(&magnet.field_w_t))
    }

    fn grouping(&self) -> Grouping {
        // A dipole in the deck.
        Grouping::AllPartsEach(&[&["dipole_x_a_m2", "dipole_y_a_m2"]])
    }

    fn aids(&self) -> &'static [Aid] {
        &[Aid::Heading]
    }
}
