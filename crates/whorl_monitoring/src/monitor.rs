//! Messages in, how well the model fits out.

use nalgebra::{UnitQuaternion, Vector3};
use whorl_dynamics::gyrostat::MAX_WHEELS;
use whorl_dynamics::platform::TiltLimit;
use whorl_dynamics::{ModelPrior, PlantError, PlatformModel};
use whorl_math::{elevation_x_rad, tilt_rad};

use crate::Settings;
use crate::cell::{CELL_S, Driven, Input, Inputs, ns};
use crate::fit::Fit;
use crate::sources::{Source, Sources};
use crate::watch::Watch;

/// A cell is compared when all that comes regularly is known until this long after its end \[s\], and what comes seldom has come.
const SETTLED_S: f64 = 0.05;
/// From the tilt stop the platform is watched at this distance only \[rad\]: what happens there is the stop's.
const FROM_STOP_RAD: f64 = 0.005;
/// Sums of on-times are rounded to this \[s\].
const ROUNDED_S: f64 = 1e-6;
/// Below so many standard deviations of its pressure sensor a tank may end before the next reading.
const LOW_STDDEVS: f64 = 6.0;

/// The monitor of one platform, of whose motors only wheels and jets are watched.
pub struct Monitor {
    model: PlatformModel,
    pub(crate) watch: Watch,
    /// `None`: the motion is not known.
    driven: Option<Driven>,
    inputs: Inputs,
    sources: Sources,
    pressure_pa: Option<f64>,
    /// What was heard last of wheels, speeds [rad/s] and torques [N m], and of valves, which are open and on-times in all \[s\].
    wheels: Option<([f64; MAX_WHEELS], [f64; MAX_WHEELS])>,
    valves: Option<(Vec<bool>, Vec<f64>)>,
}

impl Monitor {
    /// A monitor of a platform before its first data.
    ///
    /// # Errors
    /// A model that cannot be simulated.
    pub fn new(model: &PlatformModel, prior: &ModelPrior, settings: &Settings) -> Result<Self, PlantError> {
        Ok(Self {
            watch: Watch::new(model, prior, settings)?,
            model: model.clone(),
            driven: None,
            inputs: Inputs::new(),
            sources: Sources::new(!model.wheels().is_empty(), !model.jets().is_empty()),
            pressure_pa: None,
            wheels: None,
            valves: None,
        })
    }

    fn push(&mut self, at_ns: i64, input: Input) {
        // Data come nearly in order. What belongs to a cell that has been compared cannot be put right.
        if self.driven.as_ref().is_some_and(|driven| at_ns < driven.plant.now_ns()) {
            return self.lose("data came too late");
        }
        self.inputs.push((at_ns, input));
    }

    /// A message of a source; the time since the one before, if nothing is missing between them \[s\].
    fn heard(&mut self, source: Source, stamp_ns: i64) -> Option<f64> {
        self.sources.heard(source, stamp_ns).unwrap_or_else(|hole| {
            self.lose(&hole);
            // The first after the hole.
            self.sources.heard(source, stamp_ns).unwrap_or_default()
        })
    }

    /// Reading of the gyro, body axes [rad/s].
    pub fn on_gyro(&mut self, stamp_ns: i64, rate_b_rad_s: &Vector3<f64>) {
        self.heard(Source::Gyro, stamp_ns);
        // The instant that it shows.
        self.push(stamp_ns - ns(self.model.sensors.gyro.errors.latency_s), Input::Gyro(*rate_b_rad_s));
        self.compare();
    }

    /// Speeds of the wheels [rad/s] and the motor torques that were in force until then [N m], finite, of each wheel one.
    pub fn on_wheels(&mut self, stamp_ns: i64, speed_rad_s: &[f64], torque_n_m: &[f64]) {
        let fill = |of: &[f64]| std::array::from_fn(|j| of.get(j).copied().unwrap_or(0.0));
        let now: ([f64; MAX_WHEELS], _) = (fill(speed_rad_s), fill(torque_n_m));
        let since_s = self.heard(Source::Wheels, stamp_ns).unwrap_or(0.0);
        let before = self.wheels.replace(now).map_or(now.1, |(_, torque)| torque);
        // A torque took force at some time since the message before: uniform over the interval, a third of its square.
        let doubt = |j: usize| ((now.1[j] - before[j]) * since_s).powi(2) / 3.0;
        self.push(stamp_ns - ns(since_s), Input::Torque(now.1, std::array::from_fn(doubt)));
        self.push(stamp_ns, Input::Speed(now.0));
        self.compare();
    }

