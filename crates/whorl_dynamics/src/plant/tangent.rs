//! Small changes of a plant's state: what they do to its motion and to its inertial sensors.
//!
//! A filter carries a plant as its mean; the covariance needs the derivative of the equations of motion by the state, and
//! a correction must reach the state without disturbing the rest. Where effects act, derivatives are central differences of the plant's
//! own equations, so that they hold for every effect, also one that a user has written.

use std::ops::Range;

use nalgebra::{DMatrix, Matrix3, SVector, Vector3};
use whorl_math::quaternion_exp;

use super::Plant;
use crate::actuators::Forces;
use crate::gyrostat::{Derivative, Drive};
use crate::sensing::History;
use crate::{State, TrueImu};

/// Steps of the differences: a rotation \[rad\]; a rate [rad/s] and a hidden state, in proportion where they are large; a
/// wheel's speed [rad/s]. Central differences err by the third derivative times their square: below 1e-9 of a motion.
const ROTATION_RAD: f64 = 1e-5;
const RATE_RAD_S: f64 = 1e-6;
const WHEEL_RAD_S: f64 = 1e-4;

/// Coordinates of a small change of a plant's state, in this order: rotation of the body about its own axes, R_changed =
/// R exp(a) \[rad\]; rate, body axes [rad/s]; speed of each wheel [rad/s]; hidden states of effects.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Tangent {
    wheels: usize,
    hidden: usize,
}

/// Rotation.
pub const ROTATION: Range<usize> = 0..3;
/// Rate.
pub const RATE: Range<usize> = 3..6;

impl Tangent {
    /// Where the wheels' speeds are.
    #[must_use]
    pub fn wheels(&self) -> Range<usize> {
        RATE.end..RATE.end + self.wheels
    }

    /// Where the hidden states are.
    #[must_use]
    pub fn hidden(&self) -> Range<usize> {
        self.wheels().end..self.size()
    }

    /// How many coordinates there are.
    #[must_use]
    pub fn size(&self) -> usize {
        RATE.end + self.wheels + self.hidden
    }

    /// Central differences of what is seen one step to either side: rates of the coordinates (of the rotation none), and
    /// the six numbers that the inertial sensors read.
    fn slope(&self, plus: &Seen, minus: &Seen, step: f64, rates: &mut [f64], imu: &mut [f64]) {
        let per = 0.5 / step;
        let (plus_rates, minus_rates) = (&plus.derivative, &minus.derivative);
        rates[RATE].copy_from_slice(((plus_rates.omega - minus_rates.omega) * per).as_slice());
        let speeds = |of: &Derivative| of.actuators.wheels.speed_rad_s;
        let (plus_speeds, minus_speeds) = (speeds(plus_rates), speeds(minus_rates));
        for (row, j) in self.wheels().zip(0..) {
            rates[row] = (plus_speeds[j] - minus_speeds[j]) * per;
        }
        for (row, j) in self.hidden().zip(0..) {
            rates[row] = (plus_rates.hidden[j] - minus_rates.hidden[j]) * per;
        }
        imu.copy_from_slice(((plus.imu - minus.imu) * per).as_slice());
    }
}

/// Derivatives at one instant; of `n` = [`Tangent::size`] coordinates.
#[derive(Debug, Clone, PartialEq)]
pub struct LinearisedPlant {
    /// n x n: rate of each coordinate by each coordinate [unit/s per unit].
    pub rate_by_state: DMatrix<f64>,
    /// n x 3: rate of each coordinate by a torque on the body, body axes [unit/s per N m].
    pub rate_by_torque: DMatrix<f64>,
    /// 6 x n: what gyro [rad/s] and accelerometer [m/s^2] read by each coordinate, sensor axes.
    pub imu_by_state: DMatrix<f64>,
    /// What the accelerometer reads by a torque on the body [m/s^2 per N m].
    pub force_by_torque: Matrix3<f64>,
}

impl LinearisedPlant {
    /// Room for derivatives of a plant, all zero.
    #[must_use]
    pub fn none(plant: &Plant) -> Self {
        let n = plant.tangent().size();
        Self {
            rate_by_state: DMatrix::zeros(n, n),
            rate_by_torque: DMatrix::zeros(n, 3),
            imu_by_state: DMatrix::zeros(6, n),
            force_by_torque: Matrix3::zeros(),
        }
    }
}

