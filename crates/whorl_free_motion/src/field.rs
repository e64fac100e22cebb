//! The magnetometer: how the field corrects the heading, and how far it may be trusted.

use super::FreeMotionFilter;
use super::anchor::Anchor;
use super::covariance::{ATTITUDE, FIELD, IRON, Row, STATES, UNKNOWN_RAD, update};
use super::filter::{Start, rotation_about_z};
use nalgebra::{Vector2, Vector3};

/// The mean east component over this time in motion \[s\] ...
const LOST_HEADING_S: f64 = 5.0;
/// ... beyond this many standard deviations of its inhomogeneity means that the heading is wrong.
const LOST_HEADING_SIGMAS: f64 = 4.0;

/// A start's field differs from that of the places since by more than this, relative to its length: three times the 7 % by
/// which trials of BROAD differ whose start is sound \[1\] ...
const ODD_START: f64 = 0.2;
/// ... for this long in motion \[s\]: a magnet that is passed by does not last so long.
const ODD_START_S: f64 = 20.0;
/// The heading is said to be uncertain from here on \[s\].
const ODD_SAID_S: f64 = 5.0;
/// ... and by more than this times the root mean square by which those places differ among themselves \[1\].
const STEADY_RATIO: f64 = 3.0;
/// The places since are averaged over this in motion \[s\].
const RECENT_S: f64 = 10.0;
/// How well the azimuth of a field repeats where horizontal and vertical component do \[rad\]: 0.3 degrees root mean
/// square between the rests before and after the movement of seven trials of BROAD.
const RETURN_SIGMA_RAD: f64 = 5e-3;

impl FreeMotionFilter {
    /// The field: north and up components first, which say how far the east component may be trusted.
    pub(super) fn use_field(&mut self, measured: &Vector3<f64>) {
        let Some(length) = self.field_length else {
            // The first magnetometer sample came after the start.
            self.start = Some(Start::default());
            return;
        };
        let p = self.parameters;
        self.still_field.on_field(&(measured / length));
        if self.rest.resting(&p) && self.still_field.is_disturbed() {
            // A field that changes around a resting sensor says nothing of its heading.
            self.doubt_resting_start(&(measured / length));
            return;
        }
        let rotation = *self.q_world_body.to_rotation_matrix().matrix();
        let world = rotation * (measured / length - self.iron_relative);
        let (north, up) = (self.field_relative.y, self.field_relative.z);
        // The heading error turns the horizontal part as a whole, however large it is.
        let horizontal = world.x.hypot(world.y);
        let deviation =
            0.5 * ((horizontal - self.field_relative.x.hypot(north)).powi(2) + (world.z - up).powi(2));
        let time_s = if deviation > self.inhomogeneity { p.field_rise_s } else { p.field_fall_s };
        self.inhomogeneity +=
            (deviation - self.inhomogeneity) * (p.magnetometer_interval_s / time_s).min(1.0);
        if let Some(begin) = self.begin {
            let off = Vector2::new(horizontal, world.z) - begin;
            self.off_start += (off - self.off_start) * (p.magnetometer_interval_s / p.field_place_s).min(1.0);
        }
        self.follow_east_variance();
        let places = 1.0 + 2.0 * p.field_short_time_s / p.magnetometer_interval_s;
        let variance = p.magnetometer_sigma.powi(2) + self.inhomogeneity.max(deviation) * places;
        let azimuth = world.x.atan2(world.y);
        let innovations = [
            azimuth * north - self.field_relative.x,
            horizontal - self.field_relative.x.hypot(north),
            world.z - up,
        ];
        if self.heading_is_lost(azimuth * north) {
            self.forget_heading();
        }
        // The field corrects neither inclination nor motion nor gyro bias.
        let mut mask = Row::zeros();
        mask[ATTITUDE + 2] = 1.0;
        mask.fixed_rows_mut::<6>(FIELD).fill(1.0);
        for (axis, innovation) in innovations.into_iter().enumerate() {
            let mut h = Row::zeros();
            // The estimate sees R (m - iron) turned by -delta about the vertical: east gains north delta.
            if axis == 0 {
                h[ATTITUDE + 2] = north;
            }
            h[FIELD + axis] = 1.0;
            h.fixed_rows_mut::<3>(IRON).copy_from(&rotation.row(axis).transpose());
            let (correction, _) = update(&mut self.covariance, &h, innovation, variance, Some(&mask));
            self.turned_rad += correction[ATTITUDE + 2];
            self.apply(&correction);
        }
        let resting = self.rest.resting(&p);
        if !resting {
            self.doubt_start(&Vector2::new(horizontal, world.z));
        }
        if let Some(azimuth_rad) = self.anchor.add(&world, resting) {
            self.return_to_start(azimuth_rad);
        }
    }

