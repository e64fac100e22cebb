//! The Kalman filter that whitens: innovations of gyro and wheel speeds while the model is right.
//!
//! State: errors of rate (3), wheel speeds, gyro bias (3), background torque on the body (3) and on each wheel, and the
//! platform's constants in units of their directions. Rate and wheel speeds are taken over by the plant after every bin, so that their errors are zero in
//! the mean; the others stay here, and act on the plant's prediction linearly.
//!
//! Within a bin of length T the accelerations hardly change: a mean reading is the motion half-way, Phi(T/2) x with
//! Phi(t) = I + t J + t^2 J^2 / 2, J the Jacobian of the equation of motion.

use nalgebra::{DMatrix, DVector, Matrix3, UnitQuaternion, Vector3};
use whorl_dynamics::Gyrostat;
use whorl_dynamics::gyrostat::MAX_WHEELS;
use whorl_dynamics::platform::Wheel;
use whorl_identification::Directions;

use crate::Settings;
use crate::lanes::{Changes, Lanes};
use crate::places::Places;
use crate::predictor::Bin;

/// Uncertainty of a motion of which nothing is known: rate [rad/s], wheel speed [rad/s].
const ANY_RATE_RAD_S: f64 = 0.2;
const ANY_SPEED_RAD_S: f64 = 20.0;
/// Slow torque on a wheel that the model need not know (friction that warms up, a bias of its drive), over its largest
/// torque: a per mille, half of the bearing friction of a small wheel.
const WHEEL_TORQUE: f64 = 1e-3;
/// A wheel slower than this may stick or turn back [rad/s], and for so long at a time \[s\].
const SLOW_RAD_S: f64 = 1.0;
const STICKING_S: f64 = 5.0;
/// A wheel slower than this rests [rad/s] while its motor asks for less than this share of its bearing's friction: that holds
/// it even where it is half of what the model says.
const RESTING_RAD_S: f64 = 0.1;
const HELD_SHARE: f64 = 0.5;
/// What a wheel that rests may yet move by in a bin [rad/s].
const HELD_RAD_S: f64 = 1e-3;

/// How a wheel turns, as far as its friction is concerned.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Turning {
    /// Its bearing holds it.
    Held,
    /// It may stick or turn back: nobody knows which way its friction points.
    Slowly,
    /// As its model says.
    Freely,
}

impl Turning {
    /// Of a wheel in a bin.
    pub(crate) fn of(wheel: &Wheel, speed_rad_s: f64, torque_n_m: f64) -> Self {
        let held = torque_n_m.abs() < HELD_SHARE * wheel.coulomb_friction_n_m;
        match speed_rad_s.abs() {
            speed if speed < RESTING_RAD_S && held => Self::Held,
            speed if speed < SLOW_RAD_S && wheel.coulomb_friction_n_m > 0.0 => Self::Slowly,
            _ => Self::Freely,
        }
    }
}

/// A whitened bin: what evidence is made of.
#[derive(Debug, Clone)]
pub struct Whitened {
    /// Innovations of unit variance, one for each reading.
    pub innovation: DVector<f64>,
    /// Reading of each: 0 to 2 an axis of the gyro, from 3 on a wheel.
    pub reading: Vec<usize>,
    /// Readings by state, half-way through the bin.
    pub by_state: DMatrix<f64>,
    /// Lower triangle of the innovations' covariance.
    lower: DMatrix<f64>,
    /// Gain of the state.
    pub gain: DMatrix<f64>,
    /// Motion at the end of the bin by state at its start.
    pub transition: DMatrix<f64>,
    /// Motion at the end and half-way by acceleration.
    pub by_rate: (DMatrix<f64>, DMatrix<f64>),
    /// Share of the background torque that is left after the bin.
    pub torque_left: f64,
    /// Share of the constants' errors that is left after the bin.
    pub constants_left: f64,
}

impl Whitened {
    /// Lower triangle of the innovations' covariance.
    #[must_use]
    pub fn lower(&self) -> &DMatrix<f64> {
        &self.lower
    }

