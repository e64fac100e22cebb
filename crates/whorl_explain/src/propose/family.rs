//! The competing manoeuvres, as steps of an experiment.

use std::f64::consts::TAU;

use nalgebra::Vector3;
use whorl_dynamics::PlatformModel;
use whorl_dynamics::platform::{TiltLimit, Wheel};
use whorl_math::deg_from_rad;

/// Margin to the tilt limit for control errors \[deg\].
const TILT_MARGIN_DEG: f64 = 1.0;
/// Largest tilt about balance \[deg\].
const TILT_MOST_DEG: f64 = 2.5;
/// Fastest yaw rate \[deg/s\].
const RATE_MOST_DEG_S: f64 = 16.0;
/// Rate [deg/s] and acceleration [deg/s^2] that control may need beside what is planned.
const LEAST_DEMAND_DEG_S: (f64, f64) = (1.0, 0.6);

/// Above this stiffness, gravity brings a platform back from a few degrees [N m].
const STABLE_N_M: f64 = 0.5;
/// A wheel whose axis is nearer to the vertical than 45 deg turns the platform in yaw.
const YAW_AXIS: f64 = 0.707;
/// Lengths of a long and a short pulse, and the longest that a jet slot holds \[s\].
const PULSES_S: [f64; 2] = [0.09, 0.03];
const LONGEST_PULSE_S: f64 = 0.1;
/// Time from pulse to pulse, of a tilt, and of coasting \[s\].
const PULSE_EVERY_S: f64 = 2.0;
const TILT_S: f64 = 6.0;
const COAST_S: f64 = 30.0;

/// A manoeuvre of the family.
#[derive(Debug, Clone, PartialEq)]
pub struct Manoeuvre {
    /// Short name.
    pub name: &'static str,
    /// Description, to complete "the platform ...".
    pub words: &'static str,
    /// What control uses: `wheels` alone, whose momentum is measured while thrust is not, or `jets` alone.
    pub actuators: &'static str,
    /// Its steps after settling at balance, as lines of an experiment file.
    pub steps: Vec<String>,
    /// Excitations played by its steps, likewise.
    pub excitations: Vec<String>,
    /// Largest rate [deg/s] and acceleration [deg/s^2] that its steps ask for.
    pub demand_deg_s: (f64, f64),
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
    pulses_s: [f64; 2],
}

impl Envelope {
    /// Limits of a platform; `scale` shrinks every motion.
    pub fn of(model: &PlatformModel, scale: f64) -> Self {
        let mgr = model.mass_properties.gravity_offset_b_n_m();
        let up = if mgr.z < -1e-3 { -mgr / mgr.norm() } else { Vector3::z() };
        let (limit, tilt_at_balance) = match model.tilt_limit {
            TiltLimit::Cone { max_rad } => (max_rad, up.z.clamp(-1.0, 1.0).acos()),
            TiltLimit::Pitch { max_rad } => (max_rad, up.x.clamp(-1.0, 1.0).asin().abs()),
        };
        let (limit_deg, tilt_deg) = (deg_from_rad(limit), deg_from_rad(tilt_at_balance));
        let rests_inside = tilt_deg < limit_deg - TILT_MARGIN_DEG;
        let (balance_deg, used_deg) = if rests_inside {
            ((deg_from_rad((-up.x).asin()), deg_from_rad(up.y.atan2(up.z))), tilt_deg)
        } else {
            ((0.0, 0.0), 0.0)
        };
        let inertia = model.mass_properties.inertia_b_kg_m2();
        let about = |axis: usize, of: &dyn Fn(&Wheel) -> f64| -> f64 {
            model.wheels().iter().map(|w| w.spin_axis_b[axis].abs() * of(w)).sum()
        };
        let torque_n_m = |axis: usize| about(axis, &|w| w.max_torque_n_m);
        let wheels = (torque_n_m(2) > 0.0).then(|| {
            let momentum_n_m_s = about(2, &|w| w.spin_inertia_kg_m2 * w.max_speed_rad_s);
            let rate = deg_from_rad(0.35 * momentum_n_m_s / inertia[(2, 2)]).min(RATE_MOST_DEG_S);
            (rate * scale, deg_from_rad(0.5 * torque_n_m(2) / inertia[(2, 2)]) * scale)
        });
        // Both ways about the vertical; half of it is left for disturbances.
        let yaw_n_m = model.jets().iter().map(|jet| jet.torque_b_n_m().z);
        let (plus, minus) =
            yaw_n_m.fold((0.0, 0.0), |(p, m), x| (p + f64::max(x, 0.0), m - f64::min(x, 0.0)));
        let torque = 0.5 * f64::min(plus, minus);
        let least_s = 1.5 * model.jets().iter().map(|j| j.min_on_time_s).fold(0.0, f64::max);
        let least_s = least_s.min(LONGEST_PULSE_S);
        let largest_n_m = model.wheels().iter().map(|w| w.max_torque_n_m).fold(f64::INFINITY, f64::min);
        let names = |of: &dyn Fn(&Wheel) -> bool| {
            model.wheels().iter().filter(|w| of(w)).map(|w| w.name.clone()).collect()
        };
        Self {
            balance_deg,
            tilt_deg: (limit_deg - TILT_MARGIN_DEG - used_deg).clamp(0.2, TILT_MOST_DEG) * scale,
            wheels,
            jets: (torque > 0.0).then(|| deg_from_rad(torque / inertia[(2, 2)]) * scale),
            torque_n_m: 0.5 * torque_n_m(0).min(torque_n_m(1)) * scale,
            inertia_kg_m2: inertia[(0, 0)].max(inertia[(1, 1)]),
            stiffness_n_m: mgr.norm(),
            stable: mgr.z < -STABLE_N_M && rests_inside,
            wheel_names: names(&|_| true),
            yaw_wheels: names(&|w| w.spin_axis_b.z.abs() > YAW_AXIS),
            wheel_torque_n_m: 0.5 * largest_n_m * scale,
            jet_names: model.jets().iter().map(|j| j.name.clone()).collect(),
            pulses_s: PULSES_S.map(|on_s| (on_s * scale).clamp(least_s, LONGEST_PULSE_S)),
        }
    }

