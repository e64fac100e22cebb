//! The filter itself.

use super::FreeMotionParameters;
use super::anchor::Anchor;
use super::clipping::Clipping;
use super::covariance::{
    ATTITUDE, Covariance, FIELD, FORCE_BIAS, GYRO_BIAS, GYRO_MATRIX, IRON, Interval, POSITION, Row,
    UNKNOWN_RAD, VELOCITY, propagate, update,
};
use super::rest::RestDetector;
use super::still_field::StillField;
use nalgebra::{Matrix3, Matrix6, UnitQuaternion, Vector2, Vector3};
use whorl_math::{attitude_from_two_vectors, attitude_from_vertical, quaternion_exp, unit};

/// The covariance is carried in steps of at least this, the interval of magnetometer samples; within it the sums are exact to
/// the first order in the error \[s\].
const COVARIANCE_STEP_S: f64 = 0.05;
/// A longer gap between samples restarts the filter \[s\].
const GAP_S: f64 = 1.0;
/// A hand or a trolley may have turned as fast meanwhile, standard deviation [rad/s].
const GAP_RATE_RAD_S: f64 = 0.5;

/// The estimate of the filter.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FreeMotionEstimate {
    /// Attitude: x east, y magnetic north, z up.
    pub q_world_body: UnitQuaternion<f64>,
    /// Gyro bias, sensor axes [rad/s].
    pub gyro_bias_rad_s: Vector3<f64>,
    /// Accelerometer bias, sensor axes [m/s^2].
    pub accelerometer_bias_m_s2: Vector3<f64>,
    /// Field of iron on the sensor, sensor axes, in the unit of the magnetometer.
    pub iron_magnetometer_unit: Vector3<f64>,
    /// Standard deviation of the attitude error, world axes: inclination about east and north, heading \[rad\].
    pub sigma_rad: Vector3<f64>,
    /// Whether the sensor rests.
    pub resting: bool,
}

/// Averages before the first attitude.
#[derive(Clone, Debug, PartialEq, Default)]
pub(super) struct Start {
    elapsed_s: f64,
    /// Sum in the sensor axes of the start [m/s^2].
    force: Vector3<f64>,
    forces: u32,
    /// Sum in the same axes, in the unit of the magnetometer.
    field: Vector3<f64>,
    fields: u32,
    /// Current sensor axes relative to the initial ones.
    q: UnitQuaternion<f64>,
}

/// Sums of the covariance's step.
#[derive(Clone, Debug, PartialEq)]
struct Sums {
    dt_s: f64,
    rotation_s: Matrix3<f64>,
    force_w_m_s: Vector3<f64>,
    rotation_rate: [Matrix3<f64>; 3],
    rate_squared_s: f64,
    acceleration_squared_s: f64,
}

impl Sums {
    const ZERO: Self = Self {
        dt_s: 0.0,
        rotation_s: Matrix3::new(0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0),
        force_w_m_s: Vector3::new(0.0, 0.0, 0.0),
        rotation_rate: [Matrix3::new(0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0); 3],
        rate_squared_s: 0.0,
        acceleration_squared_s: 0.0,
    };
}

