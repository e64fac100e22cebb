//! The motion of a whole run, and what pushed the platform beside its model, from all readings before and behind.

use crate::inputs::commands::ns;
use nalgebra::{DMatrix, DVector, Matrix3, UnitQuaternion, Vector3};
use whorl_dynamics::plant::{RATE, ROTATION};
use whorl_math::quaternion_exp;

use crate::columns::Columns;
use crate::filter::Filter;
use crate::layout::Layout;
use crate::noise::Noise;
use crate::prepared::Prepared;
use crate::since::Since;
use crate::start::Start;

/// Memory for a run's states at most, whatever its length \[bytes\].
const MOST_BYTES: f64 = 48e6;

/// The state at an instant given all readings of the run, with the standard deviation of each number.
#[derive(Debug, Clone, PartialEq)]
pub struct SmoothedState {
    /// Time since the start of the run \[s\].
    pub time_s: f64,
    /// Attitude, v_world = q v_body.
    pub q_world_body: UnitQuaternion<f64>,
    /// Of its rotation about each body axis \[rad\].
    pub attitude_stddev_b_rad: Vector3<f64>,
    /// Rate of the body, body axes [rad/s].
    pub omega_wb_b_rad_s: Vector3<f64>,
    /// See there.
    pub omega_stddev_b_rad_s: Vector3<f64>,
    /// Wheel speeds relative to the body [rad/s].
    pub wheel_speed_rad_s: Vec<f64>,
    /// See there.
    pub wheel_speed_stddev_rad_s: Vec<f64>,
    /// Torque on the body beside the model's, body axes [N m]; of a rig with fewer axes what acts about those.
    pub torque_b_n_m: Vector3<f64>,
    /// Its covariance [N^2 m^2].
    pub torque_covariance_b: Matrix3<f64>,
    /// Torque of each wheel's motor beside the model's, about the wheel's axis [N m]; empty: the noise has none.
    pub motor_torque_n_m: Vec<f64>,
    /// See there.
    pub motor_torque_stddev_n_m: Vec<f64>,
}

/// The filter's state at an instant, and what the readings to the next one say of it.
struct Node {
    time_s: f64,
    q_world_body: UnitQuaternion<f64>,
    omega_wb_b_rad_s: Vector3<f64>,
    wheel_speed_rad_s: Vec<f64>,
    beside: DVector<f64>,
    covariance: DMatrix<f64>,
    since: Since,
}

/// States every `every_s` seconds, at instants at which anything was read, and further apart where the run is so long that they would
/// take more than 48 MB on the way. `None` where the motion is lost.
///
/// The filter goes once through the recording. With x, P its state and covariance at an instant, a_i the derivatives of later
/// innovations by that state, e_i and S_i these innovations and their variances (METHOD.md, "Smoothed"):
///
/// ```text
/// x_smoothed = x + P sum(a_i e_i/S_i),   P_smoothed = P - P sum(a_i a_i^T/S_i) P
/// ```
#[must_use]
pub fn smoothed(
    case: &Prepared<'_>,
    noise: &Noise,
    start: &Start,
    every_s: f64,
) -> Option<Vec<SmoothedState>> {
    let size = start.layout.size();
    let every_ns = ns(every_s.max(longest_apart_s(case, size))).max(1);
    let mut filter = Filter::new(case, noise, start);
    let mut nodes: Vec<Node> = Vec::new();
    let mut due_ns = i64::MIN;
    while filter.step(&mut |_| {}) {
        let now_ns = filter.mean.plant.now_ns();
        if now_ns < due_ns {
            continue;
        }
        due_ns = now_ns.saturating_add(every_ns);
        let before = filter.columns.replace(Columns::since_now(start.layout));
        if let Some((node, columns)) = nodes.last_mut().zip(before) {
            node.since = columns.since();
        }
        nodes.push(Node::of(&filter, size));
    }
    if filter.is_lost() {
        return None;
    }
    if let Some((node, columns)) = nodes.last_mut().zip(filter.columns.take()) {
        node.since = columns.since();
    }
    let free = case.model().freedom.projection();
    let (mut states, mut later) = (Vec::with_capacity(nodes.len()), Since::none(size));
    while let Some(node) = nodes.pop() {
        let (state, all) = node.smoothed(start.layout, later, &free);
        states.push(state);
        later = all;
    }
    states.reverse();
    Some(states)
}

/// Interval at which the states of a run fill the memory that they may take \[s\].
fn longest_apart_s(case: &Prepared<'_>, size: usize) -> f64 {
    let bytes_each = 3.0 * 8.0 * (size * size) as f64;
    case.recording().duration_s() * bytes_each / MOST_BYTES
}

impl Node {
    fn of(filter: &Filter<'_>, size: usize) -> Self {
        let state = filter.mean.plant.state();
        Self {
            time_s: filter.mean.plant.now_ns() as f64 * 1e-9,
            q_world_body: state.q_world_body,
            omega_wb_b_rad_s: state.omega_wb_b_rad_s,
            wheel_speed_rad_s: state.wheel_speed_rad_s().to_vec(),
            beside: filter.mean.beside.clone(),
            covariance: filter.gains.covariance.matrix(size, size),
            since: Since::none(size),
        }
    }

    /// The state with what all readings behind it say, and what these say, that behind the next node included.
    fn smoothed(self, layout: Layout, later: Since, free: &Matrix3<f64>) -> (SmoothedState, Since) {
        let all = self.since.and(&later);
        let p = &self.covariance;
        let change = p * &all.slope;
        let covariance = p - p * &all.information * p;
        let stddev = |i: usize| covariance[(i, i)].max(0.0).sqrt();
        let three = |from: usize| Vector3::from_fn(|i, _| change[from + i]);
        let wheels = layout.plant.wheels();
        let torque = layout.disturbance();
        let (torque_b_n_m, torque_covariance_b) = if torque.is_empty() {
            (Vector3::zeros(), Matrix3::zeros())
        } else {
            let processes = || torque.clone().step_by(3);
            let mean = |from: usize| Vector3::from_fn(|i, _| self.beside[from + i] + change[from + i]);
            let of = |(from, to)| -> Matrix3<f64> { covariance.fixed_view::<3, 3>(from, to).into() };
            let pairs = processes().flat_map(|from| processes().map(move |to| (from, to)));
            let mean: Vector3<f64> = processes().map(mean).sum();
            let of: Matrix3<f64> = pairs.map(of).sum();
            (free * mean, free * of * free.transpose())
        };
        let state = SmoothedState {
            time_s: self.time_s,
            q_world_body: self.q_world_body * quaternion_exp(&three(ROTATION.start)),
            attitude_stddev_b_rad: Vector3::from_fn(|i, _| stddev(ROTATION.start + i)),
            omega_wb_b_rad_s: self.omega_wb_b_rad_s + three(RATE.start),
            omega_stddev_b_rad_s: Vector3::from_fn(|i, _| stddev(RATE.start + i)),
            wheel_speed_rad_s: self
                .wheel_speed_rad_s
                .iter()
                .zip(wheels.clone())
                .map(|(x, i)| x + change[i])
                .collect(),
            wheel_speed_stddev_rad_s: wheels.map(stddev).collect(),
            torque_b_n_m,
            torque_covariance_b,
            motor_torque_n_m: layout.motors().map(|i| self.beside[i] + change[i]).collect(),
            motor_torque_stddev_n_m: layout.motors().map(stddev).collect(),
        };
        (state, all)
    }
}
