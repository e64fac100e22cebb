//! Readings that are means over a window.

use nalgebra::Vector3;

use super::{Plant, ns_from_s};
use crate::actuators::Kind;
use crate::actuators::jets::MAX_JETS;
use crate::actuators::wheels::MAX_WHEELS;
use crate::gyrostat::Drive;
use crate::platform::TriaxialErrors;
use crate::sensing::Snapshot;
use crate::{Environment, PlatformModel};

/// What drives a platform, as the mean over a stretch of time.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct MeanInputs {
    /// Motor torques [N m].
    pub wheel_torque_n_m: [f64; MAX_WHEELS],
    /// Share of the time during which each jet was open.
    pub valve_fraction: [f64; MAX_JETS],
    /// External torque, body axes [N m].
    pub body_torque_b_n_m: Vector3<f64>,
}

impl MeanInputs {
    /// Numbers that it has.
    pub const COUNT: usize = MAX_WHEELS + MAX_JETS + 3;

    /// All numbers: of motors, valves and the torque from outside.
    #[must_use]
    pub fn numbers(&self) -> [f64; Self::COUNT] {
        let mut numbers = [0.0; Self::COUNT];
        let all = self.wheel_torque_n_m.iter().chain(&self.valve_fraction).chain(&self.body_torque_b_n_m);
        numbers.iter_mut().zip(all).for_each(|(to, x)| *to = *x);
        numbers
    }

    /// Which of these drive a platform, and from where to where each goes.
    pub fn ranges(model: &PlatformModel) -> impl Iterator<Item = (usize, [f64; 2])> {
        let wheels = model.wheels().iter().map(|of| [-of.max_torque_n_m, of.max_torque_n_m]).enumerate();
        let jets = (MAX_WHEELS..MAX_WHEELS + model.jets().len()).map(|input| (input, [0.0, 1.0]));
        wheels.chain(jets).chain((Self::COUNT - 3..Self::COUNT).map(|input| (input, [-1.0, 1.0])))
    }

    /// The inverse of [`Self::numbers`].
    #[must_use]
    pub fn of_numbers(numbers: &[f64; Self::COUNT]) -> Self {
        let mut inputs = Self::default();
        let MeanInputs { wheel_torque_n_m, valve_fraction, body_torque_b_n_m } = &mut inputs;
        let slots = wheel_torque_n_m.iter_mut().chain(valve_fraction).chain(body_torque_b_n_m.iter_mut());
        slots.zip(numbers).for_each(|(slot, x)| *slot = *x);
        inputs
    }
}

impl Plant {
    /// Lets the accelerometer read the mean over a window about the next instant that is predicted, over which these are the mean
    /// inputs; `None`: the instant alone. The platform's motion is not changed by it.
    pub fn average_readings(&mut self, over: Option<MeanInputs>) {
        self.mean_inputs = over;
    }

    /// By how much the angular acceleration that the accelerometer shows is more than that of the instant [rad/s^2], which `seen` shows:
    /// over a window inputs jump, and the rest of the motion is as in its middle.
    pub(super) fn over_window_b_rad_s2(&self, seen: &Environment<'_>, drive: &Drive) -> Vector3<f64> {
        self.mean_inputs.as_ref().map_or(Vector3::zeros(), |mean| self.by_inputs_b_rad_s2(mean, seen, drive))
    }

    /// Lets these inputs drive it, whatever its commands and valves are, for how it acts over a stretch of time of which they are the means.
    pub fn drive_by(&mut self, mean: &MeanInputs) {
        let (actuators, drive) = (&self.gyrostat.model().actuators, &mut self.drive);
        let wheels = actuators.wheels.0.len().min(MAX_WHEELS);
        actuators.command(&mut drive.actuators, Kind::Wheels, &mean.wheel_torque_n_m[..wheels]);
        drive.actuators.jets.valve_fraction = mean.valve_fraction;
        drive.actuators.jets.valves.blow(&mean.valve_fraction);
        drive.body_torque_b_n_m = mean.body_torque_b_n_m;
    }

    /// What drives it now.
    #[must_use]
    pub fn inputs(&self) -> MeanInputs {
        let Drive { actuators, body_torque_b_n_m, .. } = &self.drive;
        MeanInputs {
            wheel_torque_n_m: actuators.wheels.motor_torque_n_m,
            valve_fraction: actuators.jets.valve_fraction,
            body_torque_b_n_m: *body_torque_b_n_m,
        }
    }