/// What the plant does in one state.
pub(super) struct Seen {
    pub derivative: Derivative,
    pub imu: SVector<f64, 6>,
}

impl Plant {
    /// The same with sensors whose data are not late: a filter takes readings at the instants that they show.
    #[must_use]
    pub fn without_latency(mut self) -> Self {
        let sensors = &mut self.gyrostat.model_mut().sensors;
        sensors.gyro.errors.latency_s = 0.0;
        sensors.accelerometer.errors.latency_s = 0.0;
        if let Some(vector) = &mut sensors.vector {
            vector.latency_s = 0.0;
        }
        self.history = History::new(0);
        self
    }

    /// Coordinates of a small change of its state.
    #[must_use]
    pub fn tangent(&self) -> Tangent {
        Tangent {
            wheels: self.gyrostat.model().wheels().len(),
            hidden: self.gyrostat.effects().hidden_states(),
        }
    }

    /// Which wheels their bearing's dry friction holds.
    pub fn held_wheels(&self) -> impl Iterator<Item = bool> + '_ {
        (0..self.gyrostat.model().wheels().len()).map(|j| self.drive.actuators.wheels.holds(j))
    }

    /// Whether the bearing's own stop touches, and whether a contact among the effects does.
    #[must_use]
    pub fn touching(&self) -> [bool; 2] {
        self.contact_torques_b_n_m().map(|torque| torque != Vector3::zeros())
    }

    /// Angular acceleration by what touches, body axes [rad/s^2].
    #[must_use]
    pub fn contact_acceleration_b_rad_s2(&self) -> Vector3<f64> {
        self.gyrostat.rate_equation().inverse_resisting()
            * self.contact_torques_b_n_m().iter().sum::<Vector3<f64>>()
    }

    fn contact_torques_b_n_m(&self) -> [Vector3<f64>; 2] {
        self.gyrostat.contact_torques_b_n_m(self.time_s(), &self.state, &self.drive)
    }

    /// What gyro [rad/s] and accelerometer [m/s^2] read now without noise, limits, latency and biases that are drawn,
    /// sensor axes.
    #[must_use]
    pub fn imu_reading(&self) -> (Vector3<f64>, Vector3<f64>) {
        let imu = self.seen(&self.state, &self.drive).imu;
        (imu.fixed_rows::<3>(0).into(), imu.fixed_rows::<3>(3).into())
    }

    /// Derivatives in the present state, under the present commands and the present branches of contacts and dry friction; those by a
    /// torque as well if `by_torque`. On paper where that is all there is, else by differences.
    pub fn linearise_into(&self, found: &mut LinearisedPlant, by_torque: bool) {
        found.rate_by_state.fill(0.0);
        found.imu_by_state.fill(0.0);
        if !self.derive_into(found) {
            self.difference_states(found);
            if by_torque {
                self.difference_torques(found);
            }
        }
        self.turn_with_the_body(found);
    }

    /// By central differences of the plant's own equations, whatever acts.
    #[cfg(test)]
    pub(super) fn difference_into(&self, found: &mut LinearisedPlant) {
        self.difference_states(found);
        self.difference_torques(found);
        self.turn_with_the_body(found);
    }

    /// da/dt = dw - w x a of the rotation.
    fn turn_with_the_body(&self, found: &mut LinearisedPlant) {
        if self.gyrostat.model().freedom.turns() && !self.drive.clamped {
            let turn =
                found.rate_by_state.fixed_view::<3, 3>(0, 0) - whorl_math::skew(&self.state.omega_wb_b_rad_s);
            found.rate_by_state.fixed_view_mut::<3, 3>(0, 0).copy_from(&turn);
            let free = self.gyrostat.model().freedom.projection();
            found.rate_by_state.fixed_view_mut::<3, 3>(0, 3).copy_from(&free);
        }
    }

    fn difference_states(&self, found: &mut LinearisedPlant) {
        let tangent = self.tangent();
        let turns = self.gyrostat.model().freedom.turns() && !self.drive.clamped;
        for i in (0..tangent.size()).filter(|i| turns || !RATE.contains(i)) {
            let step = self.step_of(i);
            let [plus, minus] = [step, -step].map(|step| {
                let mut state = self.state;
                change_coordinate(&mut state, &tangent, i, step);
                self.seen(&state, &self.drive)
            });
            let (mut rates, mut imu) = (found.rate_by_state.column_mut(i), found.imu_by_state.column_mut(i));
            tangent.slope(&plus, &minus, step, rates.as_mut_slice(), imu.as_mut_slice());
        }
    }

    /// The derivatives by a torque on the body; what has hidden states may follow it too.
    fn difference_torques(&self, to: &mut LinearisedPlant) {
        let tangent = self.tangent();
        let mut drive = self.drive.clone();
        // In proportion to the inertia: a rate of 1 rad/s^2 on any rig.
        let step = self.gyrostat.model().mass_properties.inertia_b_kg_m2().trace() / 3.0;
        let own = drive.body_torque_b_n_m;
        let mut imu = SVector::<f64, 6>::zeros();
        for axis in 0..3 {
            let [plus, minus] = [step, -step].map(|step| {
                drive.body_torque_b_n_m = own + Vector3::ith(axis, step);
                self.seen(&self.state, &drive)
            });
            let mut rates = to.rate_by_torque.column_mut(axis);
            tangent.slope(&plus, &minus, step, rates.as_mut_slice(), imu.as_mut_slice());
            to.force_by_torque.set_column(axis, &imu.fixed_rows::<3>(3));
        }
    }

    /// Changes the state by [`Tangent`] coordinates, as an estimate's correction does: time, gas, valves and commands go
    /// on as they were; what is behind a sensor's low-pass changes as if the state had been so for a while. Wheels that
    /// their friction holds stay held. Numbers that are not finite are ignored.
    pub fn change_state(&mut self, change: &[f64]) {
        let tangent = self.tangent();
        if change.len() < tangent.size() || !change.iter().all(|x| x.is_finite()) {
            return;
        }
        let before = self.has_filter.then(|| self.ideal_imu(&self.state, &Vector3::zeros()));
        self.move_by(change);
        let behind = self.behind_filter;
        self.keep_parts();
        if let Some(before) = before {
            let after = self.ideal_imu(&self.state, &Vector3::zeros());
            self.behind_filter = TrueImu {
                angular_velocity_b_rad_s: behind.angular_velocity_b_rad_s + after.angular_velocity_b_rad_s
                    - before.angular_velocity_b_rad_s,
                specific_force_b_m_s2: behind.specific_force_b_m_s2 + after.specific_force_b_m_s2
                    - before.specific_force_b_m_s2,
            };
        }
    }

    /// Adds [`Tangent`] coordinates to the state, and no more.
    pub(super) fn move_by(&mut self, change: &[f64]) {
        let tangent = self.tangent();
        let of = |range: Range<usize>| {
            Vector3::from_fn(|i, _| change.get(range.start + i).copied().unwrap_or(0.0))
        };
        if self.gyrostat.model().freedom.turns() && !self.drive.clamped {
            self.state.omega_wb_b_rad_s += self.gyrostat.model().freedom.share(&of(RATE));
        }
        self.state.q_world_body *= quaternion_exp(&of(ROTATION));
        self.state.normalise();
        for (j, i) in tangent.wheels().enumerate() {
            if !self.drive.actuators.wheels.holds(j) {
                let speed = self.state.wheel_speed_rad_s().get(j).copied().unwrap_or(0.0);
                self.state.set_one_wheel_speed_rad_s(j, speed + change[i]);
            }
        }
        for (i, hidden) in tangent.hidden().zip(&mut self.state.hidden) {
            *hidden += change[i];
        }
    }

    fn step_of(&self, i: usize) -> f64 {
        let tangent = self.tangent();
        if ROTATION.contains(&i) {
            return ROTATION_RAD;
        }
        if RATE.contains(&i) {
            return RATE_RAD_S * (1.0 + self.state.omega_wb_b_rad_s.norm());
        }
        if let Some(speed) =
            tangent.wheels().position(|k| k == i).and_then(|j| self.state.wheel_speed_rad_s().get(j))
        {
            return WHEEL_RAD_S.max(RATE_RAD_S * speed.abs());
        }
        let hidden = tangent.hidden().position(|k| k == i).and_then(|j| self.state.hidden.get(j));
        RATE_RAD_S * (1.0 + hidden.copied().unwrap_or(0.0).abs())
    }

    pub(super) fn seen(&self, state: &State, drive: &Drive) -> Seen {
        let (mut forces, mut derivative) = (Forces::default(), Derivative::zero());
        self.gyrostat.derivative(&self.instant(0.0), state, drive, &mut forces, &mut derivative);
        let imu = self.read(self, state, drive, &derivative);
        Seen { derivative, imu }
    }

    /// What its gyro and accelerometer read of a motion that is that of another plant, or of this one.
    pub(super) fn read(
        &self,
        of: &Self,
        state: &State,
        drive: &Drive,
        derivative: &Derivative,
    ) -> SVector<f64, 6> {
        let mut environment = self.gyrostat.environment(of.time_s(), state, drive);
        environment.omega_dot_wb_b_rad_s2 = derivative.omega + of.over_window_b_rad_s2(&environment, drive);
        environment.vertical_b = whorl_math::vertical_b(&state.q_world_body);
        let sensors = &self.gyrostat.model().sensors;
        let mut imu = self.gyrostat.ideal_imu(&environment);
        // Behind a low-pass a change of the state shows as if it had been so for a while.
        if self.has_filter {
            let now = self.ideal_imu(&of.state, &Vector3::zeros());
            let changed = self.ideal_imu(state, &Vector3::zeros());
            if sensors.gyro.errors.time_constant_s > 0.0 {
                imu.angular_velocity_b_rad_s = of.behind_filter.angular_velocity_b_rad_s
                    + changed.angular_velocity_b_rad_s
                    - now.angular_velocity_b_rad_s;
            }
            if sensors.accelerometer.errors.time_constant_s > 0.0 {
                imu.specific_force_b_m_s2 = of.behind_filter.specific_force_b_m_s2
                    + changed.specific_force_b_m_s2
                    - now.specific_force_b_m_s2;
            }
        }
        self.gyrostat.effects().measure_imu(&environment, &mut imu);
        let (gyro, force) = (&sensors.gyro.errors, &sensors.accelerometer.errors);
        let mut read = SVector::<f64, 6>::zeros();
        read.fixed_rows_mut::<3>(0).copy_from(&(gyro.ideal(&imu.angular_velocity_b_rad_s) + gyro.bias));
        read.fixed_rows_mut::<3>(3).copy_from(&(force.ideal(&imu.specific_force_b_m_s2) + force.bias));
        read
    }
}

