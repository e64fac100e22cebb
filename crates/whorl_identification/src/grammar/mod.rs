//! Unmodelled laws: functions of one recorded variable that act about an axis, along the rate, on a wheel, or in a
//! sensor's reading.

use nalgebra::{UnitQuaternion, Vector3};
use whorl_dynamics::actuators::wheels::MAX_WHEELS;
use whorl_dynamics::{Plant, PlatformModel};
use whorl_math::{azimuth_rad, vertical_b};
use whorl_prediction::Push;
use whorl_recording::{Recording, Series};

use crate::signals::lines::Lines;
use crate::signals::observed::{Applied, Motion, Observed};

/// Speeds or angles of the wheels; entries beyond the platform's own stay zero.
type Wheels = [f64; MAX_WHEELS];

/// A variable, and its shape as odd or even.
pub(crate) struct Shape {
    pub variable: String,
    pub parity: &'static str,
    pub frequency_hz: Option<f64>,
    /// Its frequency was read off the spectrum of what is to be explained.
    pub is_picked: bool,
    value: Value,
    way: Way,
}

/// About which axes a shape may act.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Way {
    /// Those of the body.
    Body,
    /// Those of the body or of the room.
    BodyOrRoom,
    /// Along the rate, as friction of any law does.
    AlongRate,
    /// On a wheel, about its axis.
    Wheel(usize),
    /// In the gyro's readings, as a dead band of their own rate.
    Gyro,
    /// In the gyro's readings, by something else.
    GyroBy,
    /// In what the vector sensors see, about the vertical.
    Heading,
    /// About the vertical of the room.
    Vertical,
    /// Along the torque of the jets.
    Jets(Jets),
}

/// Which jets.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Jets {
    /// Those that are open.
    Open,
    /// Those that have opened just now.
    Opened,
    /// Those that have closed just now.
    Closed,
}

/// Time for which a valve has opened or closed just now \[s\]: what solenoid valves of a few newtons take, and a pulse has at least.
const EDGE_S: f64 = 0.02;

impl Way {
    /// Axes about which it may act, of the body or of the room.
    fn axes(self, world: bool) -> usize {
        match (self, world) {
            (Self::AlongRate | Self::Wheel(_) | Self::Jets(_), false)
            | (Self::Heading | Self::Vertical, true) => 1,
            (Self::Body | Self::Gyro | Self::GyroBy, false) | (Self::BodyOrRoom, _) => 3,
            _ => 0,
        }
    }
}

/// Knots of the friction of any law, a factor of e apart in the rate.
const FRICTION_KNOTS: u32 = 6;

/// Highest harmonic of the heading: so many teeth has a small motor or a ring of nozzles.
const MOST_TEETH: u32 = 24;

/// Scale of the lowest of them, as a share of the largest rate.
const SLOWEST: f64 = 0.01;

/// One column's error of the gyro [rad/s]: the bias of a usual one.
const GYRO_RAD_S: f64 = 1e-3;

/// One column's torque, as a share of the applied torque RMS.
const SHARE: f64 = 0.02;

/// Slow quantities.
#[derive(Debug, Clone, Copy, Default)]
struct Slow {
    pressure_pa: f64,
    voltage_v: f64,
    temperature_k: f64,
}

/// What a law may depend on, at one instant.
pub(crate) struct At<'a> {
    recording: &'a Recording,
    /// Time since the start of the run, and of the run's first and last readings \[s\].
    time_s: f64,
    run_s: (f64, f64),
    slow: Slow,
    omega: Vector3<f64>,
    q: UnitQuaternion<f64>,
    wheel: Wheels,
    /// Angle that each wheel has turned since the first instant \[rad\].
    wheel_angle: Wheels,
    /// Torque of the jets that are open, that have opened and that have closed just now, body axes [N m], and how many are open.
    jets_b_n_m: [Vector3<f64>; 3],
    open: f64,
}

