//! The competing manoeuvres, as experiments.

use std::f64::consts::TAU;

use nalgebra::Vector3;
use whorl_dynamics::PlatformModel;
use whorl_dynamics::platform::{TiltLimit, Wheel};
use whorl_math::deg_from_rad;

/// Margin to the tilt limit for control errors, and largest tilt about balance \[deg\].
const TILT_MARGIN_DEG: f64 = 1.0;
const TILT_MOST_DEG: f64 = 2.5;
/// Fastest yaw rate with wheels, and yaw rate with jets [deg/s].
const RATE_MOST_DEG_S: f64 = 16.0;
const RATE_OF_JETS_DEG_S: f64 = 3.0;
/// Torque about x and y of jets that fire in pulses [N m].
const TORQUE_OF_JETS_N_M: f64 = 0.15;
/// Rate [deg/s] and acceleration [deg/s^2] that control may need beside what is planned.
const LEAST_DEMAND_DEG_S: (f64, f64) = (1.0, 0.6);
/// Above this stiffness, gravity brings a platform back from a few degrees [N m].
const STABLE_N_M: f64 = 0.5;
/// A wheel whose axis is nearer to the vertical than 45 deg turns the platform in yaw.
const YAW_AXIS: f64 = 0.707;
/// Lengths of a long and a short pulse, and the longest that a jet slot holds \[s\].
const PULSES_S: [f64; 2] = [0.09, 0.03];
const LONGEST_PULSE_S: f64 = 0.1;
/// Initial time for settling at balance, of a tilt, from pulse to pulse, and of coasting \[s\].
const SETTLE_S: f64 = 8.0;
const TILT_S: f64 = 6.0;
const PULSE_EVERY_S: f64 = 2.0;
const COAST_S: f64 = 30.0;

/// A step in terms of what a platform can do.
#[derive(Debug, Clone, Copy)]
enum Step {
    /// Turns to the yaw that the full rate reaches from zero in this time \[s\], at this share of the rate.
    Turn(f64, f64),
    /// Turns to this yaw \[deg\], at this share of the rate.
    Head(f64, f64),
    /// Tilts in pitch and roll to these shares of the available tilt.
    Tilt(f64, f64),
    /// Swings about an axis, as far as the platform can in this period \[s\], so many times.
    Swing(&'static str, f64, f64),
    /// Holds its attitude for so long \[s\].
    Hold(f64),
    /// Spins up with this sign and coasts.
    Coast(f64),
    /// Fires one jet after the other, with each length of a pulse, while the wheels hold the attitude.
    Pulses,
}
use Step::{Coast, Head, Hold, Pulses, Swing, Tilt, Turn};

/// Name, words to complete "the platform ...", actuators and steps of each.
type Row = (&'static str, &'static str, &'static str, &'static [Step]);

const FAMILY: [Row; 6] = [
    (
        "yaw_rates",
        "turns in yaw at rates over 10:1, both ways, each time to a full stop",
        "wheels",
        &[Turn(12., 1.), Hold(2.), Turn(11., 0.1), Turn(6., 0.4), Hold(2.), Turn(7., 0.1), Turn(-4., 1.)],
    ),
    (
        "slow_turn",
        "turns slowly by half a turn at balance, tilts, and turns back tilted",
        "wheels",
        &[Head(175., 0.7), Tilt(0.6, -0.6), Head(0., 0.7), Tilt(0., 0.)],
    ),
    (
        "swings",
        "swings about yaw, pitch and roll, slow and fast",
        "wheels",
        &[
            Swing("yaw", 24., 1.),
            Swing("yaw", 9., 2.),
            Swing("pitch", 7., 2.),
            Swing("roll", 5., 3.),
            Swing("pitch", 3., 4.),
        ],
    ),
    ("coast", "spins up in yaw and coasts, to both sides", "wheels", &[Coast(1.), Coast(-1.)]),
    (
        "jet_pulses",
        "fires one jet after the other, long and short, while the wheels hold it",
        "wheels",
        &[Pulses, Hold(2.)],
    ),
    (
        "jets",
        "swings and steps about every axis with the jets alone, in pulses",
        "jets",
        &[Swing("yaw", 16., 2.), Swing("pitch", 6., 3.), Swing("roll", 6., 3.), Turn(2., 0.5), Turn(0., 0.5)],
    ),
];

/// A manoeuvre of the family for one platform.
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
    /// Attitude at which it balances and begins: pitch, roll \[deg\].
    pub balance_deg: (f64, f64),
}