fn change_coordinate(state: &mut State, tangent: &Tangent, i: usize, step: f64) {
    if ROTATION.contains(&i) {
        state.q_world_body *= quaternion_exp(&Vector3::ith(i, step));
    } else if RATE.contains(&i) {
        state.omega_wb_b_rad_s[i - RATE.start] += step;
    } else if let Some(j) = tangent.wheels().position(|k| k == i) {
        let speed = state.wheel_speed_rad_s().get(j).copied().unwrap_or(0.0);
        state.set_one_wheel_speed_rad_s(j, speed + step);
    } else if let Some(x) = tangent.hidden().position(|k| k == i).and_then(|j| state.hidden.get_mut(j)) {
        *x += step;
    }
}

#[cfg(test)]
mod tests {
    use nalgebra::UnitQuaternion;

    use super::*;
    use crate::platform::TiltLimit;
    use crate::{InitialState, PlatformModel};

    /// A tumbling platform with turning wheels; nothing rubs, nothing stops it.
    fn plant() -> Plant {
        let mut model = PlatformModel::whorl_1_reference();
        model.tilt_limit = TiltLimit::NONE;
        for wheel in model.wheels_mut() {
            (wheel.viscous_friction_n_m_s, wheel.coulomb_friction_n_m) = (0.0, 0.0);
        }
        let start = InitialState {
            q_world_body: UnitQuaternion::from_euler_angles(0.2, -0.3, 1.0),
            omega_wb_b_rad_s: Vector3::new(0.1, -0.4, 0.6),
            wheel_speed_rad_s: vec![20.0, -35.0, 50.0],
            ..InitialState::default()
        };
        Plant::new(&model, &start, 1).unwrap()
    }

