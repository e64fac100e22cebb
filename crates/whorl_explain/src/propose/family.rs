//! The competing manoeuvres, as steps of an experiment.

use whorl_dynamics::PlatformModel;
use whorl_dynamics::platform::TiltLimit;
use whorl_math::deg_from_rad;

/// Margin to the tilt limit for control errors \[deg\].
const TILT_MARGIN_DEG: f64 = 1.0;
/// Largest tilt about balance \[deg\].
const TILT_MOST_DEG: f64 = 2.5;
/// Fastest yaw rate \[deg/s\].
const RATE_MOST_DEG_S: f64 = 16.0;

/// Above this stiffness, gravity brings a platform back from a few degrees [N m].
const STABLE_N_M: f64 = 0.5;
/// A wheel whose axis is nearer to the vertical than 45 deg turns the platform in yaw.
const YAW_AXIS: f64 = 0.707;
/// Lengths of a long and a short pulse, and the longest that a jet slot holds \[s\].
const PULSES_S: [f64; 2] = [0.09, 0.03];
const LONGEST_PULSE_S: f64 = 0.1;
/// Time from pulse to pulse, and duration of coasting \[s\].
const PULSE_EVERY_S: f64 = 2.0;
const COAST_S: f64 = 30.0;

/// Actuators used by control.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Actuators {
    /// Wheels alone: their momentum is measured, thrust is not.
    Wheels,
    /// Jets alone.
    Jets,
}

/// One step of the experiment; angles in degrees.
#[derive(Debug, Clone, PartialEq)]
pub enum Step {
    /// Turns to angles within rate and acceleration limits; angles that are not given stay.
    Slew {
        /// Heading; `None` leaves it.
        yaw_deg: Option<f64>,
        /// Pitch and roll; `None` leaves them.
        tilt_deg: Option<(f64, f64)>,
        /// Rate limit [deg/s].
        rate_deg_s: f64,
        /// Acceleration limit [deg/s^2].
        acceleration_deg_s2: f64,
        /// Length \[s\].
        duration_s: f64,
    },
    /// Swings one angle.
    Scan {
        /// yaw, pitch or roll.
        axis: &'static str,
        /// Amplitude \[deg\].
        amplitude_deg: f64,
        /// Period \[s\].
        period_s: f64,
        /// Length \[s\].
        duration_s: f64,
    },
    /// Plays an excitation of the manoeuvre.
    Excite {
        /// Its name.
        excitation: &'static str,
        /// Fastest rate that it brings [deg/s].
        rate_deg_s: f64,
        /// Largest acceleration that it brings [deg/s^2].
        acceleration_deg_s2: f64,
        /// Length \[s\].
        duration_s: f64,
    },
    /// Waits.
    Hold {
        /// Length \[s\].
        duration_s: f64,
    },
}

/// An excitation: signals that the platform's own control plays in open loop.
#[derive(Debug, Clone, PartialEq)]
pub struct Excitation {
    /// Its name.
    pub name: &'static str,
    /// What control keeps holding meanwhile: attitude, tilt or nothing.
    pub hold: &'static str,
    /// What is driven.
    pub drive: Drive,
}

/// Actuators driven by an excitation.
#[derive(Debug, Clone, PartialEq)]
pub enum Drive {
    /// None: the platform coasts.
    Nothing,
    /// Wheels, with a signal.
    Wheels {
        /// Which.
        names: Vec<String>,
        /// Kind of signal.
        signal: &'static str,
        /// Amplitude [N m].
        torque_n_m: f64,
        /// Period \[s\].
        period_s: f64,
        /// Highest frequency in it \[Hz\].
        highest_hz: f64,
    },
    /// One jet after the other, with each of these lengths.
    Jets {
        /// Which.
        names: Vec<String>,
        /// Lengths of pulses, in turn \[s\].
        on_time_s: Vec<f64>,
        /// From pulse to pulse \[s\].
        every_s: f64,
    },
}

/// A manoeuvre of the family.
#[derive(Debug, Clone, PartialEq)]
pub struct Manoeuvre {
    /// Short name.
    pub name: &'static str,
    /// Description, to complete "the platform ...".
    pub words: &'static str,
    /// With which actuators.
    pub actuators: Actuators,
    /// Its steps, after settling at balance.
    pub steps: Vec<Step>,
    /// Excitations played by its steps.
    pub excitations: Vec<Excitation>,
}

