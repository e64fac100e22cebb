//! Readings of a short time as one, against the platform's own plant with what its actuators did.
//!
//! Over a cell what the platform does otherwise than its plant is a straight line. So the mean of the readings less their predictions is a
//! reading in the middle of the cell, exact to the first order.

use std::collections::VecDeque;

use nalgebra::{UnitQuaternion, Vector3};
use whorl_dynamics::gyrostat::{MAX_JETS, MAX_WHEELS};
use whorl_dynamics::platform::SensorSuite;
use whorl_dynamics::{Environment, InitialState, Plant, PlantError, PlatformModel};
use whorl_prediction::{InState, Reading};
use whorl_recording::{Channel, Component};

use crate::gas;

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
}

/// Inputs in the order of their times \[ns\].
pub(crate) type Inputs = VecDeque<(i64, Input)>;

/// A cell.
#[derive(Debug, Clone)]
pub(crate) struct Cell {
    pub length_s: f64,
    /// Sums of readings less their predictions, and their numbers.
    gyro: [(f64, f64); 3],
    speed: [(f64, f64); MAX_WHEELS],
    /// In its middle: time since the start of the plant \[s\], attitude, rate [rad/s], wheel speeds [rad/s], hidden states.
    time_s: f64,
    q_world_body: UnitQuaternion<f64>,
    omega_b_rad_s: Vector3<f64>,
    pub wheel_speed_rad_s: [f64; MAX_WHEELS],
    hidden: Vec<f64>,
    /// Mean motor torques [N m].
    pub wheel_torque_n_m: [f64; MAX_WHEELS],
    /// Variance of the motors' impulses [(N m s)^2]: nobody knows just when a torque took force.
    pub wheel_impulse_variance: [f64; MAX_WHEELS],
    /// Share of the time during which gas flowed.
    pub valve_fraction: [f64; MAX_JETS],
}

impl Cell {
    /// Means of readings less their predictions, with the variances of their noise.
    pub fn readings(&self, sensors: &SensorSuite) -> Vec<Reading> {
        let gyro = sensors.gyro.errors.one_sample_stddev();
        let of = |channel: Channel, all: &[(f64, f64)], stddev: &dyn Fn(usize) -> f64| {
            let present = all.iter().enumerate().filter(|(_, (_, count))| *count > 0.0);
            let reading = |(i, (sum, count)): (usize, &(f64, f64))| Reading {
                component: Component::new(channel, 0, i),
                value: sum / count,
                variance: stddev(i).powi(2) / count,
            };
            present.map(reading).collect::<Vec<_>>()
        };
        let mut readings = of(Channel::Gyro, &self.gyro, &|axis| gyro[axis]);
        let speed = sensors.wheel_speed.one_sample_stddev_rad_s();
        readings.extend(of(Channel::WheelSpeed, &self.speed, &|_| speed));
        readings
    }

    /// The state in its middle, with mean inputs, of the plant that has gone through it.
    pub fn in_state<'a>(&'a self, plant: &'a Plant) -> InState<'a> {
        let gyrostat = plant.gyrostat();
        let model = gyrostat.model();
        let supplies = plant.environment();
        let environment = Environment {
            time_s: self.time_s,
            wheel_speed_rad_s: self.wheel_speed_rad_s.get(..model.wheels().len()).unwrap_or(&[]),
            wheel_motor_torque_n_m: self.wheel_torque_n_m.get(..model.wheels().len()).unwrap_or(&[]),
            valve_fraction: self.valve_fraction.get(..model.jets().len()).unwrap_or(&[]),
            tank_pressure_pa: supplies.tank_pressure_pa,
            gas_used_kg: supplies.gas_used_kg,
            bus_voltage_v: supplies.bus_voltage_v,
            temperature_k: supplies.temperature_k,
            ballast_direction: supplies.ballast_direction,
            ..Environment::new(model, self.q_world_body, self.omega_b_rad_s)
        };
        InState::of(gyrostat, environment, &self.hidden)
    }
}

/// Supplies as measured.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct Supplies {
    /// Tank pressure \[Pa\].
    pub pressure_pa: Option<f64>,
    /// Bus voltage \[V\].
    pub voltage_v: Option<f64>,
    /// Temperature \[K\].
    pub temperature_k: Option<f64>,
}

