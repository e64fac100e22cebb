//! Recordings made ready: trajectories smoothed, whitened, linearised.

use std::sync::Arc;

use nalgebra::UnitQuaternion;
use whorl_math::vertical_b;
use whorl_recording::{Channel, Recording};
use whorl_trajectory::noise::typical_step_s;

use crate::bins::motion::Motion;
use crate::bins::run::{Run, is_clamped};
use crate::bins::torques::Torques;
use crate::evidence::ar_noise::{ArModel, ArModels, ar_log_density, ar_models_of};
use crate::evidence::nuisance::{CORRELATION_TIMES, Nuisance, STEP};
use crate::evidence::regression::{Normal, Whitened};
use crate::parameters::{Column, Point, Reference};
use crate::whitening::columns::{GROUPS, LANES, Linearised, Moved, group_response, predict};
use crate::whitening::filter::{Background, Settings, System};
use crate::whitening::mechanics::{Mechanics, Prediction, TorqueSlope};
use crate::{DiagnosisError, threads};

/// Nodes of all runs together, at most: more data go into wider bins.
const MOST_NODES: f64 = 9_000.0;

/// Widest bin \[s\].
const WIDEST_BIN_S: f64 = 0.1;

/// Times that a motion is turned to the heading that springs tell.
const MOST_TURNS: usize = 8;

/// A walk of the rate so strong that any motion is as likely as the model's [rad/s/sqrt(s)].
pub(crate) const FREE_RATE_WALK: f64 = 0.3;

/// Runs with their trajectories; copies share the runs.
#[derive(Debug, Clone)]
pub(crate) struct Problem {
    pub reference: Reference,
    pub runs: Arc<Vec<Run>>,
    pub motions: Arc<Vec<Motion>>,
    /// Random walk of the rate of each run that its data supported last [rad/s/sqrt(s)].
    walks: Vec<f64>,
    pub threads: usize,
    /// Density of the gyro's noise, per run [rad/s sqrt(s)].
    gyro_density: Vec<f64>,
    wheel_density: Vec<f64>,
    /// Time over which the whitening filter remembers \[s\].
    memory_s: f64,
    /// Noise that is expected beside what the model states.
    pub nuisance: Nuisance,
    /// What turns the platform, by which torques are measured that have no formula.
    pub torques: Torques,
}

/// The whitened regression of a set of runs at a point.
pub(crate) struct Dataset {
    /// Normal equations, run by run, block by block.
    pub blocks: Vec<Normal>,
    pub total: Normal,
    pub whitened: Vec<Whitened>,
    /// AR noise model of each channel of each run.
    pub ar_models: ArModels,
    /// Log density of innovations of zero, up to a constant: sum of the logarithms of their inverse sizes.
    pub log_density: f64,
}

/// Process noise with which a motion is smoothed: the random walk of the rate beside the model's accelerations [rad/s/sqrt(s)].
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) enum ProcessNoise {
    /// This walk.
    Fixed(f64),
    /// The walk that the data of each run support best.
    Estimated,
    /// That of the last smoothing of the same kind: what one step of a fit changes is less than a factor of five.
    Previous,
}

/// The random walk of the rate that the data support best, not below `least`.
fn likeliest_walk(least: f64, doubt_nats: f64, log_likelihood: impl Fn(f64) -> f64) -> f64 {
    let mut best = (least, log_likelihood(least));
    for factor in [5.0, 25.0, 125.0] {
        let here = (least * factor, log_likelihood(least * factor));
        // A few more would be chance.
        if here.1 < best.1 + doubt_nats {
            break;
        }
        best = here;
    }
    best.0
}

