//! Frames of the replay, sampled while a run is read.

use nalgebra::{UnitQuaternion, Vector3};

/// Shortest time between two frames \[s\].
const STEP_S: f64 = 0.05;
/// Largest number of frames; a longer run is shown with steps twice as long.
const FRAMES: usize = 6000;

/// Times of the frames: multiples of a step that doubles as a run gets longer.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Grid {
    step_s: f64,
    frames: usize,
}

impl Default for Grid {
    fn default() -> Self {
        Self { step_s: STEP_S, frames: 0 }
    }
}

impl Grid {
    /// Time between two frames \[s\].
    pub fn step_s(self) -> f64 {
        self.step_s
    }

    /// Frames so far.
    pub fn frames(self) -> usize {
        self.frames
    }

    /// The frames before a time that are not there yet; see [`Self::coarsen`].
    pub fn until(&mut self, time_s: f64) -> impl Iterator<Item = f64> + use<> {
        let (begin, step_s) = (self.frames, self.step_s);
        while (self.frames as f64) * step_s < time_s {
            self.frames += 1;
        }
        (begin..self.frames).map(move |i| i as f64 * step_s)
    }

    /// Whether the step has been doubled: there would be too many frames before this time. To be asked again until it has not, and
    /// before the frames are made: a clock that jumps by years asks for billions.
    pub fn coarsen(&mut self, time_s: f64) -> bool {
        let many = time_s > FRAMES as f64 * self.step_s;
        if many {
            self.step_s *= 2.0;
            self.frames = self.frames.div_ceil(2);
        }
        many
    }
}

/// What a platform looked like at one time.
#[derive(Debug, Clone, Default, PartialEq)]
pub(crate) struct Frame {
    /// Attitude, true if that is known.
    pub q_world_body: Option<UnitQuaternion<f64>>,
    /// Reference.
    pub q_world_reference: Option<UnitQuaternion<f64>>,
    /// Momentum of the wheels, body axes \[N m s\], and gas used \[kg\].
    pub momentum_and_gas: Option<(Vector3<f64>, f64)>,
    /// Open time of each jet since the start \[s\].
    pub on_time_s: Option<Vec<f64>>,
}

/// Keeps every other frame, the first included.
pub(crate) fn every_other(frames: &mut Vec<Frame>) {
    let mut keep = false;
    frames.retain(|_| {
        keep = !keep;
        keep
    });
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_frames_of_a_day_are_few_and_evenly_spaced() {
        let mut grid = Grid::default();
        let mut times: Vec<f64> = Vec::new();
        for k in 1..=8640 {
            let time_s = f64::from(k) * 10.0;
            while grid.coarsen(time_s) {
                times = times.into_iter().step_by(2).collect();
            }
            times.extend(grid.until(time_s));
        }
        assert!(times.len() <= FRAMES && times.len() >= FRAMES / 2 && times.len() == grid.frames());
        for (k, t) in times.iter().enumerate() {
            assert!((t - k as f64 * grid.step_s()).abs() < 1e-9, "{k}: {t}");
        }
        assert!(times.last().is_some_and(|t| *t > 86_400.0 - grid.step_s() - 1e-9));
    }

    #[test]
    fn a_clock_that_jumps_by_centuries_makes_no_more_frames() {
        let mut grid = Grid::default();
        let begin: Vec<f64> = grid.until(10.0).collect();
        let end_s = 9.2e9;
        let mut kept = begin.len();
        while grid.coarsen(end_s) {
            kept = kept.div_ceil(2);
        }
        let after = grid.until(end_s).count();
        assert!(kept + after <= FRAMES && kept + after == grid.frames(), "{kept} and {after}");
    }
}