    /// Amplitude of a swing in tilt that the torque allows \[deg\].
    fn swing_deg(&self, torque_n_m: f64, period_s: f64) -> f64 {
        let omega = TAU / period_s;
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
    manoeuvre: Manoeuvre,
}

impl Plan<'_> {
    /// Adds a step that lasts so long and asks for these rates and accelerations.
    fn step(&mut self, name: &str, kind: &str, duration_s: f64, more: &str, demand_deg_s: (f64, f64)) {
        let Manoeuvre { steps, demand_deg_s: all, .. } = &mut self.manoeuvre;
        let number = steps.len() + 1;
        steps.push(format!("{name}_{number}: {{kind: {kind}, duration_s: {duration_s:.1}{more}}}"));
        *all = (all.0.max(demand_deg_s.0), all.1.max(demand_deg_s.1));
    }

    /// Turns to angles within rate and acceleration limits; angles that are not given stay.
    fn turn(&mut self, name: &str, angles: &str, rate_deg_s: f64, duration_s: f64) {
        let acceleration_deg_s2 = self.acceleration_deg_s2;
        let more = format!(
            ", {angles}, rate_max_deg_s: {rate_deg_s:.2}, acceleration_max_deg_s2: {acceleration_deg_s2:.2}"
        );
        self.step(name, "slew", duration_s, &more, (rate_deg_s, acceleration_deg_s2));
    }

    fn yaw(&mut self, to_deg: f64, rate_deg_s: f64) {
        let duration_s = turn_s(to_deg - self.yaw_deg, rate_deg_s, self.acceleration_deg_s2) + 1.0;
        self.yaw_within(to_deg, rate_deg_s, duration_s);
    }

    /// A turn for which this time may be too short: then it continues during the next steps.
    fn yaw_within(&mut self, to_deg: f64, rate_deg_s: f64, duration_s: f64) {
        let wrapped_deg = (to_deg + 180.0).rem_euclid(360.0) - 180.0;
        self.turn("turn", &format!("yaw_deg: {wrapped_deg:.1}"), rate_deg_s, duration_s);
        self.yaw_deg = to_deg;
    }

    /// Tilts about balance: pitch, roll.
    fn tilt(&mut self, pitch_deg: f64, roll_deg: f64, duration_s: f64) {
        let (pitch, roll) = self.envelope.balance_deg;
        let angles = format!("pitch_deg: {:.2}, roll_deg: {:.2}", pitch + pitch_deg, roll + roll_deg);
        self.turn("tilt", &angles, 1.0, duration_s);
    }