impl Manoeuvre {
    /// Largest rate and acceleration that its steps ask for.
    pub fn demand_deg_s(&self) -> (f64, f64) {
        self.steps.iter().fold((1.0, 0.6), |(rate, acceleration), step| {
            let (r, a) = match step {
                Step::Slew { rate_deg_s, acceleration_deg_s2, .. }
                | Step::Excite { rate_deg_s, acceleration_deg_s2, .. } => (*rate_deg_s, *acceleration_deg_s2),
                Step::Scan { amplitude_deg, period_s, .. } => {
                    let omega = std::f64::consts::TAU / period_s;
                    (amplitude_deg * omega, amplitude_deg * omega * omega)
                }
                Step::Hold { .. } => (0.0, 0.0),
            };
            (rate.max(r), acceleration.max(a))
        })
    }
}

/// Limits of a platform that matter for manoeuvres.
#[derive(Debug, Clone, PartialEq)]
pub struct Envelope {
    /// Attitude at which it balances: pitch, roll \[deg\].
    pub balance_deg: (f64, f64),
    /// Available tilt about balance \[deg\].
    pub tilt_deg: f64,
    /// Yaw rate [deg/s] and acceleration [deg/s^2] with the wheels.
    pub wheels: Option<(f64, f64)>,
    /// Yaw acceleration [deg/s^2] with the jets.
    pub jets: Option<f64>,
    /// Torque about x and y that wheels give [N m].
    torque_n_m: f64,
    inertia_kg_m2: f64,
    stiffness_n_m: f64,
    /// Whether gravity brings it back when released.
    stable: bool,
    /// Names of all wheels, and of those that turn it in yaw.
    wheel_names: Vec<String>,
    yaw_wheels: Vec<String>,
    /// Torque of one wheel in an excitation [N m].
    wheel_torque_n_m: f64,
    jet_names: Vec<String>,
    /// A long and a short pulse \[s\].
    pulses_s: Vec<f64>,
}

impl Envelope {
    /// Limits of a platform; `scale` shrinks every motion.
    pub fn of(model: &PlatformModel, scale: f64) -> Self {
        let mgr = model.mass_properties.gravity_offset_b_n_m();
        let up = if mgr.z < -1e-3 { -mgr / mgr.norm() } else { nalgebra::Vector3::z() };
        let (limit, tilt_at_balance) = match model.tilt_limit {
            TiltLimit::Cone { max_rad } => (max_rad, up.z.clamp(-1.0, 1.0).acos()),
            TiltLimit::Pitch { max_rad } => (max_rad, up.x.clamp(-1.0, 1.0).asin().abs()),
        };
        let limit_deg = deg_from_rad(limit);
        let rests_inside = deg_from_rad(tilt_at_balance) < limit_deg - TILT_MARGIN_DEG;
        let balance_deg = if rests_inside {
            (deg_from_rad((-up.x).asin()), deg_from_rad(up.y.atan2(up.z)))
        } else {
            (0.0, 0.0)
        };
        let used_deg = if rests_inside { deg_from_rad(tilt_at_balance) } else { 0.0 };
        let inertia = model.mass_properties.inertia_b_kg_m2();
        let about = |axis: usize| {
            let sum = |of: &dyn Fn(&whorl_dynamics::platform::Wheel) -> f64| {
                model.wheels().iter().map(|w| w.spin_axis_b[axis].abs() * of(w)).sum::<f64>()
            };
            (sum(&|w| w.max_torque_n_m), sum(&|w| w.spin_inertia_kg_m2 * w.max_speed_rad_s))
        };
        let (torque_z, momentum_z) = about(2);
        let wheels = (torque_z > 0.0).then(|| {
            let rate = deg_from_rad(0.35 * momentum_z / inertia[(2, 2)]).min(RATE_MOST_DEG_S);
            (rate * scale, deg_from_rad(0.5 * torque_z / inertia[(2, 2)]) * scale)
        });
        // Both ways about the vertical; half of it is left for disturbances.
        let (mut plus, mut minus) = (0.0, 0.0);
        for jet in model.jets() {
            let torque = jet.position_b_m.cross(&jet.force_direction_b).z * jet.thrust_n;
            if torque > 0.0 { plus += torque } else { minus -= torque }
        }
        let torque: f64 = 0.5 * f64::min(plus, minus);
        let jets = (torque > 0.0).then(|| deg_from_rad(torque / inertia[(2, 2)]) * scale);
        Self {
            balance_deg,
            tilt_deg: (limit_deg - TILT_MARGIN_DEG - used_deg).clamp(0.2, TILT_MOST_DEG) * scale,
            wheels,
            jets,
            torque_n_m: 0.5 * about(0).0.min(about(1).0) * scale,
            inertia_kg_m2: inertia[(0, 0)].max(inertia[(1, 1)]),
            stiffness_n_m: mgr.norm(),
            stable: mgr.z < -STABLE_N_M && rests_inside,
            wheel_names: model.wheels().iter().map(|w| w.name.clone()).collect(),
            yaw_wheels: model
                .wheels()
                .iter()
                .filter(|w| w.spin_axis_b.z.abs() > YAW_AXIS)
                .map(|w| w.name.clone())
                .collect(),
            wheel_torque_n_m: 0.5
                * model.wheels().iter().map(|w| w.max_torque_n_m).fold(f64::INFINITY, f64::min)
                * scale,
            jet_names: model.jets().iter().map(|j| j.name.clone()).collect(),
            pulses_s: {
                let least = 1.5 * model.jets().iter().map(|j| j.min_on_time_s).fold(0.0, f64::max);
                PULSES_S
                    .map(|on_s| (on_s * scale).clamp(least.min(LONGEST_PULSE_S), LONGEST_PULSE_S))
                    .to_vec()
            },
        }
    }

