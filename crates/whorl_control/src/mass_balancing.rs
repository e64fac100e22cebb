//! Automatic mass balancing: the linear actuators move until the gravity offset is at its target.
//!
//! While the platform holds or moves slowly under control, momentum balance in body axes over a window is
//! linear in the gravity offset m g r_cg (eq. 4.83 with the wheels' momentum measured):
//!
//! ```text
//! h(t) - h(0) + int w x h dt = int k_b x (m g r_cg) dt,      h = I w + A J Om
//! ```
//!
//! [`Balancer`] collects these equations over a window, with the momentum at its start unknown, and
//! updates offset and covariance as a Kalman filter of a constant does; its own moves shift the offset by
//! a known amount. No derivative is taken, and torque commands need not be known. Level, only the x and y
//! parts show; z shows in proportion to the tilt, so sweep a few degrees to find it, slowly: an error of the
//! inertia looks like a z offset of that error times the square of the sweep's angular frequency (3 % of
//! 6.2 kg m^2 at 0.06 rad/s: 0.7 N mm).
//!
//! [`Balancer::with_masses`] says what the actuators are made of. Moves then end at their end stops, and what the play
//! of a spindle may have kept of a move is added to the covariance, evenly spread over the play, (W gap)^2 / 12, so that
//! the next window measures it.

use nalgebra::{Matrix3, Matrix6, UnitQuaternion, Vector3, Vector6};
use thiserror::Error;
use whorl_dynamics::actuators::moving_masses::MovingMasses;
use whorl_dynamics::gyrostat::equation::momentum_rate_b_n_m;
use whorl_math::{skew, vertical_b};

/// A number outside its range.
#[derive(Debug, Clone, Copy, PartialEq, Error)]
#[error("mass balancing: {name} must be positive and finite")]
pub struct BalancingError {
    /// Which.
    pub name: &'static str,
}

/// How balancing works.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct BalancingSettings {
    /// Offset wanted [N m]; a small negative z keeps the platform pendulum-stable.
    pub target_b_n_m: Vector3<f64>,
    /// Largest moment of the actuators along each body axis, either way: weight times travel [N m].
    pub limit_b_n_m: Vector3<f64>,
    /// Length of a window \[s\].
    pub window_s: f64,
    /// Noise of the measured momentum about each axis, a sample: inertia times rate noise [N m s].
    pub momentum_noise_n_m_s: f64,
    /// Offset before, standard deviation [N m].
    pub initial_stddev_n_m: f64,
    /// An axis is moved once it is known this well [N m].
    pub move_stddev_n_m: f64,
    /// Balanced when every axis is known to, and nearer than, this [N m].
    pub tolerance_n_m: f64,
    /// How fast the offset may change by itself, gas and cables [N m/sqrt(s)].
    pub drift_n_m_sqrt_s: f64,
}

impl Default for BalancingSettings {
    /// 10 s windows, tolerance 1 N mm, for a platform of some kg m^2 with a MotionPak-class gyro.
    fn default() -> Self {
        Self {
            target_b_n_m: Vector3::zeros(),
            limit_b_n_m: Vector3::repeat(0.5),
            window_s: 10.0,
            momentum_noise_n_m_s: 0.01,
            initial_stddev_n_m: 0.1,
            move_stddev_n_m: 2e-3,
            tolerance_n_m: 1e-3,
            drift_n_m_sqrt_s: 1e-5,
        }
    }
}

/// What is measured at one time.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct BalancingInput {
    /// Time since the last input \[s\]; the first one's does not count.
    pub dt_s: f64,
    /// Attitude.
    pub q_world_body: UnitQuaternion<f64>,
    /// Body rate, body axes [rad/s].
    pub omega_wb_b_rad_s: Vector3<f64>,
    /// Momentum of the wheels relative to the body, A J Om, body axes [N m s].
    pub wheel_momentum_b_n_m_s: Vector3<f64>,
    /// Known other torques, jets included, body axes [N m].
    pub known_torque_b_n_m: Vector3<f64>,
}

/// Where balancing stands.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct BalancingState {
    /// Wanted moment of the actuators [N m].
    pub moment_b_n_m: Vector3<f64>,
    /// Remaining offset, less the target [N m].
    pub residual_b_n_m: Vector3<f64>,
    /// Its standard deviation [N m].
    pub residual_stddev_n_m: Vector3<f64>,
    /// Whether every axis is within the tolerance, at two standard deviations.
    pub balanced: bool,
    /// Axes along which the actuators cannot give what is needed: at the end of their travel, or none there.
    pub at_limit: [bool; 3],
}