    /// Swings one angle.
    fn scan(&mut self, axis: &str, amplitude_deg: f64, period_s: f64, periods: f64) {
        let omega = TAU / period_s;
        let more = format!(", axis: {axis}, amplitude_deg: {amplitude_deg:.2}, period_s: {period_s:.1}");
        let demand_deg_s = (amplitude_deg * omega, amplitude_deg * omega * omega);
        self.step("swing", "scan", period_s * periods, &more, demand_deg_s);
    }

    /// A yaw swing as large as rate and acceleration allow.
    fn swing_yaw(&mut self, rate_deg_s: f64, period_s: f64, periods: f64) {
        let omega = TAU / period_s;
        let amplitude = (rate_deg_s / omega).min(self.acceleration_deg_s2 / (omega * omega)).min(60.0);
        self.scan("yaw", amplitude, period_s, periods);
    }

    fn swing_tilt(&mut self, axis: &str, torque_n_m: f64, period_s: f64, periods: f64) {
        let amplitude = self.envelope.swing_deg(torque_n_m, period_s);
        self.scan(axis, amplitude, period_s, periods);
    }

    /// Plays an excitation: signals that the platform's own control plays in open loop, while it keeps holding attitude, tilt or nothing.
    fn excite(&mut self, name: &str, hold: &str, drive: &str, duration_s: f64) {
        let (rate_deg_s, _) = self.envelope.wheels.unwrap_or((RATE_MOST_DEG_S, 0.0));
        let demand_deg_s = (rate_deg_s, self.acceleration_deg_s2);
        self.step(name, "excite", duration_s, &format!(", excitation: {name}"), demand_deg_s);
        let excitation = format!("{name}: {{hold: {hold}{drive}}}");
        if !self.manoeuvre.excitations.contains(&excitation) {
            self.manoeuvre.excitations.push(excitation);
        }
    }

    /// What these wheels do in an excitation.
    fn wheels(&self, names: &[String], signal: &str, sign: f64) -> String {
        format!(
            ", wheels: [{}], signal: {signal}, torque_n_m: {:.4}, period_s: 30.0, highest_hz: 1.00",
            names.join(", "),
            sign * self.envelope.wheel_torque_n_m
        )
    }

    /// A signal on wheels while the tilt is held and yaw is left alone, and back to balance.
    fn signal(&mut self, signal: &str, duration_s: f64) {
        let drive = self.wheels(&self.envelope.wheel_names, signal, 1.0);
        self.excite(signal, "tilt", &drive, duration_s);
        self.stop();
    }

    /// Comes to rest at balance, from any rate.
    fn stop(&mut self) {
        let (rate, _) = self.envelope.wheels.unwrap_or((1.0, 0.0));
        self.tilt(0.0, 0.0, 4.0 + 1.5 * rate / self.acceleration_deg_s2);
    }

    /// Spins up in yaw with the wheels, then coasts.
    fn spin_up_and_coast(&mut self, name: &str, sign: f64) {
        let Some((rate_deg_s, acceleration_deg_s2)) = self.envelope.wheels else { return };
        // `acceleration_deg_s2` is based on half the torque of all yaw wheels.
        let drive = self.wheels(&self.envelope.yaw_wheels, "constant", sign);
        self.excite(name, "tilt", &drive, rate_deg_s / acceleration_deg_s2);
        let hold = if self.envelope.stable { "nothing" } else { "tilt" };
        self.excite("coast", hold, "", COAST_S);
        self.stop();
    }

    /// Fires one jet after the other, with each length of a pulse, while the wheels hold the attitude.
    fn pulses(&mut self) {
        let Envelope { jet_names, pulses_s, .. } = self.envelope;
        let drive = format!(
            ", jets: [{}], on_time_s: [{}], every_s: {PULSE_EVERY_S:.1}",
            jet_names.join(", "),
            pulses_s.map(|on_s| format!("{on_s:.3}")).join(", ")
        );
        let count = jet_names.len() * pulses_s.len();
        self.excite("pulses", "attitude", &drive, PULSE_EVERY_S * count as f64);
    }

    fn hold(&mut self, duration_s: f64) {
        self.step("hold", "hold", duration_s, "", (0.0, 0.0));
    }
}