    /// Amplitude of a swing in tilt that the torque allows \[deg\].
    fn swing_deg(&self, torque_n_m: f64, period_s: f64) -> f64 {
        let omega = std::f64::consts::TAU / period_s;
        let needed = (self.inertia_kg_m2 * omega * omega - self.stiffness_n_m).abs().max(0.2);
        deg_from_rad(torque_n_m / needed).min(self.tilt_deg)
    }
}

/// Duration of a turn \[s\]: a smooth one needs 50 % more time to gain and lose speed than an abrupt one.
fn turn_s(angle_deg: f64, rate_deg_s: f64, acceleration_deg_s2: f64) -> f64 {
    let angle = angle_deg.abs();
    let gain_s = 1.5 * rate_deg_s / acceleration_deg_s2;
    if angle > rate_deg_s * gain_s {
        angle / rate_deg_s + gain_s
    } else {
        2.0 * (1.5 * angle / acceleration_deg_s2).sqrt()
    }
}

/// A plan under construction, with the current yaw.
struct Plan<'a> {
    envelope: &'a Envelope,
    acceleration_deg_s2: f64,
    yaw_deg: f64,
    steps: Vec<Step>,
    excitations: Vec<Excitation>,
}

impl<'a> Plan<'a> {
    fn new(envelope: &'a Envelope, acceleration_deg_s2: f64) -> Self {
        Self { envelope, acceleration_deg_s2, yaw_deg: 0.0, steps: Vec::new(), excitations: Vec::new() }
    }

    fn yaw(&mut self, to_deg: f64, rate_deg_s: f64) {
        let duration_s = turn_s(to_deg - self.yaw_deg, rate_deg_s, self.acceleration_deg_s2) + 1.0;
        self.steps.push(self.turn(Some(to_deg), None, rate_deg_s, duration_s));
        self.yaw_deg = to_deg;
    }

    /// A turn that continues during the next steps.
    fn yaw_meanwhile(&mut self, to_deg: f64, rate_deg_s: f64) -> f64 {
        let whole_s = turn_s(to_deg - self.yaw_deg, rate_deg_s, self.acceleration_deg_s2);
        self.steps.push(self.turn(Some(to_deg), None, rate_deg_s, 4.0));
        self.yaw_deg = to_deg;
        whole_s - 4.0
    }

    /// Tilts about balance: pitch, roll.
    fn tilt(&mut self, pitch_deg: f64, roll_deg: f64) {
        let (pitch, roll) = self.envelope.balance_deg;
        let step = self.turn(None, Some((pitch + pitch_deg, roll + roll_deg)), 1.0, 6.0);
        self.steps.push(step);
    }

