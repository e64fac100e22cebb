//! Readings of a short time as one, against the platform's own plant with what its actuators did.
//!
//! Over a cell what the platform does otherwise than its plant is a straight line. So the mean of the readings less their predictions is a
//! reading in the middle of the cell, exact to the first order.

use std::collections::VecDeque;

use nalgebra::{UnitQuaternion, Vector3};
use whorl_dynamics::gyrostat::{MAX_JETS, MAX_WHEELS};
use whorl_dynamics::{Environment, InitialState, Plant, PlantError, PlatformModel};
use whorl_prediction::{InState, Reading};
use whorl_recording::{Channel, Component};

/// Readings are averaged over this long \[s\].
pub(crate) const CELL_S: f64 = 0.2;

/// What the platform was told or measured, at a time.
#[derive(Debug, Clone, PartialEq)]
pub(crate) enum Input {
    /// Motor torques of the wheels from now on [N m], and the variance of what they may have done otherwise since the torque before
    /// [(N m s)^2].
    Torque([f64; MAX_WHEELS], [f64; MAX_WHEELS]),
    /// A jet's valve is driven for so long \[s\], from now on.
    Pulse(usize, f64),
    /// Moment of the linear mass actuators from now on, body axes [N m].
    Ballast(Vector3<f64>),
    /// Reading of the gyro, sensor axes [rad/s].
    Gyro(Vector3<f64>),
    /// Readings of the wheels' speeds [rad/s].
    Speed([f64; MAX_WHEELS]),
    /// Estimates of attitude and rate, body axes [rad/s].
    Attitude(UnitQuaternion<f64>, Vector3<f64>),
}

/// Inputs in the order of their times \[ns\].
pub(crate) type Inputs = VecDeque<(i64, Input)>;

/// Attitude, rate [rad/s], body axes, and wheel speeds [rad/s].
pub(crate) type Motion = (UnitQuaternion<f64>, Vector3<f64>, [f64; MAX_WHEELS]);

/// A cell.
#[derive(Debug, Clone, Default)]
pub(crate) struct Cell {
    pub length_s: f64,
    /// Sums of readings less their predictions, and their numbers: gyro, then wheel speeds.
    sums: [(f64, f64); 3 + MAX_WHEELS],
    /// Mean motor torques [N m].
    pub wheel_torque_n_m: [f64; MAX_WHEELS],
    /// Variance of the motors' impulses [(N m s)^2]: nobody knows just when a torque took force.
    pub wheel_impulse_variance: [f64; MAX_WHEELS],
    /// Share of the time during which gas flowed.
    pub valve_fraction: [f64; MAX_JETS],
}

impl Cell {
    /// Means of readings less their predictions, with the variances of their noise.
    pub fn readings(&self, model: &PlatformModel) -> Vec<Reading> {
        let gyro_rad_s = model.sensors.gyro.errors.one_sample_stddev();
        let speed_rad_s = model.sensors.wheel_speed.one_sample_stddev_rad_s();
        let present = self.sums.iter().enumerate().filter(|(_, (_, count))| *count > 0.0);
        let reading = |(i, (sum, count)): (usize, &(f64, f64))| {
            let (channel, index, stddev) = match gyro_rad_s.get(i) {
                Some(stddev) => (Channel::Gyro, i, *stddev),
                None => (Channel::WheelSpeed, i - 3, speed_rad_s),
            };
            let component = Component::new(channel, 0, index);
            Reading { component, value: sum / count, variance: stddev * stddev / count }
        };
        present.map(reading).collect()
    }
}

/// The plant, with what drives it.
#[derive(Debug, Clone)]
pub(crate) struct Driven {
    pub plant: Plant,
    /// Motor torques now [N m], and how long each jet was open \[s\].
    torque_n_m: [f64; MAX_WHEELS],
    valve_open_s: Vec<f64>,
    /// The newest estimate of attitude and rate [rad/s], and its time \[ns\].
    attitude: (i64, UnitQuaternion<f64>, Vector3<f64>),
}

impl Driven {
    /// In a motion at this time, with what a sensor reads of the gas \[Pa\]. Pulses were carried out: none is too short.
    ///
    /// # Errors
    /// A platform that cannot be simulated, or numbers that are not finite.
    pub fn new(
        model: &PlatformModel,
        pressure_pa: Option<f64>,
        now_ns: i64,
        (q_world_body, rate_b_rad_s, speed_rad_s): &Motion,
    ) -> Result<Self, PlantError> {
        let mut quiet = model.clone();
        quiet.sensors.silence();
        quiet.jets_mut().iter_mut().for_each(|jet| jet.min_on_time_s = 0.0);
        let start = InitialState { time_ns: now_ns, ..InitialState::default() };
        let plant = Plant::new(&quiet, &start, 0)?;
        let mut plant = plant.with_step_ns(ns(CELL_S)).without_random_torque().without_latency();
        pressure_pa.into_iter().for_each(|measured_pa| plant.set_tank_pressure(measured_pa));
        plant.set_motion(q_world_body, rate_b_rad_s, &speed_rad_s[..model.wheels().len().min(MAX_WHEELS)])?;
        let attitude = (now_ns, *q_world_body, *rate_b_rad_s);
        let valve_open_s = vec![0.0; model.jets().len()];
        Ok(Self { plant, torque_n_m: [0.0; MAX_WHEELS], valve_open_s, attitude })
    }