    /// By how much the angular acceleration under these inputs is more than under those of the instant [rad/s^2], which `seen` shows.
    fn by_inputs_b_rad_s2(&self, mean: &MeanInputs, seen: &Environment<'_>, drive: &Drive) -> Vector3<f64> {
        if drive.clamped {
            return Vector3::zeros();
        }
        let mut torque = mean.body_torque_b_n_m - drive.body_torque_b_n_m;
        let jets = drive.actuators.jets.valves.drive(self.now_ns, 0.0);
        // Most of the time no jet blows, and a power is expensive.
        if jets.thrust_n != 0.0 || mean.valve_fraction.iter().any(|fraction| *fraction != 0.0) {
            let over = Environment { valve_fraction: &mean.valve_fraction, ..*seen };
            let now = jets.torque_b_n_m * self.gyrostat.jet_factor(seen);
            torque += self.gyrostat.jet_torque_b_n_m(&over) - now;
        }
        let wheels = self.gyrostat.model().wheels().iter().zip(mean.wheel_torque_n_m);
        let now_n_m = drive.actuators.wheels.motor_torque_n_m;
        for (j, ((wheel, mean_n_m), now_n_m)) in wheels.zip(now_n_m).enumerate() {
            if !drive.actuators.wheels.holds(j) {
                let motor_n_m = mean_n_m.max(-wheel.max_torque_n_m).min(wheel.max_torque_n_m);
                torque -= wheel.spin_axis_b.into_inner() * (motor_n_m - now_n_m);
            }
        }
        drive.equation.inverse_resisting() * torque
    }

    /// The motion that a reading of now shows: of an averaging sensor with mean rate and mean angular acceleration over its window. What
    /// of the window lies ahead of now is left out.
    pub(super) fn shown(&self, errors: &TriaxialErrors, now: &Snapshot) -> Snapshot {
        let middle_ns = self.now_ns - ns_from_s(errors.latency_s);
        let half_ns = ns_from_s(0.5 * errors.averaging_window_s);
        let mut shown = self.history.at(middle_ns, now);
        let ends = [middle_ns - half_ns, (middle_ns + half_ns).min(self.now_ns)];
        let length_ns = ends[1] - ends[0];
        if half_ns == 0 || length_ns <= 0 {
            return shown;
        }
        let rate = |time_ns: i64| self.history.at(time_ns, now).omega_wb_b_rad_s;
        shown.omega_dot_wb_b_rad_s2 = (rate(ends[1]) - rate(ends[0])) / (length_ns as f64 * 1e-9);
        let parts = MEAN_OF as i64;
        let middles = (0..parts).map(|k| rate(ends[0] + length_ns * (2 * k + 1) / (2 * parts)));
        shown.omega_wb_b_rad_s = middles.sum::<Vector3<f64>>() / MEAN_OF as f64;
        shown
    }
}

/// Instants of which the mean rate is made: by the midpoint rule a jump of acceleration then errs by a 64th of what it does to the mean.
const MEAN_OF: usize = 8;

#[cfg(test)]
mod tests {
    use nalgebra::Matrix3;

    use super::*;
    use crate::{InitialState, MassProperties, PlatformModel};

    /// A platform at rest that is pushed from now on: its sensors show the mean of rest and of a constant acceleration.
    #[test]
    fn a_sensor_shows_the_mean_over_its_window() {
        let mut model = PlatformModel::whorl_1_reference();
        model.mass_properties =
            MassProperties::new(Matrix3::identity() * 8.0, Vector3::zeros(), 80.0).unwrap();
        model.wheels_mut().clear();
        model.sensors.accelerometer.lever_arm_b_m = Vector3::new(0.3, -0.2, 0.1);
        let sensors = &mut model.sensors;
        for errors in [&mut sensors.gyro.errors, &mut sensors.accelerometer.errors] {
            (errors.noise_stddev, errors.bias_turn_on_stddev) = (Vector3::zeros(), Vector3::zeros());
            errors.bias_walk = Vector3::zeros();
            (errors.averaging_window_s, errors.latency_s) = (0.02, 0.01);
        }
        let mut plant = Plant::new(&model, &InitialState::default(), 1).unwrap();
        plant.advance_to(100_000_000).unwrap();
        plant.set_body_torque(Vector3::new(0.0, 0.0, 1.6));
        // The window ends now and is pushed for its last 5 ms of 20.
        plant.advance_to(105_000_000).unwrap();
        let read = plant.sample_imu();
        let acceleration = Vector3::new(0.0, 0.0, 0.2);
        let force = (acceleration * 0.25).cross(&model.sensors.accelerometer.lever_arm_b_m);
        let expected = force + Vector3::new(0.0, 0.0, 9.81);
        assert!((read.specific_force_m_s2 - expected).norm() < 1e-5, "{read:?} {expected}");
        // The rate grows to 1 mrad/s meanwhile: half of that over a quarter of the time.
        let rate = read.angular_velocity_rad_s.z;
        assert!((rate - 1.25e-4).abs() < 0.02 * 1.25e-4, "{rate}");
    }
}