/// Balances by steps, a window each.
#[derive(Debug, Clone)]
pub struct Balancer {
    settings: BalancingSettings,
    /// What the actuators are; none: ideal ones.
    masses: MovingMasses,
    /// Axes along which the end stops kept the last move short.
    stopped: [bool; 3],
    inertia_b_kg_m2: Matrix3<f64>,
    moment: Vector3<f64>,
    /// Offset with the current moment, and its covariance.
    offset: Vector3<f64>,
    covariance: Matrix3<f64>,
    window: Option<Window>,
}

/// Sums over a window; unknowns are the offset and the error of the initial momentum.
#[derive(Debug, Clone)]
struct Window {
    elapsed_s: f64,
    start: Vector3<f64>,
    explained: Vector3<f64>,
    lever: Matrix3<f64>,
    normal: Matrix6<f64>,
    right: Vector6<f64>,
}

impl Balancer {
    /// Starts from actuators at `moment_b_n_m` and an estimated offset of `offset_b_n_m`.
    ///
    /// # Errors
    /// When a setting is not positive and finite.
    pub fn new(
        settings: BalancingSettings,
        inertia_b_kg_m2: Matrix3<f64>,
        moment_b_n_m: Vector3<f64>,
        offset_b_n_m: Vector3<f64>,
    ) -> Result<Self, BalancingError> {
        let numbers = [
            ("window_s", settings.window_s),
            ("momentum_noise_n_m_s", settings.momentum_noise_n_m_s),
            ("initial_stddev_n_m", settings.initial_stddev_n_m),
            ("move_stddev_n_m", settings.move_stddev_n_m),
            ("tolerance_n_m", settings.tolerance_n_m),
            ("the smallest limit", settings.limit_b_n_m.min()),
        ];
        if let Some((name, _)) = numbers.into_iter().find(|(_, x)| !(*x > 0.0 && x.is_finite())) {
            return Err(BalancingError { name });
        }
        Ok(Self {
            settings,
            masses: MovingMasses::default(),
            stopped: [false; 3],
            inertia_b_kg_m2,
            moment: moment_b_n_m,
            offset: offset_b_n_m,
            covariance: Matrix3::identity() * settings.initial_stddev_n_m.powi(2),
            window: None,
        })
    }

    /// The same with actuators that have travel and play.
    #[must_use]
    pub fn with_masses(self, masses: MovingMasses) -> Self {
        Self { masses, ..self }
    }

    /// Where it stands.
    #[must_use]
    pub fn state(&self) -> BalancingState {
        let residual = self.offset - self.settings.target_b_n_m;
        let stddev = self.covariance.diagonal().map(f64::sqrt);
        let tolerance = self.settings.tolerance_n_m;
        BalancingState {
            moment_b_n_m: self.moment,
            residual_b_n_m: residual,
            residual_stddev_n_m: stddev,
            balanced: (0..3).all(|n| residual[n].abs() + 2.0 * stddev[n] < 2.0 * tolerance),
            at_limit: std::array::from_fn(|n| {
                self.stopped[n] || self.moment[n].abs() >= self.settings.limit_b_n_m[n]
            }),
        }
    }

    /// Forgets the window: the platform was not free, or was touched.
    pub fn interrupt(&mut self) {
        self.window = None;
    }