impl Problem {
    /// Checks recordings and makes rough trajectories of them. Bins are so wide that `total_s` of data have
    /// no more than the most nodes.
    pub fn new(
        recordings: &[Recording],
        reference: Reference,
        total_s: f64,
        threads: usize,
    ) -> Result<Self, DiagnosisError> {
        let made = threads::map(threads, recordings, |recording| {
            let clamped = is_clamped(recording, &reference.model);
            let base =
                if clamped { &recording.wheel_speed_rad_s.time_s } else { &recording.gyro_b_rad_s.time_s };
            // Typical time between samples of the channel that sets the nodes.
            let step_s = typical_step_s(base).max(1e-6);
            let samples = (total_s / MOST_NODES / step_s).ceil().max(1.0);
            let widest = (WIDEST_BIN_S / step_s).floor().max(1.0);
            let bin_s = step_s * samples.min(widest);
            let run = Run::new(
                recording,
                &reference.model,
                bin_s,
                reference.extra_latency_s,
                reference.settings.feedback_correlation,
            )?;
            Ok::<_, DiagnosisError>((run, step_s))
        });
        let mut problem = Self {
            runs: Arc::default(),
            motions: Arc::default(),
            walks: Vec::new(),
            threads,
            gyro_density: Vec::new(),
            wheel_density: Vec::new(),
            memory_s: reference.settings.memory_s,
            nuisance: Nuisance::default(),
            torques: Torques::default(),
            reference,
        };
        let mut runs = Vec::new();
        for result in made {
            let (run, step_s) = result?;
            problem.gyro_density.push(run.noise.gyro.mean() * step_s.sqrt());
            problem.wheel_density.push(run.noise.wheel * step_s.sqrt());
            problem.memory_s = problem.memory_s.max(problem.reference.settings.memory_samples * step_s);
            runs.push(run);
        }
        problem.runs = Arc::new(runs);
        let mechanics = Mechanics::new(&problem.reference.model)?;
        let motions = threads::map(threads, &problem.runs, |run| Motion::rough(run, mechanics.model()));
        problem.motions = Arc::new(motions);
        problem.check_attitude()?;
        problem.torques = Torques::of(
            &problem.runs,
            &problem.motions,
            mechanics.model(),
            problem.reference.settings.at_work_s,
        );
        Ok(problem)
    }

    /// Fixes for all further fits in which intervals the bearing's stop is near, where the filter takes the torque as unknown.
    /// One such interval more or less changes the density of the data by more than two similar effects differ.
    pub fn settle_stops(&mut self) -> Result<(), DiagnosisError> {
        let mechanics = Mechanics::new(&self.reference.model)?;
        for (run, motion) in Arc::make_mut(&mut self.runs).iter_mut().zip(self.motions.iter()) {
            run.near_stop = motion.q_mid.iter().map(|q| mechanics.near_stop(q)).collect();
        }
        Ok(())
    }

    fn check_attitude(&self) -> Result<(), DiagnosisError> {
        for (run, motion) in self.runs.iter().zip(self.motions.iter()) {
            if !motion.is_finite() {
                return Err(DiagnosisError::NoTrajectory {
                    run: run.name.clone(),
                    what: "the rates give no finite attitude",
                });
            }
        }
        Ok(())
    }

    /// Smooths the trajectories with the model at a point.
    ///
    /// Sensitivities are taken along this trajectory. If it followed the gyro's noise, a reading's noise
    /// would be part of its own regressor (errors in variables), and a platform at rest would seem to have
    /// a gyro with a scale error. Hence the process noise is only as large as the errors of the model.
    pub fn smooth(&mut self, point: &Point, process_noise: ProcessNoise) -> Result<(), DiagnosisError> {
        let mechanics = Mechanics::new(&self.reference.model_at(point)?)?;
        let indices: Vec<usize> = (0..self.runs.len()).collect();
        let smoothed = threads::map(self.threads, &indices, |&r| {
            let (Some(run), Some(motion)) = (self.runs.get(r), self.motions.get(r)) else {
                return (Motion::default(), 0.0);
            };
            let motion = &self.turned_by_springs(r, run, motion, &mechanics);
            let (_, prediction) = predict(&mechanics, run, motion);
            let system = |rate_walk| self.smoothing(r, run, motion, &mechanics, &prediction, rate_walk);
            let linear = system(0.0).linear();
            let least = self.settings(r).rate_walk;
            let walk = match (process_noise, self.walks.get(r)) {
                (ProcessNoise::Fixed(walk), _) => walk,
                (ProcessNoise::Previous, Some(walk)) => walk.max(least),
                _ => likeliest_walk(least, self.reference.settings.doubt_nats, |walk| {
                    system(walk).log_likelihood(&linear)
                }),
            };
            (system(walk).corrected(&linear).0, walk)
        });
        let (motions, walks): (Vec<Motion>, Vec<f64>) = smoothed.into_iter().unzip();
        self.motions = Arc::new(motions);
        if !matches!(process_noise, ProcessNoise::Fixed(_)) {
            self.walks = walks;
        }
        self.check_attitude()
    }

