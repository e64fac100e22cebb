//! The field that a sensor sees while it does not seem to move.
//!
//! A resting sensor sees a constant field: one that changes is disturbed, and says nothing of the heading. And where the gyro shows
//! a steady rate, the field tells a turn from a bias: it turns back by the angle of the turn, or stays.

use nalgebra::Vector3;
use whorl_math::quaternion_exp;

/// Samples of the first mean, a second of them.
const FIRST: u32 = 20;
/// The mean does not follow the field for longer than this: ten seconds of samples.
const LONGEST: u32 = 200;
/// Samples of the present mean.
const PRESENT: f64 = 20.0;
/// A mean that is off by more than this is disturbed, relative to the field's length \[1\].
const CHANGED: f64 = 0.02;
/// So is a sample that is off by so many standard deviations.
const SIGMAS: f64 = 6.0;
/// The field would have moved by more than this, relative to its length, so that it can tell a turn from a bias \[1\].
const DECISIVE: f64 = 0.06;

/// What the field says about a steady rate.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Verdict {
    /// The sensor rests.
    Rests,
    /// The sensor turns as the gyro says.
    Turns,
    /// Not enough, or a field that does neither.
    Unknown,
}

/// See the module.
#[derive(Clone, Debug, Default, PartialEq)]
pub(super) struct StillField {
    /// Mean since the beginning, and mean square distance from it; sensor axes, relative to the field's length.
    mean: Vector3<f64>,
    square: f64,
    samples: u32,
    /// Mean of the latest samples.
    present: Vector3<f64>,
    disturbed: bool,
    /// Turn by the gyro, with the bias of the beginning, since the middle of the first second \[rad\].
    turn_rad: Vector3<f64>,
    /// The bias of the beginning [rad/s].
    bias_rad_s: Option<Vector3<f64>>,
}

impl StillField {
    /// A sample of the gyro; `still`: the sensor does not seem to move.
    pub fn on_gyro(&mut self, still: bool, dt_s: f64, gyro_rad_s: &Vector3<f64>, bias_rad_s: &Vector3<f64>) {
        if !still {
            *self = Self::default();
            return;
        }
        let bias = *self.bias_rad_s.get_or_insert(*bias_rad_s);
        if self.samples >= FIRST / 2 {
            self.turn_rad += (gyro_rad_s - bias) * dt_s;
        }
    }

    /// A sample of the magnetometer, relative to the field's length.
    pub fn on_field(&mut self, field: &Vector3<f64>) {
        if self.bias_rad_s.is_none() {
            return;
        }
        if self.samples == 0 {
            self.present = *field;
        }
        self.present += (field - self.present) / PRESENT;
        let apart = field - self.mean;
        if self.samples >= FIRST {
            let noise = (self.square / f64::from(self.samples)).sqrt();
            self.disturbed = apart.norm() > (SIGMAS * noise).max(CHANGED)
                || (self.present - self.mean).norm() > CHANGED.max(2.0 * noise);
        }
        if !self.disturbed && self.samples < LONGEST {
            self.samples += 1;
            self.mean += apart / f64::from(self.samples);
            if self.samples > 1 {
                self.square += apart.dot(&(field - self.mean));
            }
        }
    }

    /// Whether the field is not that of the beginning of this rest.
    pub fn is_disturbed(&self) -> bool {
        self.disturbed
    }

    /// Whether the rate of this rest is a bias.
    pub fn verdict(&self) -> Verdict {
        if self.samples < FIRST {
            return Verdict::Unknown;
        }
        let turned = quaternion_exp(&self.turn_rad).inverse_transform_vector(&self.mean);
        let chord = (turned - self.mean).norm() / self.mean.norm().max(1e-9);
        if chord < DECISIVE {
            return Verdict::Unknown;
        }
        let off = |from: &Vector3<f64>| (self.present - from).norm() / self.mean.norm().max(1e-9);
        // Means lag behind by half a second or so: a turn is told by less than half of it.
        match (off(&self.mean) < 0.3 * chord, off(&turned) < 0.5 * chord) {
            (true, false) => Verdict::Rests,
            (false, true) => Verdict::Turns,
            _ => Verdict::Unknown,
        }
    }

    /// The bias that was believed when this rest began [rad/s].
    pub fn bias_before(&self) -> Option<Vector3<f64>> {
        self.bias_rad_s
    }
}