impl<'a> At<'a> {
    /// Of an instant of a smoothed motion.
    pub fn motion(run: &'a Observed<'_>, model: &PlatformModel, k: usize) -> Self {
        let (motion, recording) = (&run.motion, run.recording);
        let time_s = motion.time_s.get(k).copied().unwrap_or(0.0);
        let latest = |series: &Series<f64>| {
            let next = series.time_s.partition_point(|t| *t <= time_s);
            series.value.get(next.saturating_sub(1)).copied().unwrap_or(0.0)
        };
        let here = Self {
            recording,
            time_s,
            run_s: ends_s(motion),
            slow: Slow {
                pressure_pa: latest(&recording.tank_pressure_pa),
                voltage_v: latest(&recording.bus_voltage_v),
                temperature_k: latest(&recording.temperature_k),
            },
            omega: motion.omega.get(k).copied().unwrap_or_default(),
            q: motion.q.get(k).copied().unwrap_or_default(),
            wheel: wheels(|j| motion.wheel.get(k).and_then(|of| of.get(j)).copied()),
            wheel_angle: wheels(|j| motion.wheel_angle.get(k).and_then(|of| of.get(j)).copied()),
            jets_b_n_m: [Vector3::zeros(); 3],
            open: 0.0,
        };
        here.with_jets_at(model, time_s)
    }

    /// The same with what the commanded pulses do at an instant \[s\], behind the delays of the valves.
    fn with_jets_at(mut self, model: &PlatformModel, time_s: f64) -> Self {
        for (jet, pulses) in model.jets().iter().zip(&self.recording.jet_pulses) {
            let begun = pulses.partition_point(|pulse| pulse.on_s + jet.opening_delay_s <= time_s);
            let Some(pulse) = begun.checked_sub(1).and_then(|last| pulses.get(last)) else { continue };
            let opened_s = time_s - pulse.on_s - jet.opening_delay_s;
            let closed_s = time_s - pulse.off_s - jet.closing_delay_s;
            let is_open = closed_s < 0.0;
            let phases = [is_open, is_open && opened_s < EDGE_S, (0.0..EDGE_S).contains(&closed_s)];
            for (torque_b_n_m, _) in self.jets_b_n_m.iter_mut().zip(phases).filter(|(_, is)| *is) {
                *torque_b_n_m += jet.torque_b_n_m();
            }
            self.open += f64::from(u8::from(is_open));
        }
        self
    }

    /// From -1 at the beginning of the run to 1 at its end.
    fn time_in_run(&self) -> f64 {
        let (first_s, last_s) = self.run_s;
        2.0 * (self.time_s - first_s) / (last_s - first_s).max(1e-9) - 1.0
    }

    /// Of a plant on its way through the same run. The motion tells the angles that wheels have turned.
    pub fn plant(run: &'a Observed<'_>, plant: &Plant, with_angles: bool) -> Self {
        let (state, time_s, environment) = (plant.state(), plant.now_ns() as f64 * 1e-9, plant.environment());
        let speeds = state.wheel_speed_rad_s();
        let angle = |j: usize| (with_angles && j < speeds.len()).then(|| run.motion.wheel_at(j, time_s).1);
        let here = Self {
            recording: run.recording,
            time_s,
            run_s: ends_s(&run.motion),
            slow: Slow {
                pressure_pa: environment.tank_pressure_pa,
                voltage_v: environment.bus_voltage_v,
                temperature_k: environment.temperature_k,
            },
            omega: state.omega_wb_b_rad_s,
            q: state.q_world_body,
            wheel: wheels(|j| speeds.get(j).copied()),
            wheel_angle: wheels(angle),
            jets_b_n_m: [Vector3::zeros(); 3],
            open: 0.0,
        };
        here.with_jets_at(plant.gyrostat().model(), time_s)
    }
}

fn wheels(of: impl Fn(usize) -> Option<f64>) -> Wheels {
    std::array::from_fn(|j| of(j).unwrap_or(0.0))
}

/// First and last instant of a motion \[s\].
fn ends_s(motion: &Motion) -> (f64, f64) {
    (motion.time_s.first().copied().unwrap_or(0.0), motion.time_s.last().copied().unwrap_or(0.0))
}