/// All manoeuvres for which the platform has the actuators.
pub fn family(envelope: &Envelope) -> Vec<Manoeuvre> {
    let mut all = Vec::new();
    let mut add = |name, words, (actuators, acceleration_deg_s2), write: &dyn Fn(&mut Plan<'_>)| {
        let (steps, excitations) = (Vec::new(), Vec::new());
        let manoeuvre =
            Manoeuvre { name, words, actuators, steps, excitations, demand_deg_s: LEAST_DEMAND_DEG_S };
        let mut plan = Plan { envelope, acceleration_deg_s2, yaw_deg: 0.0, manoeuvre };
        write(&mut plan);
        all.push(plan.manoeuvre);
    };
    let (tilt_deg, torque) = (envelope.tilt_deg, envelope.torque_n_m);
    if let Some((rate, acceleration)) = envelope.wheels {
        let by = ("wheels", acceleration);
        add("yaw_rates", "turns in yaw at rates over 10:1, both ways, each time to a full stop", by, &|p| {
            p.yaw(12.0 * rate, rate);
            p.hold(2.0);
            p.yaw(11.0 * rate, 0.1 * rate);
            p.yaw(6.0 * rate, 0.4 * rate);
            p.hold(2.0);
            p.yaw(7.0 * rate, 0.1 * rate);
            p.yaw(-4.0 * rate, rate);
        });
        add("slow_turn", "turns slowly by half a turn at balance, tilts, and turns back tilted", by, &|p| {
            p.yaw(175.0, 0.7 * rate);
            p.tilt(0.6 * tilt_deg, -0.6 * tilt_deg, TILT_S);
            p.yaw(0.0, 0.7 * rate);
            p.tilt(0.0, 0.0, TILT_S);
        });
        add("swings", "swings about yaw, pitch and roll, slow and fast", by, &|p| {
            p.swing_yaw(rate, 24.0, 1.0);
            p.swing_yaw(rate, 9.0, 2.0);
            p.swing_tilt("pitch", torque, 7.0, 2.0);
            p.swing_tilt("roll", torque, 5.0, 3.0);
            p.swing_tilt("pitch", torque, 3.0, 4.0);
        });
        let words = "drives one wheel after the other at rest, then again during a steady yaw turn";
        add("wheel_sweep", words, by, &|p| {
            for is_turning in [false, true] {
                p.swing_tilt("pitch", torque, 4.0, 3.0);
                p.swing_tilt("roll", torque, 4.0, 3.0);
                if !is_turning {
                    p.swing_yaw(rate, 6.0, 2.0);
                    p.yaw_within(175.0, 0.6 * rate, 4.0);
                }
            }
            p.hold(6.0);
        });
        add("headings", "holds and swings at two headings far apart", by, &|p| {
            for heading in [80.0, -80.0] {
                p.yaw(heading, rate);
                p.hold(8.0);
                p.swing_yaw(0.5 * rate, 10.0, 1.0);
                p.tilt(0.5 * tilt_deg, 0.5 * tilt_deg, TILT_S);
                p.tilt(0.0, 0.0, TILT_S);
            }
        });
        let words = "plays a multisine on every wheel, with its tilt held and its yaw free";
        add("multisine", words, by, &|p| p.signal("multisine", 60.0));
        // 127 bits of half a second.
        let words = "plays a binary sequence on every wheel, with its tilt held and its yaw free";
        add("prbs", words, by, &|p| p.signal("prbs", 64.0));
        if !envelope.yaw_wheels.is_empty() {
            add("coast", "spins up in yaw and coasts, to both sides", by, &|p| {
                p.spin_up_and_coast("spin_up", 1.0);
                p.spin_up_and_coast("spin_back", -1.0);
            });
        }
        if !envelope.jet_names.is_empty() {
            let words = "fires one jet after the other, long and short, while the wheels hold it";
            add("jet_pulses", words, by, &|p| {
                p.pulses();
                p.hold(2.0);
            });
        }
    }
    if let Some(acceleration) = envelope.jets {
        let words = "swings and steps about every axis with the jets alone, in pulses";
        add("jets", words, ("jets", acceleration), &|p| {
            p.swing_yaw(3.0, 16.0, 2.0);
            for axis in ["pitch", "roll"] {
                p.scan(axis, envelope.swing_deg(0.15, 6.0).min(0.6 * tilt_deg), 6.0, 3.0);
            }
            p.yaw(6.0, 1.5);
            p.yaw(0.0, 1.5);
        });
    }
    all
}