    /// Takes it from the newest attitude through a cell that ends at `end_ns`, and the inputs until then off the queue.
    ///
    /// # Errors
    /// A motion that is not finite.
    pub fn pass(&mut self, inputs: &mut Inputs, end_ns: i64) -> Result<Cell, PlantError> {
        let (now_ns, state) = (self.plant.now_ns(), *self.plant.state());
        let (at_ns, q_world_body, rate_b_rad_s) = self.attitude;
        let now = q_world_body * whorl_math::quaternion_exp(&(rate_b_rad_s * seconds(now_ns - at_ns)));
        let wheels = self.plant.tangent().wheels().len();
        self.plant.set_motion(&now, &state.omega_wb_b_rad_s, &state.wheel_speed_rad_s()[..wheels])?;
        let mut cell = Cell { length_s: seconds(end_ns - now_ns), ..Cell::default() };
        let due = inputs.partition_point(|(at_ns, _)| *at_ns <= end_ns);
        for (at_ns, input) in inputs.drain(..due) {
            self.take(&mut cell, at_ns, input)?;
        }
        self.advance(&mut cell, end_ns)?;
        let open_s = self.plant.truth().valve_open_s;
        let shares = cell.valve_fraction.iter_mut().zip(open_s.iter().zip(&self.valve_open_s));
        shares.for_each(|(share, (now_s, before_s))| *share = (now_s - before_s) / cell.length_s);
        self.valve_open_s = open_s;
        Ok(cell)
    }

    /// Goes on with the torques that are in force.
    fn advance(&mut self, cell: &mut Cell, at_ns: i64) -> Result<(), PlantError> {
        let now_ns = self.plant.now_ns();
        if at_ns > now_ns {
            let share = seconds(at_ns - now_ns) / cell.length_s;
            let means = cell.wheel_torque_n_m.iter_mut().zip(&self.torque_n_m);
            means.for_each(|(mean, torque)| *mean += torque * share);
            self.plant.advance_to(at_ns)?;
        }
        Ok(())
    }

    /// Takes an input in at its time, or now if that has passed.
    fn take(&mut self, cell: &mut Cell, at_ns: i64, input: Input) -> Result<(), PlantError> {
        let wheels = self.plant.tangent().wheels().len();
        if !matches!(input, Input::Pulse(..) | Input::Attitude(..)) {
            self.advance(cell, at_ns)?;
        }
        let mut add = |first: usize, read: &[f64], expected: &[f64]| {
            for (slot, (read, expected)) in cell.sums[first..].iter_mut().zip(read.iter().zip(expected)) {
                if read.is_finite() {
                    *slot = (slot.0 + read - expected, slot.1 + 1.0);
                }
            }
        };
        match input {
            Input::Torque(torque_n_m, variance) => {
                let sums = cell.wheel_impulse_variance.iter_mut().zip(variance);
                sums.for_each(|(sum, variance)| *sum += variance);
                self.torque_n_m = torque_n_m;
                // The platform's own: their number was checked.
                let _ = self.plant.command_wheels(&torque_n_m[..wheels]);
            }
            // A pulse is carried out when it is due.
            Input::Pulse(jet, on_time_s) => {
                let _ = self.plant.command_jet_pulse(jet, at_ns.max(self.plant.now_ns()), on_time_s);
            }
            Input::Ballast(moment) => self.plant.set_ballast_moment(moment),
            Input::Gyro(read) => add(0, read.as_slice(), self.plant.imu_reading().0.as_slice()),
            Input::Speed(read) => add(3, &read[..wheels], self.plant.state().wheel_speed_rad_s()),
            Input::Attitude(q_world_body, rate_b_rad_s) => {
                self.attitude = (at_ns, q_world_body, rate_b_rad_s)
            }
        }
        Ok(())
    }

