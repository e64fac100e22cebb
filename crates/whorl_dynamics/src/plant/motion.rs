//! The motion of one plant against that of another, as when two models begin in the same state.

use nalgebra::{DVector, SVector, Vector3};

use super::tangent::Seen;
use super::{Plant, RATE, ROTATION};
use crate::State;
use crate::gyrostat::{Derivative, Drive};

/// How a plant moves and what it reads at one instant.
#[derive(Debug, Clone)]
pub struct Acts {
    /// Rates of its [`super::Tangent`] coordinates \[unit/s\]; of the rotation none.
    pub rates: DVector<f64>,
    /// What gyro [rad/s] and accelerometer [m/s^2] read without noise, sensor axes.
    pub imu: SVector<f64, 6>,
    derivative: Derivative,
}

impl Acts {
    /// Of a plant that does nothing, with room for what one does.
    #[must_use]
    pub fn none(plant: &Plant) -> Self {
        let rates = DVector::zeros(plant.tangent().size());
        Self { rates, imu: SVector::zeros(), derivative: Derivative::zero() }
    }
}

impl Plant {
    /// Takes over attitude, rates, wheel speeds, hidden states, disturbance and window of readings of another plant that has the same
    /// [`super::Tangent`] and began at the same time, with a small change in these coordinates, or with none; commands, valves and supplies
    /// stay its own. A wheel that dry friction holds stays held.
    pub fn take_motion_of(&mut self, other: &Self, change: &[f64]) {
        self.state.q_world_body = other.state.q_world_body;
        self.state.omega_wb_b_rad_s = other.state.omega_wb_b_rad_s;
        self.state.set_wheel_speed_rad_s(other.state.wheel_speed_rad_s());
        self.state.hidden = other.state.hidden;
        self.drive.disturbances = other.drive.disturbances;
        self.drive.motor_disturbances = other.drive.motor_disturbances;
        self.behind_filter = other.behind_filter;
        self.mean_inputs = other.mean_inputs;
        self.keep_parts();
        if !change.is_empty() {
            self.move_by(change);
        }
    }

    /// Takes over time, commands and what valves do as well, of a plant that has the same actuators, whose constants may be others; its gas
    /// stays its own.
    pub fn stand_in_for(&mut self, other: &Self, change: &[f64]) {
        let gas = self.state.actuators.jets;
        (self.now_ns, self.state) = (other.now_ns, other.state);
        self.state.actuators.jets = gas;
        let Drive { body_torque_b_n_m, clamped, stop, contact, ref actuators, .. } = other.drive;
        let own = &mut self.drive;
        (own.body_torque_b_n_m, own.clamped, own.stop, own.contact) =
            (body_torque_b_n_m, clamped, stop, contact);
        let model = self.gyrostat.model();
        model.actuators.take_over(&mut own.actuators, actuators, other.now_ns);
        own.equation = self.gyrostat.rate_equation_now(&own.actuators);
        self.take_motion_of(other, change);
    }

    /// What is left of its gas \[kg\].
    #[must_use]
    pub fn gas_kg(&self) -> f64 {
        self.state.actuators.jets.gas_kg
    }

    /// So much more gas is left.
    pub fn add_gas_kg(&mut self, more_kg: f64) {
        self.state.actuators.jets.gas_kg += more_kg;
    }

    /// Decides which parts stick after a small change of their motion. What a part that sticks does to the others' motion is made anew
    /// only where another one does: it takes as long as a step.
    pub(super) fn keep_parts(&mut self) {
        let held = self.held();
        self.gyrostat.model().actuators.set_out(&self.state.actuators, &mut self.drive.actuators);
        if self.held() != held || !self.gyrostat.model().gyros().is_empty() {
            self.drive.equation = self.gyrostat.rate_equation_now(&self.drive.actuators);
        }
    }

    /// Finds how it moves and what it reads now, under its present commands; valves whose time has come open and close first.
    pub fn act_into(&mut self, acts: &mut Acts) {
        let actuators = &self.gyrostat.model().actuators;
        if actuators.next_event_ns(&self.drive.actuators) <= self.now_ns {
            actuators.settle(&mut self.drive.actuators, self.now_ns);
        }
        let Seen { derivative, imu } = self.seen(&self.state, &self.drive);
        let tangent = self.tangent();
        acts.rates.fixed_rows_mut::<3>(RATE.start).copy_from(&derivative.omega);
        let wheels = tangent.wheels().zip(derivative.actuators.wheels.speed_rad_s);
        let hidden = tangent.hidden().zip(derivative.hidden);
        wheels.chain(hidden).for_each(|(i, rate)| acts.rates[i] = rate);
        (acts.imu, acts.derivative) = (imu, derivative);
    }

    /// What its sensors would read of another plant that acts so now.
    #[must_use]
    pub fn imu_of(&self, other: &Self, acts: &Acts) -> SVector<f64, 6> {
        self.read(other, &other.state, &other.drive, &acts.derivative)
    }

    /// Whether no jet pushes now or within a window of readings: all valves are shut, and thrust follows them at once.
    #[must_use]
    pub fn jets_rest(&self) -> bool {
        let now = &self.drive.actuators.jets.valve_fraction;
        let over_window = self.mean_inputs.iter().flat_map(|mean| &mean.valve_fraction);
        self.gyrostat.thrust_lag().is_none() && now.iter().chain(over_window).all(|fraction| *fraction == 0.0)
    }