    /// Takes in one sample; at the end of a window returns the state with a new moment. Samples that are
    /// not finite interrupt.
    pub fn step(&mut self, input: &BalancingInput) -> Option<BalancingState> {
        let omega = input.omega_wb_b_rad_s;
        let momentum = self.inertia_b_kg_m2 * omega + input.wheel_momentum_b_n_m_s;
        let finite = momentum.iter().chain(&input.known_torque_b_n_m).all(|x| x.is_finite());
        if !(finite && input.dt_s > 0.0 && input.dt_s < 0.5) {
            self.interrupt();
            return None;
        }
        let Some(window) = &mut self.window else {
            self.window = Some(Window {
                elapsed_s: 0.0,
                start: momentum,
                explained: Vector3::zeros(),
                lever: Matrix3::zeros(),
                normal: Matrix6::zeros(),
                right: Vector6::zeros(),
            });
            return None;
        };
        window.elapsed_s += input.dt_s;
        window.explained += momentum_rate_b_n_m(&omega, &momentum, &input.known_torque_b_n_m) * input.dt_s;
        window.lever += skew(&vertical_b(&input.q_world_body)) * input.dt_s;
        // momentum - start - explained = lever * offset + initial error.
        let value = momentum - window.start - window.explained;
        let lever = window.lever;
        let (lt, identity) = (lever.transpose(), Matrix3::identity());
        let mut block = |row: usize, column: usize, m: &Matrix3<f64>| {
            let mut view = window.normal.fixed_view_mut::<3, 3>(row, column);
            view += m;
        };
        block(0, 0, &(lt * lever));
        block(0, 3, &lt);
        block(3, 0, &lever);
        block(3, 3, &identity);
        let mut offset = window.right.fixed_rows_mut::<3>(0);
        offset += lt * value;
        let mut start = window.right.fixed_rows_mut::<3>(3);
        start += value;
        if window.elapsed_s < self.settings.window_s {
            return None;
        }
        let window = self.window.take()?;
        self.update(&window);
        self.command();
        Some(self.state())
    }

    fn update(&mut self, window: &Window) {
        let weight = self.settings.momentum_noise_n_m_s.powi(-2);
        let (normal, right) = (window.normal * weight, window.right * weight);
        // The initial error is eliminated; its scatter is that of one sample.
        let corner = normal.fixed_view::<3, 3>(3, 3) + Matrix3::identity() * weight;
        let Some(inverse) = corner.try_inverse() else { return };
        let cross = normal.fixed_view::<3, 3>(0, 3) * inverse;
        let information = normal.fixed_view::<3, 3>(0, 0) - cross * normal.fixed_view::<3, 3>(3, 0);
        let pull = right.fixed_rows::<3>(0) - cross * right.fixed_rows::<3>(3);
        let drift = self.settings.drift_n_m_sqrt_s.powi(2) * window.elapsed_s;
        let prior = self.covariance + Matrix3::identity() * drift;
        let Some(prior_information) = prior.try_inverse() else { return };
        let total = prior_information + 0.5 * (information + information.transpose());
        let Some(covariance) = total.try_inverse() else { return };
        self.offset = covariance * (prior_information * self.offset + pull);
        self.covariance = 0.5 * (covariance + covariance.transpose());
    }

    /// Moves every axis that is known well enough.
    fn command(&mut self) {
        let mut wanted = self.moment;
        for axis in 0..3 {
            if self.covariance[(axis, axis)].sqrt() > self.settings.move_stddev_n_m {
                continue;
            }
            let limit = self.settings.limit_b_n_m[axis];
            let needed = self.moment[axis] - (self.offset[axis] - self.settings.target_b_n_m[axis]);
            wanted[axis] = needed.max(-limit).min(limit);
        }
        let reached = self.masses.within_travel(&wanted);
        for axis in 0..3 {
            self.stopped[axis] = (wanted[axis] - reached[axis]).abs() > 0.5 * self.settings.tolerance_n_m;
            let moved = reached[axis] - self.moment[axis];
            self.moment[axis] += moved;
            self.offset[axis] += moved;
            self.doubt_play(axis, moved);
        }
    }

