//! Runs as a fit leaves them: the smoothed motion, and innovations on an even grid.

use nalgebra::{UnitQuaternion, Vector3};
use whorl_dynamics::PlatformModel;
use whorl_math::noise::{sample_clock, typical_step_s};
use whorl_prediction::{Followed, Innovation, Noise, Prepared, Start, Told, predict, smoothed};
use whorl_recording::{Channel, Recording};

use crate::parameter_space::available::sample_s;
use crate::selection::hypothesis::{Evaluated, Runs};
use crate::signals::is_clamped;
use crate::signals::remains::{Remains, Sums};
use crate::{DiagnosisError, threads};

/// Time between states of a smoothed motion \[s\], and so many samples.
const MOTION_S: f64 = 0.03;
/// Samples of a run on an even grid, at most: stamps may hold anything.
const MOST_SAMPLES: f64 = 4e6;
/// Normalised innovations are clipped here: an edge of a jet is no vibration, and one wild sample no slow torque.
const MOST_DEVIATIONS: f64 = 6.0;

/// Motion of a run.
#[derive(Debug, Clone, Default)]
pub(crate) struct Motion {
    pub time_s: Vec<f64>,
    pub q: Vec<UnitQuaternion<f64>>,
    pub omega: Vec<Vector3<f64>>,
    pub wheel: Vec<Vec<f64>>,
    /// Angle that each wheel has turned since the first instant \[rad\].
    pub wheel_angle: Vec<Vec<f64>>,
}

impl Motion {
    fn of(case: &Prepared<'_>, noise: &Noise, start: &Start) -> Self {
        let every_s = MOTION_S.max(sample_s(case.recording()));
        let mut motion = Self::default();
        for state in smoothed(case, noise, start, every_s).unwrap_or_default() {
            let speeds = state.wheel_speed_rad_s;
            let mut angles = motion.wheel_angle.last().cloned().unwrap_or_else(|| vec![0.0; speeds.len()]);
            if let (Some(before_s), Some(before)) = (motion.time_s.last(), motion.wheel.last()) {
                let half_s = 0.5 * (state.time_s - before_s);
                let turned = before.iter().zip(&speeds).map(|(a, b)| (a + b) * half_s);
                angles.iter_mut().zip(turned).for_each(|(angle, by)| *angle += by);
            }
            motion.time_s.push(state.time_s);
            motion.q.push(state.q_world_body);
            motion.omega.push(state.omega_wb_b_rad_s);
            motion.wheel.push(speeds);
            motion.wheel_angle.push(angles);
        }
        motion
    }

    /// The instant at or before a time, and how far the time is on the way to the next, 0 to 1.
    fn place(&self, time_s: f64) -> (usize, f64) {
        let k = self.time_s.partition_point(|t| *t <= time_s).saturating_sub(1);
        let share = match (self.time_s.get(k), self.time_s.get(k + 1)) {
            (Some(from_s), Some(to_s)) if to_s > from_s => (time_s - from_s) / (to_s - from_s),
            _ => 0.0,
        };
        (k, share.clamp(0.0, 1.0))
    }

    /// Attitude at the instant before, not turned on.
    pub fn attitude(&self, time_s: f64) -> UnitQuaternion<f64> {
        self.q.get(self.place(time_s).0).copied().unwrap_or_default()
    }

    /// Rate of the body, straight between instants [rad/s].
    pub fn rate(&self, time_s: f64) -> Vector3<f64> {
        let (k, share) = self.place(time_s);
        let before = self.omega.get(k).copied().unwrap_or_default();
        self.omega.get(k + 1).map_or(before, |after| before.lerp(after, share))
    }