    /// The derivation on paper, [`crate::RateEquation::linearised`], which the filters use.
    #[test]
    fn differences_are_the_derivatives_on_paper() {
        let plant = plant();
        let mut found = LinearisedPlant::none(&plant);
        plant.linearise_into(&mut found, true);
        let (model, state) = (plant.gyrostat().model(), plant.state());
        let vertical = whorl_math::vertical_b(&state.q_world_body);
        let momentum = plant.truth().momentum_b_n_m_s;
        let offset = model.mass_properties.gravity_offset_b_n_m();
        let equation = plant.gyrostat().rate_equation();
        let paper = equation.linearised(&state.omega_wb_b_rad_s, &momentum, offset, &vertical);
        let near = |what: &str, found: Matrix3<f64>, paper: Matrix3<f64>| {
            assert!(
                paper.amax() > 1e-3 && (found - paper).amax() < 1e-7 * (1.0 + paper.amax()),
                "{what}: {found} {paper}"
            );
        };
        let block =
            |row: usize, column: usize| found.rate_by_state.fixed_view::<3, 3>(row, column).into_owned();
        near("rate by rate", block(3, 3), paper.by_rate);
        near("rate by rotation", block(3, 0), paper.by_attitude);
        near("rate by torque", found.rate_by_torque.fixed_view::<3, 3>(3, 0).into_owned(), paper.by_torque);
        near("rotation by rotation", block(0, 0), -whorl_math::skew(&state.omega_wb_b_rad_s));
        near("rotation by rate", block(0, 3), Matrix3::identity());
        for (wheel, i) in model.wheels().iter().zip(plant.tangent().wheels()) {
            let by_speed =
                paper.by_wheel_momentum * wheel.spin_axis_b.into_inner() * wheel.spin_inertia_kg_m2;
            assert!((found.rate_by_state.fixed_view::<3, 1>(3, i) - by_speed).amax() < 1e-8);
            // Without a torque on it a wheel keeps its speed in space: it loses what the body gains.
            let of_wheel = -wheel.spin_axis_b.transpose() * block(3, 3);
            assert!((found.rate_by_state.fixed_view::<1, 3>(i, 3) - of_wheel).amax() < 1e-12);
        }
        // The gyro reads the rate, and the accelerometer the vertical: k turns by k x a.
        assert!((found.imu_by_state.fixed_view::<3, 3>(0, 3) - Matrix3::identity()).amax() < 1e-8);
        let arm = Vector3::new(0.10, 0.05, 0.15);
        let by_rotation = whorl_math::skew(&vertical) * whorl_math::GRAVITY_M_S2
            - whorl_math::skew(&arm) * paper.by_attitude;
        near("force by rotation", found.imu_by_state.fixed_view::<3, 3>(3, 0).into_owned(), by_rotation);
        near("force by torque", found.force_by_torque, -whorl_math::skew(&arm) * paper.by_torque);
    }

