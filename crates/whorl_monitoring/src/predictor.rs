//! Predicts a bin with the platform's plant, from the estimate at its start.

use std::collections::VecDeque;

use nalgebra::{UnitQuaternion, Vector3};
use whorl_dynamics::gyrostat::{MAX_JETS, MAX_WHEELS};
use whorl_dynamics::{Environment, InitialState, Plant, PlantError, PlatformModel};

use crate::gas;

/// Largest integration step \[ns\]; valve edges are integration points.
const STEP_NS: i64 = 10_000_000;

/// What the platform was told or measured, at a time.
#[derive(Debug, Clone, PartialEq)]
pub enum Input {
    /// Motor torques of the wheels from now on [N m].
    Torque([f64; MAX_WHEELS]),
    /// Variance of what the wheels' motors may have done otherwise since the torque before [(N m s)^2].
    Doubt([f64; MAX_WHEELS]),
    /// A jet's valve is driven for so long \[s\], from now on.
    Pulse(usize, f64),
    /// Moment of the linear mass actuators from now on, body axes [N m].
    Ballast(Vector3<f64>),
    /// Reading of the gyro, body axes [rad/s].
    Gyro(Vector3<f64>),
    /// Readings of the wheels' speeds [rad/s].
    Speed([f64; MAX_WHEELS]),
}

/// Mean of a quantity over a bin: measured less predicted.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct Mean {
    sum: f64,
    count: f64,
}

impl Mean {
    fn add(&mut self, difference: f64) {
        if difference.is_finite() {
            self.sum += difference;
            self.count += 1.0;
        }
    }

    /// The mean and the number of readings; `None` without any.
    #[must_use]
    pub fn value(&self) -> Option<(f64, f64)> {
        (self.count > 0.0).then(|| (self.sum / self.count, self.count))
    }
}

/// A bin, predicted.
#[derive(Debug, Clone)]
pub struct Bin {
    /// Length \[s\].
    pub length_s: f64,
    /// Gyro, measured less predicted [rad/s].
    pub gyro: [Mean; 3],
    /// Wheel speeds, measured less predicted [rad/s].
    pub speed: [Mean; MAX_WHEELS],
    /// Half-way: time since the start of the plant \[s\], attitude, rate and its derivative, wheel speeds.
    pub time_s: f64,
    /// Attitude half-way.
    pub q_world_body: UnitQuaternion<f64>,
    /// Rate half-way, body axes [rad/s].
    pub omega_b_rad_s: Vector3<f64>,
    /// Mean angular acceleration, body axes [rad/s^2].
    pub omega_dot_b_rad_s2: Vector3<f64>,
    /// Wheel speeds half-way [rad/s].
    pub wheel_speed_rad_s: [f64; MAX_WHEELS],
    /// Mean motor torques [N m].
    pub wheel_torque_n_m: [f64; MAX_WHEELS],
    /// Variance of the motors' impulses [(N m s)^2]: nobody knows just when a torque took force.
    pub wheel_impulse_variance: [f64; MAX_WHEELS],
    /// Share of the time during which gas flowed.
    pub valve_fraction: [f64; MAX_JETS],
    /// Tank pressure \[Pa\], gas used \[kg\], bus voltage \[V\], temperature \[K\], travel of the ballast.
    supplies: (f64, f64, f64, f64, Vector3<f64>),
    /// Hidden states of the model's effects.
    pub hidden: Vec<f64>,
}

