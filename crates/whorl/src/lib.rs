//! Whorl as a library: model a rotating rig, simulate it, steer it, and explain its recordings.
//!
//! This crate holds no code. It gathers what users of the libraries need under one name, in the order of a
//! laboratory's day, with a compiled example for each. Vectors, matrices and quaternions are those of
//! [`nalgebra`]; units and frames stand in every name (`torque_b_n_m`: a torque in body axes, newton metres).
//!
//! | you want to | module |
//! |---|---|
//! | know the conventions; convert attitudes | [`math`] |
//! | describe a platform and simulate it with its physical effects | [`dynamics`] |
//! | turn a wanted torque into wheel torques and jet pulses | [`allocation`] |
//! | track attitudes, and hold a formation | [`control`] |
//! | estimate attitude from gyro, accelerometer and directions | [`estimation`] |
//! | estimate the orientation of a sensor in a hand, on a limb or on a vehicle | [`free_motion`] |
//! | compute the orbits and attitudes of a co-observation pass | [`orbits`] |
//! | read and write recordings | [`recording`], [`bag`] |
//! | identify mass properties | [`identification`] |
//! | check what was recorded, predict and fit it | [`prediction`] |
//! | calibrate gyro and accelerometer | [`calibration`] |
//! | compare model and recording, and learn which physical effect is missing | [`explain`] |
//! | read ROS 2 parameter files with errors that help | [`params`] |
//! | run the nodes of a whole experiment in one process | [`sim`] |

#[doc(no_inline)]
pub use nalgebra;

/// Rotations, attitude parameters, and the conventions that everything else keeps.
///
/// ```
/// use whorl::math::{attitude_error, tilt_rad, vertical_b};
/// use whorl::nalgebra::{UnitQuaternion, Vector3};
///
/// // A platform rolled by 0.1 rad; quaternions rotate body vectors into the world.
/// let q_world_body = UnitQuaternion::from_axis_angle(&Vector3::x_axis(), 0.1);
/// assert!((tilt_rad(&q_world_body) - 0.1).abs() < 1e-12);
/// // The vertical, seen from the body, leans towards +y.
/// assert!((vertical_b(&q_world_body) - Vector3::new(0.0, 0.1_f64.sin(), 0.1_f64.cos())).norm() < 1e-12);
/// let error = attitude_error(&UnitQuaternion::identity(), &q_world_body);
/// assert!((error - Vector3::new(0.1, 0.0, 0.0)).norm() < 1e-12);
/// ```
pub mod math {
    pub use whorl_math::*;
}

/// Platforms, the truth plant, and the catalogue of physical effects.
///
/// ```
/// use whorl::dynamics::{InitialState, Plant, PlatformModel};
/// use whorl::nalgebra::Vector3;
///
/// let mut model = PlatformModel::whorl_1_reference();
/// // A cable to the base, by its id in the catalogue (`whorl effects` lists them).
/// model.effects.insert("harness_spring".into(), [("k_n_m_rad".into(), 0.5)].into());
///
/// let initial = InitialState { omega_wb_b_rad_s: Vector3::new(0.0, 0.0, 0.05), ..Default::default() };
/// let mut plant = Plant::new(&model, &initial, 1)?;
/// plant.advance_to(20_000_000_000)?; // 20 s
///
/// // The cable has stopped the turn and pulls back.
/// assert!(plant.truth().omega_wb_b_rad_s.z < 0.0);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
pub mod dynamics {
    pub use whorl_dynamics::*;
}

/// The quadratic program that shares a torque among jets and wheels, and pulse modulation.
///
/// ```
/// use whorl::allocation::{Allocator, TorqueDemand, EffectorLayout, Effectors, Mode};
/// use whorl::nalgebra::{Matrix3xX, Vector3};
///
/// // Three wheels along the body axes, no jets.
/// let effectors = Effectors::new(EffectorLayout {
///     jet_torque_b_n_m: Matrix3xX::zeros(0),
///     jet_force_b_n: None,
///     jet_gas_rate_kg_s: vec![],
///     // A motor that accelerates its wheel turns the body the other way.
///     motor_torque_b: -Matrix3xX::identity(3),
///     motor_limit: vec![0.5; 3],
/// })?;
/// let mut allocator = Allocator::new(effectors)?;
///
/// // More than the z wheel can give: the direction is kept, the size is not.
/// let demand = TorqueDemand::nominal(allocator.effectors(), Mode::Motors, Vector3::new(0.2, 0.0, 1.0));
/// let allocation = allocator.allocate(&demand)?;
/// assert!((allocation.alpha - 0.5).abs() < 1e-9);
/// assert!((allocation.achieved_torque_b_n_m - Vector3::new(0.1, 0.0, 0.5)).norm() < 1e-9);
/// assert!((allocation.motor_command[2] + 0.5).abs() < 1e-9);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
pub mod allocation {
    pub use whorl_allocation::*;
}

