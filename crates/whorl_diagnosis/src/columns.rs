//! Sensitivities of every whitened sample to the parameters.

use nalgebra::Vector3;
use whorl_dynamics::gyrostat::MAX_WHEELS;
use whorl_dynamics::{EffectKind, Environment, Gyrostat, TrueImu};

use crate::DiagnosisError;
use crate::filter::{Gains, RATE, System, WHEEL, across};
use crate::inputs::Inputs;
use crate::mechanics::{Mechanics, Prediction};
use crate::motion::Motion;
use crate::parameters::{Column, Point, Reference, Target};
use crate::run::{Run, Wheels};

/// Columns that pass through the filter side by side.
pub(crate) const LANES: usize = 8;

/// One row of a group of columns.
pub(crate) type Lanes = [f64; LANES];

/// How a run's prediction changes per unit of a column.
#[derive(Debug, Default)]
struct Change {
    omega_dot: Vec<Vector3<f64>>,
    wheel_dot: Vec<Wheels>,
    gyro: Vec<Vector3<f64>>,
    accel: Vec<Vector3<f64>>,
    vectors: Vec<Vec<Vector3<f64>>>,
}

/// A run linearised at a point.
pub(crate) struct Linearised {
    pub mechanics: Mechanics,
    pub inputs: Inputs,
    pub prediction: Prediction,
    pub gains: Gains,
}

/// Share of a column's unit by which values are changed to see the difference.
const DIFFERENCE: f64 = 0.1;

/// Reads one group of columns of a run: whitened sensitivities, one row of lanes per measurement.
pub(crate) fn group_response(
    run: &Run,
    motion: &Motion,
    linearised: &Linearised,
    reference: &Reference,
    point: &Point,
    columns: &[Column],
) -> Result<Vec<Lanes>, DiagnosisError> {
    let changes = columns
        .iter()
        .map(|column| change(run, motion, linearised, reference, point, column))
        .collect::<Result<Vec<_>, _>>()?;
    Ok(pass(run, linearised, &changes))
}

fn change(
    run: &Run,
    motion: &Motion,
    base: &Linearised,
    reference: &Reference,
    point: &Point,
    column: &Column,
) -> Result<Change, DiagnosisError> {
    let mut units = DIFFERENCE;
    if column.quadratic {
        units = 1.0;
    } else if column.name == "range_rad_s" || column.name == "angle_rad" {
        // What lies beyond a limit is small: so must be the step.
        units *= 0.02;
    }
    if column.range.1 < units + reference.distance(point, column) {
        units = -units;
    }
    let moved = match reference.model_at(&reference.moved(point, column, units)) {
        Ok(model) => model,
        Err(_) => {
            units = -units;
            reference.model_at(&reference.moved(point, column, units))?
        }
    };
    let mechanics = Mechanics::new(&moved)?;
    let mut change = Change::default();
    let (of_sensors, of_motion) = match column.target {
        Target::Moment(_) => (false, true),
        Target::Effect(effect) => {
            let sensor = effect.info().kind == EffectKind::Sensor;
            (sensor || touches_sensors(&base.mechanics.gyrostat, &mechanics.gyrostat), !sensor)
        }
    };
    if of_motion {
        dynamics(run, motion, base, &mechanics, units, &mut change);
    }
    if of_sensors {
        readings(run, motion, base, &mechanics, units, &mut change);
    }
    Ok(change)
}

/// Whether the model's jets do other than the base's, with all else equal.
fn only_jets_differ(base: &Gyrostat, moved: &Gyrostat) -> bool {
    let (a, b) = (base.model(), moved.model());
    let lag = base.jet_rise_time_s() != moved.jet_rise_time_s();
    let differ = a.jets != b.jets || a.tank != b.tank;
    (differ || lag) && a.wheels == b.wheels && a.mass_properties == b.mass_properties
}

fn touches_sensors(base: &Gyrostat, moved: &Gyrostat) -> bool {
    if base.model().sensors != moved.model().sensors {
        return true;
    }
    let q = nalgebra::UnitQuaternion::from_euler_angles(0.1, -0.2, 0.7);
    let mut environment = Environment::new(base.model(), q, Vector3::new(0.1, 0.2, -0.3));
    environment.time_s = 12.3;
    environment.temperature_k += 3.0;
    let read = |gyrostat: &Gyrostat| {
        let mut imu = TrueImu {
            angular_velocity_b_rad_s: environment.omega_wb_b_rad_s,
            specific_force_b_m_s2: Vector3::new(0.3, -0.2, 9.8),
        };
        gyrostat.effects().measure_imu(&environment, &mut imu);
        imu
    };
    read(base) != read(moved)
}

