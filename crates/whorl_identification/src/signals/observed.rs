//! Runs as a fit leaves them: the smoothed motion, and innovations on an even grid.

use std::collections::BTreeMap;

use nalgebra::{UnitQuaternion, Vector3};
use whorl_dynamics::PlatformModel;
use whorl_math::noise::{sample_clock, typical_step_s};
use whorl_math::threads;
use whorl_prediction::{Followed, Noise, Prepared, SmoothedState, Start, Told, predict, smoothed};
use whorl_recording::{Channel, Component, Recording};

use crate::DiagnosisError;
use crate::parameter_space::available::sample_s;
use crate::selection::hypothesis::{Evaluated, Runs};

/// Time between states of a smoothed motion \[s\], and so many samples.
const MOTION_S: f64 = 0.03;
/// Stretches over which innovations are summed \[s\].
const WINDOWS_S: [f64; 2] = [1.0, 8.0];
/// Samples of a run on an even grid, at most: stamps may hold anything.
const MOST_SAMPLES: f64 = 4e6;
/// Normalised innovations are clipped here: an edge of a jet is no vibration, and one wild sample no slow torque.
const MOST_DEVIATIONS: f64 = 6.0;

#[derive(Debug, Clone, Default)]
pub(crate) struct Motion {
    pub states: Vec<SmoothedState>,
    /// Angle that each wheel has turned since the first of them \[rad\].
    wheel_angle: Vec<Vec<f64>>,
}

impl Motion {
    fn of(case: &Prepared<'_>, noise: &Noise, start: &Start) -> Self {
        let every_s = MOTION_S.max(sample_s(case.recording()));
        let states = smoothed(case, noise, start, every_s).unwrap_or_default();
        let mut angles = vec![0.0; case.model().wheels().len()];
        let mut wheel_angle = vec![angles.clone()];
        for pair in states.windows(2) {
            let half_s = 0.5 * (pair[1].time_s - pair[0].time_s);
            let speeds = pair[0].wheel_speed_rad_s.iter().zip(&pair[1].wheel_speed_rad_s);
            angles.iter_mut().zip(speeds).for_each(|(angle, (from, to))| *angle += (from + to) * half_s);
            wheel_angle.push(angles.clone());
        }
        Self { states, wheel_angle }
    }

    pub fn times_s(&self) -> Vec<f64> {
        self.states.iter().map(|state| state.time_s).collect()
    }

    /// The number of the instant at or before a time, it and the next one; of the last it twice.
    fn around(&self, time_s: f64) -> Option<(usize, &SmoothedState, &SmoothedState)> {
        let k = self.states.partition_point(|state| state.time_s <= time_s).saturating_sub(1);
        let from = self.states.get(k)?;
        Some((k, from, self.states.get(k + 1).unwrap_or(from)))
    }

    /// Attitude at the instant before, not turned on.
    pub fn attitude(&self, time_s: f64) -> UnitQuaternion<f64> {
        self.around(time_s).map_or_else(UnitQuaternion::identity, |(_, at, _)| at.q_world_body)
    }

    /// Rate of the body, straight between instants [rad/s].
    pub fn rate(&self, time_s: f64) -> Vector3<f64> {
        let Some((_, from, to)) = self.around(time_s) else { return Vector3::zeros() };
        let share = (time_s - from.time_s) / (to.time_s - from.time_s).max(1e-9);
        from.omega_wb_b_rad_s.lerp(&to.omega_wb_b_rad_s, share.clamp(0.0, 1.0))
    }

    /// Speed of a wheel and the angle that it has turned; zero where there is no motion.
    pub fn wheel_at(&self, wheel: usize, time_s: f64) -> (f64, f64) {
        let speed = |state: &SmoothedState| state.wheel_speed_rad_s.get(wheel).copied();
        let found = self.around(time_s).and_then(|(k, from, to)| {
            let (angle, speed, next) = (self.wheel_angle.get(k)?.get(wheel)?, speed(from)?, speed(to)?);
            let since_s = time_s - from.time_s;
            let more = (next - speed) / (to.time_s - from.time_s).max(1e-9) * since_s;
            Some((speed + more, angle + (speed + 0.5 * more) * since_s))
        });
        found.unwrap_or_default()
    }
}

/// Applied torques, root mean squares over all runs [N m]: on the body, then on each wheel.
#[derive(Debug, Clone)]
pub(crate) struct Applied(Vec<f64>);