/// Attitude tracking, reference shaping, momentum management and the formation laws.
///
/// ```
/// use whorl::control::Reference;
/// use whorl::control::formation::Offset;
/// use whorl::nalgebra::{UnitQuaternion, Vector3};
///
/// // A leader that turns at 1 deg/s, and a follower that looks 20 deg to the left of it.
/// let leader = Reference {
///     omega_wr_r_rad_s: Vector3::z() * 1_f64.to_radians(),
///     ..Reference::at_rest(UnitQuaternion::identity())
/// };
/// let offset = Offset::constant(UnitQuaternion::from_axis_angle(&Vector3::z_axis(), 20_f64.to_radians()));
/// let follower = offset.apply(&leader);
/// assert!((follower.q_world_reference.angle().to_degrees() - 20.0).abs() < 1e-9);
/// assert!((follower.omega_wr_r_rad_s - leader.omega_wr_r_rad_s).norm() < 1e-12);
/// ```
pub mod control {
    pub use whorl_control::*;
}

/// Attitude filters for platforms and free sensors, with their consistency statistics.
///
/// ```
/// use whorl::estimation::{Estimator, EstimatorError, FilterKind, ImuSample, Parameters};
/// use whorl::nalgebra::Vector3;
///
/// let mut estimator = Estimator::new(FilterKind::ATTITUDE_BIAS, Parameters::motion_pak_ii(), None)?;
/// // Two seconds at rest, rolled by 0.1 rad: the accelerometer reads the reaction to gravity. Real sensors are never
/// // still to the last digit; ones that are count as frozen.
/// for k in 0..200 {
///     let noise = if k % 2 == 0 { 1e-3 } else { -1e-3 };
///     estimator.on_imu(&ImuSample {
///         stamp_ns: k * 10_000_000,
///         gyro_rad_s: Vector3::repeat(noise),
///         specific_force_m_s2: Vector3::new(noise, 9.81 * 0.1_f64.sin() + noise, 9.81 * 0.1_f64.cos() + noise),
///     });
/// }
/// let estimate = estimator.estimate(2_000_000_000);
/// assert!((whorl::math::tilt_rad(&estimate.q_world_body) - 0.1).abs() < 1e-3);
/// # Ok::<(), EstimatorError>(())
/// ```
pub mod estimation {
    pub use whorl_estimation::*;
}

/// Orientation of a sensor that moves freely: gyro with accelerometer and magnetometer, or with known directions.
///
/// ```
/// use whorl::free_motion::{FreeMotionEstimator, FreeMotionParameters};
/// use whorl::nalgebra::{UnitQuaternion, Vector3};
///
/// // A sensor that lies rolled by 0.3 rad where the field is 22 uT north and 42 uT down. World axes: east, north, up.
/// let q_world_sensor = UnitQuaternion::from_axis_angle(&Vector3::x_axis(), 0.3);
/// let seen = |world: Vector3<f64>| q_world_sensor.inverse() * world;
/// let mut estimator = FreeMotionEstimator::new(FreeMotionParameters::default());
/// for k in 0..300 {
///     estimator.on_imu(k * 10_000_000, &Vector3::zeros(), &seen(Vector3::new(0.0, 0.0, 9.81)));
///     estimator.on_magnetometer(&seen(Vector3::new(0.0, 22.0, -42.0)));
/// }
/// let estimate = estimator.estimate().ok_or("no estimate yet")?;
/// assert!(estimate.q_world_body.angle_to(&q_world_sensor) < 1e-3);
/// # Ok::<(), &str>(())
/// ```
pub mod free_motion {
    pub use whorl_free_motion::*;
}

/// Two-body, relative and elliptic motion; co-observation passes and their scaling to the laboratory.
///
/// ```
/// use whorl::orbits::{EARTH_RADIUS_M, Elements};
/// use whorl::orbits::formation::Formation;
///
/// let chief = Elements {
///     semi_major_axis_m: EARTH_RADIUS_M + 500e3,
///     eccentricity: 0.0,
///     inclination_rad: 51.6_f64.to_radians(),
///     node_rad: 0.0,
///     perigee_rad: 0.0,
///     mean_anomaly_rad: 0.0,
/// };
/// assert!((chief.period_s() / 60.0 - 94.6).abs() < 0.1);
/// // A deputy 10 km away as seen along the radius, wherever on its circle.
/// let deputy = Formation::ProjectedCircular { radius_m: 10e3, phase_rad: 1.0 }.deputy(&chief)?;
/// assert!((deputy.position_m.yz().norm() - 10e3).abs() < 1e-6);
/// # Ok::<(), whorl::orbits::formation::FormationError>(())
/// ```
pub mod orbits {
    pub use whorl_orbits::*;
}

/// What was measured of one platform in one run, as series: the input of everything that explains data.
///
/// ```
/// use whorl::nalgebra::Vector3;
/// use whorl::recording::{Recording, Series};
///
/// let recording = Recording {
///     name: "spin".into(),
///     platform: "whorl_1".into(),
///     gyro_b_rad_s: Series { time_s: vec![0.0, 0.01], value: vec![Vector3::z(); 2] },
///     ..Recording::default()
/// };
/// assert_eq!(recording.duration_s(), 0.01);
/// ```
pub mod recording {
    pub use whorl_recording::*;
}