/// The model without noise, with the supplies as they were measured. Pulses were carried out: none is too short.
fn quiet(model: &PlatformModel, supplies: &Supplies) -> PlatformModel {
    let mut quiet = model.clone();
    let sensors = &mut quiet.sensors;
    sensors.silence();
    sensors.ambient_temperature_k = supplies.temperature_k.unwrap_or(sensors.ambient_temperature_k);
    quiet.bus.initial_v = supplies.voltage_v.unwrap_or(quiet.bus.initial_v);
    for jet in quiet.jets_mut() {
        jet.min_on_time_s = 0.0;
    }
    quiet
}

/// The plant, with what drives it.
#[derive(Debug, Clone)]
pub(crate) struct Driven {
    pub plant: Plant,
    /// Motor torques now [N m], and how long each jet was open \[s\].
    torque_n_m: [f64; MAX_WHEELS],
    valve_open_s: Vec<f64>,
}

impl Driven {
    /// At this time, with steps as long as a cell.
    ///
    /// # Errors
    /// When the platform cannot be simulated.
    pub fn new(
        model: &PlatformModel,
        supplies: &Supplies,
        now_ns: i64,
        cell_ns: i64,
    ) -> Result<Self, PlantError> {
        let start = InitialState { time_ns: now_ns, ..InitialState::default() };
        let plant = Plant::new(&quiet(model, supplies), &start, 0)?;
        let mut plant = plant.with_step_ns(cell_ns).without_random_torque().without_latency();
        supplies.pressure_pa.into_iter().for_each(|measured_pa| plant.set_tank_pressure(measured_pa));
        Ok(Self { plant, torque_n_m: [0.0; MAX_WHEELS], valve_open_s: vec![0.0; model.jets().len()] })
    }

    /// Keeps the gas at what a sensor reads of it \[Pa\]: small errors of what jets use add up.
    pub fn hear_pressure(&mut self, measured_pa: f64) {
        let expected_pa = self.plant.environment().tank_pressure_pa;
        if !gas::is_explained(measured_pa, expected_pa, self.plant.gyrostat().model()) {
            self.plant.set_tank_pressure(measured_pa);
        }
    }