    /// A move of more than the tolerance may have been lost in the play.
    fn doubt_play(&mut self, axis: usize, moved_n_m: f64) {
        if moved_n_m.abs() < 0.5 * self.settings.tolerance_n_m {
            return;
        }
        let play = self.masses.play_b_n_m()[axis];
        self.covariance[(axis, axis)] += play * play / 12.0;
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use whorl_dynamics::{InitialState, MassProperties, Plant, PlatformModel};
    use whorl_math::attitude_error;

    /// Whorl-I balanced except for an error of 30 N mm.
    fn nearly_balanced(offset: Vector3<f64>) -> PlatformModel {
        let mut model = PlatformModel::whorl_1_reference();
        let inertia = *model.mass_properties.inertia_b_kg_m2();
        model.mass_properties = MassProperties::new(inertia, offset, 110.0).unwrap();
        model.tilt_limit = whorl_dynamics::platform::TiltLimit::Cone { max_rad: 0.3 };
        model
    }

    /// Follows a slow sweep of +-3 deg with the wheels, measures with noise, moves the actuators.
    fn balance(
        offset: Vector3<f64>,
        settings: BalancingSettings,
        seed: u64,
    ) -> (Plant, Balancer, Option<f64>) {
        let model = nearly_balanced(offset);
        let mut plant = Plant::new(&model, &InitialState::default(), seed).unwrap();
        let inertia = *model.mass_properties.inertia_b_kg_m2();
        // The inertia in the balancer is 3 % off.
        let mut balancer =
            Balancer::new(settings, inertia * 1.03, Vector3::zeros(), Vector3::zeros()).unwrap();
        let mut done = None;
        for k in 0..40_000i64 {
            plant.advance_to(k * 10_000_000).unwrap();
            let t = plant.time_s();
            let truth = plant.truth();
            let reference =
                UnitQuaternion::from_euler_angles(0.05 * (0.06 * t).sin(), 0.05 * (0.045 * t).sin(), 0.0);
            let error = attitude_error(&reference, &truth.q_world_body);
            let torque = -(error * 0.5 + truth.omega_wb_b_rad_s * 1.4).component_mul(&inertia.diagonal());
            plant.command_wheels((-torque).as_slice()).unwrap();
            let noise =
                plant.sample_imu().angular_velocity_rad_s - truth.omega_wb_b_rad_s - truth.gyro_bias_rad_s;
            let input = BalancingInput {
                dt_s: 0.01,
                q_world_body: truth.q_world_body,
                omega_wb_b_rad_s: truth.omega_wb_b_rad_s + noise,
                wheel_momentum_b_n_m_s: Vector3::from_iterator(
                    plant.sample_wheels().iter().map(|w| 0.08 * w.speed_rad_s),
                ),
                known_torque_b_n_m: Vector3::zeros(),
            };
            if let Some(state) = balancer.step(&input) {
                plant.set_ballast_moment(state.moment_b_n_m);
                if state.balanced && done.is_none() {
                    done = Some(t);
                }
            }
        }
        (plant, balancer, done)
    }

    #[test]
    fn thirty_newton_millimetres_become_less_than_one() {
        for (seed, offset) in [
            (1, Vector3::new(0.03, 0.0, 0.0)),
            (2, Vector3::new(-0.02, 0.018, -0.013)),
            (3, Vector3::new(0.01, -0.02, 0.02)),
        ] {
            let (_, balancer, done) = balance(offset, BalancingSettings::default(), seed);
            let left = offset + balancer.state().moment_b_n_m;
            println!("{offset:?} left {left:?} {:?} after {done:?}", balancer.state());
            assert!(left.norm() < 1e-3, "{left}");
            // Its covariance is consistent, except for the error that the wrong inertia adds to z.
            let state = balancer.state();
            let misses = (left - state.residual_b_n_m).component_div(&state.residual_stddev_n_m);
            assert!(misses.xy().amax() < 4.0, "{misses}");
            assert!(done.is_some());
        }
    }

    #[test]
    fn an_actuator_at_its_end_is_said_and_not_overdriven() {
        let settings = BalancingSettings { limit_b_n_m: Vector3::new(0.01, 0.5, 0.5), ..Default::default() };
        let (_, balancer, done) = balance(Vector3::new(0.03, 0.0, 0.0), settings, 4);
        let state = balancer.state();
        assert_eq!(state.at_limit, [true, false, false]);
        assert!((state.residual_b_n_m.x - 0.02).abs() < 1e-3 && !state.balanced);
        assert_eq!(done, None);
    }

    #[test]
    fn bad_settings_and_samples_are_refused() {
        let bad = BalancingSettings { window_s: 0.0, ..Default::default() };
        assert!(Balancer::new(bad, Matrix3::identity(), Vector3::zeros(), Vector3::zeros()).is_err());
        let mut balancer = Balancer::new(
            BalancingSettings::default(),
            Matrix3::identity(),
            Vector3::zeros(),
            Vector3::zeros(),
        )
        .unwrap();
        let input = BalancingInput {
            dt_s: f64::NAN,
            q_world_body: UnitQuaternion::identity(),
            omega_wb_b_rad_s: Vector3::zeros(),
            wheel_momentum_b_n_m_s: Vector3::zeros(),
            known_torque_b_n_m: Vector3::zeros(),
        };
        assert_eq!(balancer.step(&input), None);
    }
}
