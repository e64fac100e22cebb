//! The competing manoeuvres, as experiments.

use std::f64::consts::TAU;

use nalgebra::Vector3;
use whorl_dynamics::PlatformModel;
use whorl_dynamics::platform::TiltLimit;
use whorl_math::deg_from_rad;

/// Margin to the tilt limit for control errors, and largest tilt about balance \[deg\].
const TILT_MARGIN_DEG: f64 = 1.0;
const TILT_MOST_DEG: f64 = 2.5;
/// Fastest yaw rate with wheels, yaw rate with jets [deg/s], and torque about x and y of jets that fire in pulses [N m].
const RATE_MOST_DEG_S: f64 = 16.0;
const RATE_OF_JETS_DEG_S: f64 = 3.0;
const TORQUE_OF_JETS_N_M: f64 = 0.15;
/// Lengths of a long and a short pulse, and the longest that a jet slot holds \[s\].
const PULSES_S: [f64; 2] = [0.09, 0.03];
const LONGEST_PULSE_S: f64 = 0.1;
/// Initial time for settling at balance, at least of swings, at the end of a turn, of a tilt, from pulse to pulse \[s\].
const SETTLE_S: f64 = 8.0;
const SWING_S: f64 = 14.0;
const REST_S: f64 = 2.0;
const TILT_S: f64 = 6.0;
const PULSE_EVERY_S: f64 = 2.0;

