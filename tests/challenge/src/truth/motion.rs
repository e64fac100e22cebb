//! Equations of motion of the true platform, in a different form: total angular momentum in world
//! axes, axial momentum of each wheel, canonical momenta of sloshing and flexing masses, attitude as
//! modified Rodrigues parameters.
//!
//! ```text
//! dH_w/dt = R g_b                              torque about the centre of rotation
//! d h_j/dt = u_j,  h_j = J_j (Om_j + a_j . w)  motor and drag of wheel j
//! M w = R^T H_w - sum a_j h_j - m r x p - d q  with M = I - sum J a a^T - m [r]P[r]^T - d d^T
//! ```
//!
//! Body rates follow from momenta algebraically; nothing here divides by the library's reduced inertia
//! in a differential equation.

use nalgebra::{Matrix3, Quaternion, SVector, UnitQuaternion, Vector3};

use super::body::{Body, G_M_S2, across, turned};
use super::hidden::Hidden;
use super::valves::Valves;

/// Wheels of the platforms in the challenge.
pub const WHEELS: usize = 3;
/// sigma 0..3, H_w 3..6, h 6..9, wheel angle 9..12, slosh s 12..14 and p 14..16, flex 16..18, gas 18, heading counted
/// over whole turns 19.
pub type State = SVector<f64, 20>;
/// The laboratory's magnetic field (east, north, up) \[T\].
const FIELD_WORLD_T: Vector3<f64> = Vector3::new(-3.0e-6, 21.0e-6, -47.0e-6);

/// Motion as people describe it.
#[derive(Debug, Clone, PartialEq)]
pub struct Motion {
    pub q_world_body: UnitQuaternion<f64>,
    pub omega_b_rad_s: Vector3<f64>,
    pub wheel_speed_rad_s: [f64; WHEELS],
    pub wheel_angle_rad: [f64; WHEELS],
    /// Deflection and its rate; `None`: hanging at rest.
    pub slosh: Option<[f64; 4]>,
    pub flex: [f64; 2],
    pub gas_kg: f64,
    /// Heading counted over whole turns; `None`: the one nearest to that at which a cable is relaxed.
    pub heading_rad: Option<f64>,
}

/// What acts from outside at one instant.
#[derive(Debug, Clone, Copy)]
pub struct Inputs<'a> {
    pub time_s: f64,
    pub wheel_command_n_m: [f64; WHEELS],
    pub ballast_n_m: Vector3<f64>,
    pub volt: f64,
    pub temperature_k: f64,
    pub valves: &'a Valves,
    pub blowing: &'a [usize],
}

/// Everything at one instant.
#[derive(Debug, Clone, Copy)]
pub struct Instant {
    pub derivative: State,
    pub omega_b_rad_s: Vector3<f64>,
    pub omega_dot_b_rad_s2: Vector3<f64>,
    pub vertical_b: Vector3<f64>,
    /// Columns: world axes in body axes.
    pub world_to_body: Matrix3<f64>,
    pub wheel_speed_rad_s: [f64; WHEELS],
    pub valve_open: f64,
}

/// A platform with its hidden effects, ready to move.
#[derive(Debug, Clone)]
pub struct Mechanics {
    pub body: Body,
    pub hidden: Hidden,
    mass_inverse: Matrix3<f64>,
    slosh_arm: Vector3<f64>,
}

fn cross_matrix(v: &Vector3<f64>) -> Matrix3<f64> {
    v.cross_matrix()
}

/// World to body for modified Rodrigues parameters.
fn world_to_body(sigma: &Vector3<f64>) -> Matrix3<f64> {
    let square = sigma.norm_squared();
    let s = cross_matrix(sigma);
    Matrix3::identity() + (8.0 * s * s - 4.0 * (1.0 - square) * s) / (1.0 + square).powi(2)
}

fn v3(state: &State, first: usize) -> Vector3<f64> {
    Vector3::new(state[first], state[first + 1], state[first + 2])
}