    /// The state at the end of a cell, with its mean inputs.
    pub fn in_state<'a>(&'a self, cell: &'a Cell) -> InState<'a> {
        let (gyrostat, state) = (self.plant.gyrostat(), self.plant.state());
        let model = gyrostat.model();
        let environment = Environment {
            wheel_motor_torque_n_m: cell.wheel_torque_n_m.get(..model.wheels().len()).unwrap_or(&[]),
            valve_fraction: cell.valve_fraction.get(..model.jets().len()).unwrap_or(&[]),
            ..self.plant.environment()
        };
        InState::of(gyrostat, environment, &state.hidden[..gyrostat.effects().hidden_states()])
    }
}

fn seconds(ns: i64) -> f64 {
    ns as f64 * 1e-9
}

pub(crate) fn ns(seconds: f64) -> i64 {
    (seconds * 1e9).round() as i64
}

#[cfg(test)]
mod tests {
    use whorl_dynamics::platform::TiltLimit;

    use super::*;

    fn driven(pressure_pa: f64) -> Driven {
        Driven::new(&PlatformModel::whorl_1_reference(), Some(pressure_pa), 0, &Motion::default()).unwrap()
    }

    /// Rate about the axis of the first jet behind a pulse of 0.1 s [rad/s].
    fn rate_by_a_pulse_rad_s(pressure_pa: f64) -> f64 {
        let after = |inputs: &[(i64, Input)]| {
            let mut driven = driven(pressure_pa);
            driven.pass(&mut inputs.iter().cloned().collect(), 200_000_000).unwrap();
            driven.plant.state().omega_wb_b_rad_s
        };
        (after(&[(0, Input::Pulse(0, 0.1))]) - after(&[])).norm()
    }

    #[test]
    fn a_tank_that_reads_less_than_nothing_is_empty() {
        assert!(rate_by_a_pulse_rad_s(2e7) > 1e-4);
        // A step that is split errs a little otherwise.
        assert!(rate_by_a_pulse_rad_s(0.0) < 1e-7);
        assert!(rate_by_a_pulse_rad_s(-300.0) < 1e-7);
    }

    /// A plant that is read at 100 Hz while its motors change 50 times a second and jets give short pulses: what is read is what the cells
    /// predict, to a part of the noise of their means.
    #[test]
    fn means_of_readings_are_predicted_whatever_actuators_do_within_a_cell() {
        // Pulses turn it further than its stops would let it.
        let model = PlatformModel { tilt_limit: TiltLimit::NONE, ..PlatformModel::whorl_1_reference() };
        let mut speeds = [0.0; MAX_WHEELS];
        speeds[..3].copy_from_slice(&[90.0, -70.0, 120.0]);
        let tilted = UnitQuaternion::from_euler_angles(0.05, -0.03, 0.4);
        let mut cells =
            Driven::new(&model, None, 0, &(tilted, Vector3::new(0.02, -0.03, 0.05), speeds)).unwrap();
        let mut truth = cells.plant.clone().with_step_ns(1_000_000);
        let wheels = model.wheels().len();
        let mut inputs = Inputs::new();
        for step in 0..200_i64 {
            let at_ns = step * 10_000_000;
            truth.advance_to(at_ns).unwrap();
            if step % 2 == 0 {
                let torque: [f64; MAX_WHEELS] =
                    std::array::from_fn(|j| 0.05 * ((step * 7 + j as i64) as f64).sin());
                truth.command_wheels(&torque[..wheels]).unwrap();
                inputs.push_back((at_ns, Input::Torque(torque, [0.0; MAX_WHEELS])));
            }
            if step % 13 == 5 {
                let (jet, on_time_s) = (step as usize % 12, 0.02 + 0.001 * (step % 50) as f64);
                truth.command_jet_pulse(jet, at_ns, on_time_s).unwrap();
                inputs.push_back((at_ns, Input::Pulse(jet, on_time_s)));
            }
            inputs.push_back((at_ns, Input::Gyro(truth.imu_reading().0)));
            inputs.push_back((at_ns, Input::Speed(*truth.state().wheel_speed_rad_s())));
            let (q, rate) = (truth.state().q_world_body, truth.state().omega_wb_b_rad_s);
            inputs.push_back((at_ns, Input::Attitude(q, rate)));
        }
        let gyro_rad_s = model.sensors.gyro.errors.one_sample_stddev().min();
        let speed_rad_s = model.sensors.wheel_speed.one_sample_stddev_rad_s();
        for cell in 1..=9 {
            let found = cells.pass(&mut inputs, cell * 200_000_000).unwrap();
            for reading in found.readings(&model) {
                let noise = if reading.component.channel == Channel::Gyro { gyro_rad_s } else { speed_rad_s };
                let mean_noise = noise / 20_f64.sqrt();
                assert!(reading.value.abs() < 0.2 * mean_noise, "cell {cell}: {reading:?} of {mean_noise}");
            }
        }
    }
}