    /// Speed of a wheel and the angle that it has turned; zero before the first instant.
    pub fn wheel_at(&self, wheel: usize, time_s: f64) -> (f64, f64) {
        let k = self.place(time_s).0;
        let of = |all: &[Vec<f64>], k: usize| all.get(k).and_then(|of| of.get(wheel)).copied();
        let (Some(from_s), Some(speed), Some(angle)) =
            (self.time_s.get(k), of(&self.wheel, k), of(&self.wheel_angle, k))
        else {
            return (0.0, 0.0);
        };
        let since_s = time_s - from_s;
        let slope = match (self.time_s.get(k + 1), of(&self.wheel, k + 1)) {
            (Some(next_s), Some(next)) if next_s > from_s => (next - speed) / (next_s - from_s),
            _ => 0.0,
        };
        (speed + slope * since_s, angle + speed * since_s + 0.5 * slope * since_s * since_s)
    }
}

/// Sums of squares of applied torques.
#[derive(Debug, Clone, Default)]
pub(crate) struct Applied {
    body: f64,
    wheels: Vec<f64>,
    count: f64,
}

impl Applied {
    /// Of the torque on the body, and on each wheel, by what the rates change over an interval.
    pub fn of(observed: &[Observed<'_>], model: &PlatformModel, interval_s: f64) -> Self {
        let mut sums = Self { wheels: vec![0.0; model.wheels().len()], ..Self::default() };
        let inertia = model.mass_properties.inertia_b_kg_m2();
        for motion in observed.iter().map(|run| &run.motion) {
            let step_s = typical_step_s(&motion.time_s).max(1e-9);
            let apart = ((interval_s / step_s).round() as usize).max(1);
            for k in (apart..motion.time_s.len()).step_by(apart) {
                let before = k - apart;
                let time_s = (motion.time_s[k] - motion.time_s[before]).max(1e-9);
                let change = motion.omega[k] - motion.omega[before];
                sums.body += (inertia * change / time_s).norm_squared();
                let speeds = motion.wheel[k].iter().zip(&motion.wheel[before]);
                for ((slot, wheel), (after, before)) in sums.wheels.iter_mut().zip(model.wheels()).zip(speeds)
                {
                    *slot += (wheel.spin_inertia_kg_m2 * (after - before) / time_s).powi(2);
                }
                sums.count += 1.0;
            }
        }
        sums
    }

    /// On the body, root mean square [N m].
    pub fn body_n_m(&self) -> f64 {
        (self.body / self.count.max(1.0)).sqrt().max(f64::MIN_POSITIVE)
    }

    /// On a wheel.
    pub fn wheel_n_m(&self, wheel: usize) -> f64 {
        let square = self.wheels.get(wheel).copied().unwrap_or(0.0);
        (square / self.count.max(1.0)).sqrt().max(f64::MIN_POSITIVE)
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
    pub wheels: Vec<Vec<f64>>,
    /// Predicted deviation of a sample of each inertial channel, the mean.
    pub stddev: [f64; 6],
}

/// A run as a fit leaves it.
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
    /// Innovations with the random torque of the run, or without it.
    pub fn grid(&self, quiet: bool) -> &Grid {
        self.quiet.as_ref().filter(|_| quiet).unwrap_or(&self.loud)
    }
}

/// The training runs as a fit leaves them.
pub(crate) fn observed<'a>(runs: &Runs<'a>, set: &Evaluated) -> Result<Vec<Observed<'a>>, DiagnosisError> {
    let of_run = |case: &Prepared<'a>, followed: &Followed| {
        let (loud, of_loud) = Grid::of(case, &followed.noise, &followed.fitted.start);
        let quiet = (followed.noise.disturbance.is_some())
            .then(|| Grid::of(case, &followed.undisturbed_noise(), &followed.undisturbed.start));
        Observed {
            recording: case.recording(),
            clamped: is_clamped(case.recording(), case.model()),
            motion: Motion::of(case, &followed.noise, &followed.fitted.start),
            loud,
            remains: quiet.as_ref().map_or(of_loud, |(_, remains)| *remains),
            quiet: quiet.map(|(grid, _)| grid),
        }
    };
    each_reading(runs, set, runs.training, &set.fitted.followed, of_run)
}