    /// Takes it through a cell that ends at `end_ns`, and the inputs until then off the queue.
    ///
    /// # Errors
    /// A motion that is no longer finite.
    pub fn pass(&mut self, inputs: &mut Inputs, end_ns: i64) -> Result<Cell, PlantError> {
        let start_ns = self.plant.now_ns();
        let half_ns = start_ns + (end_ns - start_ns) / 2;
        let due = inputs.partition_point(|(at_ns, _)| *at_ns <= end_ns);
        let (before, behind): (Vec<_>, Vec<_>) =
            inputs.drain(..due).partition(|(at_ns, _)| *at_ns <= half_ns);
        let mut cell = Cell {
            length_s: seconds(end_ns - start_ns),
            gyro: [(0.0, 0.0); 3],
            speed: [(0.0, 0.0); MAX_WHEELS],
            time_s: 0.0,
            q_world_body: UnitQuaternion::identity(),
            omega_b_rad_s: Vector3::zeros(),
            wheel_speed_rad_s: [0.0; MAX_WHEELS],
            hidden: Vec::new(),
            wheel_torque_n_m: [0.0; MAX_WHEELS],
            wheel_impulse_variance: [0.0; MAX_WHEELS],
            valve_fraction: [0.0; MAX_JETS],
        };
        for (at_ns, input) in before {
            self.take(&mut cell, at_ns, input)?;
        }
        self.advance(&mut cell, half_ns)?;
        let state = self.plant.state();
        (cell.time_s, cell.q_world_body) = (self.plant.time_s(), state.q_world_body);
        (cell.omega_b_rad_s, cell.wheel_speed_rad_s) = (state.omega_wb_b_rad_s, *state.wheel_speed_rad_s());
        cell.hidden = state.hidden[..self.plant.gyrostat().effects().hidden_states()].to_vec();
        for (at_ns, input) in behind {
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
        // A pulse is carried out when it is due.
        if let Input::Pulse(jet, on_time_s) = input {
            let _ = self.plant.command_jet_pulse(jet, at_ns.max(self.plant.now_ns()), on_time_s);
            return Ok(());
        }
        self.advance(cell, at_ns)?;
        let add = |slot: &mut (f64, f64), difference: f64| {
            if difference.is_finite() {
                *slot = (slot.0 + difference, slot.1 + 1.0);
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
            Input::Pulse(..) => {}
            Input::Ballast(moment) => self.plant.set_ballast_moment(moment),
            Input::Gyro(read) => {
                let (expected, _) = self.plant.imu_reading();
                let slots = cell.gyro.iter_mut().zip(read.iter().zip(&expected));
                slots.for_each(|(slot, (read, expected))| add(slot, read - expected));
            }
            Input::Speed(read) => {
                let expected = self.plant.state().wheel_speed_rad_s();
                let slots = cell.speed.iter_mut().zip(read.iter().zip(expected)).take(wheels);
                slots.for_each(|(slot, (read, expected))| add(slot, read - expected));
            }
        }
        Ok(())
    }
}

fn seconds(ns: i64) -> f64 {
    ns as f64 * 1e-9
}

#[cfg(test)]
mod tests {
    use whorl_dynamics::platform::TiltLimit;

    use super::*;

    fn driven(pressure_pa: f64) -> Driven {
        let supplies = Supplies { pressure_pa: Some(pressure_pa), ..Supplies::default() };
        Driven::new(&PlatformModel::whorl_1_reference(), &supplies, 0, 200_000_000).unwrap()
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
        assert!(rate_by_a_pulse_rad_s(0.0) < 1e-9);
        assert!(rate_by_a_pulse_rad_s(-300.0) < 1e-9);
    }

    #[test]
    fn the_gas_is_what_the_sensor_reads_where_its_noise_does_not_explain_the_difference() {
        let noise_pa = PlatformModel::whorl_1_reference().sensors.tank_pressure.stddev();
        assert!(noise_pa > 0.0);
        for (measured_pa, expected_pa) in [
            (2e7 - 2.0 * noise_pa, 2e7),
            (2e7 - 4.0 * noise_pa, 2e7 - 4.0 * noise_pa),
            (1e7, 1e7),
            (-noise_pa, 0.0),
        ] {
            let mut driven = driven(2e7);
            driven.hear_pressure(measured_pa);
            let heard_pa = driven.plant.environment().tank_pressure_pa;
            assert!((heard_pa - expected_pa).abs() < 1.0, "{measured_pa} {heard_pa}");
        }
    }

    /// A plant that is read at 100 Hz while its motors change 50 times a second and jets give short pulses: what is read is what the cells
    /// predict, to a part of the noise of their means.
    #[test]
    fn means_of_readings_are_predicted_whatever_actuators_do_within_a_cell() {
        // Pulses turn it further than its stops would let it.
        let model = PlatformModel { tilt_limit: TiltLimit::NONE, ..PlatformModel::whorl_1_reference() };
        let supplies = Supplies::default();
        let mut truth = Driven::new(&model, &supplies, 0, 1_000_000).unwrap().plant;
        let mut cells = Driven::new(&model, &supplies, 0, 200_000_000).unwrap();
        let wheels = model.wheels().len();
        for plant in [&mut truth, &mut cells.plant] {
            let tilted = UnitQuaternion::from_euler_angles(0.05, -0.03, 0.4);
            plant.set_motion(&tilted, &Vector3::new(0.02, -0.03, 0.05), &[90.0, -70.0, 120.0]).unwrap();
        }
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
        }
        let gyro_rad_s = model.sensors.gyro.errors.one_sample_stddev().min();
        let speed_rad_s = model.sensors.wheel_speed.one_sample_stddev_rad_s();
        for cell in 1..=9 {
            let found = cells.pass(&mut inputs, cell * 200_000_000).unwrap();
            for reading in found.readings(&model.sensors) {
                let noise = if reading.component.channel == Channel::Gyro { gyro_rad_s } else { speed_rad_s };
                let mean_noise = noise / 20_f64.sqrt();
                assert!(reading.value.abs() < 0.2 * mean_noise, "cell {cell}: {reading:?} of {mean_noise}");
            }
        }
    }
}
