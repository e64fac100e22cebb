//! Behaviour of the true platform beyond its drawing: the hidden effects, in formulas that differ from
//! the library's where nature may differ (drag exponent 1.8, smooth Stribeck friction, plenum blow-down,
//! stiffening cable), and effects that the library does not have at all.

use nalgebra::{Matrix3, Vector3};

use super::filter::Filters;
use super::foreign::Foreign;

/// All hidden effects; zero everywhere is a platform that has none.
#[derive(Debug, Clone, PartialEq)]
pub struct Hidden {
    // Torques.
    pub viscous_n_m_s: f64,
    pub coulomb_n_m: f64,
    /// Torque at 0.15 rad/s over 0.15^2, per axis [N m s^2]; grows with rate^1.8.
    pub drag_n_m_s2: Vector3<f64>,
    pub air_current_world_n_m: Vector3<f64>,
    pub periodic_world_n_m: Vector3<f64>,
    pub periodic_hz: f64,
    pub periodic_phase_rad: f64,
    /// Of a machine on the platform: amplitude and phase about each body axis.
    pub cycle_b_n_m: Vector3<f64>,
    pub cycle_phase_rad: Vector3<f64>,
    pub cycle_hz: f64,
    /// Torque at 0.1 rad/s of a drag that grows with a power of the rate.
    pub power_drag_n_m: f64,
    pub power_drag_exponent: f64,
    /// Of a cable that is twisted further with every turn.
    pub winding_n_m_rad: f64,
    pub winding_yaw_rad: f64,
    pub winding_n_m_s: f64,
    pub turbine_body_n_m: f64,
    pub turbine_vertical_n_m: f64,
    pub dipole_b_a_m2: Vector3<f64>,
    pub cable_n_m_rad: f64,
    pub cable_yaw_rad: f64,
    pub cable_n_m_s: f64,
    pub compliance_m_n: Matrix3<f64>,
    /// Shift of m g r_cg per gas that is gone from the full tank.
    pub mass_shift_n_m_kg: Vector3<f64>,
    pub ballast_gap_n_m: Vector3<f64>,
    pub contact_n_m_rad: f64,
    pub contact_n_m_s: f64,
    pub contact_rad: f64,
    // Actuators.
    pub jet_strength: Vec<f64>,
    pub jet_strength_all: f64,
    pub jet_tilt_rad: Vec<[f64; 2]>,
    pub valve_on_s: f64,
    pub valve_off_s: f64,
    pub plenum_s: f64,
    pub leak_n: Vec<f64>,
    pub pressure_exponent: f64,
    pub wheel_torque_per_v: f64,
    pub valve_delay_s_v: f64,
    /// Thrust goes with the voltage over that of a full battery to this power.
    pub thrust_voltage_exponent: f64,
    pub wheel_bias_n_m: Vec<f64>,
    pub wheel_constant: Vec<f64>,
    pub wheel_viscous_n_m_s: Vec<f64>,
    pub wheel_coulomb_n_m: Vec<f64>,
    pub wheel_windage_n_m_s2: Vec<f64>,
    pub wheel_tilt_rad: Vec<[f64; 2]>,
    pub wheel_inertia: Vec<f64>,
    pub wheel_imbalance_kg_m2: Vec<f64>,
    // Sensors.
    pub gyro_scale: Vector3<f64>,
    /// Off-diagonal: what each axis (row) senses of the others.
    pub gyro_cross: Matrix3<f64>,
    pub gyro_per_k: Vector3<f64>,
    pub gyro_per_g: Matrix3<f64>,
    pub gyro_range_rad_s: f64,
    pub accel_bias_m_s2: Vector3<f64>,
    pub accel_scale: Vector3<f64>,
    pub accel_arm_m: Vector3<f64>,
    pub imu_late_s: f64,
    pub imu_filters: Filters,
    pub vector_turn_rad: Vector3<f64>,
    pub alias_gyro_rad_s: Vector3<f64>,
    pub alias_accel_m_s2: Vector3<f64>,
    pub alias_hz: f64,
    pub alias_background: f64,
    // Hidden states.
    pub slosh_kg: f64,
    pub slosh_hz: f64,
    pub slosh_damping: f64,
    pub slosh_height_m: f64,
    pub flexible_sqrt_kg_m: Vector3<f64>,
    pub flexible_hz: f64,
    pub flexible_damping: f64,
    // What no library has.
    pub foreign: Foreign,
}

impl Hidden {
    /// None, for a platform with these numbers of wheels and jets.
    #[must_use]
    pub fn none(wheels: usize, jets: usize) -> Self {
        let (v, m) = (Vector3::zeros(), Matrix3::zeros());
        Self {
            viscous_n_m_s: 0.0,
            coulomb_n_m: 0.0,
            drag_n_m_s2: v,
            air_current_world_n_m: v,
            periodic_world_n_m: v,
            periodic_hz: 0.1,
            periodic_phase_rad: 0.0,
            cycle_b_n_m: v,
            cycle_phase_rad: v,
            cycle_hz: 0.1,
            power_drag_n_m: 0.0,
            power_drag_exponent: 1.5,
            winding_n_m_rad: 0.0,
            winding_yaw_rad: 0.0,
            winding_n_m_s: 0.0,
            turbine_body_n_m: 0.0,
            turbine_vertical_n_m: 0.0,
            dipole_b_a_m2: v,
            cable_n_m_rad: 0.0,
            cable_yaw_rad: 0.0,
            cable_n_m_s: 0.0,
            compliance_m_n: m,
            mass_shift_n_m_kg: v,
            ballast_gap_n_m: v,
            contact_n_m_rad: 0.0,
            contact_n_m_s: 0.0,
            contact_rad: 1.0,
            jet_strength: vec![0.0; jets],
            jet_strength_all: 0.0,
            jet_tilt_rad: vec![[0.0; 2]; jets],
            valve_on_s: 0.0,
            valve_off_s: 0.0,
            plenum_s: 0.0,
            leak_n: vec![0.0; jets],
            pressure_exponent: 0.0,
            wheel_torque_per_v: 0.0,
            valve_delay_s_v: 0.0,
            thrust_voltage_exponent: 0.0,
            wheel_bias_n_m: vec![0.0; wheels],
            wheel_constant: vec![0.0; wheels],
            wheel_viscous_n_m_s: vec![0.0; wheels],
            wheel_coulomb_n_m: vec![0.0; wheels],
            wheel_windage_n_m_s2: vec![0.0; wheels],
            wheel_tilt_rad: vec![[0.0; 2]; wheels],
            wheel_inertia: vec![0.0; wheels],
            wheel_imbalance_kg_m2: vec![0.0; wheels],
            gyro_scale: v,
            gyro_cross: m,
            gyro_per_k: v,
            gyro_per_g: m,
            gyro_range_rad_s: f64::MAX,
            accel_bias_m_s2: v,
            accel_scale: v,
            accel_arm_m: v,
            imu_late_s: 0.0,
            imu_filters: Filters::default(),
            vector_turn_rad: v,
            alias_gyro_rad_s: v,
            alias_accel_m_s2: v,
            alias_hz: 120.0,
            alias_background: 0.0,
            slosh_kg: 0.0,
            slosh_hz: 1.0,
            slosh_damping: 0.02,
            slosh_height_m: 0.2,
            flexible_sqrt_kg_m: v,
            flexible_hz: 5.0,
            flexible_damping: 0.005,
            foreign: Foreign::default(),
        }
    }
}
