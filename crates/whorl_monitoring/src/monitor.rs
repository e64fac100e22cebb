//! Messages in, how well the model fits out.

use std::collections::VecDeque;

use nalgebra::{UnitQuaternion, Vector3};
use whorl_dynamics::actuators::Kind;
use whorl_dynamics::gyrostat::MAX_WHEELS;
use whorl_dynamics::platform::TiltLimit;
use whorl_dynamics::{ModelPrior, PlatformModel};

use crate::Settings;
use crate::cells::{Driven, Input, Inputs, Supplies};
use crate::error::MonitorError;
use crate::fit::{Fit, State};
use crate::gas::Gas;
use crate::sources::{GAP_S, Hole, Source, Sources, WheelTorque};
use crate::watch::Watch;

/// A cell is compared when all that comes regularly is known until this long after its end \[s\]: what comes seldom has
/// arrived by then.
const SETTLED_S: f64 = 0.05;
/// From the tilt stop the platform is watched at this distance only \[rad\]: what happens there is the stop's.
const FROM_STOP_RAD: f64 = 0.005;
/// Data that wait at most; more is lost.
const MOST_WAITING: usize = 4096;
/// Sums of on-times are rounded to this \[s\].
const ROUNDED_S: f64 = 1e-6;

/// The valves as they were last.
#[derive(Debug, Clone)]
struct Valves {
    open: Vec<bool>,
    total_on_time_s: Vec<f64>,
}

/// The monitor of one platform.
pub struct Monitor {
    model: PlatformModel,
    settings: Settings,
    pub(crate) watch: Watch,
    driven: Option<Driven>,
    inputs: Inputs,
    attitudes: VecDeque<(i64, UnitQuaternion<f64>, Vector3<f64>)>,
    supplies: Supplies,
    gas: Gas,
    sources: Sources,
    wheel_torque: WheelTorque,
    valves_before: Option<Valves>,
    broken: bool,
    hole: Option<Hole>,
    holes: u64,
    alarmed: bool,
}

impl Monitor {
    /// A monitor of a platform before its first data.
    ///
    /// # Errors
    /// See [`MonitorError`].
    pub fn new(model: &PlatformModel, prior: &ModelPrior, settings: &Settings) -> Result<Self, MonitorError> {
        for (kind, range) in Kind::ALL.into_iter().zip(model.actuators.motor_ranges()) {
            if kind != Kind::Wheels && !range.is_empty() {
                return Err(MonitorError::OtherActuators { what: format!("{kind:?}") });
            }
        }
        Ok(Self {
            watch: Watch::new(model, prior, settings)?,
            model: model.clone(),
            settings: settings.clone(),
            driven: None,
            inputs: VecDeque::new(),
            attitudes: VecDeque::new(),
            supplies: Supplies::default(),
            gas: Gas::default(),
            sources: Sources::new(!model.wheels().is_empty(), !model.jets().is_empty()),
            wheel_torque: WheelTorque::default(),
            valves_before: None,
            broken: true,
            hole: None,
            holes: 0,
            alarmed: false,
        })
    }

    /// End of the newest cell \[ns\].
    fn now_ns(&self) -> Option<i64> {
        self.driven.as_ref().filter(|_| !self.broken).map(|driven| driven.plant.now_ns())
    }

    fn push(&mut self, at_ns: i64, input: Input) {
        if self.inputs.len() >= MOST_WAITING {
            self.lose(Hole::TooMany);
        }
        // Data come nearly in order. What belongs to a cell that has been compared cannot be put right.
        if self.now_ns().is_some_and(|now_ns| at_ns < now_ns) {
            self.lose(Hole::Late);
            return;
        }
        let place = self.inputs.iter().rposition(|(before, _)| *before <= at_ns).map_or(0, |k| k + 1);
        self.inputs.insert(place, (at_ns, input));
    }

    /// A message of a source; the time since the one before, if nothing is missing between them \[s\].
    fn heard(&mut self, source: Source, stamp_ns: i64) -> Option<f64> {
        match self.sources.heard(source, stamp_ns) {
            Ok(since_s) => since_s,
            Err(hole) => {
                self.lose(hole);
                // The first after the hole.
                let _ = self.sources.heard(source, stamp_ns);
                None
            }
        }
    }

    /// Reading of the gyro, body axes [rad/s].
    pub fn on_gyro(&mut self, stamp_ns: i64, rate_b_rad_s: &Vector3<f64>) {
        self.heard(Source::Gyro, stamp_ns);
        // The instant that it shows.
        let latency_ns = ns(self.model.sensors.gyro.errors.latency_s);
        self.push(stamp_ns - latency_ns, Input::Gyro(*rate_b_rad_s));
        self.compare();
    }

