//! Runs as a fit leaves them: the smoothed motion, and innovations on an even grid.

use nalgebra::{UnitQuaternion, Vector3};
use whorl_dynamics::PlatformModel;
use whorl_math::noise::typical_step_s;
use whorl_prediction::{Followed, Innovation, Noise, Prepared, Start, Told, predict, smoothed};
use whorl_recording::{Channel, Recording};

use crate::parameter_space::available::sample_s;
use crate::selection::hypothesis::{Evaluated, Runs};
use crate::signals::clamped::is_clamped;
use crate::signals::remains::Remains;
use crate::{DiagnosisError, threads};

/// Time between states of a smoothed motion \[s\], and so many samples.
const MOTION_S: f64 = 0.03;
/// Samples of a run on an even grid, at most: stamps may hold anything.
const MOST_SAMPLES: f64 = 4e6;
/// Normalised innovations are clipped here: an edge of a jet is no vibration.
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
            let angle = match (motion.time_s.last(), motion.wheel.last(), motion.wheel_angle.last()) {
                (Some(time_s), Some(speeds), Some(angles)) => {
                    let half_s = 0.5 * (state.time_s - time_s);
                    let turned = speeds.iter().zip(&state.wheel_speed_rad_s).map(|(a, b)| (a + b) * half_s);
                    angles.iter().zip(turned).map(|(angle, by)| angle + by).collect()
                }
                _ => vec![0.0; state.wheel_speed_rad_s.len()],
            };
            motion.time_s.push(state.time_s);
            motion.q.push(state.q_world_body);
            motion.omega.push(state.omega_wb_b_rad_s);
            motion.wheel.push(state.wheel_speed_rad_s);
            motion.wheel_angle.push(angle);
        }
        motion
    }

    /// The instant at or before a time.
    pub fn index(&self, time_s: f64) -> usize {
        self.time_s.partition_point(|t| *t <= time_s).saturating_sub(1)
    }

    /// Attitude there, not turned on.
    pub fn attitude(&self, time_s: f64) -> UnitQuaternion<f64> {
        self.q.get(self.index(time_s)).copied().unwrap_or_default()
    }

    /// Speed of a wheel and the angle that it has turned; zero before the first instant.
    pub fn wheel_at(&self, wheel: usize, time_s: f64) -> (f64, f64) {
        let k = self.index(time_s);
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

    /// Root mean square of the torque on the body, and on each wheel, by what the rates change over an interval [N m].
    pub fn applied(&self, model: &PlatformModel, interval_s: f64, sums: &mut Applied) {
        let inertia = model.mass_properties.inertia_b_kg_m2();
        let step_s = typical_step_s(&self.time_s).max(1e-9);
        let apart = ((interval_s / step_s).round() as usize).max(1);
        for k in (apart..self.time_s.len()).step_by(apart) {
            let time_s = (self.time_s[k] - self.time_s[k - apart]).max(1e-9);
            sums.body += (inertia * (self.omega[k] - self.omega[k - apart]) / time_s).norm_squared();
            let speeds = self.wheel[k].iter().zip(&self.wheel[k - apart]);
            for ((slot, wheel), (after, before)) in sums.wheels.iter_mut().zip(model.wheels()).zip(speeds) {
                *slot += (wheel.spin_inertia_kg_m2 * (after - before) / time_s).powi(2);
            }
            sums.count += 1.0;
        }
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
    pub fn of(observed: &[Observed<'_>], model: &PlatformModel, interval_s: f64) -> Self {
        let mut sums = Self { wheels: vec![0.0; model.wheels().len()], ..Self::default() };
        for run in observed {
            run.motion.applied(model, interval_s, &mut sums);
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

impl Grid {
    pub fn time(&self, index: usize) -> f64 {
        self.start_s + index as f64 * self.step_s
    }

    pub fn len(&self) -> usize {
        self.inertial[0].len()
    }
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
    let model = set
        .refit(runs.reference)
        .model_at(&set.fitted.at)
        .ok_or(whorl_prediction::PredictionError::NoModel)?;
    let numbers: Vec<usize> = (0..runs.training.len()).collect();
    let of_run = |run: &usize| -> Result<Observed<'a>, DiagnosisError> {
        let (recording, followed) = (&runs.training[*run], &set.fitted.followed[*run]);
        let case = Prepared::new(recording, &model, each_reading(runs))?;
        let clamped = is_clamped(recording, &model);
        let is_disturbed = followed.noise.disturbance.is_some();
        let (loud, of_loud) = grid(&case, &followed.noise, &followed.fitted.start);
        let quiet =
            is_disturbed.then(|| grid(&case, &followed.undisturbed_noise(), &followed.undisturbed.start));
        let remains = quiet.as_ref().map_or(of_loud, |(_, remains)| *remains);
        Ok(Observed {
            recording,
            clamped,
            motion: Motion::of(&case, &followed.noise, &followed.fitted.start),
            loud,
            quiet: quiet.map(|(grid, _)| grid),
            remains,
        })
    };
    threads::map(runs.threads, &numbers, of_run).into_iter().collect()
}

/// What a model without a random torque leaves of runs.
pub(crate) fn remains(
    runs: &Runs<'_>,
    recordings: &[Recording],
    followed: &[Followed],
    set: &Evaluated,
) -> Result<Remains, DiagnosisError> {
    let model = set
        .refit(runs.reference)
        .model_at(&set.fitted.at)
        .ok_or(whorl_prediction::PredictionError::NoModel)?;
    let pairs: Vec<(&Recording, &Followed)> = recordings.iter().zip(followed).collect();
    let of_run = |(recording, followed): &(&Recording, &Followed)| -> Result<Remains, DiagnosisError> {
        let case = Prepared::new(recording, &model, each_reading(runs))?;
        Ok(grid(&case, &followed.undisturbed_noise(), &followed.undisturbed.start).1)
    };
    let all: Result<Vec<Remains>, DiagnosisError> =
        threads::map(runs.threads, &pairs, of_run).into_iter().collect();
    Ok(all?.into_iter().fold(Remains::default(), Remains::and))
}

/// Numbers of the predictor by which every reading is seen by itself.
fn each_reading(runs: &Runs<'_>) -> whorl_prediction::Settings {
    Runs { each_reading: true, ..*runs }.prediction()
}

fn grid(case: &Prepared<'_>, noise: &Noise, start: &Start) -> (Grid, Remains) {
    let recording = case.recording();
    let clock = sample_clock(&recording.gyro_b_rad_s.time_s)
        .or_else(|| sample_clock(&recording.wheel_speed_rad_s.time_s));
    let (start_s, step_s) = clock.unwrap_or((0.0, 1.0));
    let last_s = recording.gyro_b_rad_s.time_s.last().or(recording.wheel_speed_rad_s.time_s.last());
    let last_s = last_s.copied().unwrap_or(start_s);
    let count = ((last_s - start_s) / step_s).round().clamp(0.0, MOST_SAMPLES) as usize + 1;
    let mut grid = Grid {
        start_s,
        step_s,
        inertial: std::array::from_fn(|_| vec![0.0; count]),
        there: [vec![false; count], vec![false; count]],
        wheels: vec![vec![0.0; count]; case.model().wheels().len()],
        stddev: [0.0; 6],
    };
    let mut counts = [0.0; 6];
    let mut sums = Remains::default().sums();
    predict(case, noise, start, &[], &mut |told| {
        let Told::Innovation(innovation) = told else { return };
        sums.add(innovation);
        grid.put(recording, innovation, &mut counts);
    });
    for (stddev, count) in grid.stddev.iter_mut().zip(counts) {
        *stddev /= f64::max(count, 1.0);
    }
    (grid, sums.end())
}

impl Grid {
    fn put(&mut self, recording: &Recording, innovation: &Innovation, counts: &mut [f64; 6]) {
        let (component, sample) = (innovation.component, innovation.sample);
        let stamp_s = match component.channel {
            Channel::Gyro => recording.gyro_b_rad_s.time_s.get(sample),
            Channel::Accelerometer => recording.specific_force_b_m_s2.time_s.get(sample),
            Channel::WheelSpeed => recording.wheel_speed_rad_s.time_s.get(sample),
            _ => None,
        };
        let Some(at) = stamp_s.map(|stamp_s| ((stamp_s - self.start_s) / self.step_s).round()) else {
            return;
        };
        if at < 0.0 || at >= self.len() as f64 {
            return;
        }
        let (at, axis) = (at as usize, component.index());
        let value = innovation.normalised().clamp(-MOST_DEVIATIONS, MOST_DEVIATIONS);
        let sensor = match component.channel {
            Channel::Gyro => 0,
            Channel::Accelerometer => 1,
            _ => {
                if let Some(slot) = self.wheels.get_mut(axis).and_then(|wheel| wheel.get_mut(at)) {
                    *slot = value;
                }
                return;
            }
        };
        let channel = 3 * sensor + axis;
        if channel < 6 {
            self.inertial[channel][at] = value;
            self.there[sensor][at] = true;
            self.stddev[channel] += innovation.stddev;
            counts[channel] += 1.0;
        }
    }
}

/// Start and step of the sensor's own clock, from stamps that jitter \[s\]. The median of thousands of steps that
/// jitter by a twentieth is off by 10^-3 of a step, which is several samples over a run: a line near half the sample
/// rate would lose half its power.
fn sample_clock(stamps_s: &[f64]) -> Option<(f64, f64)> {
    let first_s = *stamps_s.first()?;
    let (mut start_s, mut step_s) = (first_s, typical_step_s(stamps_s).max(1e-4));
    for _ in 0..2 {
        // The sample's number follows the stamps slowly, so that no single one of them makes it slip.
        let (mut number, mut expected_s) = (0.0, start_s);
        let (mut count, mut sums, mut squares, mut products) = (0.0, (0.0, 0.0), 0.0, 0.0);
        for t in stamps_s {
            let steps = ((t - expected_s) / step_s).round().max(0.0);
            number += steps;
            expected_s += steps * step_s;
            expected_s += 0.05 * (t - expected_s);
            let since_first_s = t - first_s;
            count += 1.0;
            sums = (sums.0 + number, sums.1 + since_first_s);
            squares += number * number;
            products += number * since_first_s;
        }
        let spread = squares - sums.0 * sums.0 / count;
        if spread <= 0.0 {
            return None;
        }
        step_s = ((products - sums.0 * sums.1 / count) / spread).max(1e-4);
        start_s = first_s + (sums.1 - step_s * sums.0) / count;
    }
    Some((start_s, step_s))
}

#[cfg(test)]
mod tests {
    use rand_distr::{Distribution, StandardNormal};
    use rand_pcg::Pcg64;

    use super::*;

    #[test]
    fn the_clock_is_found_behind_stamps_that_jitter() {
        let mut random = Pcg64::new(4, 2);
        let mut noise = || -> f64 { StandardNormal.sample(&mut random) };
        let step_s = 0.010_003;
        // Every hundredth sample is lost, and a second of them.
        let stamps_s: Vec<f64> = (0..9000_u32)
            .filter(|i| i % 100 != 7 && !(4000..4100).contains(i))
            .map(|i| 5.0 + step_s * f64::from(i) + 5e-4 * noise())
            .collect();
        let (start_s, found_s) = sample_clock(&stamps_s).unwrap();
        assert!((start_s - 5.0).abs() < 1e-4, "{start_s}");
        // A twentieth of a sample over the whole run.
        assert!((found_s - step_s).abs() * 9000.0 < 0.05 * step_s, "{found_s}");
    }
}
