//! Back at rest in the field of the start?

use nalgebra::{Vector2, Vector3};

/// The mean of a rest is looked at after each so many samples: every second.
const SAMPLES: u32 = 20;
/// Samples in motion after which the sensor has left its place: five seconds of them.
const LEFT: u32 = 100;
/// The horizontal and the vertical component repeat to this, relative to the field's length, where a sensor rests again
/// at the place of its start: three times 0.4 % root mean square, between the rests before and after the movement of
/// seven trials of BROAD \[1\].
const REPEATS: f64 = 0.012;

/// The field of the start, and the mean of the present rest.
///
/// A field's horizontal and vertical component do not depend on the heading. Where a resting sensor sees both as they were
/// at the start, it most likely lies where it began (by chance, in a room whose field varies by 6 %, both agree in one
/// place of fifty), and the third component, the azimuth, is that of the start too.
#[derive(Clone, Debug, PartialEq, Default)]
pub(super) struct Anchor {
    /// Horizontal and vertical component.
    begin: Option<Vector2<f64>>,
    /// Samples in motion since the start.
    moving: u32,
    sum: Vector3<f64>,
    samples: u32,
}

impl Anchor {
    pub(super) fn at(begin: Vector2<f64>) -> Self {
        Self { begin: Some(begin), ..Self::default() }
    }

    /// Whether the sensor has moved for a second since the start.
    pub(super) fn has_moved(&self) -> bool {
        self.moving > SAMPLES
    }

    /// Whether it has left its place.
    pub(super) fn has_left(&self) -> bool {
        self.moving > LEFT
    }

    /// Takes a sample, world axes at the present heading. Gives the azimuth from north towards east of a field that is the
    /// start's again \[rad\].
    pub(super) fn add(&mut self, field_w: &Vector3<f64>, resting: bool) -> Option<f64> {
        if !resting {
            self.moving += 1;
            (self.sum, self.samples) = (Vector3::zeros(), 0);
            return None;
        }
        self.sum += field_w;
        self.samples += 1;
        if !self.samples.is_multiple_of(SAMPLES) {
            return None;
        }
        let mean = self.sum / f64::from(self.samples);
        let begin = self.begin.filter(|_| self.has_left())?;
        let here = Vector2::new(mean.x.hypot(mean.y), mean.z);
        ((here - begin).amax() < REPEATS).then(|| mean.x.atan2(mean.y))
    }
}