    fn turn(&self, yaw: Option<f64>, tilt: Option<(f64, f64)>, rate: f64, duration_s: f64) -> Step {
        Step::Slew {
            yaw_deg: yaw,
            tilt_deg: tilt,
            rate_deg_s: rate,
            acceleration_deg_s2: self.acceleration_deg_s2,
            duration_s,
        }
    }

    fn scan(&mut self, axis: &'static str, amplitude_deg: f64, period_s: f64, periods: f64) {
        self.steps.push(Step::Scan { axis, amplitude_deg, period_s, duration_s: period_s * periods });
    }

    /// A yaw swing as large as rate and acceleration allow.
    fn swing_yaw(&mut self, rate_deg_s: f64, period_s: f64, periods: f64) {
        let omega = std::f64::consts::TAU / period_s;
        let amplitude = (rate_deg_s / omega).min(self.acceleration_deg_s2 / (omega * omega)).min(60.0);
        self.scan("yaw", amplitude, period_s, periods);
    }

    fn swing_tilt(&mut self, axis: &'static str, torque_n_m: f64, period_s: f64, periods: f64) {
        let amplitude = self.envelope.swing_deg(torque_n_m, period_s);
        self.scan(axis, amplitude, period_s, periods);
    }

    /// Plays an excitation.
    fn excite(&mut self, name: &'static str, hold: &'static str, drive: Drive, duration_s: f64) {
        let (rate_deg_s, _) = self.envelope.wheels.unwrap_or((RATE_MOST_DEG_S, 0.0));
        let acceleration_deg_s2 = self.acceleration_deg_s2;
        self.steps.push(Step::Excite { excitation: name, rate_deg_s, acceleration_deg_s2, duration_s });
        if self.excitations.iter().all(|e| e.name != name) {
            self.excitations.push(Excitation { name, hold, drive });
        }
    }

    /// A signal on wheels while the tilt is held and yaw is left alone, and back to balance.
    fn signal(&mut self, signal: &'static str, highest_hz: f64, duration_s: f64) {
        let drive = Drive::Wheels {
            names: self.envelope.wheel_names.clone(),
            signal,
            torque_n_m: self.envelope.wheel_torque_n_m,
            period_s: 30.0,
            highest_hz,
        };
        self.excite(signal, "tilt", drive, duration_s);
        self.stop();
    }

    /// Comes to rest at balance, from any rate.
    fn stop(&mut self) {
        let (pitch, roll) = self.envelope.balance_deg;
        let (rate, _) = self.envelope.wheels.unwrap_or((1.0, 0.0));
        let duration_s = 4.0 + 1.5 * rate / self.acceleration_deg_s2;
        let step = self.turn(None, Some((pitch, roll)), 1.0, duration_s);
        self.steps.push(step);
    }

    /// Spins up in yaw with the wheels, then coasts.
    fn spin_up_and_coast(&mut self, name: &'static str, sign: f64) {
        let Some((rate_deg_s, acceleration_deg_s2)) = self.envelope.wheels else { return };
        // `acceleration_deg_s2` is based on half the torque of all yaw wheels.
        let torque_n_m = self.envelope.wheel_torque_n_m * sign;
        let drive = Drive::Wheels {
            names: self.envelope.yaw_wheels.clone(),
            signal: "constant",
            torque_n_m,
            period_s: 30.0,
            highest_hz: 1.0,
        };
        self.excite(name, "tilt", drive, rate_deg_s / acceleration_deg_s2);
        let hold = if self.envelope.stable { "nothing" } else { "tilt" };
        self.excite("coast", hold, Drive::Nothing, COAST_S);
        self.stop();
    }

    fn hold(&mut self, duration_s: f64) {
        self.steps.push(Step::Hold { duration_s });
    }
}

