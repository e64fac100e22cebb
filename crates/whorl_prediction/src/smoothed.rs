//! The motion of a whole run, and what pushed the platform beside its model, from all readings before and behind.

use nalgebra::{DMatrix, DVector, Matrix3, UnitQuaternion, Vector3};
use whorl_dynamics::plant::{RATE, ROTATION};

use crate::columns::Columns;
use crate::commands::ns;
use crate::filter::Filter;
use crate::{Noise, Prepared, Start};

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
    /// Its standard deviation [rad/s].
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

/// The filter's state at an instant, and what the readings behind it say: with x and P the state and covariance there, they move the state to
/// x + P `slope` and leave P - P `information` P.
struct Node {
    time_s: f64,
    state: Start,
    /// How an error of the filter at the instant moves to the next node, readings included: that by this.
    transition: DMatrix<f64>,
    /// Sum of a e/S, a = d reading/d state at the instant, through the filter's gains in between.
    slope: DVector<f64>,
    information: DMatrix<f64>,
}

/// States every `every_s` seconds, at instants at which anything was read, and further apart where the run is so long that they would
/// take more than 48 MB on the way. `None` where the motion is lost. The filter goes once through the recording (METHOD.md, "Smoothed").
pub fn smoothed(
    case: &Prepared<'_>,
    noise: &Noise,
    start: &Start,
    every_s: f64,
) -> Option<Vec<SmoothedState>> {
    let size = start.layout.size();
    let least_s = case.recording().duration_s() * 24.0 * (size * size) as f64 / MOST_BYTES;
    let every_ns = ns(every_s.max(least_s)).max(1);
    let mut filter = Filter::new(case, noise, start);
    let mut nodes: Vec<Node> = Vec::new();
    let mut due_ns = i64::MIN;
    loop {
        let goes_on = filter.step(&mut |_| {});
        let now_ns = filter.mean.plant.now_ns();
        if goes_on && now_ns < due_ns {
            continue;
        }
        due_ns = now_ns.saturating_add(every_ns);
        let before = filter.columns.replace(Columns::of_state(start.layout, true, 0, None));
        if let Some((node, columns)) = nodes.last_mut().zip(before) {
            node.transition = DMatrix::from_fn(size, size, |i, k| columns.blocks.at(i, k));
            (node.information, node.slope, _) = columns.blocks.said();
        }
        if !goes_on {
            break;
        }
        nodes.push(Node::of(&filter, size));
    }
    let free = case.model().freedom.projection();
    // Of what comes behind each node, that of the next one.
    for k in (1..nodes.len()).rev() {
        let (before, later) = nodes.split_at_mut(k);
        let (node, later) = (&mut before[k - 1], &later[0]);
        node.slope.gemv_tr(1.0, &node.transition, &later.slope, 1.0);
        node.information += node.transition.transpose() * &later.information * &node.transition;
    }
    (!filter.mean.lost).then(|| nodes.iter().map(|node| node.smoothed(&free)).collect())
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
        let none = DMatrix::zeros(size, size);
        let time_s = filter.mean.plant.now_ns() as f64 * 1e-9;
        Self { time_s, state, transition: none.clone(), slope: DVector::zeros(size), information: none }
    }

    fn smoothed(&self, free: &Matrix3<f64>) -> SmoothedState {
        let (p, layout) = (&self.state.covariance, self.state.layout);
        let covariance = p - p * &self.information * p;
        let state = self.state.moved(&(p * &self.slope));
        let stddev = |i: usize| covariance[(i, i)].max(0.0).sqrt();
        let processes = || layout.disturbance().step_by(3);
        let torque: Vector3<f64> =
            processes().map(|from| state.beside.fixed_rows::<3>(from).into_owned()).sum();
        let pairs = processes().flat_map(|from| processes().map(move |to| (from, to)));
        let of_torque: Matrix3<f64> =
            pairs.map(|pair| Matrix3::from(covariance.fixed_view::<3, 3>(pair.0, pair.1))).sum();
        SmoothedState {
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
        }
    }
}