impl Mechanics {
    /// Applies what changes constants, and prepares.
    #[must_use]
    pub fn new(mut body: Body, hidden: Hidden) -> Self {
        for (w, wheel) in body.wheels.iter_mut().enumerate() {
            wheel.spin_inertia_kg_m2 *= 1.0 + hidden.wheel_inertia[w];
            wheel.axis_b = turned(&wheel.axis_b, hidden.wheel_tilt_rad[w]);
        }
        for (j, jet) in body.jets.iter_mut().enumerate() {
            jet.thrust_n *= (1.0 + hidden.jet_strength_all) * (1.0 + hidden.jet_strength[j]);
            jet.direction_b = turned(&jet.direction_b, hidden.jet_tilt_rad[j]);
        }
        if hidden.slosh_kg > 0.0 {
            // The gravity offset that a balance measures is that with the liquid hanging at rest.
            let pull = G_M_S2 / (std::f64::consts::TAU * hidden.slosh_hz);
            body.mgr_n_m.z -= hidden.slosh_kg * pull * pull;
        }
        let slosh_arm = Vector3::z() * hidden.slosh_height_m;
        let mut mass = body.inertia_kg_m2 - hidden.flexible_sqrt_kg_m * hidden.flexible_sqrt_kg_m.transpose();
        for wheel in &body.wheels {
            mass -= wheel.axis_b * wheel.axis_b.transpose() * wheel.spin_inertia_kg_m2;
        }
        let r = cross_matrix(&slosh_arm);
        let level = Matrix3::from_diagonal(&Vector3::new(1.0, 1.0, 0.0));
        mass -= hidden.slosh_kg * r * level * r.transpose();
        let mass_inverse = mass.try_inverse().unwrap_or_else(Matrix3::zeros);
        Self { body, hidden, mass_inverse, slosh_arm }
    }

    /// The state that has this motion.
    #[must_use]
    pub fn state(&self, motion: &Motion) -> State {
        let q = motion.q_world_body.into_inner();
        let q = if q.w < 0.0 { -q } else { q };
        let sigma = q.imag() / (1.0 + q.w);
        let bn = world_to_body(&sigma);
        let (omega, k) = (motion.omega_b_rad_s, bn.column(2).into_owned());
        let mut state = State::zeros();
        state.fixed_rows_mut::<3>(0).copy_from(&sigma);
        let mut momentum = self.body.inertia_kg_m2 * omega;
        for (w, wheel) in self.body.wheels.iter().enumerate() {
            let speed = motion.wheel_speed_rad_s[w];
            momentum += wheel.axis_b * (wheel.spin_inertia_kg_m2 * speed);
            state[6 + w] = wheel.spin_inertia_kg_m2 * (speed + wheel.axis_b.dot(&omega));
            state[9 + w] = motion.wheel_angle_rad[w];
        }
        let pull = G_M_S2 / (std::f64::consts::TAU * self.hidden.slosh_hz).powi(2);
        let slosh = motion.slosh.unwrap_or([-pull * k.x, -pull * k.y, 0.0, 0.0]);
        let carried = omega.cross(&self.slosh_arm);
        let rate = Vector3::new(slosh[2], slosh[3], 0.0);
        momentum += self.hidden.slosh_kg * self.slosh_arm.cross(&rate);
        state[12] = slosh[0];
        state[13] = slosh[1];
        state[14] = slosh[2] + carried.x;
        state[15] = slosh[3] + carried.y;
        momentum += self.hidden.flexible_sqrt_kg_m * motion.flex[1];
        state[16] = motion.flex[0];
        state[17] = motion.flex[1] + self.hidden.flexible_sqrt_kg_m.dot(&omega);
        state[18] = motion.gas_kg;
        let relaxed = self.hidden.winding_yaw_rad;
        let twist = bn[(0, 1)].atan2(bn[(0, 0)]) - relaxed;
        state[19] = motion.heading_rad.unwrap_or(relaxed + twist.sin().atan2(twist.cos()));
        state.fixed_rows_mut::<3>(3).copy_from(&(bn.transpose() * momentum));
        state
    }

    /// The motion of this state.
    #[must_use]
    pub fn motion(&self, state: &State) -> Motion {
        let sigma = v3(state, 0);
        let square = sigma.norm_squared();
        let q = Quaternion::from_parts((1.0 - square) / (1.0 + square), sigma * (2.0 / (1.0 + square)));
        let (_, omega, speed) = self.rates(state);
        let carried = omega.cross(&self.slosh_arm);
        Motion {
            q_world_body: UnitQuaternion::from_quaternion(q),
            omega_b_rad_s: omega,
            wheel_speed_rad_s: speed,
            wheel_angle_rad: [state[9], state[10], state[11]],
            slosh: Some([state[12], state[13], state[14] - carried.x, state[15] - carried.y]),
            flex: [state[16], state[17] - self.hidden.flexible_sqrt_kg_m.dot(&omega)],
            gas_kg: state[18],
            heading_rad: Some(state[19]),
        }
    }