type Value = Box<dyn Fn(&At<'_>) -> f64 + Sync + Send>;

/// All shapes, in groups that explain together.
pub(crate) fn shapes(observed: &[Observed<'_>], model: &PlatformModel, lines: &Lines) -> Vec<Vec<Shape>> {
    let mut groups: Vec<Vec<Shape>> = Vec::new();
    let single = |variable: &str, parity: &'static str, value: Value| Shape {
        variable: variable.to_owned(),
        parity,
        frequency_hz: None,
        is_picked: false,
        value,
        way: Way::BodyOrRoom,
    };
    let mut add = |variable: &str, scale: f64, centre: f64, value: Value| {
        let of_body = variable.contains("rate") || variable.contains("speed") || variable == "tank_pressure";
        let way = if of_body { Way::Body } else { Way::BodyOrRoom };
        let slow = matches!(variable, "tank_pressure" | "bus_voltage" | "temperature" | "time");
        let value = std::sync::Arc::new(value);
        for (parity, power) in [("odd", 1), ("even", 2), ("odd", 3)] {
            let value = std::sync::Arc::clone(&value);
            let shape: Value = Box::new(move |at| ((value(at) - centre) / scale).powi(power));
            groups.push(vec![Shape { way, ..single(variable, parity, shape) }]);
        }
        if slow {
            // A line through a zero of its own.
            let linear = std::sync::Arc::clone(&value);
            let shape: Value = Box::new(move |at| (linear(at) - centre) / scale);
            let first = Shape { way, ..single(variable, "odd", shape) };
            let second = Shape { way, ..single(variable, "odd", Box::new(|_| 1.0)) };
            groups.push(vec![first, second]);
        }
        let other = std::sync::Arc::clone(&value);
        let sense: Value = Box::new(move |at| {
            let x = (other(at) - centre) / scale;
            x / x.hypot(0.05)
        });
        // What differs with the sense has a kink.
        let kink: Value = Box::new(move |at| ((value(at) - centre) / scale).abs());
        groups.push(vec![Shape { way, ..single(variable, "even", kink) }]);
        groups.push(vec![Shape { way, ..single(variable, "odd", sense) }]);
    };
    let largest = |of: &dyn Fn(&Motion, usize) -> f64| {
        let each = observed.iter().map(|run| &run.motion);
        each.flat_map(|motion| (0..motion.time_s.len()).map(move |k| of(motion, k).abs())).fold(0.0, f64::max)
    };
    let rate = largest(&|m, k| m.omega.get(k).map_or(0.0, Vector3::norm)).max(1e-12);
    let tilt = largest(&|m, k| m.q.get(k).map_or(0.0, |q| vertical_b(q).xy().norm())).max(1e-9);
    for (i, name) in ["roll_rate", "pitch_rate", "yaw_rate"].into_iter().enumerate() {
        add(name, 0.5 * rate, 0.0, Box::new(move |at| at.omega[i]));
    }
    add("rate", 0.5 * rate, 0.0, Box::new(|at| at.omega.norm()));
    for (i, name) in ["tilt_x", "tilt_y"].into_iter().enumerate() {
        add(name, 0.5 * tilt, 0.0, Box::new(move |at| vertical_b(&at.q)[i]));
    }
    for (j, wheel) in model.wheels().iter().enumerate() {
        let name = format!("{}_speed", wheel.name);
        let scale = largest(&|m, k| m.wheel.get(k).and_then(|w| w.get(j)).copied().unwrap_or(0.0)).max(1e-9);
        add(&name, 0.5 * scale, 0.0, Box::new(move |at| at.wheel[j]));
    }
    let span = |values: &dyn Fn(&Observed<'_>) -> Vec<f64>| -> (f64, f64) {
        let all: Vec<f64> = observed.iter().flat_map(values).collect();
        let low = all.iter().copied().fold(f64::INFINITY, f64::min);
        let high = all.iter().copied().fold(f64::NEG_INFINITY, f64::max);
        (0.5 * (low + high), 0.5 * (high - low))
    };
    let mut slow = |name: &str, (centre, half): (f64, f64), value: fn(&At<'_>) -> f64| {
        if half > 1e-9 * centre.abs().max(1e-9) {
            add(name, half, centre, Box::new(value));
        }
    };
    let every = |of: fn(&Recording) -> &Series<f64>| observed.iter().all(|run| of(run.recording).len() > 1);
    if every(|r| &r.tank_pressure_pa) {
        let of_runs = span(&|run| run.recording.tank_pressure_pa.value.clone());
        slow("tank_pressure", of_runs, |at| at.slow.pressure_pa);
    }
    if every(|r| &r.bus_voltage_v) {
        slow("bus_voltage", span(&|run| run.recording.bus_voltage_v.value.clone()), |at| at.slow.voltage_v);
    }
    if every(|r| &r.temperature_k) {
        slow("temperature", span(&|run| run.recording.temperature_k.value.clone()), |at| {
            at.slow.temperature_k
        });
    }
    slow("time", span(&|run| <[f64; 2]>::from(ends_s(&run.motion)).to_vec()), |at| at.time_s);
    groups.push(vec![single("constant", "even", Box::new(|_| 1.0))]);
    // Friction of any law: along the rate, with a size of its own at every rate.
    let slowest = SLOWEST * rate;
    let friction = (0..FRICTION_KNOTS).map(|knot| {
        let size: Value = Box::new(move |at| {
            let place = (at.omega.norm() / slowest).asinh().min(f64::from(FRICTION_KNOTS - 1));
            (1.0 - (place - f64::from(knot)).abs()).max(0.0)
        });
        Shape { way: Way::AlongRate, ..single("rate", "odd", size) }
    });
    groups.push(friction.collect());
    // Drag of a wheel by any law, which may change with time.
    for (j, wheel) in model.wheels().iter().enumerate() {
        let scale =
            0.5 * largest(&|m, k| m.wheel.get(k).and_then(|w| w.get(j)).copied().unwrap_or(0.0)).max(1e-9);
        let speed = move |at: &At<'_>| at.wheel[j] / scale;
        let shape = |value: Value| Shape {
            way: Way::Wheel(j),
            ..single(&format!("{}_speed", wheel.name), "odd", value)
        };
        groups.push(vec![
            shape(Box::new(speed)),
            shape(Box::new(move |at| speed(at) / speed(at).hypot(0.02))),
            shape(Box::new(move |at| speed(at).powi(3))),
            shape(Box::new(move |at| speed(at) * at.time_in_run())),
            shape(Box::new(move |at| speed(at) * at.time_in_run().powi(2))),
        ]);
    }
    if observed.iter().any(|run| run.recording.jet_pulses.iter().any(|pulses| !pulses.is_empty())) {
        groups.extend(of_jets());
    }
    groups.extend(of_sensors(rate));
    // What a wheel that turns does to the gyro beside it: by its speed, and its square.
    for (j, wheel) in model.wheels().iter().enumerate() {
        let scale = largest(&|m, k| m.wheel.get(k).and_then(|w| w.get(j)).copied().unwrap_or(0.0)).max(1e-9);
        for (parity, power) in [("odd", 1), ("even", 2)] {
            let value: Value = Box::new(move |at| (at.wheel[j] / scale).powi(power));
            groups.push(vec![Shape {
                way: Way::GyroBy,
                ..single(&format!("{}_speed", wheel.name), parity, value)
            }]);
        }
    }
    // Heading: the first harmonics.
    for n in [1.0, 2.0, 3.0] {
        let sine: Value = Box::new(move |at| (n * azimuth_rad(&at.q)).sin());
        let cosine: Value = Box::new(move |at| (n * azimuth_rad(&at.q)).cos());
        let first = single("yaw", "none", sine);
        groups.push(vec![first, single("yaw", "none", cosine)]);
    }
    // And those of what turns with teeth, magnets or nozzles, about the vertical.
    for n in (4..=MOST_TEETH).map(f64::from) {
        let sine: Value = Box::new(move |at| (n * azimuth_rad(&at.q)).sin());
        let cosine: Value = Box::new(move |at| (n * azimuth_rad(&at.q)).cos());
        let first = Shape { way: Way::Vertical, ..single("yaw", "none", sine) };
        groups.push(vec![first, Shape { way: Way::Vertical, ..single("yaw", "none", cosine) }]);
    }
    for hz in &lines.hz {
        let hz = *hz;
        let w = std::f64::consts::TAU * hz;
        let sine: Value = Box::new(move |at| (w * at.time_s).sin());
        let cosine: Value = Box::new(move |at| (w * at.time_s).cos());
        let shape =
            |value| Shape { frequency_hz: Some(hz), is_picked: true, ..single("time", "none", value) };
        groups.push(vec![shape(sine), shape(cosine)]);
    }
    for (wheel, order) in &lines.orders {
        let (wheel, order) = (*wheel, *order);
        let name = model.wheels().get(wheel).map_or("wheel", |w| w.name.as_str());
        let phase = move |at: &At<'_>| order * at.wheel_angle[wheel];
        let sine: Value = Box::new(move |at| phase(at).sin());
        let cosine: Value = Box::new(move |at| phase(at).cos());
        let angle = format!("{name}_angle");
        let shape = |value| Shape { way: Way::Body, is_picked: true, ..single(&angle, "none", value) };
        groups.push(vec![shape(sine), shape(cosine)]);
    }
    groups
}

/// Thrust that depends on how many jets are open, and pulse edges whose times differ from the recorded ones, by a constant or a
/// growing amount.
fn of_jets() -> Vec<Vec<Shape>> {
    let shape = |variable: &str, of: Jets, value: Value| Shape {
        variable: variable.to_owned(),
        parity: "none",
        frequency_hz: None,
        is_picked: false,
        value,
        way: Way::Jets(of),
    };
    let edges = |variable: &str, of: Jets| {
        vec![shape(variable, of, Box::new(|_| 1.0)), shape(variable, of, Box::new(|at| at.time_in_run()))]
    };
    vec![
        vec![shape("jets_open", Jets::Open, Box::new(|at| (at.open - 1.0).max(0.0)))],
        edges("jet_opening", Jets::Opened),
        edges("jet_closing", Jets::Closed),
    ]
}

/// Errors of sensors that no effect of the catalogue makes: a gyro that sticks near zero or bends, a vector sensor
/// whose error turns with the heading.
fn of_sensors(largest_rate_rad_s: f64) -> Vec<Vec<Shape>> {
    let shape = |variable: &str, parity: &'static str, way: Way, value: Value| Shape {
        variable: variable.to_owned(),
        parity,
        frequency_hz: None,
        is_picked: false,
        value,
        way,
    };
    // Of the rate about its own axis, in units of 1 rad/s: the caller scales by the component.
    let gyro = |width: f64| -> Value { Box::new(move |_| width) };
    let widths = [0.003, 0.012, 0.05, 0.2].map(|share| share * largest_rate_rad_s);
    let mut groups = vec![
        widths.iter().map(|width| shape("gyro_rate", "odd", Way::Gyro, gyro(*width))).collect::<Vec<_>>(),
    ];
    let mut heading = Vec::new();
    for n in [1.0, 2.0] {
        let azimuth = move |at: &At<'_>| n * azimuth_rad(&at.q);
        heading.push(shape("yaw", "none", Way::Heading, Box::new(move |at| azimuth(at).sin())));
        heading.push(shape("yaw", "none", Way::Heading, Box::new(move |at| azimuth(at).cos())));
    }
    groups.push(heading);
    groups
}