impl Applied {
    /// By what the rates change over an interval.
    pub fn of(observed: &[Observed<'_>], model: &PlatformModel, interval_s: f64) -> Self {
        let (inertia, wheels) = (model.mass_properties.inertia_b_kg_m2(), model.wheels());
        let (mut squares, mut count) = (vec![0.0; 1 + wheels.len()], 0.0);
        for motion in observed.iter().map(|run| &run.motion) {
            let step_s = typical_step_s(&motion.times_s()).max(1e-9);
            let apart = ((interval_s / step_s).round() as usize).max(1);
            let ends: Vec<&SmoothedState> = motion.states.iter().step_by(apart).collect();
            for pair in ends.windows(2) {
                let per_s = (pair[1].time_s - pair[0].time_s).max(1e-9).recip();
                let change = pair[1].omega_wb_b_rad_s - pair[0].omega_wb_b_rad_s;
                let speeds = pair[1].wheel_speed_rad_s.iter().zip(&pair[0].wheel_speed_rad_s);
                let on_wheels = wheels.iter().zip(speeds).map(|(of, (b, a))| of.spin_inertia_kg_m2 * (b - a));
                let torques = std::iter::once((inertia * change).norm()).chain(on_wheels);
                squares.iter_mut().zip(torques).for_each(|(sum, torque)| *sum += (torque * per_s).powi(2));
                count += 1.0;
            }
        }
        let mean = |sum: f64| (sum / f64::max(count, 1.0)).sqrt().max(f64::MIN_POSITIVE);
        Self(squares.into_iter().map(mean).collect())
    }

    pub fn body_n_m(&self) -> f64 {
        self.0[0]
    }

    pub fn wheel_n_m(&self, wheel: usize) -> f64 {
        self.0.get(1 + wheel).copied().unwrap_or(f64::MIN_POSITIVE)
    }
}

/// Normalised innovations of a run on an even grid; lost samples are zero.
#[derive(Debug, Clone, Default)]
pub(crate) struct Grid {
    pub start_s: f64,
    pub step_s: f64,
    /// Gyro's axes, then the accelerometer's.
    pub inertial: [Vec<f64>; 6],
    /// Which samples of the gyro and of the accelerometer there are.
    pub there: [Vec<bool>; 2],
    /// Predicted deviation of a sample of each inertial channel, the mean.
    pub stddev: [f64; 6],
}

pub(crate) struct Observed<'a> {
    pub recording: &'a Recording,
    pub clamped: bool,
    pub motion: Motion,
    /// Innovations with the random torque that the run shows,
    pub loud: Grid,
    /// and those without one, if there is one.
    pub quiet: Option<Grid>,
    /// What the model without a random torque leaves.
    pub remains: Remains,
}

impl Observed<'_> {
    pub fn grid(&self, quiet: bool) -> &Grid {
        self.quiet.as_ref().filter(|_| quiet).unwrap_or(&self.loud)
    }
}

/// What a model without a random torque leaves of the held-out runs.
pub(crate) fn held_out_remains(runs: &Runs<'_>, set: &Evaluated) -> Result<Remains, DiagnosisError> {
    let model = set.model(runs.reference)?;
    let settings = Runs { each_reading: true, ..*runs }.prediction();
    let of_run = |(recording, followed): &(&Recording, &Followed)| -> Result<Remains, DiagnosisError> {
        let case = Prepared::new(recording, &model, settings)?;
        Ok(Grid::of(&case, &followed.undisturbed_noise(), &followed.undisturbed.start).1)
    };
    let pairs: Vec<(&Recording, &Followed)> = runs.held_out.iter().zip(&set.held_out).collect();
    threads::map(runs.threads, &pairs, of_run).into_iter().sum()
}

pub(crate) fn remains_of(observed: &[Observed<'_>]) -> Remains {
    observed.iter().map(|run| run.remains).sum()
}

pub(crate) fn observed<'a>(runs: &Runs<'a>, set: &Evaluated) -> Result<Vec<Observed<'a>>, DiagnosisError> {
    let model = set.model(runs.reference)?;
    let settings = Runs { each_reading: true, ..*runs }.prediction();
    let of_run = |(recording, followed): &(&'a Recording, &Followed)| {
        let case = Prepared::new(recording, &model, settings)?;
        let (loud, of_loud) = Grid::of(&case, &followed.noise, &followed.fitted.start);
        let quiet = (followed.noise.disturbance.is_some())
            .then(|| Grid::of(&case, &followed.undisturbed_noise(), &followed.undisturbed.start));
        Ok(Observed {
            recording,
            clamped: recording.is_clamped(&model),
            motion: Motion::of(&case, &followed.noise, &followed.fitted.start),
            loud,
            remains: quiet.as_ref().map_or(of_loud, |(_, remains)| *remains),
            quiet: quiet.map(|(grid, _)| grid),
        })
    };
    let pairs: Vec<(&'a Recording, &Followed)> = runs.training.iter().zip(&set.fitted.followed).collect();
    threads::map(runs.threads, &pairs, of_run).into_iter().collect()
}