    /// Of made-up numbers.
    #[cfg(test)]
    pub fn of_parts(
        innovation: DVector<f64>,
        reading: Vec<usize>,
        by_state: DMatrix<f64>,
        lower: DMatrix<f64>,
        gain: DMatrix<f64>,
        transition: DMatrix<f64>,
        by_rate: (DMatrix<f64>, DMatrix<f64>),
    ) -> Self {
        let (torque_left, constants_left) = (0.9, 0.8);
        Self { innovation, reading, by_state, lower, gain, transition, by_rate, torque_left, constants_left }
    }
}

/// The filter.
#[derive(Debug, Clone)]
pub struct Filter {
    /// Where what is.
    pub places: Places,
    /// Which directions the constants are.
    constants: Vec<usize>,
    covariance: DMatrix<f64>,
    state: DVector<f64>,
    stddev: Vec<f64>,
    gyro_variance: Vector3<f64>,
    gyro_walk: Vector3<f64>,
    speed_variance: f64,
    torque_walk_n_m_sqrt_s: Vector3<f64>,
    /// Variance of the motors' white torque noise over that of the settings.
    motor_noise_share: f64,
    settings: Settings,
}

impl Filter {
    /// Before the first bin.
    #[must_use]
    pub fn new(all: &Directions, settings: &Settings) -> Self {
        let constants: Vec<usize> =
            (0..all.directions.len()).filter(|k| all.directions[*k].base_stddev > 0.0).collect();
        let model = all.base.model();
        let places = Places { wheels: model.wheels().len().min(MAX_WHEELS), constants: constants.len() };
        let (gyro, speed) = (&model.sensors.gyro.errors, &model.sensors.wheel_speed);
        let stddev: Vec<f64> = constants.iter().map(|k| all.directions[*k].base_stddev).collect();
        let mut covariance = DMatrix::zeros(places.len(), places.len());
        for axis in 0..3 {
            let bias = gyro.bias_turn_on_stddev[axis].max(gyro.one_sample_stddev()[axis]);
            covariance[(places.bias() + axis, places.bias() + axis)] = bias * bias;
            let torque = settings.background_torque_n_m;
            covariance[(places.torque() + axis, places.torque() + axis)] = torque * torque;
        }
        for (j, wheel) in model.wheels().iter().enumerate().take(places.wheels) {
            let torque = WHEEL_TORQUE * wheel.max_torque_n_m;
            covariance[(places.wheel_torque() + j, places.wheel_torque() + j)] = torque * torque;
        }
        for (k, stddev) in stddev.iter().enumerate() {
            covariance[(places.first_constant() + k, places.first_constant() + k)] = stddev * stddev;
        }
        let mut filter = Self {
            state: DVector::zeros(places.len()),
            gyro_variance: gyro.one_sample_stddev().map(|s| s * s),
            gyro_walk: gyro.bias_walk,
            speed_variance: speed.one_sample_stddev_rad_s().powi(2),
            torque_walk_n_m_sqrt_s: all.base.effects().torque_walk_b_n_m_sqrt_s(),
            motor_noise_share: 1.0,
            settings: settings.clone(),
            places,
            constants,
            covariance,
            stddev,
        };
        filter.forget_motion();
        filter
    }

    /// The motion is unknown: after a gap in the data. What was learned of constants and sensors stays.
    pub fn forget_motion(&mut self) {
        let motion = self.places.motion();
        self.covariance.rows_mut(0, motion).fill(0.0);
        self.covariance.columns_mut(0, motion).fill(0.0);
        self.state.rows_mut(0, motion).fill(0.0);
        for k in 0..motion {
            let any = if k < 3 { ANY_RATE_RAD_S } else { ANY_SPEED_RAD_S };
            self.covariance[(k, k)] = any * any;
        }
    }

    /// Allows the motors from now on this much of the variance that the settings give their torque noise.
    pub fn set_motor_noise_share(&mut self, share: f64) {
        self.motor_noise_share = share.max(0.0);
    }