    /// Lets its supplies go on to another instant as they act, where no valve opens or closes until then; it does not move.
    pub fn wait_until(&mut self, time_ns: i64, acts: &Acts) {
        let actuators = &self.gyrostat.model().actuators;
        let after_s = (time_ns - self.now_ns) as f64 * 1e-9;
        let before = self.state.actuators;
        actuators.moved(&before, &acts.derivative.actuators, after_s, &mut self.state.actuators);
        actuators.bound(&mut self.state.actuators);
        self.now_ns = time_ns;
    }

    /// By how much what is behind its sensors' low-pass differs from another plant's: rate [rad/s] and specific force [m/s^2].
    #[must_use]
    pub fn behind_filter_less(&self, other: &Self) -> [Vector3<f64>; 2] {
        let (own, others) = (&self.behind_filter, &other.behind_filter);
        [
            own.angular_velocity_b_rad_s - others.angular_velocity_b_rad_s,
            own.specific_force_b_m_s2 - others.specific_force_b_m_s2,
        ]
    }

    /// Moves what is behind its sensors' low-pass.
    pub fn move_behind_filter(&mut self, by: &[Vector3<f64>; 2]) {
        self.behind_filter.angular_velocity_b_rad_s += by[0];
        self.behind_filter.specific_force_b_m_s2 += by[1];
    }

    /// Which wheels dry friction holds, as bits.
    fn held(&self) -> u64 {
        self.held_wheels().fold(0, |bits, held| bits << 1 | u64::from(held))
    }

    /// Whether dry friction holds the same wheels of both, and the same contacts touch: only then is the one's motion less the
    /// other's a derivative.
    #[must_use]
    pub fn is_on_branch_of(&self, other: &Self) -> bool {
        self.held() == other.held() && self.touching() == other.touching()
    }

    /// By how much its motion differs from another state of the same platform: the change, in [`super::Tangent`] coordinates, that makes
    /// that one into its own.
    pub fn motion_less(&self, other: &State, to: &mut [f64]) {
        let (tangent, own) = (self.tangent(), &self.state);
        let turned: Vector3<f64> = (other.q_world_body.inverse() * own.q_world_body).scaled_axis();
        to[ROTATION].copy_from_slice(turned.as_slice());
        to[RATE].copy_from_slice((own.omega_wb_b_rad_s - other.omega_wb_b_rad_s).as_slice());
        let speeds = own.wheel_speed_rad_s().iter().zip(other.wheel_speed_rad_s());
        for (i, (own, others)) in tangent.wheels().zip(speeds) {
            to[i] = own - others;
        }
        for (i, (own, others)) in tangent.hidden().zip(own.hidden.iter().zip(&other.hidden)) {
            to[i] = own - others;
        }
    }
}

#[cfg(test)]
mod tests {
    use nalgebra::{DVector, UnitQuaternion, Vector3};

    use crate::actuators::Kind;
    use crate::{InitialState, Plant, PlatformModel};

    #[test]
    fn a_difference_is_the_change_that_makes_up_for_it() {
        let model = PlatformModel::whorl_1_reference();
        let start = InitialState {
            q_world_body: UnitQuaternion::from_euler_angles(0.2, -0.1, 1.0),
            omega_wb_b_rad_s: Vector3::new(0.1, -0.4, 0.6),
            wheel_speed_rad_s: vec![20.0, -35.0, 50.0],
            ..InitialState::default()
        };
        let plant = Plant::new(&model, &start, 1).unwrap();
        let mut other = Plant::new(&model, &InitialState::default(), 1).unwrap();
        other.take_motion_of(&plant, &[0.0; 9]);
        let mut found = [1.0; 9];
        other.motion_less(plant.state(), &mut found);
        assert_eq!(found, [0.0; 9]);
        let change = [0.01, -0.02, 0.03, 0.1, 0.2, 0.3, 1.0, 2.0, 3.0];
        other.take_motion_of(&plant, &change);
        other.motion_less(plant.state(), &mut found);
        assert!(found.iter().zip(change).all(|(found, made)| (found - made).abs() < 1e-12), "{found:?}");
    }

    /// What more friction of the bearing and of the wheels does within a step.
    #[test]
    fn differences_of_short_steps_need_no_fine_integration() {
        let model = PlatformModel::whorl_1_reference();
        let start = InitialState {
            omega_wb_b_rad_s: Vector3::new(0.1, -0.4, 0.6),
            wheel_speed_rad_s: vec![20.0, -35.0, 50.0],
            ..InitialState::default()
        };
        let mut changed = model.clone();
        let friction = [("c_n_m_s".to_owned(), 0.1)].into();
        changed.effects.insert("bearing_viscous_friction".to_owned(), friction);
        changed.wheels_mut().iter_mut().for_each(|wheel| wheel.viscous_friction_n_m_s += 1e-5);
        let difference = |quick: bool| {
            let [mut one, mut other] = [&model, &changed].map(|model| {
                let plant = Plant::new(model, &start, 1).unwrap();
                if quick { plant.with_step_ns(10_000_000).for_differences(false) } else { plant }
            });
            for plant in [&mut one, &mut other] {
                plant.command_motors(Kind::Wheels, &[0.1, -0.05, 0.02]).unwrap();
                plant.advance_to(10_000_000).unwrap();
            }
            let mut found = DVector::zeros(9);
            other.motion_less(one.state(), found.as_mut_slice());
            found
        };
        let (fine, quick) = (difference(false), difference(true));
        assert!(fine.norm() > 1e-6 && (&quick - &fine).norm() < 1e-4 * fine.norm(), "{fine} {quick}");
    }
}