/// What a model without a random torque leaves of the held-out runs.
pub(crate) fn held_out_remains(runs: &Runs<'_>, set: &Evaluated) -> Result<Remains, DiagnosisError> {
    let of_run = |case: &Prepared<'_>, followed: &Followed| {
        Grid::of(case, &followed.undisturbed_noise(), &followed.undisturbed.start).1
    };
    let all = each_reading(runs, set, runs.held_out, &set.held_out, of_run)?;
    Ok(all.into_iter().fold(Remains::default(), Remains::and))
}

/// What is found of each run with the model of a set, where every reading is seen by itself.
fn each_reading<'a, T: Send>(
    runs: &Runs<'a>,
    set: &Evaluated,
    recordings: &'a [Recording],
    followed: &[Followed],
    find: impl Fn(&Prepared<'a>, &Followed) -> T + Sync,
) -> Result<Vec<T>, DiagnosisError> {
    let model = set.model(runs.reference)?;
    let settings = Runs { each_reading: true, ..*runs }.prediction();
    let pairs: Vec<(&'a Recording, &Followed)> = recordings.iter().zip(followed).collect();
    let of_run = |(recording, followed): &(&'a Recording, &Followed)| {
        Ok(find(&Prepared::new(recording, &model, settings)?, followed))
    };
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
        let stamps = [&recording.gyro_b_rad_s.time_s, &recording.wheel_speed_rad_s.time_s];
        let (start_s, step_s) =
            stamps.into_iter().find_map(|stamps| sample_clock(stamps)).unwrap_or((0.0, 1.0));
        let last_s = stamps.into_iter().find_map(|stamps| stamps.last()).copied().unwrap_or(start_s);
        let count = ((last_s - start_s) / step_s).round().clamp(0.0, MOST_SAMPLES) as usize + 1;
        let mut grid = Self {
            start_s,
            step_s,
            inertial: std::array::from_fn(|_| vec![0.0; count]),
            there: [vec![false; count], vec![false; count]],
            wheels: vec![vec![0.0; count]; case.model().wheels().len()],
            stddev: [0.0; 6],
        };
        let mut counts = [0.0; 6];
        let mut sums = Sums::default();
        predict(case, noise, start, &[], &mut |told| {
            let Told::Innovation(innovation) = told else { return };
            let value = innovation.normalised().clamp(-MOST_DEVIATIONS, MOST_DEVIATIONS);
            sums.add(innovation, value);
            grid.put(recording, innovation, value, &mut counts);
        });
        for (stddev, count) in grid.stddev.iter_mut().zip(counts) {
            *stddev /= f64::max(count, 1.0);
        }
        (grid, sums.end())
    }

    fn put(&mut self, recording: &Recording, innovation: &Innovation, value: f64, counts: &mut [f64; 6]) {
        let (channel, axis) = (innovation.component.channel, innovation.component.index());
        let (stamps, sensor) = match channel {
            Channel::Gyro => (&recording.gyro_b_rad_s.time_s, 0),
            Channel::Accelerometer => (&recording.specific_force_b_m_s2.time_s, 1),
            Channel::WheelSpeed => (&recording.wheel_speed_rad_s.time_s, 2),
            _ => return,
        };
        let Some(stamp_s) = stamps.get(innovation.sample) else { return };
        let at = ((stamp_s - self.start_s) / self.step_s).round();
        if at < 0.0 || at >= self.len() as f64 {
            return;
        }
        let at = at as usize;
        if sensor == 2 {
            if let Some(wheel) = self.wheels.get_mut(axis) {
                wheel[at] = value;
            }
        } else if axis < 3 {
            let channel = 3 * sensor + axis;
            self.inertial[channel][at] = value;
            self.there[sensor][at] = true;
            self.stddev[channel] += innovation.stddev;
            counts[channel] += 1.0;
        }
    }
}