    /// Speeds of the wheels [rad/s] and the motor torques that were in force until then [N m].
    pub fn on_wheels(&mut self, stamp_ns: i64, speed_rad_s: &[f64], torque_n_m: &[f64]) {
        let wheels = self.model.wheels().len();
        let finite = speed_rad_s.iter().chain(torque_n_m).all(|x| x.is_finite());
        if speed_rad_s.len() != wheels || torque_n_m.len() != wheels || !finite {
            return;
        }
        let fill = |numbers: &[f64]| std::array::from_fn(|j| numbers.get(j).copied().unwrap_or(0.0));
        let usual_s = self.sources.usual_s(Source::Wheels);
        let since_s = self.heard(Source::Wheels, stamp_ns);
        let torque = fill(torque_n_m);
        let doubt = since_s.map(|since_s| self.wheel_torque.took_force(&torque, since_s, usual_s));
        if doubt.is_none() {
            self.wheel_torque.is(&torque);
        }
        let from_ns = stamp_ns - ns(since_s.unwrap_or(0.0));
        self.push(from_ns, Input::Torque(torque, doubt.unwrap_or_default()));
        self.push(stamp_ns, Input::Speed(fill(speed_rad_s)));
        self.compare();
    }

    /// State of the valves at `stamp_ns`, and how long each was driven in all \[s\]: so that a message that is lost loses no
    /// pulse.
    pub fn on_valves(&mut self, stamp_ns: i64, open: &[bool], total_on_time_s: &[f64]) {
        let jets = self.model.jets().len();
        let finite = total_on_time_s.iter().all(|total| total.is_finite());
        if open.len() != jets || total_on_time_s.len() != jets || !finite {
            return;
        }
        let since_s = self.heard(Source::Valves, stamp_ns);
        let now = Valves { open: open.to_vec(), total_on_time_s: total_on_time_s.to_vec() };
        let before = self.valves_before.replace(now);
        if let (Some(since_s), Some(before)) = (since_s, before) {
            let before_ns = stamp_ns - ns(since_s);
            for (jet, (total_s, before_s)) in total_on_time_s.iter().zip(&before.total_on_time_s).enumerate()
            {
                let on_time_s = total_s - before_s;
                if !(-ROUNDED_S..=since_s + ROUNDED_S).contains(&on_time_s) {
                    self.lose(Hole::Contradiction(Source::Valves));
                    break;
                }
                let on_ns = ns(on_time_s).clamp(0, stamp_ns - before_ns);
                if on_ns == 0 {
                    continue;
                }
                let opened_meanwhile = open[jet] && !before.open.get(jet).copied().unwrap_or(false);
                let start_ns = if opened_meanwhile { stamp_ns - on_ns } else { before_ns };
                let on_time_s = on_ns as f64 * 1e-9;
                if self.gas.fire(jet, on_time_s, &self.model) {
                    if self.gas == Gas::Gone {
                        self.supplies.pressure_pa = Some(0.0);
                    }
                    self.lose(Hole::Gas);
                    break;
                }
                self.push(start_ns, Input::Pulse(jet, on_time_s));
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
        // Control acts on estimates, and may act on one twice.
        if self.sources.newest_ns(Source::Control).is_none_or(|newest| newest < stamp_ns) {
            self.heard(Source::Control, stamp_ns);
            self.compare();
        }
    }

    /// Supplies as measured; those that are `None` stay as they were.
    pub fn on_supplies(&mut self, new: &Supplies) {
        let pressure_pa = new.pressure_pa.map(|measured_pa| self.gas.hear(measured_pa, &self.model));
        if let Some((pressure_pa, driven)) = pressure_pa.zip(self.driven.as_mut()) {
            driven.hear_pressure(pressure_pa);
        }
        let old = self.supplies;
        self.supplies = Supplies {
            pressure_pa: pressure_pa.or(old.pressure_pa),
            voltage_v: new.voltage_v.or(old.voltage_v),
            temperature_k: new.temperature_k.or(old.temperature_k),
        };
    }

    /// Nobody knows how the platform moves from here on: a hand, a stop, an estimate that is of no use. What was learned stays.
    pub fn pause(&mut self) {
        self.broken = true;
        self.inputs.clear();
        self.attitudes.clear();
        self.sources.forget();
        self.valves_before = None;
    }

    /// The same because data are late, lost or in disorder.
    fn lose(&mut self, hole: Hole) {
        if !self.broken {
            self.holes += 1;
        }
        self.hole = Some(hole);
        self.pause();
    }

    /// Forgets a mismatch, as after a repair, and all evidence.
    pub fn forget(&mut self) {
        self.alarmed = false;
        self.watch.forget();
    }

    /// An estimated attitude and rate.
    pub fn on_attitude(
        &mut self,
        stamp_ns: i64,
        q_world_body: &UnitQuaternion<f64>,
        rate_b_rad_s: &Vector3<f64>,
    ) {
        let vertical = whorl_math::vertical_b(q_world_body);
        let from_stop_rad = match self.model.tilt_limit {
            TiltLimit::Cone { max_rad } => max_rad - vertical.z.clamp(-1.0, 1.0).acos(),
            TiltLimit::Pitch { max_rad } => max_rad - vertical.x.clamp(-1.0, 1.0).asin().abs(),
        };
        if self.model.tilt_limit.stops() && from_stop_rad <= FROM_STOP_RAD {
            self.pause();
            return;
        }
        self.heard(Source::Attitude, stamp_ns);
        if self.attitudes.len() >= MOST_WAITING {
            self.attitudes.pop_front();
        }
        self.attitudes.push_back((stamp_ns, *q_world_body, *rate_b_rad_s));
        if self.broken {
            self.restart(stamp_ns, q_world_body, rate_b_rad_s);
            return;
        }
        self.compare();
    }

    /// Compares all cells about which everything has arrived.
    fn compare(&mut self) {
        while let Some(start_ns) = self.now_ns() {
            let end_ns = start_ns + ns(self.settings.bin_s);
            match self.sources.complete(end_ns + ns(SETTLED_S)) {
                Ok(true) => {}
                Ok(false) => return,
                Err(hole) => return self.lose(hole),
            }
            let attitude = self.attitude_at(start_ns);
            let compared = attitude.zip(self.driven.as_mut()).is_some_and(|(attitude, driven)| {
                self.watch.cell(driven, &attitude, &mut self.inputs, end_ns)
            });
            if !compared {
                self.pause();
            } else if self.watch.is_settled() {
                self.hole = None;
            }
        }
    }

    fn restart(&mut self, stamp_ns: i64, q_world_body: &UnitQuaternion<f64>, rate_b_rad_s: &Vector3<f64>) {
        let speeds = self.inputs.iter().rev().find_map(|(_, input)| match input {
            Input::Speed(speeds) => Some(*speeds),
            _ => None,
        });
        let wheels = self.model.wheels().len();
        if speeds.is_none() && wheels > 0 {
            return;
        }
        let speeds = speeds.unwrap_or_default();
        let driven = Driven::new(&self.model, &self.supplies, stamp_ns, ns(self.settings.bin_s));
        let Ok(mut driven) = driven else { return };
        if driven.plant.set_motion(q_world_body, rate_b_rad_s, &speeds[..wheels.min(MAX_WHEELS)]).is_err() {
            return;
        }
        self.inputs.retain(|(at, _)| *at > stamp_ns);
        self.driven = Some(driven);
        self.watch.forget_motion();
        self.broken = false;
    }

    /// The attitude at a time, by the newest estimate until then.
    fn attitude_at(&mut self, at_ns: i64) -> Option<UnitQuaternion<f64>> {
        while self.attitudes.get(1).is_some_and(|(next, ..)| *next <= at_ns) {
            self.attitudes.pop_front();
        }
        let (stamp_ns, q, rate) = self.attitudes.front()?;
        let later_s = (at_ns - stamp_ns) as f64 * 1e-9;
        (later_s.abs() <= GAP_S).then(|| q * whorl_math::quaternion_exp(&(rate * later_s)))
    }

    /// How well the model fits now. Sums begin anew.
    pub fn fit(&mut self, now_ns: i64) -> Fit {
        let newest = self.watch.newest();
        let ln_evidence = self.watch.evidence.ln_evidence();
        let limit = self.settings.limit_nats();
        self.alarmed |= ln_evidence >= limit;
        let state = match (self.alarmed, self.broken || !self.watch.is_settled()) {
            (true, _) => State::Mismatch,
            (false, true) => State::Waiting,
            (false, false) if ln_evidence >= 0.5 * limit => State::Doubt,
            (false, false) => State::Agrees,
        };
        Fit {
            stamp_ns: newest.end_ns.unwrap_or(now_ns),
            state,
            gyro: newest.gyro,
            wheel_speed: newest.wheel_speed,
            squares: newest.squares,
            ln_evidence,
            likeliest: if self.alarmed { self.watch.likeliest() } else { None },
            hole: self.hole.filter(|_| state == State::Waiting),
            holes: self.holes,
        }
    }

    /// The evidence that is an alarm \[nats\].
    #[must_use]
    pub fn limit_nats(&self) -> f64 {
        self.settings.limit_nats()
    }
}

fn ns(seconds: f64) -> i64 {
    (seconds * 1e9).round() as i64
}