    /// Makes the motion another that is so far from the one that all was counted from.
    ///
    /// `change` is of rate [rad/s] and wheel speeds [rad/s].
    pub fn set_motion_error(&mut self, change: &DVector<f64>) {
        let motion = self.places.motion();
        self.state.rows_mut(0, motion).copy_from(change);
    }

    /// Estimated gyro bias, beside the model's [rad/s].
    #[must_use]
    pub fn bias_rad_s(&self) -> Vector3<f64> {
        self.state.fixed_rows::<3>(self.places.bias()).into_owned()
    }

    /// Jacobian of the motion by motion and torque.
    fn jacobian(base: &Gyrostat, bin: &Bin, places: &Places) -> (DMatrix<f64>, DMatrix<f64>) {
        let model = base.model();
        let momentum = base.momentum_b_n_m_s(&bin.omega_b_rad_s, bin.environment(model).wheel_speed_rad_s);
        let vertical = whorl_math::vertical_b(&bin.q_world_body);
        let offset = model.mass_properties.gravity_offset_b_n_m();
        let by = base.rate_equation().linearised(&bin.omega_b_rad_s, &momentum, offset, &vertical);
        let (mut by_motion, mut by_torque) =
            (DMatrix::zeros(places.motion(), places.motion()), DMatrix::zeros(places.motion(), 3));
        by_motion.view_mut((0, 0), (3, 3)).copy_from(&by.by_rate);
        by_torque.rows_mut(0, 3).copy_from(&by.by_torque);
        for (j, wheel) in model.wheels().iter().enumerate().take(places.wheels) {
            let axis = wheel.spin_axis_b.into_inner();
            let column = by.by_wheel_momentum * axis * wheel.spin_inertia_kg_m2;
            by_motion.view_mut((0, 3 + j), (3, 1)).copy_from(&column);
        }
        // Without a torque of its own a wheel keeps its speed about its axis in space.
        for (j, wheel) in model.wheels().iter().enumerate().take(places.wheels) {
            let axis = wheel.spin_axis_b.transpose();
            let row = -(axis * by_motion.rows(0, 3));
            by_motion.row_mut(3 + j).copy_from(&row);
            let row = -(axis * by_torque.rows(0, 3));
            by_torque.row_mut(3 + j).copy_from(&row);
        }
        (by_motion, by_torque)
    }

    /// Motion by a torque on each wheel that is not held, which the body takes.
    fn by_wheel_torque(
        base: &Gyrostat,
        bin: &Bin,
        by_torque: &DMatrix<f64>,
        places: &Places,
    ) -> DMatrix<f64> {
        let mut by = DMatrix::zeros(places.motion(), places.wheels);
        for (j, wheel) in base.model().wheels().iter().enumerate().take(places.wheels) {
            if Turning::of(wheel, bin.wheel_speed_rad_s[j], bin.wheel_torque_n_m[j]) == Turning::Held {
                continue;
            }
            let mut change = by_torque * -wheel.spin_axis_b.into_inner();
            change[3 + j] += 1.0 / wheel.spin_inertia_kg_m2;
            by.column_mut(j).copy_from(&change);
        }
        by
    }