/// Attitude, velocity, position, sensor biases, field and iron of a freely moving sensor.
///
/// A pure state machine without allocation: `Clone` is the save and the restore.
#[derive(Clone, Debug, PartialEq)]
pub struct FreeMotionFilter {
    pub(super) parameters: FreeMotionParameters,
    pub(super) start: Option<Start>,
    previous_ns: Option<i64>,
    pub(super) q_world_body: UnitQuaternion<f64>,
    pub(super) velocity_w_m_s: Vector3<f64>,
    pub(super) position_w_m: Vector3<f64>,
    pub(super) gyro_bias_rad_s: Vector3<f64>,
    /// Error of scale and axes \[1\].
    gyro_matrix: Matrix3<f64>,
    force_bias_m_s2: Vector3<f64>,
    /// World axes, relative to `field_length` \[1\].
    pub(super) field_relative: Vector3<f64>,
    /// Sensor axes, relative to the same \[1\].
    pub(super) iron_relative: Vector3<f64>,
    /// Of the first field, in the unit of the magnetometer.
    pub(super) field_length: Option<f64>,
    pub(super) covariance: Covariance,
    sums: Sums,
    pub(super) rest: RestDetector,
    pub(super) still_field: StillField,
    pub(super) clipping: Clipping,
    /// What samples at the end of the gyro's range add to the covariance of the attitude error, world axes \[rad^2\].
    clipped_w: Matrix3<f64>,
    /// Whether the accelerometer is wrong: specific force is then gravity at the attitude of the gyro.
    pub(super) without_force: bool,
    since_motion_s: f64,
    since_field_s: f64,
    /// Mean square deviation of the field's north and up components, relative to its length.
    pub(super) inhomogeneity: f64,
    /// Mean east component of the field at the estimated heading, in motion.
    pub(super) east_mean: f64,
    /// Angle about the vertical by which the field has turned the heading \[rad\].
    pub(super) turned_rad: f64,
    /// North and up component of the field at the start.
    pub(super) begin: Option<Vector2<f64>>,
    /// The start's field until the sensor is back at rest there.
    pub(super) anchor: Anchor,
    /// Mean of the horizontal and vertical component in motion.
    pub(super) recent: Vector2<f64>,
    /// Mean square distance from it.
    pub(super) recent_spread: f64,
    /// How long the field has been unlike the start's, in motion \[s\].
    pub(super) doubt_s: f64,
    /// Mean difference of the field's horizontal and up component from those of the start.
    pub(super) off_start: Vector2<f64>,
    /// Standard deviation of the east component at the latest sample; `None`: not yet.
    pub(super) east_sigma: Option<f64>,
    /// Variance of the heading of a start whose field may have been disturbed \[rad^2\]. Told, and not used: the field's part in the
    /// filter is its own matter.
    pub(super) start_doubt_rad2: f64,
    /// What was known before a gap, and how long that was \[s\].
    gap: Option<(UnitQuaternion<f64>, f64)>,
    /// Gaps so far, and the longest \[s\].
    pub(super) gaps: (u32, f64),
}

impl FreeMotionFilter {
    /// A filter that finds its first attitude from its first samples.
    #[must_use]
    pub fn new(parameters: FreeMotionParameters) -> Self {
        Self {
            parameters,
            start: Some(Start::default()),
            previous_ns: None,
            q_world_body: UnitQuaternion::identity(),
            velocity_w_m_s: Vector3::zeros(),
            position_w_m: Vector3::zeros(),
            gyro_bias_rad_s: Vector3::zeros(),
            gyro_matrix: Matrix3::zeros(),
            force_bias_m_s2: Vector3::zeros(),
            field_relative: Vector3::y(),
            iron_relative: Vector3::zeros(),
            field_length: None,
            covariance: Covariance::zeros(),
            sums: Sums::ZERO,
            rest: RestDetector::default(),
            still_field: StillField::default(),
            clipping: Clipping::default(),
            clipped_w: Matrix3::zeros(),
            without_force: false,
            since_motion_s: 0.0,
            since_field_s: f64::INFINITY,
            inhomogeneity: parameters.inhomogeneity_start.powi(2),
            east_mean: 0.0,
            turned_rad: 0.0,
            begin: None,
            anchor: Anchor::default(),
            recent: Vector2::zeros(),
            recent_spread: 0.0,
            doubt_s: 0.0,
            off_start: Vector2::zeros(),
            east_sigma: None,
            start_doubt_rad2: 0.0,
            gap: None,
            gaps: (0, 0.0),
        }
    }