    /// The sensor rests where it began: the field's azimuth there is north again, as well as it was. Left unused where the
    /// heading is known clearly better than that and does not contradict it.
    fn return_to_start(&mut self, azimuth_rad: f64) {
        let north = self.field_relative.y;
        let of_start = (self.parameters.start_east_sigma * north).powi(2);
        let variance = self.parameters.start_east_sigma.powi(2) + RETURN_SIGMA_RAD.powi(2);
        let known = self.covariance[(ATTITUDE + 2, ATTITUDE + 2)];
        if azimuth_rad.powi(2) < LOST_HEADING_SIGMAS.powi(2) * variance && known < 0.5 * variance {
            return;
        }
        // A positive rotation about the vertical turns what is seen at a positive azimuth back to north.
        self.turn_heading(azimuth_rad);
        for state in [ATTITUDE + 2, FIELD] {
            self.covariance.fill_row(state, 0.0);
            self.covariance.fill_column(state, 0.0);
        }
        // What the start's field was off from north, heading and field share.
        self.covariance[(ATTITUDE + 2, ATTITUDE + 2)] = variance;
        self.covariance[(FIELD, FIELD)] = of_start + RETURN_SIGMA_RAD.powi(2);
        self.covariance[(ATTITUDE + 2, FIELD)] = -of_start / north;
        self.covariance[(FIELD, ATTITUDE + 2)] = -of_start / north;
        self.field_relative.x = 0.0;
        self.east_mean = 0.0;
    }

    /// Where the components that do not depend on the heading have changed, the east component has changed as well, and where they are
    /// again as at the start, so is it: it grows by something unknown, and shrinks in proportion.
    fn follow_east_variance(&mut self) {
        let sigma = self.east_variance().sqrt();
        let Some(before) = self.east_sigma.replace(sigma).filter(|before| *before > 0.0) else { return };
        if sigma >= before {
            self.covariance[(FIELD, FIELD)] += sigma * sigma - before * before;
            return;
        }
        let left = sigma / before;
        self.field_relative.x *= left;
        for state in 0..STATES {
            self.covariance[(FIELD, state)] *= left;
            self.covariance[(state, FIELD)] *= left;
        }
    }

    /// The field has changed since the start, and the sensor has not moved yet: one of the two is disturbed. If it was the start, the
    /// heading is off by as much as the components say.
    fn doubt_resting_start(&mut self, measured: &Vector3<f64>) {
        let Some(begin) = self.begin.filter(|_| !self.anchor.has_moved()) else { return };
        let world = self.q_world_body * measured;
        let here = Vector2::new(world.x.hypot(world.y), world.z);
        let apart = (here - begin).norm();
        if apart > ODD_START {
            self.doubt_heading(apart / here.x.min(begin.x).max(1e-3));
        }
    }

    fn doubt_heading(&mut self, angle_rad: f64) {
        self.start_doubt_rad2 = self.start_doubt_rad2.max(angle_rad.min(UNKNOWN_RAD).powi(2));
    }

    /// A start whose field is unlike that of all places since was itself disturbed: then it says nothing of north.
    fn doubt_start(&mut self, here: &Vector2<f64>) {
        let interval_s = self.parameters.magnetometer_interval_s;
        let Some(begin) = self.begin else { return };
        self.recent += (here - self.recent) * (interval_s / RECENT_S);
        let apart = (self.recent - begin).norm();
        let spread = (here - self.recent).norm_squared();
        self.recent_spread += (spread - self.recent_spread) * (interval_s / RECENT_S);
        let steady = apart.powi(2) > STEADY_RATIO.powi(2) * self.recent_spread;
        let odd = apart > ODD_START && steady;
        self.doubt_s = (self.doubt_s + if odd { interval_s } else { -interval_s }).max(0.0);
        if self.doubt_s >= ODD_SAID_S {
            self.doubt_heading(apart / self.recent.x.max(1e-3));
        } else if self.anchor.has_left() && self.off_start.norm() < 0.5 * ODD_START {
            // Elsewhere the field is that of the start, too: it was none of a magnet's.
            self.start_doubt_rad2 = 0.0;
        }
        if self.doubt_s < ODD_START_S {
            return;
        }
        self.doubt_s = 0.0;
        self.start_doubt_rad2 = 0.0;
        let here = self.recent;
        self.begin = Some(here);
        self.off_start = Vector2::zeros();
        self.east_sigma = None;
        (self.field_relative.y, self.field_relative.z) = (here.x.max(1e-3), here.y);
        for state in [FIELD + 1, FIELD + 2] {
            self.covariance.fill_row(state, 0.0);
            self.covariance.fill_column(state, 0.0);
            self.covariance[(state, state)] = (self.parameters.field_east_sigma * here.x).powi(2);
        }
        self.anchor = Anchor::default();
        self.inhomogeneity = self.parameters.inhomogeneity_start.powi(2);
        // The start's east component was off by as much as the others: the heading is that of the places since.
        self.forget_heading();
    }