/// All manoeuvres for which the platform has the actuators; `scale` shrinks every motion.
#[must_use]
pub fn family(model: &PlatformModel, scale: f64) -> Vec<Manoeuvre> {
    FAMILY.into_iter().filter_map(|row| Plan::of(row, model, scale)).collect()
}

/// A manoeuvre under construction.
struct Plan<'a> {
    model: &'a PlatformModel,
    scale: f64,
    /// Available tilt about balance \[deg\].
    tilt_deg: f64,
    /// What its actuators can do: in yaw [deg/s], [deg/s^2], and about x and y [N m].
    rate_deg_s: f64,
    acceleration_deg_s2: f64,
    torque_n_m: f64,
    /// Whether gravity brings the platform back when released.
    is_stable: bool,
    yaw_deg: f64,
    written: Manoeuvre,
}

impl<'a> Plan<'a> {
    /// `None` where the platform does not have the actuators.
    fn of((name, words, actuators, steps): Row, model: &'a PlatformModel, scale: f64) -> Option<Manoeuvre> {
        let mgr = model.mass_properties.gravity_offset_b_n_m();
        let up = if mgr.z < -1e-3 { -mgr / mgr.norm() } else { Vector3::z() };
        let limit_deg = deg_from_rad(model.tilt_limit.max_rad());
        let tilt_deg = deg_from_rad(tilt_rad(model.tilt_limit, &up));
        let rests_inside = tilt_deg < limit_deg - TILT_MARGIN_DEG;
        let (balance_deg, used_deg) = if rests_inside {
            ((deg_from_rad((-up.x).asin()), deg_from_rad(up.y.atan2(up.z))), tilt_deg)
        } else {
            ((0.0, 0.0), 0.0)
        };
        let inertia_z_kg_m2 = model.mass_properties.inertia_b_kg_m2()[(2, 2)];
        let yaw_deg = |x: f64| deg_from_rad(x / inertia_z_kg_m2);
        let about = |axis: usize, of: fn(&Wheel) -> f64| -> f64 {
            model.wheels().iter().map(|w| w.spin_axis_b[axis].abs() * of(w)).sum()
        };
        let [x, y, z] = [0, 1, 2].map(|axis| 0.5 * about(axis, |w| w.max_torque_n_m));
        let momentum_n_m_s = about(2, |w| w.spin_inertia_kg_m2 * w.max_speed_rad_s);
        let (yaw_n_m, rate_deg_s, torque_n_m) = if actuators == "jets" {
            // Both ways about the vertical; half of it is left for disturbances.
            let jets = model.jets().iter().map(|jet| jet.torque_b_n_m().z);
            let [plus, minus] =
                [1.0, -1.0].map(|sign| jets.clone().map(|n_m| (sign * n_m).max(0.0)).sum::<f64>());
            (0.5 * plus.min(minus), RATE_OF_JETS_DEG_S, TORQUE_OF_JETS_N_M)
        } else {
            (z, yaw_deg(0.35 * momentum_n_m_s).min(RATE_MOST_DEG_S), x.min(y))
        };
        let mut plan = Self {
            model,
            scale,
            tilt_deg: (limit_deg - TILT_MARGIN_DEG - used_deg).clamp(0.2, TILT_MOST_DEG) * scale,
            rate_deg_s: rate_deg_s * scale,
            acceleration_deg_s2: yaw_deg(yaw_n_m) * scale,
            torque_n_m: torque_n_m * scale,
            is_stable: mgr.z < -STABLE_N_M && rests_inside,
            yaw_deg: 0.0,
            written: Manoeuvre {
                name,
                words,
                actuators,
                steps: Vec::new(),
                excitations: Vec::new(),
                demand_deg_s: LEAST_DEMAND_DEG_S,
                balance_deg,
            },
        };
        let is_possible = yaw_n_m > 0.0 && steps.iter().all(|step| plan.write(*step));
        is_possible.then_some(plan.written)
    }