/// rosbag2 MCAP bags and run directories.
///
/// ```no_run
/// use std::path::Path;
/// use whorl::bag::RunDirectory;
///
/// let run = RunDirectory::open(Path::new("runs/2026-11-21T06-32-49Z_leader_follower"))?;
/// for message in run.bag()?.messages() {
///     println!("{:?}", message?.decode()?);
/// }
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
pub mod bag {
    pub use whorl_bag::*;
}

/// Bias, scale, misalignment and noise of gyro and accelerometer, from a sensor that lies on its faces and is turned between.
///
/// ```no_run
/// use std::path::Path;
/// use whorl::calibration::{CalibrationSettings, calibrate_imu};
/// use whorl::recording::{read_model, read_run};
///
/// let run = Path::new("runs/faces");
/// let known = read_model(run, None)?;
/// let recordings = read_run(run, Some(&known.platform))?;
/// let runs: Vec<_> = recordings.iter().collect();
/// let found = calibrate_imu(&runs, &known.model.sensors, &CalibrationSettings::default());
/// println!("{found:?}");
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
pub mod calibration {
    pub use whorl_calibration::*;
}

/// What recordings say about a model: which physical effect it lacks, mass properties, balancing.
///
/// ```no_run
/// use std::path::Path;
/// use whorl::identification::{Options, identify};
/// use whorl::recording::{read_model, read_run};
///
/// let run = Path::new("runs/identify");
/// let known = read_model(run, None)?;
/// let recordings = read_run(run, Some(&known.platform))?;
/// let found = identify(&recordings, &known.model, &known.prior, &Options::default())?;
/// println!("{found:?}");
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
pub mod identification {
    pub use whorl_identification::*;
}

/// The filter by which everything is predicted and fitted: what is to come from the readings so far, the likelihood of a whole run.
///
/// ```
/// use whorl::dynamics::PlatformModel;
/// use whorl::recording::{Needs, Recording, check};
///
/// // A recording without a gyro cannot say how the body turned, and the refusal says what would help.
/// let needs = Needs { shortest_s: 10.0, free: true, accelerometer: false };
/// let empty = Recording { name: "run_1".into(), ..Recording::default() };
/// let refusal = check(&empty, &PlatformModel::whorl_1_reference(), &needs).unwrap_err();
/// assert!(refusal.to_string().starts_with("run_1: there are no gyro data"));
/// ```
pub mod prediction {
    pub use whorl_prediction::*;
}

/// How far the model is off, where it fails, which physical effect it lacks, which run would tell more, and what adopting
/// the effect brings.
///
/// ```no_run
/// use std::path::Path;
/// use whorl::explain::{Case, compare, prediction_error};
/// use whorl::recording::{read_model, read_run};
///
/// let run = Path::new("runs/2026-11-21T06-32-49Z_swing");
/// let known = read_model(run, Some("whorl_1"))?;
/// let training = read_run(run, Some("whorl_1"))?;
/// let case = Case { training: &training, held_out: &[], model: &known.model, prior: &known.prior };
/// let runs = compare(&case, &mut |_share, _doing| {})?;
/// println!("{:?} times the noise", prediction_error(&runs, false));
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
pub mod explain {
    pub use whorl_explain::*;
}

/// ROS 2 parameter files to validated types, with errors that name file, line, key and what is allowed.
///
/// ```
/// use whorl::params::{ParameterTree, Reader, range};
///
/// let file = "/rig/estimator:\n  ros__parameters:\n    rate_hz: 5000\n";
/// let tree = ParameterTree::from_texts(&[("rig.yaml", file)], &[])?;
/// let read = |r: &mut Reader<'_>| r.f64_or("rate_hz", 100.0, range(1.0..=1000.0), "update rate [Hz]");
/// let errors = whorl::params::read(&tree.for_node("/rig/estimator"), read).map(|_| ()).unwrap_err();
/// assert!(errors.to_string().starts_with("rig.yaml:3: rate_hz = 5000.0: allowed: a number from 1 to 1000"));
/// # Ok::<(), whorl::params::ParameterErrors>(())
/// ```
pub mod params {
    pub use whorl_params::*;
}

/// The nodes of an experiment in one process: deterministic, faster than real time.
///
/// ```
/// use std::time::Duration;
/// use whorl::params::ParameterTree;
/// use whorl::sim::{NodeSet, Observer, Outcome, run};
///
/// /// Builds the nodes that the parameter files name and runs them for two minutes at most; the observer sees every
/// /// message in order of time.
/// fn simulate<O: Observer>(files: &ParameterTree, observer: &mut O) -> Result<Outcome, Box<dyn std::error::Error>>
/// where
///     O::Error: std::error::Error + 'static,
/// {
///     let mut nodes = NodeSet::build(files, 1, whorl::sim::Timestamp::from_seconds(0.0))?;
///     Ok(run(&mut nodes, Duration::from_secs(120), observer, |_seconds| {})?)
/// }
/// ```
pub mod sim {
    pub use whorl_node::Timestamp;
    pub use whorl_sim::*;
}