    /// Total momentum in body axes, body rate, wheel speeds.
    fn rates(&self, state: &State) -> (Vector3<f64>, Vector3<f64>, [f64; WHEELS]) {
        let momentum = world_to_body(&v3(state, 0)) * v3(state, 3);
        let mut carried = momentum;
        for (w, wheel) in self.body.wheels.iter().enumerate() {
            carried -= wheel.axis_b * state[6 + w];
        }
        let p = Vector3::new(state[14], state[15], 0.0);
        carried -=
            self.hidden.slosh_kg * self.slosh_arm.cross(&p) + self.hidden.flexible_sqrt_kg_m * state[17];
        let omega = self.mass_inverse * carried;
        let mut speed = [0.0; WHEELS];
        for (w, wheel) in self.body.wheels.iter().enumerate() {
            speed[w] = state[6 + w] / wheel.spin_inertia_kg_m2 - wheel.axis_b.dot(&omega);
        }
        (momentum, omega, speed)
    }

    /// Tank pressure \[Pa\]: the gas cools a little as it expands.
    #[must_use]
    pub fn pressure_pa(&self, gas_kg: f64) -> f64 {
        self.body.full_pressure_pa * (gas_kg.max(0.0) / self.body.full_gas_kg).powf(1.08)
    }

    /// Kinetic and potential energy without slosh and flexing \[J\].
    #[must_use]
    pub fn energy_j(&self, state: &State) -> f64 {
        let (_, omega, speed) = self.rates(state);
        let bn = world_to_body(&v3(state, 0));
        let mut twice = omega.dot(&(self.body.inertia_kg_m2 * omega));
        for (wheel, speed) in self.body.wheels.iter().zip(speed) {
            let along = wheel.axis_b.dot(&omega);
            twice += wheel.spin_inertia_kg_m2 * ((along + speed).powi(2) - along * along);
        }
        0.5 * twice + self.body.mgr_n_m.dot(&bn.column(2))
    }

