//! Constants of the true platform, and how they differ from the drawing.

use nalgebra::{Matrix3, Unit, UnitQuaternion, Vector3};
use rand_distr::{Distribution, StandardNormal};
use rand_pcg::Pcg64;
use whorl_dynamics::PlatformModel;
use whorl_dynamics::platform::ModelPrior;

/// A wheel.
#[derive(Debug, Clone)]
pub struct TrueWheel {
    pub axis_b: Vector3<f64>,
    pub spin_inertia_kg_m2: f64,
    pub viscous_n_m_s: f64,
    pub coulomb_n_m: f64,
    pub max_torque_n_m: f64,
}

/// A jet.
#[derive(Debug, Clone)]
pub struct TrueJet {
    pub position_b_m: Vector3<f64>,
    pub direction_b: Vector3<f64>,
    pub thrust_n: f64,
    pub opening_s: f64,
    pub closing_s: f64,
}

/// The platform as it is.
#[derive(Debug, Clone)]
pub struct Body {
    pub inertia_kg_m2: Matrix3<f64>,
    pub mgr_n_m: Vector3<f64>,
    pub weight_n: f64,
    pub wheels: Vec<TrueWheel>,
    pub jets: Vec<TrueJet>,
    pub full_gas_kg: f64,
    pub full_pressure_pa: f64,
    pub reference_pressure_pa: f64,
    pub pressure_exponent: f64,
    pub exhaust_m_s: f64,
    pub full_v: f64,
    pub sag_v_n_m: f64,
    pub ambient_k: f64,
    pub lever_arm_m: Vector3<f64>,
    pub lamp_world: Vector3<f64>,
    pub tilt_max_rad: f64,
}

/// Standard gravity used by the laboratory [m/s^2].
pub const G_M_S2: f64 = 9.81;

/// A constant that the drawing gives only roughly.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Constant {
    /// Inertia element (row, column).
    Inertia(usize, usize),
    /// m g r_cg.
    Mgr(usize),
    /// Relative error of a wheel's spin inertia.
    WheelInertia(usize),
    /// Tilt of a wheel's axis.
    WheelTilt(usize, usize),
    /// Relative error of a jet's thrust.
    JetThrust(usize),
    /// Tilt of a jet.
    JetTilt(usize, usize),
}

/// The two axes across `axis`: axis x z (x x for an axis along z), then axis x that.
#[must_use]
pub fn across(axis: &Vector3<f64>) -> [Vector3<f64>; 2] {
    let helper = if axis.z.abs() > 0.708 { Vector3::x() } else { Vector3::z() };
    let first = Unit::new_normalize(axis.cross(&helper)).into_inner();
    [first, axis.cross(&first)]
}

/// `axis` turned by small angles about the two axes across it.
#[must_use]
pub fn turned(axis: &Vector3<f64>, angles: [f64; 2]) -> Vector3<f64> {
    let [e1, e2] = across(axis);
    UnitQuaternion::from_scaled_axis(e1 * angles[0] + e2 * angles[1]) * axis
}

impl Body {
    /// Exactly as drawn.
    #[must_use]
    pub fn as_drawn(model: &PlatformModel) -> Self {
        let tank = model.tank();
        Self {
            inertia_kg_m2: *model.mass_properties.inertia_b_kg_m2(),
            mgr_n_m: *model.mass_properties.gravity_offset_b_n_m(),
            weight_n: model.mass_properties.mass_kg() * G_M_S2,
            wheels: model
                .wheels()
                .iter()
                .map(|w| TrueWheel {
                    axis_b: w.spin_axis_b.into_inner(),
                    spin_inertia_kg_m2: w.spin_inertia_kg_m2,
                    viscous_n_m_s: w.viscous_friction_n_m_s,
                    coulomb_n_m: w.coulomb_friction_n_m,
                    max_torque_n_m: w.max_torque_n_m,
                })
                .collect(),
            jets: model
                .jets()
                .iter()
                .map(|j| TrueJet {
                    position_b_m: j.position_b_m,
                    direction_b: j.force_direction_b.into_inner(),
                    thrust_n: j.thrust_n,
                    opening_s: j.opening_delay_s,
                    closing_s: j.closing_delay_s,
                })
                .collect(),
            full_gas_kg: tank.initial_pressure_pa * tank.volume_m3
                / (tank.gas_constant_j_kg_k * tank.temperature_k),
            full_pressure_pa: tank.initial_pressure_pa,
            reference_pressure_pa: tank.reference_pressure_pa,
            pressure_exponent: tank.thrust_pressure_exponent,
            exhaust_m_s: G_M_S2 * tank.specific_impulse_s,
            full_v: model.bus.initial_v,
            sag_v_n_m: model.bus.sag_v_n_m,
            ambient_k: model.sensors.ambient_temperature_k,
            lever_arm_m: model.sensors.accelerometer.lever_arm_b_m,
            lamp_world: model
                .sensors
                .vector
                .map_or(Vector3::x(), |v| v.reference_direction_world.into_inner()),
            tilt_max_rad: match model.tilt_limit {
                whorl_dynamics::platform::TiltLimit::Cone { max_rad }
                | whorl_dynamics::platform::TiltLimit::Pitch { max_rad } => max_rad,
            },
        }
    }

