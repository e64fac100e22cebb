//! Mass, inertia and gravity offset.

use nalgebra::Matrix3;
use whorl_dynamics::MassProperties;
use whorl_dynamics::mass_properties::MassPropertiesError;

use crate::limits::{any, positive};
use crate::reader::Reader;

pub(super) fn read(r: &mut Reader<'_>) -> Option<MassProperties> {
    let errors_before = r.error_count();
    let mass_kg = r.f64("mass_kg", positive(), "mass of the rotating part [kg]");
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
    let gravity_offset_b_n_m = r.vector3(
        "gravity_offset_n_m",
        any(),
        "m g r_cg: weight times the centre of mass from the centre of rotation, body axes [N m]; z < 0 is stable",
    );
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
