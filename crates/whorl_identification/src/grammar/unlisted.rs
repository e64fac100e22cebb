//! Unmodelled laws: functions of one recorded variable that act about an axis, along the rate, on a wheel, or in a
//! sensor's reading.

use nalgebra::Vector3;
use whorl_dynamics::actuators::wheels::MAX_WHEELS;
use whorl_dynamics::{Environment, Plant, PlatformModel};
use whorl_math::azimuth_rad;
use whorl_prediction::Push;
use whorl_recording::{Recording, Series};

use crate::grammar::SHARE;
use crate::grammar::variable::{Recorded, Variable, possible};
use crate::signals::lines::Lines;
use crate::signals::observed::{Applied, Motion, Observed};

/// Most quantities of the table that a law may depend on.
const MOST_VARIABLES: usize = 11 + MAX_WHEELS;

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

/// What a law may depend on, at one instant.
pub(crate) struct At<'a> {
    recording: &'a Recording,
    environment: Environment<'a>,
    /// Times of the run's first and last readings since its start \[s\].
    run_s: (f64, f64),
    /// The quantities of the table.
    values: [f64; MOST_VARIABLES],
    /// Angle that each wheel has turned since the first instant \[rad\].
    wheel_angle: [f64; MAX_WHEELS],
    /// Torque of the jets that are open, that have opened and that have closed just now, body axes [N m], and how many are open.
    jets_b_n_m: [Vector3<f64>; 3],
    open: f64,
}

impl<'a> At<'a> {
    /// Of an instant of a smoothed motion.
    pub fn motion(variables: &[Variable], run: &'a Observed<'_>, model: &'a PlatformModel, k: usize) -> Self {
        let (motion, recording) = (&run.motion, run.recording);
        let time_s = motion.time_s.get(k).copied().unwrap_or(0.0);
        let latest = |series: &Series<f64>| {
            let next = series.time_s.partition_point(|t| *t <= time_s);
            series.value.get(next.saturating_sub(1)).copied().unwrap_or(0.0)
        };
        let q = motion.q.get(k).copied().unwrap_or_default();
        let environment = Environment {
            time_s,
            wheel_speed_rad_s: motion.wheel.get(k).map_or(&[], Vec::as_slice),
            tank_pressure_pa: latest(&recording.tank_pressure_pa),
            bus_voltage_v: latest(&recording.bus_voltage_v),
            temperature_k: latest(&recording.temperature_k),
            ..Environment::new(model, q, motion.omega.get(k).copied().unwrap_or_default())
        };
        let angle = |j: usize| motion.wheel_angle.get(k).and_then(|of| of.get(j)).copied();
        Self::new(variables, run, environment, angle)
    }

    /// Of a plant on its way through the same run. The motion tells the angles that wheels have turned.
    pub fn plant(variables: &[Variable], run: &'a Observed<'_>, plant: &'a Plant, with_angles: bool) -> Self {
        let environment = plant.environment();
        let (time_s, wheels) = (environment.time_s, environment.wheel_speed_rad_s.len());
        let angle = |j: usize| (with_angles && j < wheels).then(|| run.motion.wheel_at(j, time_s).1);
        Self::new(variables, run, environment, angle)
    }