/// A step in terms of what a platform can do.
#[derive(Debug, Clone, Copy)]
enum Step {
    /// Turns to the yaw that the full rate reaches from zero in this time \[s\], at this share of the rate.
    Turn(f64, f64),
    /// Turns to this yaw \[deg\], at this share of the rate.
    Head(f64, f64),
    /// Tilts in pitch and roll to these shares of the available tilt.
    Tilt([f64; 2]),
    /// Swings about an axis, as far as the platform can in this period \[s\].
    Swing(&'static str, f64),
    /// Fires one jet after the other, with each length of a pulse, while the wheels hold the attitude.
    Pulses,
}
use Step::{Head, Pulses, Swing, Tilt, Turn};

/// Name, words to complete "the platform ...", and steps of each.
type Row = (&'static str, &'static str, &'static [Step]);
const FAMILY: [Row; 4] = [
    (
        "yaw_rates",
        "turns in yaw at rates over 10:1, both ways, each time to a full stop",
        &[Turn(12., 1.), Turn(11., 0.1), Turn(6., 0.4), Turn(7., 0.1), Turn(-4., 1.)],
    ),
    (
        "slow_turn",
        "turns slowly by half a turn at balance, tilts, and turns back tilted",
        &[Head(175., 0.7), Tilt([0.6, -0.6]), Head(0., 0.7), Tilt([0., 0.])],
    ),
    (
        "swings",
        "swings about yaw, pitch and roll, slow and fast",
        &[Swing("yaw", 24.), Swing("yaw", 9.), Swing("pitch", 7.), Swing("roll", 5.), Swing("pitch", 3.)],
    ),
    ("jet_pulses", "fires one jet after the other, long and short, while the wheels hold it", &[Pulses]),
];

/// A manoeuvre of the family for one platform.
#[derive(Debug, Clone, PartialEq)]
pub struct Manoeuvre {
    /// Short name.
    pub name: &'static str,
    /// Description, to complete "the platform ...".
    pub words: &'static str,
    /// What control uses: `wheels` alone, whose momentum is measured while thrust is not, or `jets` where none turns it in yaw.
    pub actuators: &'static str,
    /// Its steps after settling at balance, as lines of an experiment file.
    pub steps: String,
    /// Excitations that its steps play, signals in open loop, likewise.
    pub excitations: String,
    /// Largest rate [deg/s] and acceleration [deg/s^2] that its steps ask for.
    pub demand_deg_s: (f64, f64),
    /// Attitude at which it balances and begins: pitch, roll \[deg\].
    pub balance_deg: [f64; 2],
    /// Available tilt about balance \[deg\].
    tilt_deg: f64,
    /// What its actuators can do: in yaw [deg/s], [deg/s^2], and about x and y [N m].
    rate_deg_s: f64,
    acceleration_deg_s2: f64,
    torque_n_m: f64,
    /// Yaw after the steps so far.
    yaw_deg: f64,
}

/// All manoeuvres for which the platform has the actuators; `scale` shrinks every motion, and no pulse.
pub fn family(model: &PlatformModel, scale: f64) -> Vec<Manoeuvre> {
    FAMILY.into_iter().filter_map(|row| Manoeuvre::of(row, model, scale)).collect()
}

impl Manoeuvre {
    fn of((name, words, steps): Row, model: &PlatformModel, scale: f64) -> Option<Self> {
        let up = vertical_at_balance(model);
        let room_deg = deg_from_rad(model.tilt_limit.max_rad() - tilt_rad(model.tilt_limit, &up));
        let yaw_deg = |x: f64| deg_from_rad(x / model.mass_properties.inertia_b_kg_m2()[(2, 2)]);
        let turns = model.wheels().iter().any(|wheel| wheel.spin_axis_b.z != 0.0);
        let actuators = if turns { "wheels" } else { "jets" };
        let (yaw_n_m, rate_deg_s, torque_n_m) = if !turns {
            // Both ways about the vertical; half of it is left for disturbances.
            let jets = model.jets().iter().map(|jet| jet.torque_b_n_m().z);
            let (all, net): (f64, f64) = (jets.clone().map(f64::abs).sum(), jets.sum());
            (0.25 * (all - net.abs()), RATE_OF_JETS_DEG_S, TORQUE_OF_JETS_N_M)
        } else {
            let wheels = model.wheels().iter();
            let most: Vector3<f64> = wheels.clone().map(|w| w.max_torque_n_m * w.spin_axis_b.abs()).sum();
            let speeds = wheels.map(|w| w.spin_axis_b.z.abs() * w.spin_inertia_kg_m2 * w.max_speed_rad_s);
            let rate_deg_s = yaw_deg(0.35 * speeds.sum::<f64>()).min(RATE_MOST_DEG_S);
            (0.5 * most.z, rate_deg_s, 0.5 * most.x.min(most.y))
        };
        let (rate_deg_s, acceleration_deg_s2) = (rate_deg_s * scale, yaw_deg(yaw_n_m) * scale);
        let mut made = Self {
            name,
            words,
            actuators,
            steps: String::new(),
            excitations: String::new(),
            // Fast swings in tilt need these at least.
            demand_deg_s: (rate_deg_s.max(6.0), acceleration_deg_s2.max(12.0)),
            balance_deg: [(-up.x).asin(), up.y.atan2(up.z)].map(deg_from_rad),
            tilt_deg: (room_deg - TILT_MARGIN_DEG).clamp(0.2, TILT_MOST_DEG) * scale,
            rate_deg_s,
            acceleration_deg_s2,
            torque_n_m: torque_n_m * scale,
            yaw_deg: 0.0,
        };
        (yaw_n_m > 0.0 && steps.iter().all(|step| made.add(model, *step))).then_some(made)
    }

    /// Adds a step; whether the platform can do it.
    fn add(&mut self, model: &PlatformModel, step: Step) -> bool {
        match step {
            Turn(s, share) => return self.add(model, Head(s * self.rate_deg_s, share)),
            Head(to_deg, share) => {
                let (rate_deg_s, turn_deg) = (share * self.rate_deg_s, (to_deg - self.yaw_deg).abs());
                // A smooth turn needs 50 % more time to gain and lose speed than an abrupt one.
                let duration_s = turn_deg / rate_deg_s + 1.5 * rate_deg_s / self.acceleration_deg_s2 + REST_S;
                let wrapped_deg = (to_deg + 180.0).rem_euclid(360.0) - 180.0;
                self.slew(&format!("yaw_deg: {wrapped_deg:.1}"), rate_deg_s, duration_s);
                self.yaw_deg = to_deg;
            }
            Tilt(shares) => {
                let [pitch, roll] = [0, 1].map(|k| self.balance_deg[k] + shares[k] * self.tilt_deg);
                self.slew(&format!("pitch_deg: {pitch:.2}, roll_deg: {roll:.2}"), 1.0, TILT_S);
            }
            Swing(axis, period_s) => {
                let (omega, mass) = (TAU / period_s, &model.mass_properties);
                let swing_deg = if axis == "yaw" {
                    (self.rate_deg_s / omega).min(self.acceleration_deg_s2 / (omega * omega)).min(60.0)
                } else {
                    let inertia_kg_m2 = mass.inertia_b_kg_m2()[(0, 0)].max(mass.inertia_b_kg_m2()[(1, 1)]);
                    let needed = inertia_kg_m2 * omega * omega - mass.gravity_offset_b_n_m().norm();
                    deg_from_rad(self.torque_n_m / needed.abs().max(0.2)).min(self.tilt_deg)
                };
                let more = format!("axis: {axis}, amplitude_deg: {swing_deg:.2}, period_s: {period_s:.1}");
                self.step("swing", "scan", period_s * (SWING_S / period_s).ceil(), &more);
            }
            Pulses => {
                let jets = model.jets();
                let names = jets.iter().map(|jet| jet.name.as_str()).collect::<Vec<_>>().join(", ");
                let least_s = 1.5 * jets.iter().map(|jet| jet.min_on_time_s).fold(0.0, f64::max);
                let [long, short] = PULSES_S.map(|on_s| on_s.max(least_s).min(LONGEST_PULSE_S));
                let drive = format!("on_time_s: [{long:.3}, {short:.3}], every_s: {PULSE_EVERY_S:.1}");
                let all_s = PULSE_EVERY_S * (jets.len() * PULSES_S.len()) as f64;
                self.step("pulses", "excite", all_s + REST_S, "excitation: pulses");
                self.excitations =
                    format!("    excitations:\n      pulses: {{hold: attitude, jets: [{names}], {drive}}}\n");
                return !jets.is_empty() && self.actuators == "wheels";
            }
        }
        true
    }

    fn step(&mut self, name: &str, kind: &str, duration_s: f64, more: &str) {
        let number = self.steps.lines().count() + 1;
        self.steps +=
            &format!("      {name}_{number}: {{kind: {kind}, duration_s: {duration_s:.1}, {more}}}\n");
    }

    /// Turns to angles within rate and acceleration limits; angles that are not given stay.
    fn slew(&mut self, angles: &str, rate_deg_s: f64, duration_s: f64) {
        let acceleration = self.acceleration_deg_s2;
        let more =
            format!("{angles}, rate_max_deg_s: {rate_deg_s:.2}, acceleration_max_deg_s2: {acceleration:.2}");
        self.step("turn", "slew", duration_s, &more);
    }

    /// The experiment file under a name, with `comments` at its top, one line each.
    pub fn yaml(&self, name: &str, platform: &str, comments: &[String]) -> String {
        let comments: String = comments.iter().map(|comment| format!("# {comment}\n")).collect();
        let Self { words, actuators, steps, excitations, demand_deg_s: (rate, acceleration), .. } = self;
        let (rate, acceleration) = (1.25 * rate, 1.25 * acceleration);
        let [pitch, roll] = self.balance_deg;
        format!(
            "{comments}/**:\n  ros__parameters:\n    formation:\n      platforms: [{platform}]\n\n\
             /coordinator:\n  ros__parameters:\n    experiment:\n      name: {name}\n      description: {platform} {words}\n    \
             limits:\n      {platform}: {{rate_max_deg_s: {rate:.2}, acceleration_max_deg_s2: {acceleration:.2}}}\n    \
             law: {{kind: leader_follower}}\n    steps:\n      \
             settle: {{kind: settle, duration_s: {SETTLE_S:.1}, yaw_deg: 0.0, pitch_deg: {pitch:.2}, roll_deg: {roll:.2}}}\n\
             {steps}\n/{platform}/local_control:\n  ros__parameters:\n    actuators: {actuators}\n{excitations}\n\
             # A simulated platform starts where it balances.\n\
             /{platform}/driver:\n  ros__parameters:\n    initial: {{yaw_deg: 0.0, pitch_deg: {pitch:.2}, roll_deg: {roll:.2}}}\n",
        )
    }
}

/// The vertical in body axes where gravity holds the platform; level where it would rest at its stop, or nowhere.
fn vertical_at_balance(model: &PlatformModel) -> Vector3<f64> {
    let mgr = model.mass_properties.gravity_offset_b_n_m();
    let up = if mgr.z < -1e-3 { -mgr / mgr.norm() } else { Vector3::z() };
    let room_deg = deg_from_rad(model.tilt_limit.max_rad() - tilt_rad(model.tilt_limit, &up));
    if room_deg > TILT_MARGIN_DEG { up } else { Vector3::z() }
}

/// The tilt that counts against a limit \[rad\], by the direction of the vertical in body axes.
pub(super) fn tilt_rad(limit: TiltLimit, up_b: &Vector3<f64>) -> f64 {
    match limit {
        TiltLimit::Cone { .. } => up_b.x.hypot(up_b.y).atan2(up_b.z),
        TiltLimit::Pitch { .. } => up_b.x.clamp(-1.0, 1.0).asin().abs(),
    }
}
