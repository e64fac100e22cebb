//! The right-hand side of the equations of motion.

use nalgebra::{Quaternion, Vector3};
use whorl_math::{quaternion_rate, vertical_b};

use super::equation::gravity_torque_n_m;
use super::{Gyrostat, MAX_JETS, MAX_WHEELS, RateEquation, State, friction_n_m};
use crate::Environment;
use crate::effects::{MAX_HIDDEN_STATES, contact_torque_b_n_m};

/// Stiffness of the bearing's own stop [N m/rad]: a platform of 10 kg m^2 rebounds within 0.25 s and
/// sinks in by less than half a degree at 0.1 rad/s.
const STOP_STIFFNESS_N_M_RAD: f64 = 2000.0;
/// Damping of the bearing's own stop [N m s]: about a third of critical for 10 kg m^2.
const STOP_DAMPING_N_M_S: f64 = 100.0;
/// A wheel's motor loses its torque over this last share of the largest speed, as back-EMF does.
const SPEED_LIMIT_BAND: f64 = 0.01;

/// Time derivative of [`State`].
#[derive(Debug, Clone, Copy)]
pub(crate) struct Derivative {
    pub quaternion: Quaternion<f64>,
    pub omega: Vector3<f64>,
    pub wheel_speed: [f64; MAX_WHEELS],
    pub gas: f64,
    pub hidden: [f64; MAX_HIDDEN_STATES],
}

/// What holds during a segment between two events.
#[derive(Debug, Clone)]
pub(crate) struct Drive {
    /// Motor torques, within the motors' limits.
    pub motor_torque_n_m: [f64; MAX_WHEELS],
    /// Sense of sliding of each wheel's bearing, -1 or 1; 0 where Coulomb friction holds the wheel.
    pub sliding: [f64; MAX_WHEELS],
    /// Wheels held by Coulomb friction.
    pub stuck: [bool; MAX_WHEELS],
    /// The equation of motion for this set of stuck wheels.
    pub equation: RateEquation,
    pub valve_fraction: [f64; MAX_JETS],
    /// Moment of the linear mass actuators' displacement, body axes [N m].
    pub ballast_moment_b_n_m: Vector3<f64>,
    pub ballast_direction: Vector3<f64>,
    /// Torque on the body from outside the platform, body axes [N m].
    pub body_torque_b_n_m: Vector3<f64>,
    /// The body is held still (wheel bench test).
    pub clamped: bool,
    pub initial_gas_kg: f64,
}

/// Jets at one instant, at reference pressure.
#[derive(Debug, Clone, Copy)]
pub(crate) struct JetDrive {
    pub torque_b_n_m: Vector3<f64>,
    pub thrust_n: f64,
}

impl Derivative {
    /// self + factor * other.
    fn add_scaled(&mut self, other: &Self, factor: f64, wheels: usize, hidden: usize) {
        self.quaternion += other.quaternion * factor;
        self.omega += other.omega * factor;
        for (sum, x) in self.wheel_speed.iter_mut().zip(&other.wheel_speed).take(wheels) {
            *sum += factor * x;
        }
        self.gas += factor * other.gas;
        for (sum, x) in self.hidden.iter_mut().zip(&other.hidden).take(hidden) {
            *sum += factor * x;
        }
    }

    /// (k1 + 2 k2 + 2 k3 + k4), six times the mean of a Runge-Kutta step.
    pub fn runge_kutta_sum(k1: &Self, k2: &Self, k3: &Self, k4: &Self, wheels: usize, hidden: usize) -> Self {
        let mut sum = *k1;
        sum.add_scaled(k2, 2.0, wheels, hidden);
        sum.add_scaled(k3, 2.0, wheels, hidden);
        sum.add_scaled(k4, 1.0, wheels, hidden);
        sum
    }
}

