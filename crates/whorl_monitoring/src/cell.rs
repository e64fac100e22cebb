//! Readings of a short time as one, against the platform's own plant with what its actuators did.

use nalgebra::{UnitQuaternion, Vector3};
use whorl_dynamics::gyrostat::{MAX_JETS, MAX_WHEELS};
use whorl_dynamics::{Environment, InitialState, Plant, PlantError, PlatformModel};
use whorl_prediction::{InState, Reading};
use whorl_recording::{Channel, Component};

/// Readings are averaged over this long \[s\].
pub(crate) const CELL_S: f64 = 0.2;

/// What the platform was told or measured, at a time: torques [N m], rates and speeds [rad/s].
#[derive(Clone)]
pub(crate) enum Input {
    /// Of the wheels' motors from now on, and the variance of what they may have done otherwise since those before [(N m s)^2].
    Torque([f64; MAX_WHEELS], [f64; MAX_WHEELS]),
    /// A jet's valve is driven for so long \[s\], from now on.
    Pulse(usize, f64),
    /// Of the linear mass actuators from now on, body axes.
    Ballast(Vector3<f64>),
    /// Reading of the gyro, sensor axes.
    Gyro(Vector3<f64>),
    Speed([f64; MAX_WHEELS]),
    /// Estimates of attitude and rate, body axes.
    Attitude(UnitQuaternion<f64>, Vector3<f64>),
}

/// Inputs with their times \[ns\].
pub(crate) type Inputs = Vec<(i64, Input)>;
/// Attitude, rate [rad/s], body axes, and wheel speeds [rad/s].
pub(crate) type Motion = (UnitQuaternion<f64>, Vector3<f64>, [f64; MAX_WHEELS]);

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

pub(crate) struct Driven {
    pub plant: Plant,
    wheels: usize,
    /// Standard deviations of one reading of the gyro and of a wheel's speed [rad/s].
    noise_rad_s: (Vector3<f64>, f64),
    /// Motor torques now [N m], and how long each jet was open \[s\].
    torque_n_m: [f64; MAX_WHEELS],
    valve_open_s: Vec<f64>,
    /// The newest estimate of attitude and rate [rad/s], and its time \[ns\].
    attitude: (i64, UnitQuaternion<f64>, Vector3<f64>),
}

impl Driven {
    /// In a motion at this time, with what a sensor reads of the gas \[Pa\]. Pulses were carried out: none is too short.
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
        let wheels = model.wheels().len().min(MAX_WHEELS);
        plant.set_motion(q_world_body, rate_b_rad_s, &speed_rad_s[..wheels])?;
        let (gyro, tachometer) = (&model.sensors.gyro.errors, &model.sensors.wheel_speed);
        let noise_rad_s = (gyro.one_sample_stddev(), tachometer.one_sample_stddev_rad_s());
        let (torque_n_m, valve_open_s) = ([0.0; MAX_WHEELS], vec![0.0; model.jets().len()]);
        let attitude = (now_ns, *q_world_body, *rate_b_rad_s);
        Ok(Self { plant, wheels, noise_rad_s, torque_n_m, valve_open_s, attitude })
    }

    /// Takes it from the newest attitude through a cell that ends at `end_ns`, and the inputs until then off the queue.
    pub fn pass(&mut self, inputs: &mut Inputs, end_ns: i64) -> Result<Cell, PlantError> {
        let (now_ns, state, wheels) = (self.plant.now_ns(), *self.plant.state(), self.wheels);
        let (at_ns, q_world_body, rate_b_rad_s) = self.attitude;
        let now = q_world_body * whorl_math::quaternion_exp(&(rate_b_rad_s * seconds(now_ns - at_ns)));
        self.plant.set_motion(&now, &state.omega_wb_b_rad_s, &state.wheel_speed_rad_s()[..wheels])?;
        let mut cell = Cell { length_s: seconds(end_ns - now_ns), ..Cell::default() };
        inputs.sort_by_key(|(at_ns, _)| *at_ns);
        let due = inputs.partition_point(|(at_ns, _)| *at_ns <= end_ns);
        for (at_ns, input) in inputs.drain(..due) {
            if !matches!(input, Input::Pulse(..) | Input::Attitude(..)) {
                self.advance(&mut cell, at_ns)?;
            }
            match input {
                Input::Torque(torque_n_m, variance) => {
                    cell.wheel_impulse_variance.iter_mut().zip(variance).for_each(|(sum, of)| *sum += of);
                    self.torque_n_m = torque_n_m;
                    // The platform's own: their number was checked.
                    let _ = self.plant.command_wheels(&torque_n_m[..wheels]);
                }
                // A pulse is carried out when it is due, or now if that has passed.
                Input::Pulse(jet, on_time_s) => {
                    let _ = self.plant.command_jet_pulse(jet, at_ns.max(self.plant.now_ns()), on_time_s);
                }
                Input::Ballast(moment) => self.plant.set_ballast_moment(moment),
                Input::Gyro(read) => cell.add(0, read.as_slice(), self.plant.imu_reading().0.as_slice()),
                Input::Speed(read) => cell.add(3, &read[..wheels], self.plant.state().wheel_speed_rad_s()),
                Input::Attitude(q_world_body, rate) => self.attitude = (at_ns, q_world_body, rate),
            }
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
        let share = seconds((at_ns - self.plant.now_ns()).max(0)) / cell.length_s;
        let means = cell.wheel_torque_n_m.iter_mut().zip(&self.torque_n_m);
        means.for_each(|(mean, torque)| *mean += torque * share);
        self.plant.advance_to(at_ns.max(self.plant.now_ns()))
    }

    /// Means of readings of a cell less their predictions, with the variances of their noise.
    pub fn readings(&self, cell: &Cell) -> Vec<Reading> {
        let present = cell.sums.iter().enumerate().filter(|(_, (_, count))| *count > 0.0);
        let reading = |(i, (sum, count)): (usize, &(f64, f64))| {
            let (channel, index, stddev) = match self.noise_rad_s.0.get(i) {
                Some(stddev) => (Channel::Gyro, i, *stddev),
                None => (Channel::WheelSpeed, i - 3, self.noise_rad_s.1),
            };
            let component = Component::new(channel, 0, index);
            Reading { component, value: sum / count, variance: stddev * stddev / count }
        };
        present.map(reading).collect()
    }

    /// The state at the end of a cell, with its mean inputs.
    pub fn in_state<'a>(&'a self, cell: &'a Cell) -> InState<'a> {
        let (gyrostat, state) = (self.plant.gyrostat(), self.plant.state());
        let environment = Environment {
            wheel_motor_torque_n_m: &cell.wheel_torque_n_m[..self.wheels],
            valve_fraction: &cell.valve_fraction[..self.valve_open_s.len().min(MAX_JETS)],
            ..self.plant.environment()
        };
        InState::of(gyrostat, environment, &state.hidden[..gyrostat.effects().hidden_states()])
    }
}

impl Cell {
    fn add(&mut self, first: usize, read: &[f64], expected: &[f64]) {
        for (slot, (read, expected)) in self.sums[first..].iter_mut().zip(read.iter().zip(expected)) {
            if read.is_finite() {
                *slot = (slot.0 + read - expected, slot.1 + 1.0);
            }
        }
    }
}

fn seconds(ns: i64) -> f64 {
    ns as f64 * 1e-9
}

pub(crate) fn ns(seconds: f64) -> i64 {
    (seconds * 1e9).round() as i64
}