    /// Takes a bin: its innovations, and what the motion at its end must be corrected by.
    ///
    /// `None` where nothing was read, or rounding has made the covariance useless; the motion is then unknown.
    pub fn step(&mut self, lanes: &Lanes, bin: &Bin, changes: &Changes) -> Option<(Whitened, DVector<f64>)> {
        let places = self.places;
        let (motion, length, time_s) = (places.motion(), places.len(), bin.length_s);
        let (by_motion, by_torque) = Self::jacobian(lanes.base(), bin, &places);
        let by_wheel_torque = Self::by_wheel_torque(lanes.base(), bin, &by_torque, &places);
        let identity = DMatrix::<f64>::identity(motion, motion);
        let square = &by_motion * &by_motion;
        let transition = |t: f64| &identity + &by_motion * t + &square * (0.5 * t * t);
        let integral = |t: f64| &identity * t + &by_motion * (0.5 * t * t);
        let by_state = |t: f64| {
            let mut rows = DMatrix::zeros(motion, length);
            let integral = integral(t);
            rows.view_mut((0, 0), (motion, motion)).copy_from(&transition(t));
            rows.view_mut((0, places.torque()), (motion, 3)).copy_from(&(&integral * &by_torque));
            rows.view_mut((0, places.wheel_torque()), (motion, places.wheels))
                .copy_from(&(&integral * &by_wheel_torque));
            for (k, direction) in self.constants.iter().enumerate() {
                let column = &integral * changes.rates.column(*direction);
                rows.column_mut(places.first_constant() + k).copy_from(&column);
            }
            rows
        };
        let (half, full) = (by_state(0.5 * time_s), by_state(time_s));

        let gyro = bin.gyro.iter().enumerate().filter_map(|(axis, mean)| {
            let (value, count) = mean.value()?;
            Some((axis, value, self.gyro_variance[axis] / count))
        });
        let speed = bin.speed.iter().take(places.wheels).enumerate().filter_map(|(wheel, mean)| {
            let (value, count) = mean.value()?;
            Some((3 + wheel, value, self.speed_variance / count))
        });
        let readings: Vec<(usize, f64, f64)> = gyro.chain(speed).collect();
        if readings.is_empty() {
            return None;
        }
        let mut h = DMatrix::zeros(readings.len(), length);
        let mut noise = DMatrix::zeros(readings.len(), readings.len());
        let mut y = DVector::zeros(readings.len());
        for (k, (reading, value, variance)) in readings.iter().enumerate() {
            h.row_mut(k).copy_from(&half.row(*reading));
            if *reading < 3 {
                h[(k, places.bias() + reading)] = 1.0;
                for (c, direction) in self.constants.iter().enumerate() {
                    h[(k, places.first_constant() + c)] += changes.readings[(*reading, *direction)];
                }
            }
            y[k] = *value;
            noise[(k, k)] = *variance;
        }
        y -= &h * &self.state;
        let cross = &self.covariance * h.transpose();
        let covariance = &h * &cross + noise;
        let cholesky = covariance.cholesky()?;
        let gain = cholesky.solve(&cross.transpose()).transpose();
        let lower = cholesky.l();
        let innovation = lower.solve_lower_triangular(&y)?;
        self.state += &gain * &y;
        self.covariance -= &gain * cross.transpose();

        let whitened = Whitened {
            innovation,
            reading: readings.iter().map(|(reading, ..)| *reading).collect(),
            by_state: h,
            lower,
            gain,
            by_rate: (integral(time_s), integral(0.5 * time_s)),
            transition: full,
            torque_left: (-time_s / self.settings.background_time_s).exp(),
            constants_left: (-time_s / self.settings.constants_time_s).exp(),
        };
        let correction = self.propagate(lanes.base(), bin, &by_torque, &by_wheel_torque, &whitened);
        (self.covariance.iter().all(|x| x.is_finite())).then_some((whitened, correction))
    }