    /// State of the valves at `stamp_ns`, and how long each was driven in all \[s\], finite: a message that is lost loses no pulse.
    pub fn on_valves(&mut self, stamp_ns: i64, open: &[bool], total_on_time_s: &[f64]) {
        let since_s = self.heard(Source::Valves, stamp_ns);
        // Nothing was driven.
        if self.valves.as_ref().is_some_and(|(was, before_s)| was == open && before_s == total_on_time_s) {
            return self.compare();
        }
        let before = self.valves.replace((open.to_vec(), total_on_time_s.to_vec()));
        let low_pa = LOW_STDDEVS * self.model.sensors.tank_pressure.stddev();
        let is_low = self.pressure_pa.is_some_and(|measured_pa| measured_pa <= low_pa);
        if let (Some(since_s), Some((was_open, before_s))) = (since_s, before) {
            let since_ns = ns(since_s);
            let valves = open.iter().zip(&was_open).zip(total_on_time_s.iter().zip(&before_s));
            for (jet, ((open, was_open), (total_s, before_s))) in valves.enumerate() {
                let on_time_s = total_s - before_s;
                let on_ns = ns(on_time_s).clamp(0, since_ns);
                if !(-ROUNDED_S..=since_s + ROUNDED_S).contains(&on_time_s) {
                    return self.lose("states of the valves contradict each other");
                } else if on_ns > 0 && is_low {
                    return self.lose("the tank is nearly empty, and jets may push or not");
                } else if on_ns > 0 {
                    let opened_meanwhile = *open && !was_open;
                    let start_ns = stamp_ns - if opened_meanwhile { on_ns } else { since_ns };
                    self.push(start_ns, Input::Pulse(jet, on_ns as f64 * 1e-9));
                }
            }
        }
        self.compare();
    }

    /// Moment of the linear mass actuators from now on, body axes [N m].
    pub fn on_ballast(&mut self, stamp_ns: i64, moment_b_n_m: &Vector3<f64>) {
        self.push(stamp_ns, Input::Ballast(*moment_b_n_m));
    }

    /// The platform is controlled until this time: no hand is on it.
    pub fn on_controlled(&mut self, stamp_ns: i64) {
        self.heard(Source::Control, stamp_ns);
        self.compare();
    }

    /// Tank pressure as measured \[Pa\].
    pub fn on_pressure(&mut self, measured_pa: f64) {
        self.pressure_pa = Some(measured_pa);
        // Small errors of what jets use add up.
        self.driven.iter_mut().for_each(|driven| driven.plant.set_tank_pressure(measured_pa));
    }

    /// An estimated attitude and rate, body axes [rad/s].
    pub fn on_attitude(
        &mut self,
        stamp_ns: i64,
        q_world_body: &UnitQuaternion<f64>,
        rate_b_rad_s: &Vector3<f64>,
    ) {
        let limit = self.model.tilt_limit;
        let off_rad = match limit {
            TiltLimit::Cone { .. } => tilt_rad(q_world_body),
            TiltLimit::Pitch { .. } => elevation_x_rad(q_world_body).abs(),
        };
        if limit.stops() && off_rad >= limit.max_rad() - FROM_STOP_RAD {
            return self.pause();
        }
        self.heard(Source::Attitude, stamp_ns);
        if self.driven.is_some() {
            self.push(stamp_ns, Input::Attitude(*q_world_body, *rate_b_rad_s));
            self.compare();
        } else if self.wheels.is_some() || self.model.wheels().is_empty() {
            let motion = (*q_world_body, *rate_b_rad_s, self.wheels.unwrap_or_default().0);
            self.driven = Driven::new(&self.model, self.pressure_pa, stamp_ns, &motion).ok();
            self.inputs.retain(|(at_ns, _)| *at_ns > stamp_ns);
            self.watch.forget_motion();
        }
    }

    /// Nobody knows how the platform moves from here on: a hand, a stop, an estimate that is of no use. What was learned stays.
    pub fn pause(&mut self) {
        self.driven = None;
        self.inputs.clear();
        self.sources.forget();
        (self.wheels, self.valves) = (None, None);
    }

    /// The same because data are late, lost or in disorder.
    fn lose(&mut self, hole: &str) {
        self.watch.newest.holes += u64::from(self.driven.is_some());
        self.watch.newest.hole = Some(hole.to_owned());
        self.pause();
    }

    /// Compares all cells about which everything has arrived.
    fn compare(&mut self) {
        while let Some(driven) = &mut self.driven {
            let end_ns = driven.plant.now_ns() + ns(CELL_S);
            match self.sources.complete(end_ns + ns(SETTLED_S)) {
                Ok(true) if self.watch.cell(driven, &mut self.inputs, end_ns) => {}
                Ok(true) => self.pause(),
                Ok(false) => return,
                Err(hole) => self.lose(&hole),
            }
        }
    }

    /// How well the model fits now. Sums begin anew.
    pub fn fit(&mut self) -> Fit {
        self.watch.fit(self.driven.is_some())
    }
}