impl Gyrostat {
    /// What effects see in this state. `omega_dot` is zero while it is unknown.
    pub(crate) fn environment<'a>(
        &'a self,
        time_s: f64,
        state: &'a State,
        drive: &'a Drive,
    ) -> Environment<'a> {
        let (wheels, jets) = (self.model.wheels().len(), self.model.jets().len());
        // Sizes were checked in `Gyrostat::new`.
        let motor_torque = drive.motor_torque_n_m.get(..wheels).unwrap_or(&[]);
        let load: f64 = motor_torque.iter().map(|u| u.abs()).sum();
        let (bus, sensors) = (&self.model.bus, &self.model.sensors);
        Environment {
            model: &self.model,
            time_s,
            q_world_body: state.q_world_body,
            vertical_b: vertical_b(&state.q_world_body),
            omega_wb_b_rad_s: state.omega_wb_b_rad_s,
            omega_dot_wb_b_rad_s2: Vector3::zeros(),
            wheel_speed_rad_s: state.wheel_speed_rad_s.get(..wheels).unwrap_or(&[]),
            wheel_motor_torque_n_m: motor_torque,
            valve_fraction: drive.valve_fraction.get(..jets).unwrap_or(&[]),
            tank_pressure_pa: self.pressure_pa(state.gas_kg),
            gas_used_kg: drive.initial_gas_kg - state.gas_kg,
            bus_voltage_v: bus.initial_v - bus.discharge_v_s * time_s - bus.sag_v_n_m * load,
            temperature_k: sensors.ambient_temperature_k + sensors.temperature_drift_k_s * time_s,
            ballast_direction: drive.ballast_direction,
        }
    }

    /// Time derivative of `state`.
    pub(crate) fn derivative(
        &self,
        time_s: f64,
        state: &State,
        drive: &Drive,
        jets: &JetDrive,
    ) -> Derivative {
        let omega = state.omega_wb_b_rad_s;
        let vertical_b = vertical_b(&state.q_world_body);
        let wheels = self.model.wheels();
        // Array sizes were checked in `Gyrostat::new`: no index below can be out of bounds.
        let momentum = self.momentum_b_n_m_s(&omega, &state.wheel_speed_rad_s);
        let mut wheel_torque = [0.0; MAX_WHEELS];
        for (j, wheel) in wheels.iter().enumerate() {
            let speed = state.wheel_speed_rad_s[j];
            wheel_torque[j] =
                available_motor_torque_n_m(drive.motor_torque_n_m[j], speed, wheel.max_speed_rad_s)
                    + friction_n_m(wheel, speed, drive.sliding[j]);
        }

        let pressure_ratio = self.pressure_pa(state.gas_kg) / self.model.tank().reference_pressure_pa;
        // Most of the time no jet blows, and a power is expensive.
        let thrust_factor = if jets.thrust_n == 0.0 { 0.0 } else { self.thrust_factor(pressure_ratio) };
        let offset = self.model.mass_properties.gravity_offset_b_n_m() + drive.ballast_moment_b_n_m;
        let mut torque = jets.torque_b_n_m * thrust_factor
            + drive.body_torque_b_n_m
            + gravity_torque_n_m(&offset, &vertical_b)
            + contact_torque_b_n_m(
                &self.model.tilt_limit,
                STOP_STIFFNESS_N_M_RAD,
                STOP_DAMPING_N_M_S,
                &vertical_b,
                &omega,
            );
        let mut gas_rate_kg_s = self.gas_rate_kg_s(jets.thrust_n * thrust_factor);
        let mut environment = None;
        if !self.effects.is_empty() {
            let environment = environment.insert(self.environment(time_s, state, drive));
            torque += self.effects.torque_b_n_m(environment, &state.hidden);
            self.effects.add_wheel_torque_n_m(environment, &mut wheel_torque[..wheels.len()]);
            if state.gas_kg > 0.0 {
                gas_rate_kg_s += self.effects.gas_rate_kg_s(environment);
            }
        }

        let omega_dot = if drive.clamped {
            Vector3::zeros()
        } else {
            let on_wheels = self.on_wheels_b_n_m(&wheel_torque, &drive.stuck);
            drive.equation.acceleration_b_rad_s2(&omega, &momentum, &torque, &on_wheels)
        };
        let wheel_speed = self.wheel_accelerations_rad_s2(&wheel_torque, &drive.stuck, &omega_dot);
        let mut hidden = [0.0; MAX_HIDDEN_STATES];
        if let Some(mut environment) = environment.filter(|_| self.effects.hidden_states() > 0) {
            environment.omega_dot_wb_b_rad_s2 = omega_dot;
            self.effects.hidden_derivative(&environment, &state.hidden, &mut hidden);
        }
        Derivative {
            quaternion: quaternion_rate(&state.q_world_body, &omega),
            omega: omega_dot,
            wheel_speed,
            gas: -gas_rate_kg_s,
            hidden,
        }
    }

    /// Torque that the bearing of stuck wheel `j` must give to hold it [N m].
    pub(crate) fn holding_torque_n_m(
        &self,
        j: usize,
        time_s: f64,
        state: &State,
        drive: &Drive,
        omega_dot: &Vector3<f64>,
    ) -> f64 {
        let Some(wheel) = self.model.wheels().get(j) else { return 0.0 };
        let mut torque_n_m = drive.motor_torque_n_m;
        if !self.effects.is_empty() {
            let environment = self.environment(time_s, state, drive);
            self.effects.add_wheel_torque_n_m(&environment, &mut torque_n_m[..self.model.wheels().len()]);
        }
        wheel.spin_inertia_kg_m2 * wheel.spin_axis_b.dot(omega_dot) - torque_n_m[j]
    }
}

/// What the motor can give at this speed of what it was asked: less and less torque that would
/// exceed the largest speed.
fn available_motor_torque_n_m(asked_n_m: f64, speed_rad_s: f64, max_speed_rad_s: f64) -> f64 {
    if asked_n_m * speed_rad_s <= 0.0 {
        return asked_n_m;
    }
    let band = SPEED_LIMIT_BAND * max_speed_rad_s;
    asked_n_m * ((max_speed_rad_s - speed_rad_s.abs()) / band).clamp(0.0, 1.0)
}
