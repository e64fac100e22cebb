//! Wheels, jets and their gas.

use nalgebra::{Unit, Vector3};

/// A momentum wheel.
#[derive(Debug, Clone, PartialEq)]
pub struct Wheel {
    /// Name in parameter files and JointState messages.
    pub name: String,
    /// Spin axis in body axes. Positive wheel speed is right-handed about it, seen from the body.
    pub spin_axis_b: Unit<Vector3<f64>>,
    /// Inertia about the spin axis [kg m^2], > 0.
    pub spin_inertia_kg_m2: f64,
    /// Largest motor torque, either sign [N m], > 0. Torque u on the wheel reacts as -u on the body.
    pub max_torque_n_m: f64,
    /// Largest speed relative to the body, either direction [rad/s], > 0.
    pub max_speed_rad_s: f64,
    /// Viscous drag of the wheel's bearing and motor [N m s], >= 0.
    pub viscous_friction_n_m_s: f64,
    /// Coulomb drag [N m], >= 0.
    pub coulomb_friction_n_m: f64,
}

/// An on/off cold-gas jet.
#[derive(Debug, Clone, PartialEq)]
pub struct Jet {
    /// Name in parameter files.
    pub name: String,
    /// Nozzle position from the centre of rotation, body axes \[m\].
    pub position_b_m: Vector3<f64>,
    /// Direction of the force on the platform (opposite to the plume), body axes.
    pub force_direction_b: Unit<Vector3<f64>>,
    /// Thrust at the tank's reference pressure \[N\], > 0.
    pub thrust_n: f64,
    /// Shortest pulse the valve can make \[s\], >= 0.
    pub min_on_time_s: f64,
    /// From the command to full thrust \[s\], >= 0.
    pub opening_delay_s: f64,
    /// From the end of the command to no thrust \[s\], >= 0.
    pub closing_delay_s: f64,
}

impl Jet {
    /// Torque on the body about the centre of rotation at the reference pressure, body axes [N m].
    #[must_use]
    pub fn torque_b_n_m(&self) -> Vector3<f64> {
        self.position_b_m.cross(&(self.force_direction_b.into_inner() * self.thrust_n))
    }
}

/// The gas supply: an isothermal tank that blows down through a regulator-free line, thrust
/// proportional to (pressure / reference pressure).
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Tank {
    /// Volume [m^3], > 0.
    pub volume_m3: f64,
    /// Pressure at the start of a run \[Pa\], > 0.
    pub initial_pressure_pa: f64,
    /// Pressure at which jets give their nominal thrust \[Pa\], > 0.
    pub reference_pressure_pa: f64,
    /// Exponent of thrust over pressure: 0 = a perfect regulator, 1 = plain blow-down.
    pub thrust_pressure_exponent: f64,
    /// Gas temperature \[K\], > 0.
    pub temperature_k: f64,
    /// Specific gas constant [J/(kg K)] (nitrogen: 296.8), > 0.
    pub gas_constant_j_kg_k: f64,
    /// Specific impulse \[s\], > 0: gas rate of a jet = thrust / (g0 Isp).
    pub specific_impulse_s: f64,
}