/// One column: a shape about an axis.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Column {
    pub group: usize,
    pub shape: usize,
    pub world: bool,
    pub axis: usize,
}

/// Columns that explain together.
pub(crate) struct Law {
    pub columns: Vec<usize>,
    /// The first of its groups.
    pub group: usize,
    pub world: bool,
    /// `None`: about any.
    pub axis: Option<usize>,
}

fn way(groups: &[Vec<Shape>], group: usize) -> Way {
    groups.get(group).and_then(|g| g.first()).map_or(Way::Body, |s| s.way)
}

/// Every shape about every axis of both frames.
pub(crate) fn columns_of(groups: &[Vec<Shape>]) -> Vec<Column> {
    let mut columns = Vec::new();
    for (group, shapes) in groups.iter().enumerate() {
        for world in [false, true] {
            let axes = way(groups, group).axes(world);
            for axis in 0..axes {
                columns.extend((0..shapes.len()).map(|shape| Column { group, shape, world, axis }));
            }
        }
    }
    columns
}

/// Each shape, and any function of each variable that all its shapes make together; about one axis, and about
/// all of them at once.
pub(crate) fn laws(groups: &[Vec<Shape>], columns: &[Column]) -> Vec<Law> {
    let mut sets: Vec<Vec<usize>> = (0..groups.len()).map(|group| vec![group]).collect();
    let plain = |group: usize| {
        let first = groups.get(group).and_then(|g| g.first());
        first.filter(|s| s.frequency_hz.is_none()).map(|s| (s.way, s.variable.as_str()))
    };
    for group in 0..groups.len() {
        let Some(kind) = plain(group) else { continue };
        let all: Vec<usize> = (0..groups.len()).filter(|g| plain(*g) == Some(kind)).collect();
        if all.first() == Some(&group) && all.len() > 1 {
            sets.push(all);
        }
    }
    let mut laws = Vec::new();
    for set in &sets {
        let Some(&group) = set.first() else { continue };
        for world in [false, true] {
            for axis in [Some(0), Some(1), Some(2), None] {
                if axis.is_some() && way(groups, group).axes(world) < 3 {
                    continue;
                }
                let own: Vec<usize> = columns
                    .iter()
                    .enumerate()
                    .filter(|(_, c)| {
                        set.contains(&c.group) && c.world == world && axis.is_none_or(|axis| c.axis == axis)
                    })
                    .map(|(i, _)| i)
                    .collect();
                if !own.is_empty() {
                    laws.push(Law { columns: own, group, world, axis });
                }
            }
        }
    }
    laws
}