    #[test]
    fn a_change_moves_the_state_and_nothing_else() {
        let (mut plant, before) = (plant(), plant());
        plant.change_state(&[0.01, -0.02, 0.03, 0.1, 0.2, 0.3, 1.0, 2.0, 3.0]);
        let turned = before.state().q_world_body.rotation_to(&plant.state().q_world_body);
        let in_body = before.state().q_world_body.inverse_transform_vector(&turned.scaled_axis());
        assert!((in_body - Vector3::new(0.01, -0.02, 0.03)).norm() < 1e-14);
        let rate = plant.state().omega_wb_b_rad_s - before.state().omega_wb_b_rad_s;
        assert!((rate - Vector3::new(0.1, 0.2, 0.3)).norm() < 1e-15);
        assert_eq!(plant.state().wheel_speed_rad_s()[..3], [21.0, -33.0, 53.0]);
        assert_eq!(plant.now_ns(), before.now_ns());
        let same = plant.clone();
        plant.change_state(&[f64::NAN; 9]);
        assert_eq!(plant.state(), same.state(), "numbers that are none are ignored");
    }

    /// Of a torque T that fades at rate r the impulse over t is T (1 - exp(-r t))/r, on a body that does not turn.
    #[test]
    fn a_disturbance_fades() {
        let mut model = PlatformModel::whorl_1_reference();
        model.freedom = crate::Freedom::Free;
        model.wheels_mut().clear();
        let mut plant = Plant::new(&model, &InitialState::default(), 1).unwrap();
        plant.set_disturbance(0, Vector3::new(0.0, 0.0, 0.4), 2.0);
        plant.advance_to(500_000_000).unwrap();
        let axis = plant.gyrostat().rate_equation().resisting_b_kg_m2() * plant.state().omega_wb_b_rad_s;
        let impulse = 0.4 * (1.0 - (-1.0_f64).exp()) / 2.0;
        assert!((axis.z - impulse).abs() < 1e-4 * impulse, "{} for {impulse}", axis.z);
    }
}
