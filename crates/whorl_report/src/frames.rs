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

    /// The frames before a time that are not there yet.
    pub fn until(&mut self, time_s: f64) -> impl Iterator<Item = f64> + use<> {
        let (begin, step_s) = (self.frames, self.step_s);
        while (self.frames as f64) * step_s < time_s {
            self.frames += 1;
        }
        (begin..self.frames).map(move |i| i as f64 * step_s)
    }

    /// Whether the step has been doubled: there were too many frames.
    pub fn coarsen(&mut self) -> bool {
        let many = self.frames > FRAMES;
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
            times.extend(grid.until(f64::from(k) * 10.0));
            if grid.coarsen() {
                times = times.into_iter().step_by(2).collect();
            }
        }
        assert!(times.len() <= FRAMES && times.len() >= FRAMES / 2 && times.len() == grid.frames());
        for (k, t) in times.iter().enumerate() {
            assert!((t - k as f64 * grid.step_s()).abs() < 1e-9, "{k}: {t}");
        }
        assert!(times.last().is_some_and(|t| *t > 86_400.0 - grid.step_s() - 1e-9));
    }
}
