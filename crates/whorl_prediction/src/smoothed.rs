//! The motion of a whole run, and what pushed the platform beside its model, from all readings before and behind.

use crate::inputs::commands::ns;
use nalgebra::{DMatrix, DVector, Matrix3, UnitQuaternion, Vector3};
use whorl_dynamics::plant::{RATE, ROTATION};

use crate::blocks::Said;
use crate::columns::Columns;
use crate::filter::Filter;
use crate::noise::Noise;
use crate::prepared::Prepared;
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

/// What readings say of the state at an instant before them: with x and P the filter's state and covariance there, before these readings, they move
/// the state to x + P `slope` and leave P - P `information` P.
struct Later {
    /// How an error of the filter at the instant moves to the present, readings included: present by instant.
    transition: DMatrix<f64>,
    /// Sum of a e/S, a = d reading/d state at the instant, through the filter's gains in between.
    slope: DVector<f64>,
    information: DMatrix<f64>,
}

impl Later {
    fn none(size: usize) -> Self {
        let (slope, information) = (DVector::zeros(size), DMatrix::zeros(size, size));
        Self { transition: DMatrix::identity(size, size), slope, information }
    }

    fn of(columns: Columns<'_>, size: usize) -> Self {
        let transition = DMatrix::from_fn(size, size, |i, k| columns.blocks.at(i, k));
        let Said { slope, information, .. } = columns.blocks.said();
        Self { transition, slope, information }
    }
}

/// The filter's state at an instant, and what the readings to the next one say of it.
struct Node {
    time_s: f64,
    state: Start,
    later: Later,
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
            node.later = Later::of(columns, size);
        }
        nodes.push(Node::of(&filter, size));
    }
    if filter.is_lost() {
        return None;
    }
    if let Some((node, columns)) = nodes.last_mut().zip(filter.columns.take()) {
        node.later = Later::of(columns, size);
    }
    let free = case.model().freedom.projection();
    let (mut states, mut later) = (Vec::with_capacity(nodes.len()), Later::none(size));
    while let Some(node) = nodes.pop() {
        let (state, all) = node.smoothed(&later, &free);
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
        let state = Start {
            layout: filter.mean.layout,
            q_world_body: state.q_world_body,
            omega_wb_b_rad_s: state.omega_wb_b_rad_s,
            wheel_speed_rad_s: state.wheel_speed_rad_s().to_vec(),
            hidden: Vec::new(),
            beside: filter.mean.beside.clone(),
            covariance: filter.gains.covariance.matrix(size, size),
        };
        Self { time_s: filter.mean.plant.now_ns() as f64 * 1e-9, state, later: Later::none(size) }
    }

    /// The state with what all readings behind it say, and what these say, that behind the next node included.
    fn smoothed(self, later: &Later, free: &Matrix3<f64>) -> (SmoothedState, Later) {
        let mut all = self.later;
        all.slope.gemv_tr(1.0, &all.transition, &later.slope, 1.0);
        all.information += all.transition.transpose() * &later.information * &all.transition;
        let (p, layout) = (&self.state.covariance, self.state.layout);
        let covariance = p - p * &all.information * p;
        let state = self.state.moved(&(p * &all.slope));
        let stddev = |i: usize| covariance[(i, i)].max(0.0).sqrt();
        let processes = || layout.disturbance().step_by(3);
        let torque: Vector3<f64> =
            processes().map(|from| Vector3::from_fn(|i, _| state.beside[from + i])).sum();
        let pairs = processes().flat_map(|from| processes().map(move |to| (from, to)));
        let of_torque: Matrix3<f64> =
            pairs.map(|pair| Matrix3::from(covariance.fixed_view::<3, 3>(pair.0, pair.1))).sum();
        let state = SmoothedState {
            time_s: self.time_s,
            q_world_body: state.q_world_body,
            attitude_stddev_b_rad: Vector3::from_fn(|i, _| stddev(ROTATION.start + i)),
            omega_wb_b_rad_s: state.omega_wb_b_rad_s,
            omega_stddev_b_rad_s: Vector3::from_fn(|i, _| stddev(RATE.start + i)),
            wheel_speed_rad_s: state.wheel_speed_rad_s,
            wheel_speed_stddev_rad_s: layout.plant.wheels().map(stddev).collect(),
            torque_b_n_m: free * torque,
            torque_covariance_b: free * of_torque * free.transpose(),
            motor_torque_n_m: layout.motors().map(|i| state.beside[i]).collect(),
            motor_torque_stddev_n_m: layout.motors().map(stddev).collect(),
        };
        (state, all)
    }
}