    /// Every constant with an uncertain prior, with its standard deviation.
    #[must_use]
    pub fn uncertain(&self, prior: &ModelPrior) -> Vec<(Constant, f64)> {
        let mut list = Vec::new();
        for (i, j) in [(0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2)] {
            list.push((Constant::Inertia(i, j), prior.inertia_b_kg_m2[(i, j)]));
        }
        list.extend((0..3).map(|i| (Constant::Mgr(i), prior.gravity_offset_b_n_m[i])));
        for w in 0..self.wheels.len() {
            list.push((Constant::WheelInertia(w), prior.actuators.wheels.spin_inertia[w]));
            list.push((Constant::WheelTilt(w, 0), prior.actuators.wheels.axis_rad[w]));
            list.push((Constant::WheelTilt(w, 1), prior.actuators.wheels.axis_rad[w]));
        }
        for j in 0..self.jets.len() {
            list.push((Constant::JetThrust(j), prior.actuators.jets.thrust[j]));
            list.push((Constant::JetTilt(j, 0), prior.actuators.jets.direction_rad[j]));
            list.push((Constant::JetTilt(j, 1), prior.actuators.jets.direction_rad[j]));
        }
        list
    }

    /// Moves one constant.
    pub fn shift(&mut self, constant: Constant, by: f64) {
        match constant {
            Constant::Inertia(i, j) => {
                self.inertia_kg_m2[(i, j)] += by;
                if i != j {
                    self.inertia_kg_m2[(j, i)] += by;
                }
            }
            Constant::Mgr(i) => self.mgr_n_m[i] += by,
            Constant::WheelInertia(w) => self.wheels[w].spin_inertia_kg_m2 *= 1.0 + by,
            Constant::WheelTilt(w, axis) => {
                let mut angles = [0.0; 2];
                angles[axis] = by;
                self.wheels[w].axis_b = turned(&self.wheels[w].axis_b, angles);
            }
            Constant::JetThrust(j) => self.jets[j].thrust_n *= 1.0 + by,
            Constant::JetTilt(j, axis) => {
                let mut angles = [0.0; 2];
                angles[axis] = by;
                self.jets[j].direction_b = turned(&self.jets[j].direction_b, angles);
            }
        }
    }

    /// A platform built after the drawing: every constant off by a draw from its prior. Draws that no
    /// rigid body has, or that would topple, are drawn again.
    #[must_use]
    pub fn built(model: &PlatformModel, prior: &ModelPrior, rng: &mut Pcg64) -> Self {
        let drawn = Self::as_drawn(model);
        loop {
            let mut body = drawn.clone();
            for (constant, stddev) in drawn.uncertain(prior) {
                let n: f64 = StandardNormal.sample(rng);
                body.shift(constant, stddev * n.clamp(-2.5, 2.5));
            }
            let mut moments: [f64; 3] = nalgebra::SymmetricEigen::new(body.inertia_kg_m2).eigenvalues.into();
            moments.sort_by(f64::total_cmp);
            let is_real = moments[0] > 0.0 && moments[2] < 0.99 * (moments[0] + moments[1]);
            let balance_rad = body.mgr_n_m.x.hypot(body.mgr_n_m.y) / -body.mgr_n_m.z;
            if is_real && body.mgr_n_m.z < -1.2 && balance_rad < 0.045 {
                return body;
            }
        }
    }
}