    /// On to the end of the bin.
    fn propagate(
        &mut self,
        base: &Gyrostat,
        bin: &Bin,
        by_torque: &DMatrix<f64>,
        by_wheel_torque: &DMatrix<f64>,
        whitened: &Whitened,
    ) -> DVector<f64> {
        let (places, time_s) = (self.places, bin.length_s);
        let motion = places.motion();
        let correction = &whitened.transition * &self.state;
        self.state.rows_mut(0, motion).fill(0.0);
        let mut left = vec![1.0; places.len()];
        left[places.torque()..places.first_constant()].fill(whitened.torque_left);
        left[places.first_constant()..].fill(whitened.constants_left);
        for (x, left) in self.state.iter_mut().zip(&left) {
            *x *= left;
        }
        // P <- F P F^T, F the identity but for the motion's rows.
        let rows = &whitened.transition * &self.covariance;
        self.covariance.rows_mut(0, motion).copy_from(&rows);
        let columns = &self.covariance * whitened.transition.transpose();
        self.covariance.columns_mut(0, motion).copy_from(&columns);
        for (k, left) in left.iter().enumerate().skip(places.torque()) {
            self.covariance.row_mut(k).scale_mut(*left);
            self.covariance.column_mut(k).scale_mut(*left);
        }
        // Random from here on.
        let mut add = |k: usize, variance: f64| self.covariance[(k, k)] += variance;
        for axis in 0..3 {
            add(places.bias() + axis, self.gyro_walk[axis].powi(2) * time_s);
            let torque = self.settings.background_torque_n_m;
            let walk = self.torque_walk_n_m_sqrt_s[axis].powi(2) * time_s;
            add(places.torque() + axis, torque * torque * (1.0 - whitened.torque_left.powi(2)) + walk);
        }
        for (j, wheel) in base.model().wheels().iter().enumerate().take(places.wheels) {
            let torque = WHEEL_TORQUE * wheel.max_torque_n_m;
            add(places.wheel_torque() + j, torque * torque * (1.0 - whitened.torque_left.powi(2)));
        }
        for (k, stddev) in self.stddev.iter().enumerate() {
            let renewed = 1.0 - whitened.constants_left.powi(2);
            add(places.first_constant() + k, stddev * stddev * renewed);
        }
        let impulses = self.random_impulses(base, bin, by_torque, by_wheel_torque);
        let mut view = self.covariance.view_mut((0, 0), (motion, motion));
        view += impulses;
        let symmetric = (&self.covariance + self.covariance.transpose()) * 0.5;
        self.covariance = symmetric;
        correction
    }

    /// Covariance of the motion from pulses and motors that are not quite what was commanded.
    fn random_impulses(
        &self,
        base: &Gyrostat,
        bin: &Bin,
        by_torque: &DMatrix<f64>,
        by_wheel_torque: &DMatrix<f64>,
    ) -> DMatrix<f64> {
        let (model, motion) = (base.model(), self.places.motion());
        let mut covariance = DMatrix::zeros(motion, motion);
        for (jet, share) in model.jets().iter().zip(&bin.valve_fraction).filter(|(_, share)| **share > 0.0) {
            let impulse = jet.torque_b_n_m() * (share * bin.length_s * self.settings.pulse_relative_sigma);
            let change = by_torque * impulse;
            covariance += &change * change.transpose();
        }
        for (j, wheel) in model.wheels().iter().enumerate().take(self.places.wheels) {
            let turning = Turning::of(wheel, bin.wheel_speed_rad_s[j], bin.wheel_torque_n_m[j]);
            if turning == Turning::Held {
                covariance[(3 + j, 3 + j)] += HELD_RAD_S * HELD_RAD_S;
                continue;
            }
            let asked = bin.wheel_torque_n_m[j] * bin.length_s * self.settings.motor_relative_sigma;
            let noise = self.settings.motor_noise_sqrt_s * wheel.max_torque_n_m;
            let noise = noise * noise * self.motor_noise_share * bin.length_s;
            let friction = if turning == Turning::Slowly { wheel.coulomb_friction_n_m } else { 0.0 };
            let sticking = friction * friction * STICKING_S * bin.length_s;
            let change = by_wheel_torque.column(j);
            covariance += change
                * change.transpose()
                * (asked * asked + noise + sticking + bin.wheel_impulse_variance[j]);
        }
        covariance
    }
}

/// Where a body is after a short time: its rate is in body axes.
#[must_use]
pub fn turned(
    q_world_body: &UnitQuaternion<f64>,
    omega_b_rad_s: &Vector3<f64>,
    time_s: f64,
) -> UnitQuaternion<f64> {
    q_world_body * whorl_math::quaternion_exp(&(omega_b_rad_s * time_s))
}

/// Torque about each body axis as a direction: what it changes of the motion.
#[must_use]
pub fn torque_rates(base: &Gyrostat, places: &Places) -> DMatrix<f64> {
    let inverse: &Matrix3<f64> = base.rate_equation().inverse_resisting();
    let mut rates = DMatrix::zeros(places.motion(), 3);
    rates.rows_mut(0, 3).copy_from(inverse);
    for (j, wheel) in base.model().wheels().iter().enumerate().take(places.wheels) {
        rates.row_mut(3 + j).copy_from(&-(wheel.spin_axis_b.transpose() * inverse));
    }
    rates
}