    /// Derivative and outputs at one instant.
    #[must_use]
    pub fn at(&self, state: &State, inputs: &Inputs<'_>) -> Instant {
        let (body, hidden, foreign) = (&self.body, &self.hidden, &self.hidden.foreign);
        let sigma = v3(state, 0);
        let bn = world_to_body(&sigma);
        let k = bn.column(2).into_owned();
        let (momentum, omega, speed) = self.rates(state);
        let pressure_ratio = self.pressure_pa(state[18]) / body.reference_pressure_pa;
        let warm_k = inputs.temperature_k - body.ambient_k;

        let mgr = body.mgr_n_m
            + inputs.ballast_n_m
            + hidden.mass_shift_n_m_kg * (body.full_gas_kg - state[18])
            + foreign.warm_cg_n_m_k * warm_k
            + foreign.drift_cg_n_m_s * inputs.time_s;
        let mut torque = k.cross(&mgr);

        // Jets.
        let exponent = body.pressure_exponent + hidden.pressure_exponent;
        let mut factor = if pressure_ratio > 0.0 { pressure_ratio.powf(exponent) } else { 0.0 };
        factor *= (inputs.volt / body.full_v).powf(hidden.thrust_voltage_exponent);
        let (mut thrust_n, mut valve_open) = (0.0, 0.0_f64);
        for &j in inputs.blowing {
            let fraction = inputs.valves.fraction(j, inputs.time_s);
            let jet = &body.jets[j];
            let force = jet.thrust_n * fraction * factor;
            torque += jet.position_b_m.cross(&jet.direction_b) * force;
            thrust_n += force;
            valve_open = valve_open.max(fraction);
        }
        for (j, leak) in hidden.leak_n.iter().enumerate() {
            if *leak > 0.0 {
                let shut = 1.0
                    - if inputs.blowing.contains(&j) {
                        inputs.valves.fraction(j, inputs.time_s)
                    } else {
                        0.0
                    };
                let force = leak * shut * pressure_ratio;
                torque += body.jets[j].position_b_m.cross(&body.jets[j].direction_b) * force;
                thrust_n += force;
            }
        }
        if foreign.burst_leak_n > 0.0
            && foreign.burst_s.iter().any(|(a, b)| (*a..*b).contains(&inputs.time_s))
        {
            let jet = &body.jets[foreign.burst_jet];
            torque += jet.position_b_m.cross(&jet.direction_b) * foreign.burst_leak_n * pressure_ratio;
        }

        torque += self.surroundings(&bn, &omega, inputs.time_s);
        // Azimuth of body x in the room, and how fast it turns.
        let (east, north) = (bn[(0, 0)], bn[(0, 1)]);
        let moved = bn.transpose() * omega.cross(&Vector3::x());
        let heading_rate = (east * moved.y - north * moved.x) / (east * east + north * north);
        let twist = state[19] - hidden.winding_yaw_rad;
        let hardening = 1.0 + 0.02 * (twist / std::f64::consts::TAU).powi(2);
        torque -= k * (hidden.winding_n_m_rad * twist * hardening + hidden.winding_n_m_s * omega.dot(&k));
        torque.z += foreign.voltage_torque_n_m_v * (body.full_v - inputs.volt);

        // Wheels.
        let mut derivative = State::zeros();
        for (w, wheel) in body.wheels.iter().enumerate() {
            let asked = inputs.wheel_command_n_m[w].clamp(-wheel.max_torque_n_m, wheel.max_torque_n_m);
            let rate = speed[w];
            let coulomb =
                wheel.coulomb_n_m + hidden.wheel_coulomb_n_m[w] * (1.0 + 0.1 * (-(rate / 3.0).powi(2)).exp());
            let constant = 1.0 + hidden.wheel_constant[w];
            let mut u = asked * constant * (1.0 + hidden.wheel_torque_per_v * (inputs.volt - body.full_v))
                + hidden.wheel_bias_n_m[w]
                - (wheel.viscous_n_m_s + hidden.wheel_viscous_n_m_s[w]) * rate
                - coulomb * rate / rate.hypot(0.2)
                - hidden.wheel_windage_n_m_s2[w]
                    * rate
                    * rate.abs()
                    * (rate.abs().max(1.0) / 100.0).powf(-0.1);
            if w == 0 {
                u -= foreign.grease(rate, inputs.time_s);
            }
            if w == 2 && foreign.gear_n_m != 0.0 {
                u += foreign.gear_n_m * (foreign.gear_teeth * state[9 + w]).sin();
            }
            derivative[6 + w] = u;
            derivative[9 + w] = rate;
            let imbalance = hidden.wheel_imbalance_kg_m2[w];
            if imbalance != 0.0 {
                let [e1, e2] = across(&wheel.axis_b);
                let (sine, cosine) = state[9 + w].sin_cos();
                torque += (e1 * cosine + e2 * sine) * (imbalance * rate * rate);
            }
        }

        // Slosh.
        if hidden.slosh_kg > 0.0 {
            let carried = omega.cross(&self.slosh_arm);
            let (sx, sy) = (state[14] - carried.x, state[15] - carried.y);
            let w = std::f64::consts::TAU * hidden.slosh_hz;
            let spin = omega.cross(&carried);
            derivative[12] = sx;
            derivative[13] = sy;
            derivative[14] = -2.0 * hidden.slosh_damping * w * sx - w * w * state[12] - spin.x - G_M_S2 * k.x;
            derivative[15] = -2.0 * hidden.slosh_damping * w * sy - w * w * state[13] - spin.y - G_M_S2 * k.y;
            torque -= hidden.slosh_kg * G_M_S2 * Vector3::new(state[12], state[13], 0.0).cross(&k);
        }
        // Flexing.
        let d = hidden.flexible_sqrt_kg_m;
        if d != Vector3::zeros() {
            let w = std::f64::consts::TAU * hidden.flexible_hz;
            let rate = state[17] - d.dot(&omega);
            derivative[16] = rate;
            derivative[17] = -2.0 * hidden.flexible_damping * w * rate - w * w * state[16];
        }

        let square = sigma.norm_squared();
        let sigma_dot =
            0.25 * ((1.0 - square) * omega + 2.0 * sigma.cross(&omega) + 2.0 * sigma * sigma.dot(&omega));
        derivative.fixed_rows_mut::<3>(0).copy_from(&sigma_dot);
        derivative.fixed_rows_mut::<3>(3).copy_from(&(bn.transpose() * torque));
        derivative[18] = -thrust_n / body.exhaust_m_s;
        derivative[19] = heading_rate;

        let mut change = torque - omega.cross(&momentum);
        for (w, wheel) in body.wheels.iter().enumerate() {
            change -= wheel.axis_b * derivative[6 + w];
        }
        let p_dot = Vector3::new(derivative[14], derivative[15], 0.0);
        change -= hidden.slosh_kg * self.slosh_arm.cross(&p_dot) + d * derivative[17];
        Instant {
            derivative,
            omega_b_rad_s: omega,
            omega_dot_b_rad_s2: self.mass_inverse * change,
            vertical_b: k,
            world_to_body: bn,
            wheel_speed_rad_s: speed,
            valve_open,
        }
    }