    /// The system by which a motion is smoothed.
    fn smoothing<'a>(
        &self,
        r: usize,
        run: &'a Run,
        motion: &'a Motion,
        mechanics: &'a Mechanics,
        prediction: &'a Prediction,
        rate_walk: f64,
    ) -> System<'a> {
        let wheel_noise =
            mechanics.model().wheels().iter().map(|w| 0.03 * w.max_torque_n_m).fold(1e-4, f64::max);
        let settings = Settings { rate_walk, wheel_noise, ..self.settings(r) };
        System { run, motion, mechanics, prediction, settings }
    }

    /// The motion turned to the heading that springs tell, where no sensor does. That needs small process noise: a walk of the
    /// rate could otherwise make up for a wrong heading.
    fn turned_by_springs(&self, r: usize, run: &Run, motion: &Motion, mechanics: &Mechanics) -> Motion {
        let mut best = (motion.clone(), f64::NEG_INFINITY);
        if run.clamped || run.has_heading() {
            return best.0;
        }
        let mut here = motion.clone();
        for _ in 0..MOST_TURNS {
            let (_, prediction) = predict(mechanics, run, &here);
            let depends = |(slope, q): (&TorqueSlope, &UnitQuaternion<f64>)| {
                (slope.by_attitude * vertical_b(q)).norm() > 0.0
            };
            if !prediction.torque_slope.iter().zip(&here.q).any(depends) {
                break;
            }
            let system = self.smoothing(r, run, &here, mechanics, &prediction, self.settings(r).rate_walk);
            let (next, log_likelihood) = system.corrected(&system.linear());
            // The log likelihood is that of the motion about which the system was linearised.
            if log_likelihood < best.1 + self.reference.settings.unfinished_nats {
                break;
            }
            best = (here, log_likelihood);
            here = next;
        }
        best.0
    }

    /// Power of the innovations of accelerometer and vector sensors against the gyro, over that of noise, with process noise
    /// so large that the model's torques do not matter. Median of the runs.
    pub fn kinematic_power(&self, point: &Point) -> Result<f64, DiagnosisError> {
        let mechanics = Mechanics::new(&self.reference.model_at(point)?)?;
        let mut powers: Vec<f64> = self
            .runs
            .iter()
            .zip(self.motions.iter())
            .enumerate()
            .filter(|(_, (run, _))| !run.clamped)
            .filter_map(|(r, (run, motion))| {
                let (_, prediction) = predict(&mechanics, run, motion);
                let settings = Settings { rate_walk: FREE_RATE_WALK, ..self.settings(r) };
                let system = System { run, motion, mechanics: &mechanics, prediction: &prediction, settings };
                let gains = system.gains(system.linear());
                let attitude: Vec<f64> = gains
                    .whitened
                    .iter()
                    .zip(gains.linear.rows())
                    .filter(|(_, row)| {
                        matches!(row.reading.channel, Channel::Accelerometer | Channel::Vector)
                    })
                    .map(|(e, _)| e * e)
                    .collect();
                (!attitude.is_empty()).then(|| attitude.iter().sum::<f64>() / attitude.len() as f64)
            })
            .collect();
        powers.sort_by(f64::total_cmp);
        Ok(powers.get(powers.len() / 2).copied().unwrap_or(1.0))
    }

    /// Frequencies at which a line may be: about as many as the longest run has nodes.
    pub fn frequencies(&self) -> f64 {
        self.runs.iter().map(Run::nodes).max().unwrap_or(1).max(1) as f64
    }

    pub fn watches_body(&self) -> bool {
        self.runs.iter().any(|run| !run.clamped)
    }

    /// The slow random torque of this noise. Its sizes are counted from where it would be as much as the walk of the
    /// rate that is always expected.
    pub fn background(&self, nuisance: Nuisance) -> Background {
        if nuisance.torque == 0 {
            return Background::default();
        }
        let correlation_time =
            CORRELATION_TIMES.get(usize::from(nuisance.correlation_time)).copied().unwrap_or(1.0);
        let correlation_s = correlation_time * self.memory_s;
        let inertia = self.reference.model.mass_properties.inertia_b_kg_m2().trace() / 3.0;
        let density = whorl_math::statistics::median(self.gyro_density.iter().copied());
        let least = inertia * density / self.memory_s / (2.0 * correlation_s).sqrt();
        let stddev_n_m = least * STEP.powi(i32::from(nuisance.torque));
        Background { stddev_n_m, correlation_s }
    }

    /// Whether the slow random torque of this noise is more than background: a good part of what turns the platform.
    pub fn is_large(&self, nuisance: Nuisance) -> bool {
        self.is_large_torque(self.background(nuisance).stddev_n_m)
    }

    /// The same of a torque of this standard deviation [N m].
    pub fn is_large_torque(&self, stddev_n_m: f64) -> bool {
        stddev_n_m > self.reference.settings.background_share * self.torques.body_n_m
    }

    /// Log prior of the noise beside what the model states. A torque that is no background is something unmodelled.
    pub fn log_prior(&self, nuisance: Nuisance) -> f64 {
        nuisance.log_prior()
            + if self.is_large(nuisance) { self.reference.settings.unmodelled.ln() } else { 0.0 }
    }

    /// Settings of the whitening filter of a run.
    pub fn settings(&self, r: usize) -> Settings {
        self.settings_with(self.nuisance, r)
    }

    /// As [`Self::settings`], with other noise.
    pub fn settings_with(&self, nuisance: Nuisance, r: usize) -> Settings {
        let density = |list: &[f64]| list.get(r).copied().unwrap_or(1e-4);
        let inertia = self.reference.model.wheels().iter().map(|w| w.spin_inertia_kg_m2).fold(1e-6, f64::max);
        let numbers = &self.reference.settings;
        Settings {
            stands_rad_s: numbers.stands_rad_s,
            wheel_stands_rad_s: numbers.wheel_stands_rad_s,
            sticks_s: numbers.sticks_s,
            rate_walk: density(&self.gyro_density) / self.memory_s,
            torque_walk: self.runs.get(r).map_or(0.0, |run| self.friction_walk(run)),
            gyro_bias_walk: nuisance.gyro_bias_walk(density(&self.gyro_density), numbers.bias_shows_after_s),
            background: self.background(nuisance),
            wheel_noise: inertia * density(&self.wheel_density) / self.memory_s
                * STEP.powi(i32::from(nuisance.wheel)),
        }
    }

    /// Without a tachometer the sense in which the wheels turn is unknown, so their friction may be wrong by all of its
    /// size for as long as a wheel keeps turning: the intensity of a torque state that walks so far within the filter's
    /// memory [N m/sqrt(s)].
    fn friction_walk(&self, run: &Run) -> f64 {
        if run.has_wheel_speed || run.clamped {
            return 0.0;
        }
        let friction = |w: &whorl_dynamics::platform::Wheel| {
            w.coulomb_friction_n_m + 0.3 * w.max_speed_rad_s * w.viscous_friction_n_m_s
        };
        let wheels = self.reference.model.wheels();
        wheels.iter().map(|w| friction(w).powi(2)).sum::<f64>().sqrt() / self.memory_s.sqrt()
    }

    /// Linearises every run at a point.
    pub fn linearise(&self, point: &Point) -> Result<Vec<Linearised>, DiagnosisError> {
        let indices: Vec<usize> = (0..self.runs.len()).collect();
        threads::map(self.threads, &indices, |&r| match (self.runs.get(r), self.motions.get(r)) {
            (Some(run), Some(motion)) => {
                Linearised::new(run, motion, &self.reference, point, self.settings(r))
            }
            _ => Err(DiagnosisError::NoRecording),
        })
        .into_iter()
        .collect()
    }

    /// Whitened sensitivities of columns at a point, one entry per run.
    pub fn respond(
        &self,
        linearised: &[Linearised],
        point: &Point,
        columns: &[Column],
    ) -> Result<Vec<Whitened>, DiagnosisError> {
        let work: Vec<(usize, usize)> = (0..self.runs.len())
            .flat_map(|r| (0..columns.len().div_ceil(GROUPS * LANES)).map(move |g| (r, g)))
            .collect();
        // At one point the platform is the same in every run.
        let Some(base) = linearised.first().map(|linear| &linear.mechanics) else { return Ok(Vec::new()) };
        let moved =
            threads::map(self.threads, columns, |column| Moved::new(base, &self.reference, point, column));
        let moved = moved.into_iter().collect::<Result<Vec<_>, _>>()?;
        let responses = threads::map(self.threads, &work, |&(r, g)| {
            let together = GROUPS * LANES;
            let group = &moved[g * together..((g + 1) * together).min(moved.len())];
            match (self.runs.get(r), self.motions.get(r), linearised.get(r)) {
                (Some(run), Some(motion), Some(linear)) => group_response(run, motion, linear, group),
                _ => Vec::new(),
            }
        });
        let mut whitened: Vec<Whitened> = self
            .runs
            .iter()
            .zip(linearised)
            .map(|(run, linear)| Whitened {
                groups: Vec::new(),
                y: linear.gains.whitened.clone(),
                reading: linear.gains.readings(),
                node: linear.gains.nodes(),
                nodes: run.nodes(),
            })
            .collect();
        for ((r, _), response) in work.iter().zip(responses) {
            if let Some(slot) = whitened.get_mut(*r) {
                slot.groups.extend(response);
            }
        }
        // Residuals relative to the reference, so that priors are about zero.
        for slot in &mut whitened {
            for (i, column) in columns.iter().enumerate() {
                let distance = self.reference.distance(point, column);
                if distance != 0.0
                    && let Some(group) = slot.groups.get(i / LANES)
                {
                    for (y, lanes) in slot.y.iter_mut().zip(group) {
                        *y += distance * f64::from(lanes[i % LANES]);
                    }
                }
            }
        }
        Ok(whitened)
    }

    /// The regression at a point. `ar_models` come from an earlier call, or are estimated with a fit of all
    /// columns, whose prior variances are `wide`.
    pub fn dataset(
        &self,
        mut whitened: Vec<Whitened>,
        columns: usize,
        wide: &[f64],
        ar_models: Option<ArModels>,
    ) -> Dataset {
        let ar_models = ar_models.unwrap_or_else(|| {
            let mut total = Normal::zeros(columns);
            for slot in &whitened {
                // A quarter of the rows is enough to leave only the noise.
                for block in slot.normals(columns, self.threads, 4) {
                    total.add(&block, 1.0);
                }
            }
            let active: Vec<usize> = (0..columns).collect();
            let fit = crate::evidence::regression::Estimate::new(&total, &active, |i| {
                wide.get(i).copied().unwrap_or(1.0)
            });
            let value = fit.map_or_else(|| nalgebra::DVector::zeros(columns), |f| f.value);
            whitened
                .iter()
                .map(|slot| {
                    ar_models_of(&slot.residual(&value), &slot.rows_by_reading(), &self.reference.settings)
                })
                .collect()
        });
        for (slot, ar_models) in whitened.iter_mut().zip(&ar_models) {
            slot.whiten(ar_models, self.threads);
        }
        let mut blocks = Vec::new();
        let mut total = Normal::zeros(columns);
        for slot in &whitened {
            for block in slot.normals(columns, self.threads, 1) {
                total.add(&block, 1.0);
                blocks.push(block);
            }
        }
        let of_run = |(slot, ar_models): (&Whitened, &Vec<ArModel>)| {
            ar_log_density(&slot.rows_by_reading(), ar_models)
        };
        let log_density = whitened.iter().zip(&ar_models).map(of_run).sum();
        Dataset { blocks, total, whitened, ar_models, log_density }
    }
}