impl Shape {
    /// Unit of what it adds.
    pub fn unit(&self) -> &'static str {
        match self.way {
            Way::Body | Way::BodyOrRoom | Way::Vertical | Way::AlongRate | Way::Wheel(_) | Way::Jets(_) => {
                "N m"
            }
            Way::Gyro | Way::GyroBy => "rad/s",
            Way::Heading => "rad",
        }
    }
}

/// What a column adds at an instant where its size is 1: a share of the applied torque RMS, a turn of 1e-3 rad; for the gyro, the
/// reading at which a dead band of the shape's width would leave nothing.
pub(crate) fn push(groups: &[Vec<Shape>], column: &Column, at: &At<'_>, torques: &Applied) -> Push {
    let Some(shape) = groups.get(column.group).and_then(|g| g.get(column.shape)) else {
        return Push::Body(Vector3::zeros());
    };
    let size = (shape.value)(at);
    let torque_n_m = SHARE * torques.body_n_m();
    let axis = Vector3::ith(column.axis, 1.0);
    match shape.way {
        // Smooth where the sense of turning is uncertain.
        Way::AlongRate => Push::Body(at.omega * (torque_n_m * size / at.omega.norm().hypot(5e-4))),
        Way::Wheel(wheel) => Push::Wheel(wheel, SHARE * torques.wheel_n_m(wheel) * size),
        Way::Gyro => {
            let rate = at.omega[column.axis];
            Push::Gyro(axis * (rate * (-(rate / size).powi(2)).exp()))
        }
        Way::GyroBy => Push::Gyro(axis * (GYRO_RAD_S * size)),
        Way::Jets(of) => Push::Body(at.jets_b_n_m[of as usize] * (SHARE * size)),
        Way::Vertical => Push::Body(vertical_b(&at.q) * (torque_n_m * size)),
        Way::Heading => Push::Turn(vertical_b(&at.q) * (1e-3 * size)),
        Way::Body | Way::BodyOrRoom if column.world => {
            Push::Body(at.q.inverse_transform_vector(&axis) * (torque_n_m * size))
        }
        Way::Body | Way::BodyOrRoom => Push::Body(axis * (torque_n_m * size)),
    }
}
