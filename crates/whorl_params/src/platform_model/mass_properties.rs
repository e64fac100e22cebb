//! Mass, inertia and gravity offset.

use nalgebra::{Matrix3, Vector3};
use whorl_dynamics::actuators::Actuators;
use whorl_dynamics::mass_properties::MassPropertiesError;
use whorl_dynamics::{Freedom, MassProperties};

use crate::limits::{any, positive};
use crate::reader::Reader;

const MASS: &str = "mass of the rotating part [kg]";

/// Mass and inertia, and the gravity offset of rigs whose weight matters.
pub(super) fn read(r: &mut Reader<'_>, freedom: &Freedom) -> Option<MassProperties> {
    let errors_before = r.error_count();
    let mass_kg = r.f64("mass_kg", positive(), MASS);
    let inertia_b_kg_m2 = r.group("inertia_kg_m2", |r| {
        let moment =
            "matrix element of the inertia about the centre of rotation, wheels included, body axes [kg m^2]";
        let product =
            "matrix element (the product of inertia with its sign in the matrix), body axes [kg m^2]";
        let xx = r.f64("xx", positive(), moment);
        let xy = r.f64("xy", any(), product);
        let xz = r.f64("xz", any(), product);
        let yy = r.f64("yy", positive(), moment);
        let yz = r.f64("yz", any(), product);
        let zz = r.f64("zz", positive(), moment);
        Matrix3::new(xx, xy, xz, xy, yy, yz, xz, yz, zz)
    });
    let gravity_offset_b_n_m = gravity_offset_b_n_m(r, freedom);
    if r.error_count() > errors_before {
        return None;
    }
    match MassProperties::new(inertia_b_kg_m2, gravity_offset_b_n_m, mass_kg) {
        Ok(mass_properties) => Some(mass_properties),
        Err(error) => {
            let key = match error {
                MassPropertiesError::MassNotPositive { .. } => "mass_kg",
                _ => "inertia_kg_m2",
            };
            r.reject(
                key,
                format!(
                    "{error}; allowed: symmetric, positive definite, no principal moment above the sum of the other two"
                ),
            );
            None
        }
    }
}

fn gravity_offset_b_n_m(r: &mut Reader<'_>, freedom: &Freedom) -> Vector3<f64> {
    let (key, doc) = (
        "gravity_offset_n_m",
        "m g r_cg: weight times the centre of mass from the centre of rotation, body axes [N m]; z < 0 is stable",
    );
    if *freedom == Freedom::OnBearing {
        return r.vector3(key, any(), doc);
    }
    let given = r.optional_vector3(key, any(), doc).unwrap_or_default();
    if *freedom == Freedom::Free && given != Vector3::zeros() {
        r.reject(key, "the weight of a free platform has no moment; allowed: left out, or [0.0, 0.0, 0.0]");
    }
    given
}

/// What stands for the mass properties of a body that is held: nothing depends on it, as long as it has room for its wheels.
pub(super) fn held(r: &mut Reader<'_>, actuators: &Actuators) -> Option<MassProperties> {
    let wheels_kg_m2: f64 = actuators.wheels.0.iter().map(|wheel| wheel.spin_inertia_kg_m2).sum();
    let inertia_kg_m2 = if wheels_kg_m2 > 0.0 { 10.0 * wheels_kg_m2 } else { 1.0 };
    let mass_kg = r.f64_or("mass_kg", 1.0, positive(), MASS);
    MassProperties::new(Matrix3::identity() * inertia_kg_m2, Vector3::zeros(), mass_kg).ok()
}