impl Grid {
    pub fn time(&self, index: usize) -> f64 {
        self.start_s + index as f64 * self.step_s
    }

    pub fn len(&self) -> usize {
        self.inertial[0].len()
    }

    fn of(case: &Prepared<'_>, noise: &Noise, start: &Start) -> (Self, Remains) {
        let recording = case.recording();
        let gyro_s = &recording.gyro_b_rad_s.time_s;
        let stamps = [gyro_s, &recording.wheel_speed_rad_s.time_s];
        let (start_s, step_s) = stamps.into_iter().find_map(|of| sample_clock(of)).unwrap_or((0.0, 1.0));
        let last_s = stamps.into_iter().find_map(|stamps| stamps.last()).copied().unwrap_or(start_s);
        let count = ((last_s - start_s) / step_s).round().clamp(0.0, MOST_SAMPLES) as usize + 1;
        let mut grid = Self {
            start_s,
            step_s,
            inertial: std::array::from_fn(|_| vec![0.0; count]),
            there: [vec![false; count], vec![false; count]],
            stddev: [0.0; 6],
        };
        let mut sums = Sums::default();
        predict(case, noise, start, &[], &mut |told| {
            let Told::Innovation(innovation) = told else { return };
            let value = innovation.normalised().clamp(-MOST_DEVIATIONS, MOST_DEVIATIONS);
            sums.add(innovation.component, innovation.time_s, value);
            let (stamps, sensor) = match innovation.component.channel {
                Channel::Gyro => (gyro_s, 0),
                Channel::Accelerometer => (&recording.specific_force_b_m_s2.time_s, 1),
                _ => return,
            };
            let (axis, stamp_s) = (innovation.component.index(), stamps.get(innovation.sample));
            let at = stamp_s.map_or(-1.0, |stamp_s| ((stamp_s - start_s) / step_s).round());
            if axis < 3 && (0.0..count as f64).contains(&at) {
                let (at, channel) = (at as usize, 3 * sensor + axis);
                grid.inertial[channel][at] = value;
                grid.there[sensor][at] = true;
                grid.stddev[channel] += innovation.stddev;
            }
        });
        for (channel, stddev) in grid.stddev.iter_mut().enumerate() {
            *stddev /= grid.there[channel / 3].iter().filter(|there| **there).count().max(1) as f64;
        }
        (grid, sums.remains)
    }
}

/// What a model without a random torque leaves: squares of sums of normalised innovations over stretches, over what noise gives. If a slow
/// torque is missing, they grow with the stretch; of noise alone each has the variance of its number of terms.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub(crate) struct Remains {
    square: f64,
    count: f64,
}

impl std::iter::Sum for Remains {
    fn sum<I: Iterator<Item = Self>>(all: I) -> Self {
        all.fold(Self::default(), |a, b| Self { square: a.square + b.square, count: a.count + b.count })
    }
}

impl Remains {
    /// Root mean square, 1 of noise alone; 1 where nothing was read.
    pub fn times_the_noise(&self) -> f64 {
        if self.count < 1.0 { 1.0 } else { (self.square / self.count).sqrt() }
    }

    /// Deviations by which it exceeds noise alone.
    pub fn significance(&self) -> f64 {
        if self.count < 1.0 { 0.0 } else { (self.square - self.count) / (2.0 * self.count).sqrt() }
    }
}

#[derive(Default)]
struct Sums {
    remains: Remains,
    /// Of each component and window the number of the stretch, its sum and its terms.
    open: BTreeMap<Component, [(i64, f64, f64); 2]>,
}

impl Sums {
    fn add(&mut self, component: Component, time_s: f64, value: f64) {
        let open = self.open.entry(component).or_default();
        for ((stretch, sum, terms), window_s) in open.iter_mut().zip(WINDOWS_S) {
            let now = (time_s / window_s).floor() as i64;
            if now != *stretch || *terms < 1.0 {
                (*stretch, *sum, *terms) = (now, 0.0, 0.0);
                self.remains.count += 1.0;
            }
            // The square of the sum so far gives way to that with this term.
            self.remains.square -= *sum * *sum / terms.max(1.0);
            (*sum, *terms) = (*sum + value, *terms + 1.0);
            self.remains.square += *sum * *sum / *terms;
        }
    }
}