fn dynamics(
    run: &Run,
    motion: &Motion,
    base: &Linearised,
    moved: &Mechanics,
    units: f64,
    change: &mut Change,
) {
    let nodes = run.nodes();
    let voltage_drop = {
        let mut environment = run.environment(base.mechanics.model(), 0);
        environment.bus_voltage_v -= 1.0;
        let delay = |g: &Gyrostat| g.effects().valve_delay_s(&environment);
        delay(&base.mechanics.gyrostat) != delay(&moved.gyrostat)
    };
    let jets_only = only_jets_differ(&base.mechanics.gyrostat, &moved.gyrostat);
    let lag = base.mechanics.gyrostat.jet_rise_time_s() != moved.gyrostat.jet_rise_time_s();
    let delays = |m: &Mechanics| -> Vec<(f64, f64)> {
        m.model().jets.iter().map(|j| (j.opening_delay_s, j.closing_delay_s)).collect()
    };
    let other_inputs =
        (voltage_drop || lag || delays(&base.mechanics) != delays(moved)).then(|| moved.inputs(run));
    let mut inputs = other_inputs.unwrap_or_else(|| base.inputs.clone());
    for (slot, active) in inputs.jet_active.iter_mut().zip(&base.inputs.jet_active) {
        *slot |= active;
    }
    let prediction = moved.accelerations(run, motion, &inputs, jets_only);
    change.omega_dot = vec![Vector3::zeros(); nodes];
    change.wheel_dot = vec![[0.0; MAX_WHEELS]; nodes];
    let wheels = base.mechanics.model().wheels.len();
    let mut edges = vec![Vector3::zeros(); nodes];
    for (k, edge) in edges.iter_mut().enumerate() {
        if jets_only && !inputs.is_active(k) {
            continue;
        }
        change.omega_dot[k] = (prediction.omega_dot[k] - base.prediction.omega_dot[k]) / units;
        for j in 0..wheels {
            change.wheel_dot[k][j] = (prediction.wheel_dot[k][j] - base.prediction.wheel_dot[k][j]) / units;
        }
        *edge = (prediction.edge_rate[k] - base.prediction.edge_rate[k]) / units;
    }
    if run.clamped {
        return;
    }
    // The accelerometer feels the angular acceleration at its lever arm.
    let lever = base.mechanics.model().sensors.accelerometer.lever_arm_b_m;
    let at = |k: usize| change.omega_dot.get(k).copied().unwrap_or_default();
    change.accel =
        (0..nodes).map(|k| if k == 0 { at(0) } else { (at(k - 1) + at(k)) * 0.5 }.cross(&lever)).collect();
    change.gyro = edges;
}

fn readings(
    run: &Run,
    motion: &Motion,
    base: &Linearised,
    moved: &Mechanics,
    units: f64,
    change: &mut Change,
) {
    let mut prediction = Prediction {
        omega_dot: base.prediction.omega_dot.clone(),
        edge_rate: base.prediction.edge_rate.clone(),
        ..Prediction::default()
    };
    moved.readings(run, motion, &base.inputs, &mut prediction);
    let difference = |a: &[Vector3<f64>], b: &[Vector3<f64>]| -> Vec<Vector3<f64>> {
        a.iter().zip(b).map(|(x, y)| (x - y) / units).collect()
    };
    let add = |slot: &mut Vec<Vector3<f64>>, more: Vec<Vector3<f64>>| {
        if slot.is_empty() {
            *slot = more;
        } else {
            slot.iter_mut().zip(more).for_each(|(a, b)| *a += b);
        }
    };
    add(&mut change.gyro, difference(&prediction.gyro, &base.prediction.gyro));
    add(&mut change.accel, difference(&prediction.accel, &base.prediction.accel));
    change.vectors =
        prediction.vectors.iter().zip(&base.prediction.vectors).map(|(a, b)| difference(a, b)).collect();
}

/// Whitened sensitivities to torques on the body, given over every interval [N m].
pub(crate) fn torque_response(
    run: &Run,
    linearised: &Linearised,
    torques: &[Vec<Vector3<f64>>],
) -> Vec<Lanes> {
    let inverse = linearised.mechanics.inverse_inertia;
    let wheels = &linearised.mechanics.model().wheels;
    let changes: Vec<Change> = torques
        .iter()
        .map(|torque| {
            let omega_dot: Vec<Vector3<f64>> = torque.iter().map(|g| inverse * g).collect();
            let wheel_dot = omega_dot
                .iter()
                .map(|acceleration| {
                    let mut rate = [0.0; MAX_WHEELS];
                    for (slot, wheel) in rate.iter_mut().zip(wheels) {
                        *slot = -wheel.spin_axis_b.dot(acceleration);
                    }
                    rate
                })
                .collect();
            Change { omega_dot, wheel_dot, ..Change::default() }
        })
        .collect();
    pass(run, linearised, &changes)
}

