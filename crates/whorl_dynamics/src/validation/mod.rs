//! Independent truth: closed forms, derivations, printed tables.

mod actuators;
mod conservation;
mod conventions;
mod drives;
mod effects;
mod freedom;
mod jacobi;
mod motion;
mod motion_at_stops;
mod regression;
mod sensors;
mod special_functions;

use nalgebra::{UnitQuaternion, Vector3};

use crate::platform::TiltLimit;
use crate::{InitialState, MassProperties, Plant, PlatformModel};

/// Whorl-I without friction, gravity offset, tilt stops or effects.
fn free_platform() -> PlatformModel {
    let mut model = PlatformModel::whorl_1_reference();
    set_mass(&mut model, None, Vector3::zeros());
    model.tilt_limit = TiltLimit::Cone { max_rad: 3.1 };
    for wheel in model.wheels_mut() {
        wheel.viscous_friction_n_m_s = 0.0;
        wheel.coulomb_friction_n_m = 0.0;
    }
    model
}

fn set_mass(model: &mut PlatformModel, inertia: Option<nalgebra::Matrix3<f64>>, mgr_n_m: Vector3<f64>) {
    let old = model.mass_properties;
    let inertia = inertia.unwrap_or(*old.inertia_b_kg_m2());
    model.mass_properties = MassProperties::new(inertia, mgr_n_m, old.mass_kg()).expect("realisable");
}

fn start(omega: Vector3<f64>, wheel_speed_rad_s: &[f64]) -> InitialState {
    InitialState {
        omega_wb_b_rad_s: omega,
        wheel_speed_rad_s: wheel_speed_rad_s.to_vec(),
        q_world_body: UnitQuaternion::from_euler_angles(0.2, -0.1, 0.5),
        ..InitialState::default()
    }
}

fn plant(model: &PlatformModel, initial: &InitialState) -> Plant {
    Plant::new(model, initial, 1).expect("a platform that can be simulated")
}

fn ns(seconds: f64) -> i64 {
    (seconds * 1e9).round() as i64
}