    /// Whether the platform can do it.
    fn write(&mut self, step: Step) -> bool {
        let (rate_deg_s, acceleration_deg_s2) = (self.rate_deg_s, self.acceleration_deg_s2);
        match step {
            Turn(s, share) => return self.write(Head(s * rate_deg_s, share)),
            Head(to_deg, share) => {
                let duration_s = 1.0 + turn_s(to_deg - self.yaw_deg, share * rate_deg_s, acceleration_deg_s2);
                let wrapped_deg = (to_deg + 180.0).rem_euclid(360.0) - 180.0;
                self.turn(&format!("yaw_deg: {wrapped_deg:.1}"), share * rate_deg_s, duration_s);
                self.yaw_deg = to_deg;
            }
            Tilt(pitch, roll) => self.tilt(pitch * self.tilt_deg, roll * self.tilt_deg, TILT_S),
            Swing(axis, period_s, periods) => {
                let (amplitude_deg, omega) = (self.swing_deg(axis, period_s), TAU / period_s);
                let more =
                    format!(", axis: {axis}, amplitude_deg: {amplitude_deg:.2}, period_s: {period_s:.1}");
                let demand_deg_s = (amplitude_deg * omega, amplitude_deg * omega * omega);
                self.step("swing", "scan", period_s * periods, &more, demand_deg_s);
            }
            Hold(duration_s) => self.step("hold", "hold", duration_s, "", (0.0, 0.0)),
            Coast(sign) => {
                let wheels = self.model.wheels().iter();
                let torque_n_m = wheels.clone().map(|w| w.max_torque_n_m).fold(f64::INFINITY, f64::min);
                let yaw = wheels.filter(|w| w.spin_axis_b.z.abs() > YAW_AXIS);
                let names: Vec<&str> = yaw.map(|wheel| wheel.name.as_str()).collect();
                let drive = format!(
                    ", wheels: [{}], signal: constant, torque_n_m: {:.4}",
                    names.join(", "),
                    0.5 * sign * self.scale * torque_n_m
                );
                let name = if sign > 0.0 { "spin_up" } else { "spin_back" };
                // The acceleration is based on half the torque of all yaw wheels.
                self.excite(name, "tilt", drive, rate_deg_s / acceleration_deg_s2);
                self.excite("coast", if self.is_stable { "nothing" } else { "tilt" }, String::new(), COAST_S);
                // Comes to rest at balance, from any rate.
                self.tilt(0.0, 0.0, 4.0 + 1.5 * rate_deg_s / acceleration_deg_s2);
                return !names.is_empty();
            }
            Pulses => {
                let jets = self.model.jets();
                let least_s = 1.5 * jets.iter().map(|jet| jet.min_on_time_s).fold(0.0, f64::max);
                let on_s = PULSES_S.map(|on_s| {
                    let on_s = (on_s * self.scale).clamp(least_s.min(LONGEST_PULSE_S), LONGEST_PULSE_S);
                    format!("{on_s:.3}")
                });
                let names: Vec<&str> = jets.iter().map(|jet| jet.name.as_str()).collect();
                let (names, on_s) = (names.join(", "), on_s.join(", "));
                let drive = format!(", jets: [{names}], on_time_s: [{on_s}], every_s: {PULSE_EVERY_S:.1}");
                let count = jets.len() * PULSES_S.len();
                self.excite("pulses", "attitude", drive, PULSE_EVERY_S * count as f64);
                return count > 0;
            }
        }
        true
    }

    /// Amplitude of a swing that rate and acceleration in yaw, or the torque in tilt, allow \[deg\].
    fn swing_deg(&self, axis: &str, period_s: f64) -> f64 {
        let omega = TAU / period_s;
        if axis == "yaw" {
            return (self.rate_deg_s / omega).min(self.acceleration_deg_s2 / (omega * omega)).min(60.0);
        }
        let mass = &self.model.mass_properties;
        let inertia_kg_m2 = mass.inertia_b_kg_m2()[(0, 0)].max(mass.inertia_b_kg_m2()[(1, 1)]);
        let needed = inertia_kg_m2 * omega * omega - mass.gravity_offset_b_n_m().norm();
        deg_from_rad(self.torque_n_m / needed.abs().max(0.2)).min(self.tilt_deg)
    }