/// Passes changes through the filter of a run.
fn pass(run: &Run, linearised: &Linearised, changes: &[Change]) -> Vec<Lanes> {
    let gains = &linearised.gains;
    let n = gains.n;
    let wheels = linearised.mechanics.model().wheels.len();
    let vectors = run.vectors.len();
    let mut out = Vec::with_capacity(gains.whitened.len());
    let mut s = vec![[0.0; LANES]; n];
    let mut next = vec![[0.0; LANES]; n];
    for k in 0..run.nodes() {
        for row in gains.first_row[k]..gains.first_row[k + 1] {
            let channel = usize::from(gains.channel[row]);
            let mut v = [0.0; LANES];
            for (lane, change) in v.iter_mut().zip(changes) {
                *lane = direct(change, channel, k, vectors, &linearised.prediction);
            }
            let h = &gains.h[row * n..(row + 1) * n];
            for (state, h) in s.iter().zip(h) {
                if *h != 0.0 {
                    for (lane, x) in v.iter_mut().zip(state) {
                        *lane += h * x;
                    }
                }
            }
            let gain = &gains.gain[row * n..(row + 1) * n];
            for (state, gain) in s.iter_mut().zip(gain) {
                for (x, lane) in state.iter_mut().zip(&v) {
                    *x -= gain * lane;
                }
            }
            let inverse = gains.inverse_stddev[row];
            v.iter_mut().for_each(|lane| *lane *= inverse);
            out.push(v);
        }
        if k + 1 >= run.nodes() {
            break;
        }
        let f = &gains.transition[k * n * n..(k + 1) * n * n];
        for (i, slot) in next.iter_mut().enumerate() {
            let mut sum = [0.0; LANES];
            for (x, state) in f[i * n..(i + 1) * n].iter().zip(&s) {
                if *x != 0.0 {
                    for (a, b) in sum.iter_mut().zip(state) {
                        *a += x * b;
                    }
                }
            }
            *slot = sum;
        }
        std::mem::swap(&mut s, &mut next);
        let h = run.length(k);
        for (lane, change) in changes.iter().enumerate() {
            if let Some(rate) = change.omega_dot.get(k) {
                for i in 0..3 {
                    s[RATE + i][lane] += rate[i] * h;
                    // Half of the interval's turn.
                    s[i][lane] += 0.5 * rate[i] * h * h;
                }
            }
            if let Some(rate) = change.wheel_dot.get(k) {
                for j in 0..wheels {
                    s[WHEEL + j][lane] += rate[j] * h;
                }
            }
        }
    }
    out
}

/// Change of a reading that does not pass through the motion.
fn direct(change: &Change, channel: usize, k: usize, vectors: usize, prediction: &Prediction) -> f64 {
    let component = |list: &[Vector3<f64>], i: usize| list.get(k).map_or(0.0, |v| v[i]);
    match channel {
        0..3 => component(&change.gyro, channel),
        3..6 => component(&change.accel, channel - 3),
        c if c < 6 + 2 * vectors => {
            let (sensor, axis) = ((c - 6) / 2, (c - 6) % 2);
            let (Some(list), Some(seen)) =
                (change.vectors.get(sensor), prediction.vectors.get(sensor).and_then(|l| l.get(k)))
            else {
                return 0.0;
            };
            let (e1, e2) = across(seen);
            list.get(k).map_or(0.0, |v| v.dot(if axis == 0 { &e1 } else { &e2 }))
        }
        _ => 0.0,
    }
}

impl Linearised {
    /// Filters a run with the model at a point.
    pub fn new(
        run: &Run,
        motion: &Motion,
        reference: &Reference,
        point: &Point,
        settings: crate::filter::Settings,
    ) -> Result<Self, DiagnosisError> {
        let mechanics = Mechanics::new(&reference.model_at(point)?)?;
        let (inputs, prediction) = predict(&mechanics, run, motion);
        let system = System { run, motion, mechanics: &mechanics, prediction: &prediction, settings };
        let (gains, _) = system.filter(true, false);
        Ok(Self { inputs, prediction, gains, mechanics })
    }
}

/// Inputs and prediction of a run.
pub(crate) fn predict(mechanics: &Mechanics, run: &Run, motion: &Motion) -> (Inputs, Prediction) {
    let inputs = mechanics.inputs(run);
    let mut prediction = mechanics.accelerations(run, motion, &inputs, false);
    mechanics.readings(run, motion, &inputs, &mut prediction);
    (inputs, prediction)
}