    /// Variance of the field's east component in motion, relative to its length squared: that of any room, and as much as the components
    /// that do not depend on the heading are off those of the start. (Their changes within a second or so are noise of the samples.)
    pub(super) fn east_variance(&self) -> f64 {
        let p = &self.parameters;
        (p.field_east_sigma * self.field_relative.y).powi(2)
            + p.disagreement_gain * 0.5 * self.off_start.norm_squared()
    }

    /// Sets a heading and a field found by other means: `azimuth_rad` is that of north in axes that only the gyro's error
    /// turns, `sigma_rad` its standard deviation. The field is given at the start, and here.
    pub(super) fn restart_field(
        &mut self,
        azimuth_rad: f64,
        sigma_rad: f64,
        at_start: &Vector3<f64>,
        here: &Vector3<f64>,
    ) {
        self.turn_heading(whorl_math::wrap_angle_rad(azimuth_rad - self.turned_rad));
        self.forget_heading();
        let length = at_start.norm().max(1e-12);
        self.field_length = Some(length);
        let begin = Vector2::new(at_start.xy().norm(), at_start.z) / length;
        self.begin = Some(begin);
        self.anchor = Anchor::at(begin);
        self.recent = begin;
        self.off_start = Vector2::zeros();
        self.east_sigma = None;
        self.field_relative = Vector3::new(0.0, here.xy().norm(), here.z) / length;
        self.inhomogeneity = self.parameters.inhomogeneity_start.powi(2);
        let east = self.east_variance();
        for (state, variance) in
            [(ATTITUDE + 2, sigma_rad.powi(2) + 1e-4), (FIELD, east), (FIELD + 1, 2e-3), (FIELD + 2, 2e-3)]
        {
            self.covariance.fill_row(state, 0.0);
            self.covariance.fill_column(state, 0.0);
            self.covariance[(state, state)] = variance;
        }
    }

    /// Turns the heading and leaves its uncertainty unchanged.
    pub(super) fn turn_heading(&mut self, angle_rad: f64) {
        self.q_world_body = rotation_about_z(angle_rad) * self.q_world_body;
        self.velocity_w_m_s = rotation_about_z(angle_rad) * self.velocity_w_m_s;
        self.position_w_m = rotation_about_z(angle_rad) * self.position_w_m;
        self.turned_rad += angle_rad;
    }

    /// Whether the field has pointed elsewhere for longer and by more than its inhomogeneity explains: then the heading
    /// is wrong, and the covariance does not show it.
    fn heading_is_lost(&mut self, east: f64) -> bool {
        let p = &self.parameters;
        if !self.rest.resting(p) {
            self.east_mean += (east - self.east_mean) * (p.magnetometer_interval_s / LOST_HEADING_S);
        }
        let explained = self.east_variance();
        self.east_mean.powi(2) > LOST_HEADING_SIGMAS.powi(2) * explained
    }

    /// Restarts the heading and the field's east component.
    pub(super) fn forget_heading(&mut self) {
        self.east_mean = 0.0;
        for state in [ATTITUDE + 2, FIELD] {
            self.covariance.fill_row(state, 0.0);
            self.covariance.fill_column(state, 0.0);
        }
        self.covariance[(ATTITUDE + 2, ATTITUDE + 2)] = 1.0;
        let north = self.field_relative.y;
        self.field_relative.x = 0.0;
        self.covariance[(FIELD, FIELD)] = (self.parameters.field_east_sigma * north).powi(2);
    }
}
