//! The magnetometer: how the field corrects the heading, and how far it may be trusted.

use super::FreeMotionFilter;
use super::anchor::Anchor;
use super::covariance::{ATTITUDE, FIELD, IRON, Row, update};
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
const ODD_START_S: f64 = 60.0;
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
        self.notice_another_place();
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

    /// Where the north and up components have changed, the east component has changed as well: its variance grows by
    /// their change.
    fn notice_another_place(&mut self) {
        let p = self.parameters;
        let here = Vector2::new(self.field_relative.y, self.field_relative.z);
        let (place, since_s) = self.place.get_or_insert((here, 0.0));
        *since_s += p.magnetometer_interval_s;
        let wanted = p.disagreement_gain * 0.5 * (here - *place).norm_squared();
        if wanted > self.place_variance {
            self.covariance[(FIELD, FIELD)] += wanted - self.place_variance;
            self.place_variance = wanted;
        }
        if *since_s > p.field_time_s {
            self.place = None;
            self.place_variance = 0.0;
        }
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
        if self.doubt_s < ODD_START_S {
            return;
        }
        self.doubt_s = 0.0;
        let here = self.recent;
        self.begin = Some(here);
        self.place = None;
        self.place_variance = 0.0;
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

    /// Variance of the field's east component in motion, relative to its length squared.
    pub(super) fn east_variance(&self) -> f64 {
        let p = &self.parameters;
        let moved = self.begin.map_or(0.0, |begin| {
            0.5 * (Vector2::new(self.field_relative.y, self.field_relative.z) - begin).norm_squared()
        });
        (p.field_east_sigma * self.field_relative.y).powi(2)
            + p.disagreement_gain * self.inhomogeneity.max(moved)
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
        self.place = None;
        self.place_variance = 0.0;
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