    /// One sample of gyro [rad/s] and accelerometer (specific force, [m/s^2]), sensor axes, stamps in order.
    pub fn on_imu(&mut self, stamp_ns: i64, gyro_rad_s: &Vector3<f64>, force_m_s2: &Vector3<f64>) {
        let (gyro, force) = (gyro_rad_s, force_m_s2);
        if !(gyro.sum() + force.sum()).is_finite() {
            return;
        }
        let Some(before_ns) = self.previous_ns else {
            self.previous_ns = Some(stamp_ns);
            return;
        };
        let dt_s = stamp_ns.saturating_sub(before_ns) as f64 * 1e-9;
        if dt_s <= 0.0 {
            return;
        }
        self.previous_ns = Some(stamp_ns);
        if dt_s > GAP_S {
            if self.start.is_none() {
                self.gap = Some((self.q_world_body, dt_s));
            }
            self.gaps = (self.gaps.0 + 1, self.gaps.1.max(dt_s));
            self.start = Some(Start::default());
            return;
        }
        // Digital inertial units filter and decimate: a sample is the mean over the interval that ends with it.
        let measured = *gyro;
        let turn = measured + self.gyro_matrix * measured - self.gyro_bias_rad_s;
        if let Some(start) = &mut self.start {
            start.q *= quaternion_exp(&(turn * dt_s));
            start.force += start.q * force;
            start.forces += 1;
            start.elapsed_s += dt_s;
            self.rest.add(&self.parameters, dt_s, gyro, force);
            self.finish_start();
            return;
        }
        if let Some(variance) = self.clipping.add(dt_s, gyro) {
            let rotation = *self.q_world_body.to_rotation_matrix().matrix();
            self.clipped_w += rotation * Matrix3::from_diagonal(&variance) * rotation.transpose();
        }
        let alone = self.q_world_body.inverse_transform_vector(&Vector3::z()) * self.parameters.gravity_m_s2;
        let used = if self.without_force { &alone } else { force };
        self.strapdown(dt_s, &turn, &measured, used);
        let rate = self.rest.add(&self.parameters, dt_s, gyro, force);
        self.still_field.on_gyro(self.rest.seems_still(), dt_s, gyro, &self.gyro_bias_rad_s);
        self.since_motion_s += dt_s;
        self.since_field_s += dt_s;
        if self.sums.dt_s >= COVARIANCE_STEP_S {
            self.carry_covariance();
        }
        if let Some(rate) = rate {
            self.carry_covariance();
            self.use_rest(&rate);
        }
        if self.since_motion_s >= self.parameters.motion_time_s && !self.without_force {
            self.carry_covariance();
            self.use_motion();
            self.since_motion_s = 0.0;
        }
    }

    /// One sample of the magnetometer, sensor axes, any unit; taken at the time of the latest inertial sample.
    /// Gives the rotation of sensor axes into axes that only the gyro's error turns about the vertical, if the sample
    /// was used.
    pub fn on_magnetometer(&mut self, field: &Vector3<f64>) -> Option<Matrix3<f64>> {
        if !field.sum().is_finite() || field.norm() <= 0.0 {
            return None;
        }
        if let Some(start) = &mut self.start {
            start.field += start.q * field;
            start.fields += 1;
            return None;
        }
        if self.since_field_s < self.parameters.magnetometer_interval_s {
            return None;
        }
        self.since_field_s = 0.0;
        self.carry_covariance();
        let rotation = rotation_about_z(-self.turned_rad) * self.q_world_body;
        self.use_field(field);
        self.start.is_none().then(|| *rotation.to_rotation_matrix().matrix())
    }

    /// The estimate; `None` before the first attitude.
    #[must_use]
    pub fn estimate(&self) -> Option<FreeMotionEstimate> {
        self.start.is_none().then(|| FreeMotionEstimate {
            q_world_body: self.q_world_body,
            gyro_bias_rad_s: self.gyro_bias_rad_s,
            accelerometer_bias_m_s2: self.force_bias_m_s2,
            iron_magnetometer_unit: self.iron_relative * self.field_length.unwrap_or(1.0),
            sigma_rad: self.attitude_w_rad2().diagonal().map(|v| v.max(0.0).sqrt()),
            resting: self.rest.resting(&self.parameters),
        })
    }