impl Bin {
    /// What effects see half-way through the bin.
    #[must_use]
    pub fn environment<'a>(&'a self, model: &'a PlatformModel) -> Environment<'a> {
        let mut environment = Environment::new(model, self.q_world_body, self.omega_b_rad_s);
        environment.time_s = self.time_s;
        environment.wheel_speed_rad_s = self.wheel_speed_rad_s.get(..model.wheels().len()).unwrap_or(&[]);
        environment.wheel_motor_torque_n_m = self.wheel_torque_n_m.get(..model.wheels().len()).unwrap_or(&[]);
        environment.valve_fraction = self.valve_fraction.get(..model.jets().len()).unwrap_or(&[]);
        let (pressure, gas, voltage, temperature, ballast) = self.supplies;
        environment.tank_pressure_pa = pressure;
        environment.gas_used_kg = gas;
        environment.bus_voltage_v = voltage;
        environment.temperature_k = temperature;
        environment.ballast_direction = ballast;
        environment
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

/// The plant that predicts.
#[derive(Debug, Clone)]
pub struct Predictor {
    plant: Plant,
    wheels: usize,
    valve_open_s: Vec<f64>,
}

/// The model without noise, with the supplies as they were measured. Pulses were carried out: none is too short.
fn quiet(model: &PlatformModel, supplies: &Supplies) -> PlatformModel {
    let mut quiet = model.clone();
    let sensors = &mut quiet.sensors;
    sensors.silence();
    sensors.gyro.errors.range = f64::INFINITY;
    sensors.accelerometer.errors.range = f64::INFINITY;
    sensors.ambient_temperature_k = supplies.temperature_k.unwrap_or(sensors.ambient_temperature_k);
    quiet.bus.initial_v = supplies.voltage_v.unwrap_or(quiet.bus.initial_v);
    for jet in quiet.jets_mut() {
        jet.min_on_time_s = 0.0;
    }
    quiet
}

impl Predictor {
    /// A plant at this time with supplies as measured.
    ///
    /// # Errors
    /// When the platform cannot be simulated.
    pub fn new(model: &PlatformModel, supplies: &Supplies, now_ns: i64) -> Result<Self, PlantError> {
        let start = InitialState { time_ns: now_ns, ..InitialState::default() };
        let mut plant =
            Plant::new(&quiet(model, supplies), &start, 0)?.with_step_ns(STEP_NS).without_random_torque();
        supplies.pressure_pa.into_iter().for_each(|measured_pa| plant.set_tank_pressure(measured_pa));
        Ok(Self { plant, wheels: model.wheels().len(), valve_open_s: vec![0.0; model.jets().len()] })
    }

    /// Time of the plant \[ns\].
    #[must_use]
    pub fn now_ns(&self) -> i64 {
        self.plant.now_ns()
    }

    /// Rate [rad/s] and wheel speeds [rad/s] now.
    #[must_use]
    pub fn motion(&self) -> (Vector3<f64>, [f64; MAX_WHEELS]) {
        let state = self.plant.state();
        (state.omega_wb_b_rad_s, *state.wheel_speed_rad_s())
    }

    /// Puts the platform where it is believed to be.
    ///
    /// # Errors
    /// A number that is not finite.
    pub fn set_motion(
        &mut self,
        q_world_body: &UnitQuaternion<f64>,
        omega_b_rad_s: &Vector3<f64>,
        wheel_speed_rad_s: &[f64; MAX_WHEELS],
    ) -> Result<(), PlantError> {
        let speeds = wheel_speed_rad_s.get(..self.wheels).unwrap_or(&[]);
        self.plant.set_motion(q_world_body, omega_b_rad_s, speeds)
    }

    /// Keeps the gas at what a sensor reads of it \[Pa\]: small errors of what jets use add up.
    pub fn hear_pressure(&mut self, measured_pa: f64) {
        let expected_pa = self.plant.environment().tank_pressure_pa;
        if !gas::is_explained(measured_pa, expected_pa, self.plant.gyrostat().model()) {
            self.plant.set_tank_pressure(measured_pa);
        }
    }

    /// Predicts up to `end_ns`, taking the inputs until then off the queue.
    ///
    /// # Errors
    /// A motion that is no longer finite.
    pub fn bin(&mut self, inputs: &mut VecDeque<(i64, Input)>, end_ns: i64) -> Result<Bin, PlantError> {
        let start_ns = self.plant.now_ns();
        let half_ns = start_ns + (end_ns - start_ns) / 2;
        let before = self.plant.state().omega_wb_b_rad_s;
        let length_s = (end_ns - start_ns) as f64 * 1e-9;
        let mut bin = self.empty(length_s);
        let (mut torque_now, mut since_ns) = (self.torque_now(), start_ns);
        let mut is_half = false;
        while let Some((at_ns, input)) = inputs.front().filter(|(at, _)| *at <= end_ns).cloned() {
            inputs.pop_front();
            let at_ns = at_ns.max(start_ns);
            if !is_half && at_ns >= half_ns {
                self.plant.advance_to(half_ns.max(self.plant.now_ns()))?;
                self.half_way(&mut bin);
                is_half = true;
            }
            self.plant.advance_to(at_ns.max(self.plant.now_ns()))?;
            match input {
                Input::Torque(torque) => {
                    add(&mut bin.wheel_torque_n_m, &torque_now, (at_ns - since_ns) as f64 * 1e-9);
                    (torque_now, since_ns) = (torque, at_ns);
                    // The platform's own: their number was checked.
                    let _ = self.plant.command_wheels(torque.get(..self.wheels).unwrap_or(&[]));
                }
                Input::Doubt(variance) => {
                    let sums = bin.wheel_impulse_variance.iter_mut().zip(variance);
                    sums.for_each(|(sum, variance)| *sum += variance);
                }
                Input::Pulse(jet, on_time_s) => {
                    let _ = self.plant.command_jet_pulse(jet, self.plant.now_ns(), on_time_s);
                }
                Input::Ballast(moment) => self.plant.set_ballast_moment(moment),
                Input::Gyro(reading) => {
                    let predicted = self.plant.sample_imu().angular_velocity_rad_s;
                    for (mean, difference) in bin.gyro.iter_mut().zip((reading - predicted).iter()) {
                        mean.add(*difference);
                    }
                }
                Input::Speed(reading) => {
                    let predicted = *self.plant.state().wheel_speed_rad_s();
                    let numbers = reading.iter().zip(predicted).take(self.wheels);
                    for (mean, (measured, predicted)) in bin.speed.iter_mut().zip(numbers) {
                        mean.add(measured - predicted);
                    }
                }
            }
        }
        if !is_half {
            self.plant.advance_to(half_ns.max(self.plant.now_ns()))?;
            self.half_way(&mut bin);
        }
        self.plant.advance_to(end_ns.max(self.plant.now_ns()))?;
        add(&mut bin.wheel_torque_n_m, &torque_now, (end_ns - since_ns) as f64 * 1e-9);
        bin.wheel_torque_n_m.iter_mut().for_each(|u| *u /= length_s);
        bin.omega_dot_b_rad_s2 = (self.plant.state().omega_wb_b_rad_s - before) / length_s;
        let open_s = self.plant.truth().valve_open_s;
        for ((share, now_s), before_s) in bin.valve_fraction.iter_mut().zip(&open_s).zip(&self.valve_open_s) {
            *share = (now_s - before_s) / length_s;
        }
        self.valve_open_s = open_s;
        Ok(bin)
    }

    fn torque_now(&self) -> [f64; MAX_WHEELS] {
        let mut torque = [0.0; MAX_WHEELS];
        for (slot, now) in torque.iter_mut().zip(self.plant.environment().wheel_motor_torque_n_m) {
            *slot = *now;
        }
        torque
    }

    fn empty(&self, length_s: f64) -> Bin {
        Bin {
            length_s,
            gyro: Default::default(),
            speed: Default::default(),
            time_s: 0.0,
            q_world_body: UnitQuaternion::identity(),
            omega_b_rad_s: Vector3::zeros(),
            omega_dot_b_rad_s2: Vector3::zeros(),
            wheel_speed_rad_s: [0.0; MAX_WHEELS],
            wheel_torque_n_m: [0.0; MAX_WHEELS],
            wheel_impulse_variance: [0.0; MAX_WHEELS],
            valve_fraction: [0.0; MAX_JETS],
            supplies: Default::default(),
            hidden: Vec::new(),
        }
    }

    fn half_way(&self, bin: &mut Bin) {
        let seen = self.plant.environment();
        bin.time_s = seen.time_s;
        bin.q_world_body = seen.q_world_body;
        bin.omega_b_rad_s = seen.omega_wb_b_rad_s;
        bin.wheel_speed_rad_s = *self.plant.state().wheel_speed_rad_s();
        bin.supplies = (
            seen.tank_pressure_pa,
            seen.gas_used_kg,
            seen.bus_voltage_v,
            seen.temperature_k,
            seen.ballast_direction,
        );
        let hidden = self.plant.gyrostat().effects().hidden_states();
        bin.hidden = self.plant.state().hidden.iter().copied().take(hidden).collect();
    }
}

fn add(sum: &mut [f64; MAX_WHEELS], torque: &[f64; MAX_WHEELS], time_s: f64) {
    sum.iter_mut().zip(torque).for_each(|(sum, torque)| *sum += torque * time_s);
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Rate about the axis of the first jet behind a pulse of 0.1 s [rad/s].
    fn rate_by_a_pulse_rad_s(pressure_pa: f64) -> f64 {
        let supplies = Supplies { pressure_pa: Some(pressure_pa), ..Supplies::default() };
        let model = PlatformModel::whorl_1_reference();
        let mut predictor = Predictor::new(&model, &supplies, 0).unwrap();
        let still = InitialState::default();
        predictor.set_motion(&still.q_world_body, &Vector3::zeros(), &[0.0; MAX_WHEELS]).unwrap();
        let at_rest = predictor.clone();
        let after = |mut predictor: Predictor, inputs: &[(i64, Input)]| {
            predictor.bin(&mut inputs.iter().cloned().collect(), 200_000_000).unwrap();
            predictor.motion().0
        };
        (after(predictor, &[(0, Input::Pulse(0, 0.1))]) - after(at_rest, &[])).norm()
    }

    #[test]
    fn a_tank_that_reads_less_than_nothing_is_empty() {
        assert!(rate_by_a_pulse_rad_s(2e7) > 1e-4);
        assert!(rate_by_a_pulse_rad_s(0.0) < 1e-9);
        assert!(rate_by_a_pulse_rad_s(-300.0) < 1e-9);
    }

    #[test]
    fn the_gas_is_what_the_sensor_reads_where_its_noise_does_not_explain_the_difference() {
        let model = PlatformModel::whorl_1_reference();
        let noise_pa = model.sensors.tank_pressure.stddev();
        assert!(noise_pa > 0.0);
        let supplies = Supplies { pressure_pa: Some(2e7), ..Supplies::default() };
        let heard = |measured_pa: f64| {
            let mut predictor = Predictor::new(&model, &supplies, 0).unwrap();
            predictor.hear_pressure(measured_pa);
            predictor.plant.environment().tank_pressure_pa
        };
        for (measured_pa, expected_pa) in [
            (2e7 - 2.0 * noise_pa, 2e7),
            (2e7 - 4.0 * noise_pa, 2e7 - 4.0 * noise_pa),
            (1e7, 1e7),
            (-noise_pa, 0.0),
        ] {
            assert!((heard(measured_pa) - expected_pa).abs() < 1.0, "{measured_pa} {}", heard(measured_pa));
        }
    }
}