    /// Adds a step that lasts so long and asks for these rates and accelerations.
    fn step(&mut self, name: &str, kind: &str, duration_s: f64, more: &str, demand_deg_s: (f64, f64)) {
        let Manoeuvre { steps, demand_deg_s: all, .. } = &mut self.written;
        let number = steps.len() + 1;
        steps.push(format!("{name}_{number}: {{kind: {kind}, duration_s: {duration_s:.1}{more}}}"));
        *all = (all.0.max(demand_deg_s.0), all.1.max(demand_deg_s.1));
    }

    /// Turns to angles within rate and acceleration limits; angles that are not given stay.
    fn turn(&mut self, angles: &str, rate_deg_s: f64, duration_s: f64) {
        let acceleration_deg_s2 = self.acceleration_deg_s2;
        let more = format!(
            ", {angles}, rate_max_deg_s: {rate_deg_s:.2}, acceleration_max_deg_s2: {acceleration_deg_s2:.2}"
        );
        self.step("turn", "slew", duration_s, &more, (rate_deg_s, acceleration_deg_s2));
    }

    /// Tilts about balance.
    fn tilt(&mut self, pitch_deg: f64, roll_deg: f64, duration_s: f64) {
        let (pitch, roll) = self.written.balance_deg;
        let angles = format!("pitch_deg: {:.2}, roll_deg: {:.2}", pitch + pitch_deg, roll + roll_deg);
        self.turn(&angles, 1.0, duration_s);
    }

    /// Plays an excitation: signals that the platform's own control plays in open loop, while it keeps holding attitude, tilt or nothing.
    fn excite(&mut self, name: &str, hold: &str, drive: String, duration_s: f64) {
        let demand_deg_s = (self.rate_deg_s, self.acceleration_deg_s2);
        self.step(name, "excite", duration_s, &format!(", excitation: {name}"), demand_deg_s);
        let excitation = format!("{name}: {{hold: {hold}{drive}}}");
        if !self.written.excitations.contains(&excitation) {
            self.written.excitations.push(excitation);
        }
    }
}

/// The tilt that counts against a limit \[rad\], by the direction of the vertical in body axes.
pub(super) fn tilt_rad(limit: TiltLimit, up_b: &Vector3<f64>) -> f64 {
    match limit {
        TiltLimit::Cone { .. } => up_b.x.hypot(up_b.y).atan2(up_b.z),
        TiltLimit::Pitch { .. } => up_b.x.clamp(-1.0, 1.0).asin().abs(),
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

impl Manoeuvre {
    /// The experiment file under a name, with `comments` at its top, one line each.
    #[must_use]
    pub fn yaml(&self, name: &str, platform: &str, comments: &[String]) -> String {
        let comments: String = comments.iter().map(|comment| format!("# {comment}\n")).collect();
        let lines = |of: &[String]| -> String { of.iter().map(|line| format!("      {line}\n")).collect() };
        let Self { words, actuators, demand_deg_s: (rate, acceleration), .. } = self;
        let (pitch, roll) = self.balance_deg;
        let heading = if self.excitations.is_empty() { "" } else { "    excitations:\n" };
        format!(
            "{comments}/**:\n  ros__parameters:\n    formation:\n      platforms: [{platform}]\n\n\
             /coordinator:\n  ros__parameters:\n    experiment:\n      name: {name}\n      description: {platform} {words}\n    \
             limits:\n      {platform}: {{rate_max_deg_s: {rate:.2}, acceleration_max_deg_s2: {acceleration:.2}}}\n    \
             law: {{kind: leader_follower}}\n    steps:\n      \
             settle: {{kind: settle, duration_s: {SETTLE_S:.1}, yaw_deg: 0.0, pitch_deg: {pitch:.2}, roll_deg: {roll:.2}}}\n\
             {steps}\n/{platform}/local_control:\n  ros__parameters:\n    actuators: {actuators}\n{heading}{excitations}\n\
             # A simulated platform starts where it balances.\n\
             /{platform}/driver:\n  ros__parameters:\n    initial: {{yaw_deg: 0.0, pitch_deg: {pitch:.2}, roll_deg: {roll:.2}}}\n",
            rate = 1.25 * rate,
            acceleration = 1.25 * acceleration,
            steps = lines(&self.steps),
            excitations = lines(&self.excitations),
        )
    }
}