    /// Covariance of the attitude error (body axes \[rad\]) and the gyro's bias error [rad/s].
    #[must_use]
    pub fn covariance(&self) -> Matrix6<f64> {
        let rotation = *self.q_world_body.to_rotation_matrix().matrix();
        let block = |row: usize, column: usize| -> Matrix3<f64> {
            self.covariance.fixed_view::<3, 3>(row, column).into()
        };
        let attitude = rotation.tr_mul(&(self.attitude_w_rad2() * rotation));
        let cross = rotation.tr_mul(&block(ATTITUDE, GYRO_BIAS));
        let mut covariance = Matrix6::zeros();
        covariance.fixed_view_mut::<3, 3>(0, 0).copy_from(&attitude);
        covariance.fixed_view_mut::<3, 3>(0, 3).copy_from(&cross);
        covariance.fixed_view_mut::<3, 3>(3, 0).copy_from(&cross.transpose());
        covariance.fixed_view_mut::<3, 3>(3, 3).copy_from(&block(GYRO_BIAS, GYRO_BIAS));
        (covariance + covariance.transpose()) * 0.5
    }

    /// Covariance of the attitude error, world axes, and what a start may be off \[rad^2\].
    fn attitude_w_rad2(&self) -> Matrix3<f64> {
        let mut attitude: Matrix3<f64> = self.covariance.fixed_view::<3, 3>(ATTITUDE, ATTITUDE).into();
        attitude[(2, 2)] += self.start_doubt_rad2;
        attitude
    }

    fn finish_start(&mut self) {
        let p = &self.parameters;
        let Some(start) = self.start.as_ref().filter(|s| s.elapsed_s >= p.start_window_s) else { return };
        let Ok(up) = unit(start.force) else { return };
        let field = start.field / f64::from(start.fields.max(1));
        let north = unit(field).ok();
        // Sensor axes of the start in the world; a field along the vertical has no north.
        let begin = north
            .and_then(|north| {
                attitude_from_two_vectors(&up, &Vector3::z_axis(), &north, &Vector3::y_axis()).ok()
            })
            .unwrap_or_else(|| attitude_from_vertical(up, 0.0));
        self.q_world_body = begin * start.q;
        let mut variance = Row::zeros();
        let mut set = |at: usize, sigma: f64| variance.fixed_rows_mut::<3>(at).fill(sigma * sigma);
        set(ATTITUDE, 0.05);
        set(VELOCITY, p.velocity_sigma_m_s);
        set(POSITION, p.position_sigma_m);
        set(GYRO_BIAS, p.gyro_bias_sigma_rad_s);
        set(FORCE_BIAS, p.accelerometer_bias_sigma_m_s2);
        set(IRON, p.iron_sigma);
        for row in 0..3 {
            set(GYRO_MATRIX + 3 * row, p.gyro_matrix_sigma);
        }
        variance[ATTITUDE + 2] = 1.0;
        let gap = self.gap.take();
        if let Some((before, gap_s)) = gap {
            // What the sensors' errors were before, they are.
            for state in (GYRO_BIAS..FORCE_BIAS + 3).chain(IRON..IRON + 3) {
                variance[state] = variance[state].min(self.covariance[(state, state)] * (1.0 + gap_s));
            }
            for state in GYRO_MATRIX..GYRO_MATRIX + 9 {
                variance[state] = self.covariance[(state, state)];
            }
            if start.fields == 0 {
                // Nothing says how it turned meanwhile: the heading is that of before, the vertical that of now.
                let up_before = before * up.into_inner();
                let upright = UnitQuaternion::rotation_between(&up_before, &Vector3::z()).unwrap_or_default();
                self.q_world_body = upright * before * start.q;
                let hidden_rad = (GAP_RATE_RAD_S * gap_s).min(UNKNOWN_RAD);
                let known = self.covariance[(ATTITUDE + 2, ATTITUDE + 2)];
                variance[ATTITUDE + 2] = (known + hidden_rad * hidden_rad).min(UNKNOWN_RAD * UNKNOWN_RAD);
            }
        }
        if start.fields > 0 {
            let length = *self.field_length.get_or_insert(field.norm());
            let world = begin * field / length;
            self.field_relative = Vector3::new(0.0, world.x.hypot(world.y), world.z);
            let begin = Vector2::new(self.field_relative.y, self.field_relative.z);
            self.begin = Some(begin);
            self.anchor = Anchor::at(begin);
            self.recent = begin;
            let north = self.field_relative.y;
            // These components include the field of the iron.
            variance[FIELD] = (p.start_east_sigma * north).powi(2);
            variance[FIELD + 1] = (p.iron_sigma + p.field_east_sigma * north).powi(2);
            variance[FIELD + 2] = variance[FIELD + 1];
        }
        let scale = self.parameters.gyro_scale_sigma.powi(2);
        self.covariance = Covariance::from_diagonal(&variance);
        if gap.is_none() {
            // Of the three scales together; the matrix is row by row.
            for one in (GYRO_MATRIX..GYRO_MATRIX + 9).step_by(4) {
                for other in (GYRO_MATRIX..GYRO_MATRIX + 9).step_by(4) {
                    self.covariance[(one, other)] += scale;
                }
            }
        }
        (self.velocity_w_m_s, self.position_w_m) = (Vector3::zeros(), Vector3::zeros());
        self.sums = Sums::ZERO;
        self.turned_rad = 0.0;
        self.off_start = Vector2::zeros();
        self.east_sigma = None;
        self.start_doubt_rad2 = 0.0;
        self.start = None;
    }