    fn new(
        variables: &[Variable],
        run: &'a Observed<'_>,
        environment: Environment<'a>,
        angle: impl Fn(usize) -> Option<f64>,
    ) -> Self {
        let mut values = [0.0; MOST_VARIABLES];
        for (value, variable) in values.iter_mut().zip(variables) {
            *value = variable.number(&environment);
        }
        let (model, time_s) = (environment.model, environment.time_s);
        let here = Self {
            recording: run.recording,
            environment,
            run_s: ends_s(&run.motion),
            values,
            wheel_angle: std::array::from_fn(|j| angle(j).unwrap_or(0.0)),
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
        2.0 * (self.environment.time_s - first_s) / (last_s - first_s).max(1e-9) - 1.0
    }

    fn azimuth_rad(&self) -> f64 {
        azimuth_rad(&self.environment.q_world_body)
    }
}

/// First and last instant of a motion \[s\].
fn ends_s(motion: &Motion) -> (f64, f64) {
    (motion.time_s.first().copied().unwrap_or(0.0), motion.time_s.last().copied().unwrap_or(0.0))
}

type Value = Box<dyn Fn(&At<'_>) -> f64 + Sync + Send>;

/// The quantities that move, and all shapes of them, in groups that explain together.
pub(crate) fn shapes(
    observed: &[Observed<'_>],
    model: &PlatformModel,
    lines: &Lines,
) -> (Vec<Variable>, Vec<Vec<Shape>>) {
    let mut groups: Vec<Vec<Shape>> = Vec::new();
    let single = |variable: &str, parity: &'static str, value: Value| Shape {
        variable: variable.to_owned(),
        parity,
        frequency_hz: None,
        is_picked: false,
        value,
        way: Way::BodyOrRoom,
    };
    // A motor's torque acts on its wheel, and the tilt is that about two axes.
    let recorded =
        Recorded { wheel_commands: false, ..Recorded::of(observed.iter().map(|run| run.recording)) };
    let mut variables = possible(model, &recorded);
    variables.retain(|variable| variable.name != "tilt");
    let ranges = ranges(&variables, observed, model);
    let largest = |names: &dyn Fn(&Variable) -> bool| {
        let own = variables.iter().zip(&ranges).filter(|(variable, _)| names(variable));
        own.map(|(_, (low, high))| high.max(-low)).fold(0.0, f64::max)
    };
    let rate = largest(&|v| v.name == "rate").max(1e-12);
    let tilt = largest(&|v| v.name.starts_with("tilt")).max(1e-9);
    for (i, (variable, &(low, high))) in variables.iter().zip(&ranges).enumerate() {
        let name = variable.name.as_str();
        let (centre, scale) = match name {
            _ if variable.is_slow => (0.5 * (low + high), 0.5 * (high - low)),
            _ if name.starts_with("tilt") => (0.0, 0.5 * tilt),
            _ if name.ends_with("rate") => (0.0, 0.5 * rate),
            _ => (0.0, 0.5 * high.max(-low).max(1e-9)),
        };
        if variable.is_slow && scale <= 1e-9 * centre.abs().max(1e-9) {
            continue;
        }
        let way = if variable.is_of_body { Way::Body } else { Way::BodyOrRoom };
        let shape = |parity: &'static str, of: fn(f64) -> f64| Shape {
            way,
            ..single(name, parity, Box::new(move |at| of((at.values[i] - centre) / scale)))
        };
        for (parity, power) in [("odd", 1), ("even", 2), ("odd", 3)] {
            let power: Value = Box::new(move |at| ((at.values[i] - centre) / scale).powi(power));
            groups.push(vec![Shape { way, ..single(name, parity, power) }]);
        }
        if variable.is_slow {
            // A line through a zero of its own.
            groups.push(vec![shape("odd", |x| x), shape("odd", |_| 1.0)]);
        }
        // What differs with the sense has a kink.
        groups.push(vec![shape("even", f64::abs)]);
        groups.push(vec![shape("odd", |x| x / x.hypot(0.05))]);
    }
    let speeds: Vec<(usize, String, f64)> = (0..model.wheels().len())
        .filter_map(|j| {
            let name = format!("{}_speed", model.wheels()[j].name);
            let largest = largest(&|v| v.name == name).max(1e-9);
            Some((variables.iter().position(|v| v.name == name)?, name, largest))
        })
        .collect();
    groups.push(vec![single("constant", "even", Box::new(|_| 1.0))]);
    // Friction of any law: along the rate, with a size of its own at every rate.
    let slowest = SLOWEST * rate;
    let friction = (0..FRICTION_KNOTS).map(|knot| {
        let size: Value = Box::new(move |at| {
            let place =
                (at.environment.omega_wb_b_rad_s.norm() / slowest).asinh().min(f64::from(FRICTION_KNOTS - 1));
            (1.0 - (place - f64::from(knot)).abs()).max(0.0)
        });
        Shape { way: Way::AlongRate, ..single("rate", "odd", size) }
    });
    groups.push(friction.collect());
    // Drag of a wheel by any law, which may change with time.
    for (j, (place, name, largest)) in speeds.iter().enumerate() {
        let (place, scale) = (*place, 0.5 * largest);
        let speed = move |at: &At<'_>| at.values[place] / scale;
        let shape = |value: Value| Shape { way: Way::Wheel(j), ..single(name, "odd", value) };
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
    for (place, name, largest) in &speeds {
        let (place, scale) = (*place, *largest);
        for (parity, power) in [("odd", 1), ("even", 2)] {
            let value: Value = Box::new(move |at| (at.values[place] / scale).powi(power));
            groups.push(vec![Shape { way: Way::GyroBy, ..single(name, parity, value) }]);
        }
    }
    // Heading: the first harmonics.
    for n in [1.0, 2.0, 3.0] {
        let sine: Value = Box::new(move |at| (n * at.azimuth_rad()).sin());
        let cosine: Value = Box::new(move |at| (n * at.azimuth_rad()).cos());
        let first = single("yaw", "none", sine);
        groups.push(vec![first, single("yaw", "none", cosine)]);
    }
    // And those of what turns with teeth, magnets or nozzles, about the vertical.
    for n in (4..=MOST_TEETH).map(f64::from) {
        let sine: Value = Box::new(move |at| (n * at.azimuth_rad()).sin());
        let cosine: Value = Box::new(move |at| (n * at.azimuth_rad()).cos());
        let first = Shape { way: Way::Vertical, ..single("yaw", "none", sine) };
        groups.push(vec![first, Shape { way: Way::Vertical, ..single("yaw", "none", cosine) }]);
    }
    for hz in &lines.hz {
        let hz = *hz;
        let w = std::f64::consts::TAU * hz;
        let sine: Value = Box::new(move |at| (w * at.environment.time_s).sin());
        let cosine: Value = Box::new(move |at| (w * at.environment.time_s).cos());
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
    (variables, groups)
}

/// Least and largest number of each quantity over all runs.
fn ranges(variables: &[Variable], observed: &[Observed<'_>], model: &PlatformModel) -> Vec<(f64, f64)> {
    let mut ranges = vec![(f64::INFINITY, f64::NEG_INFINITY); variables.len()];
    for run in observed {
        for k in 0..run.motion.time_s.len() {
            let here = At::motion(variables, run, model, k);
            for ((low, high), x) in ranges.iter_mut().zip(here.values) {
                (*low, *high) = (low.min(x), high.max(x));
            }
        }
    }
    ranges
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
        let azimuth = move |at: &At<'_>| n * at.azimuth_rad();
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
        Way::AlongRate => Push::Body(
            at.environment.omega_wb_b_rad_s
                * (torque_n_m * size / at.environment.omega_wb_b_rad_s.norm().hypot(5e-4)),
        ),
        Way::Wheel(wheel) => Push::Wheel(wheel, SHARE * torques.wheel_n_m(wheel) * size),
        Way::Gyro => {
            let rate = at.environment.omega_wb_b_rad_s[column.axis];
            Push::Gyro(axis * (rate * (-(rate / size).powi(2)).exp()))
        }
        Way::GyroBy => Push::Gyro(axis * (GYRO_RAD_S * size)),
        Way::Jets(of) => Push::Body(at.jets_b_n_m[of as usize] * (SHARE * size)),
        Way::Vertical => Push::Body(at.environment.vertical_b * (torque_n_m * size)),
        Way::Heading => Push::Turn(at.environment.vertical_b * (1e-3 * size)),
        Way::Body | Way::BodyOrRoom if column.world => {
            Push::Body(at.environment.to_body(&axis) * (torque_n_m * size))
        }
        Way::Body | Way::BodyOrRoom => Push::Body(axis * (torque_n_m * size)),
    }
}