/// All manoeuvres for which the platform has the actuators.
pub fn family(envelope: &Envelope) -> Vec<Manoeuvre> {
    let mut all = Vec::new();
    if let Some((rate, acceleration)) = envelope.wheels {
        let torque = envelope.torque_n_m;
        let mut add = |name, words, write: &dyn Fn(&mut Plan<'_>)| {
            let mut plan = Plan::new(envelope, acceleration);
            write(&mut plan);
            let Plan { steps, excitations, .. } = plan;
            all.push(Manoeuvre { name, words, actuators: Actuators::Wheels, steps, excitations });
        };
        add("yaw_rates", "turns in yaw at rates over 10:1, both ways, each time to a full stop", &|p| {
            p.yaw(12.0 * rate, rate);
            p.hold(2.0);
            p.yaw(11.0 * rate, 0.1 * rate);
            p.yaw(6.0 * rate, 0.4 * rate);
            p.hold(2.0);
            p.yaw(7.0 * rate, 0.1 * rate);
            p.yaw(-4.0 * rate, rate);
        });
        add("slow_turn", "turns slowly by half a turn at balance, tilts, and turns back tilted", &|p| {
            p.yaw(175.0, 0.7 * rate);
            p.tilt(0.6 * envelope.tilt_deg, -0.6 * envelope.tilt_deg);
            p.yaw(0.0, 0.7 * rate);
            p.tilt(0.0, 0.0);
        });
        add("swings", "swings about yaw, pitch and roll, slow and fast", &|p| {
            p.swing_yaw(rate, 24.0, 1.0);
            p.swing_yaw(rate, 9.0, 2.0);
            p.swing_tilt("pitch", torque, 7.0, 2.0);
            p.swing_tilt("roll", torque, 5.0, 3.0);
            p.swing_tilt("pitch", torque, 3.0, 4.0);
        });
        add(
            "wheel_sweep",
            "drives one wheel after the other at rest, then again during a steady yaw turn",
            &|p| {
                for _ in 0..2 {
                    p.swing_tilt("pitch", torque, 4.0, 3.0);
                    p.swing_tilt("roll", torque, 4.0, 3.0);
                    if p.yaw_deg == 0.0 {
                        p.swing_yaw(rate, 6.0, 2.0);
                        p.yaw_meanwhile(175.0, 0.6 * rate);
                    }
                }
                p.hold(6.0);
            },
        );
        add("headings", "holds and swings at two headings far apart", &|p| {
            for heading in [80.0, -80.0] {
                p.yaw(heading, rate);
                p.hold(8.0);
                p.swing_yaw(0.5 * rate, 10.0, 1.0);
                p.tilt(0.5 * envelope.tilt_deg, 0.5 * envelope.tilt_deg);
                p.tilt(0.0, 0.0);
            }
        });
        add("multisine", "plays a multisine on every wheel, with its tilt held and its yaw free", &|p| {
            p.signal("multisine", 1.0, 60.0);
        });
        add("prbs", "plays a binary sequence on every wheel, with its tilt held and its yaw free", &|p| {
            // 127 bits of half a second.
            p.signal("prbs", 1.0, 64.0);
        });
        if !envelope.yaw_wheels.is_empty() {
            add("coast", "spins up in yaw and coasts, to both sides", &|p| {
                p.spin_up_and_coast("spin_up", 1.0);
                p.spin_up_and_coast("spin_back", -1.0);
            });
        }
        if !envelope.jet_names.is_empty() {
            add(
                "jet_pulses",
                "fires one jet after the other, long and short, while the wheels hold it",
                &|p| {
                    let names = envelope.jet_names.clone();
                    let pulses = names.len() * envelope.pulses_s.len();
                    let drive =
                        Drive::Jets { names, on_time_s: envelope.pulses_s.clone(), every_s: PULSE_EVERY_S };
                    p.excite("pulses", "attitude", drive, PULSE_EVERY_S * pulses as f64);
                    p.hold(2.0);
                },
            );
        }
    }
    if let Some(acceleration) = envelope.jets {
        let mut plan = Plan::new(envelope, acceleration);
        plan.swing_yaw(3.0, 16.0, 2.0);
        for axis in ["pitch", "roll"] {
            let amplitude = envelope.swing_deg(0.15, 6.0).min(0.6 * envelope.tilt_deg);
            plan.scan(axis, amplitude, 6.0, 3.0);
        }
        plan.yaw(6.0, 1.5);
        plan.yaw(0.0, 1.5);
        all.push(Manoeuvre {
            name: "jets",
            words: "swings and steps about every axis with the jets alone, in pulses",
            actuators: Actuators::Jets,
            steps: plan.steps,
            excitations: Vec::new(),
        });
    }
    all
}