    /// Moves attitude, velocity and position.
    fn strapdown(&mut self, dt_s: f64, omega: &Vector3<f64>, gyro: &Vector3<f64>, force: &Vector3<f64>) {
        let half = self.q_world_body * quaternion_exp(&(omega * (0.5 * dt_s)));
        let middle = *half.to_rotation_matrix().matrix();
        self.q_world_body *= quaternion_exp(&(omega * dt_s));
        self.q_world_body.renormalize_fast();
        let force_w = middle * (force - self.force_bias_m_s2);
        let acceleration = force_w - Vector3::z() * self.parameters.gravity_m_s2;
        self.position_w_m += (self.velocity_w_m_s + acceleration * (0.5 * dt_s)) * dt_s;
        self.velocity_w_m_s += acceleration * dt_s;
        let sums = &mut self.sums;
        sums.dt_s += dt_s;
        sums.rotation_s += middle * dt_s;
        for (sum, rate) in sums.rotation_rate.iter_mut().zip(gyro.iter()) {
            *sum += middle * (rate * dt_s);
        }
        sums.force_w_m_s += force_w * dt_s;
        sums.rate_squared_s += omega.norm_squared() * dt_s;
        sums.acceleration_squared_s += acceleration.norm_squared() * dt_s;
    }

    fn carry_covariance(&mut self) {
        let sums = std::mem::replace(&mut self.sums, Sums::ZERO);
        if sums.dt_s <= 0.0 {
            return;
        }
        let p = &self.parameters;
        let dt_s = sums.dt_s;
        let mut noise = Row::zeros();
        let mut set = |at: usize, variance: f64| noise.fixed_rows_mut::<3>(at).fill(variance);
        set(
            ATTITUDE,
            p.gyro_noise_rad_s_sqrt_hz.powi(2) * dt_s
                + p.gyro_scale_noise_sqrt_s.powi(2) * sums.rate_squared_s,
        );
        set(
            VELOCITY,
            p.accelerometer_noise_m_s2_sqrt_hz.powi(2) * dt_s
                + p.accelerometer_scale_noise_sqrt_s.powi(2) * sums.acceleration_squared_s,
        );
        set(GYRO_BIAS, p.gyro_bias_walk_rad_s_sqrt_s.powi(2) * dt_s);
        set(FORCE_BIAS, p.accelerometer_bias_walk_m_s2_sqrt_s.powi(2) * dt_s);
        let mut east_left = 1.0;
        // The field changes with position, so it is constant at rest.
        if !self.rest.resting(p) {
            set(POSITION, p.position_walk_m_sqrt_s.powi(2) * dt_s);
            set(FIELD, p.field_walk_per_sqrt_s.powi(2) * dt_s);
            east_left = (-dt_s / p.field_time_s).exp();
            let east = self.east_variance();
            noise[FIELD] = east * (1.0 - east_left * east_left);
        }
        self.field_relative.x *= east_left;
        let interval = Interval {
            dt_s,
            rotation_s: sums.rotation_s,
            rotation_rate: sums.rotation_rate,
            force_w_m_s: sums.force_w_m_s,
            east_left,
            noise,
        };
        propagate(&mut self.covariance, &interval);
        let clipped_w = std::mem::replace(&mut self.clipped_w, Matrix3::zeros());
        let mut attitude = self.covariance.fixed_view_mut::<3, 3>(ATTITUDE, ATTITUDE);
        attitude += clipped_w;
    }