    /// Torques that need no actuator [N m], body axes.
    fn surroundings(&self, bn: &Matrix3<f64>, omega: &Vector3<f64>, time_s: f64) -> Vector3<f64> {
        let (hidden, foreign) = (&self.hidden, &self.hidden.foreign);
        let k = bn.column(2).into_owned();
        let rate = omega.norm();
        let mut torque = -hidden.viscous_n_m_s * omega;
        if hidden.coulomb_n_m != 0.0 && rate > 0.0 {
            // Stribeck: a little more at the slowest.
            let size =
                hidden.coulomb_n_m * (1.0 + 0.15 * (-(rate / 0.004).powi(2)).exp()) * (rate / 6e-4).tanh();
            torque -= omega * (size / rate);
        }
        if rate > 0.0 {
            torque -= hidden.drag_n_m_s2.component_mul(omega) * (rate * (rate / 0.15).powf(-0.2));
        }
        if hidden.power_drag_n_m != 0.0 && rate > 0.0 {
            torque -= omega / rate * (hidden.power_drag_n_m * (rate / 0.1).powf(hidden.power_drag_exponent));
        }
        if hidden.cycle_b_n_m != Vector3::zeros() {
            let phase =
                hidden.cycle_phase_rad.map(|p| (std::f64::consts::TAU * hidden.cycle_hz * time_s + p).sin());
            torque += hidden.cycle_b_n_m.component_mul(&phase);
        }
        torque += bn * hidden.air_current_world_n_m;
        if hidden.periodic_world_n_m != Vector3::zeros() {
            let phase = std::f64::consts::TAU * hidden.periodic_hz * time_s + hidden.periodic_phase_rad;
            torque += bn * hidden.periodic_world_n_m * phase.sin();
        }
        torque.z += hidden.turbine_body_n_m;
        torque += k * hidden.turbine_vertical_n_m;
        torque += hidden.dipole_b_a_m2.cross(&(bn * FIELD_WORLD_T));
        let yaw = bn[(0, 1)].atan2(bn[(0, 0)]);
        if hidden.cable_n_m_rad != 0.0 || hidden.cable_n_m_s != 0.0 {
            let twist = (yaw - hidden.cable_yaw_rad).sin().atan2((yaw - hidden.cable_yaw_rad).cos());
            let stiffening = 1.0 + 0.15 * (twist / std::f64::consts::PI).powi(2);
            torque -= k * (hidden.cable_n_m_rad * twist * stiffening + hidden.cable_n_m_s * omega.dot(&k));
        }
        torque += self.body.weight_n.powi(2) * (hidden.compliance_m_n * k).cross(&k);
        let level = k.x.hypot(k.y);
        let tilt = level.atan2(k.z);
        if hidden.contact_n_m_rad > 0.0 && tilt > hidden.contact_rad {
            let away = Vector3::new(k.y, -k.x, 0.0) / level;
            let depth = tilt - hidden.contact_rad;
            let damping = hidden.contact_n_m_s * (depth / 5e-4).min(1.0);
            torque -= away * (hidden.contact_n_m_rad * depth + damping * omega.dot(&away)).max(0.0);
        }
        torque + foreign.torque(bn, omega, time_s)
    }

    /// One classical Runge-Kutta step.
    #[must_use]
    pub fn step(&self, state: &State, inputs: &Inputs<'_>, step_s: f64) -> State {
        let later = |by: f64| Inputs { time_s: inputs.time_s + by, ..*inputs };
        let k1 = self.at(state, inputs).derivative;
        let k2 = self.at(&(state + k1 * (0.5 * step_s)), &later(0.5 * step_s)).derivative;
        let k3 = self.at(&(state + k2 * (0.5 * step_s)), &later(0.5 * step_s)).derivative;
        // Just before the end: a valve edge there belongs to the next step.
        let k4 = self.at(&(state + k3 * step_s), &later(step_s - 1e-8)).derivative;
        let mut next = state + (k1 + 2.0 * (k2 + k3) + k4) * (step_s / 6.0);
        let square = next.fixed_rows::<3>(0).norm_squared();
        if square > 1.0 {
            // The shadow set: the same attitude, away from the singularity.
            for i in 0..3 {
                next[i] /= -square;
            }
        }
        next
    }
}
