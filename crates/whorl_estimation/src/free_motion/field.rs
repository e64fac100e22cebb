//! The magnetometer: how the field corrects the heading, and how far it may be trusted.

use super::FreeMotionFilter;
use super::covariance::{ATTITUDE, FIELD, IRON, Row, update};
use super::filter::Start;
use nalgebra::Vector3;

/// The mean east component over this time in motion \[s\] ...
const LOST_HEADING_S: f64 = 5.0;
/// ... beyond this many standard deviations of its inhomogeneity means that the heading is wrong.
const LOST_HEADING_SIGMAS: f64 = 4.0;

impl FreeMotionFilter {
    /// The field: north and up components first, which say how far the east component may be trusted.
    pub(super) fn use_field(&mut self, measured: &Vector3<f64>) {
        let Some(length) = self.field_length else {
            // The first magnetometer sample came after the start.
            self.start = Some(Start::default());
            return;
        };
        let p = self.parameters;
        let rotation = *self.q.to_rotation_matrix().matrix();
        let world = rotation * (measured / length - self.iron);
        let (north, up) = (self.field.y, self.field.z);
        // The heading error turns the horizontal part as a whole, however large it is.
        let horizontal = world.x.hypot(world.y);
        let deviation = 0.5 * ((horizontal - self.field.x.hypot(north)).powi(2) + (world.z - up).powi(2));
        let time_s = if deviation > self.inhomogeneity { p.field_rise_s } else { p.field_fall_s };
        self.inhomogeneity +=
            (deviation - self.inhomogeneity) * (p.magnetometer_interval_s / time_s).min(1.0);
        let places = 1.0 + 2.0 * p.field_short_time_s / p.magnetometer_interval_s;
        let variance = p.magnetometer_sigma.powi(2) + self.inhomogeneity.max(deviation) * places;
        let azimuth = world.x.atan2(world.y);
        let innovations =
            [azimuth * north - self.field.x, horizontal - self.field.x.hypot(north), world.z - up];
        if self.heading_is_lost(azimuth * north) {
            self.forget_heading();
        }
        // Neither inclination nor motion nor gyro bias learn from the field.
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
            let (correction, s) = update(&mut self.covariance, &h, innovation, variance, Some(&mask));
            self.log_likelihood -= 0.5 * (innovation * innovation / s + s.ln());
            self.apply(&correction);
        }
    }

    /// Whether the field has pointed elsewhere for longer and by more than its inhomogeneity explains: then the heading
    /// is wrong, and the covariance does not know.
    fn heading_is_lost(&mut self, east: f64) -> bool {
        let p = &self.parameters;
        if !self.rest.resting(p) {
            self.east_mean += (east - self.east_mean) * (p.magnetometer_interval_s / LOST_HEADING_S);
        }
        let explained =
            (p.field_east_sigma * self.field.y).powi(2) + p.disagreement_gain * self.inhomogeneity;
        self.east_mean.powi(2) > LOST_HEADING_SIGMAS.powi(2) * explained
    }

    /// The heading, and the field's east component, start anew.
    pub(super) fn forget_heading(&mut self) {
        self.east_mean = 0.0;
        for state in [ATTITUDE + 2, FIELD] {
            self.covariance.fill_row(state, 0.0);
            self.covariance.fill_column(state, 0.0);
        }
        self.covariance[(ATTITUDE + 2, ATTITUDE + 2)] = 1.0;
        let north = self.field.y;
        self.field.x = 0.0;
        self.covariance[(FIELD, FIELD)] = (self.parameters.field_east_sigma * north).powi(2);
    }
}