    /// Rate, velocity at rest.
    fn use_rest(&mut self, rate: &Vector3<f64>) {
        if self.turns_slowly(rate) {
            return;
        }
        let variance = self.parameters.rest_rate_sigma_rad_s.powi(2);
        for axis in 0..3 {
            self.use_state(GYRO_BIAS + axis, rate[axis] - self.gyro_bias_rad_s[axis], variance);
        }
        if self.without_force {
            return;
        }
        for axis in 0..3 {
            self.use_motion_state(VELOCITY + axis, -self.velocity_w_m_s[axis], 0.02 * 0.02);
        }
    }

    /// The sensor stays where it is, roughly.
    fn use_motion(&mut self) {
        let (velocity, position) = (self.parameters.velocity_sigma_m_s, self.parameters.position_sigma_m);
        for axis in 0..3 {
            self.use_motion_state(VELOCITY + axis, -self.velocity_w_m_s[axis], velocity * velocity);
            self.use_motion_state(POSITION + axis, -self.position_w_m[axis], position * position);
        }
    }

    /// A measurement of one state's error.
    fn use_state(&mut self, index: usize, innovation: f64, variance: f64) {
        let mut h = Row::zeros();
        h[index] = 1.0;
        let (correction, _) = update(&mut self.covariance, &h, innovation, variance, None);
        self.apply(&correction);
    }

    /// A measurement of a velocity or a place. These are as probable in every direction, and tell no heading; what the linear update
    /// makes of them would turn it all the same, the more the less the field says.
    fn use_motion_state(&mut self, index: usize, innovation: f64, variance: f64) {
        let mut h = Row::zeros();
        h[index] = 1.0;
        let mut mask = Row::repeat(1.0);
        mask[ATTITUDE + 2] = 0.0;
        let (correction, _) = update(&mut self.covariance, &h, innovation, variance, Some(&mask));
        self.apply(&correction);
    }

    pub(super) fn apply(&mut self, correction: &Row) {
        let part = |at: usize| Vector3::from(correction.fixed_rows::<3>(at));
        self.q_world_body = quaternion_exp(&part(ATTITUDE)) * self.q_world_body;
        self.q_world_body.renormalize_fast();
        self.velocity_w_m_s += part(VELOCITY);
        self.position_w_m += part(POSITION);
        self.gyro_bias_rad_s += part(GYRO_BIAS);
        self.force_bias_m_s2 += part(FORCE_BIAS);
        self.field_relative += part(FIELD);
        self.iron_relative += part(IRON);
        // A field without a horizontal part tells no heading; its direction is north by definition.
        self.field_relative.y = self.field_relative.y.max(1e-3);
        let matrix = correction.fixed_rows::<9>(GYRO_MATRIX);
        self.gyro_matrix += Matrix3::from_row_iterator(matrix.iter().copied());
    }
}

pub(super) fn rotation_about_z(angle_rad: f64) -> UnitQuaternion<f64> {
    UnitQuaternion::from_axis_angle(&Vector3::z_axis(), angle_rad)
}
