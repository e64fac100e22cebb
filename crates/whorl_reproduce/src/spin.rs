//! Figures 4.10-4.20: the bias filter on simulated motion.

use nalgebra::{Unit, UnitQuaternion, Vector3};
use whorl_dynamics::{MassProperties, PlatformModel};
use whorl_estimation::{
    AttitudeBiasEstimator, GyroSampling, ImuSample, Parameters, VectorParameters, VectorUse,
};
use whorl_math::{attitude_error, tilt_rad, wrap_angle_rad};
use whorl_report::{ReproducedPlot, Reproduction};

use crate::data::{measured, rigid_whorl_1};
use crate::regression::{StateSample, StateSeries};
use crate::rigid_body::simulate_rigid_body;
use crate::spin_sentences::{self, Measures};

/// Scale error of the simulated gyros: what makes heading drift with the rate of spin.
const GYRO_SCALE: f64 = 1e-3;
/// Rate of all samples \[Hz\].
const RATE_HZ: f64 = 100.0;

/// One run of the filter.
struct Run {
    title: String,
    truth: StateSeries,
    /// Noise of the second vector sensor \[rad\]; `None`: there is none.
    vector_noise_rad: Option<f64>,
}

/// Output of the filter: time and values.
#[derive(Default)]
struct Traces {
    tilt: [Vec<(f64, f64)>; 2],
    clocking: [Vec<(f64, f64)>; 2],
    tilt_error: Vec<(f64, f64)>,
    clocking_error: Vec<(f64, f64)>,
    error: [Vec<(f64, f64)>; 3],
    three_sigma: Vec<(f64, f64)>,
    angles: [Vec<(f64, f64)>; 3],
    rates: [Vec<(f64, f64)>; 3],
    rates_true: [Vec<(f64, f64)>; 3],
}

/// A figure by its name; `None` for an unknown name.
pub fn figure(name: &str) -> Option<Reproduction> {
    use std::f64::consts::PI;
    let nominal = || Run {
        title: "flat spin at pi/4 rad/s".into(),
        truth: spin(PI / 4.0, 0.0, 60.0),
        vector_noise_rad: Some(2e-3),
    };
    let blind = |title: &str, truth| Run { title: title.into(), truth, vector_noise_rad: None };
    let whorl_1 = rigid_whorl_1(true).mass_properties;
    let (runs, kind): (Vec<Run>, Kind) = match name {
        "fig_4_10" => (vec![nominal()], Kind::State),
        "fig_4_11" => (vec![nominal()], Kind::Error),
        "fig_4_13" => (vec![nominal()], Kind::Angles),
        "fig_4_14" => (vec![nominal()], Kind::AngleError),
        "fig_4_15" => (
            vec![
                Run {
                    title: "(a) vector sensor ten times noisier".into(),
                    vector_noise_rad: Some(2e-2),
                    ..nominal()
                },
                blind("(b) no vector sensor", spin(PI / 4.0, 0.0, 60.0)),
            ],
            Kind::AngleError,
        ),
        "fig_4_16" => (
            vec![
                blind("(a) flat spin at pi rad/s", spin(PI, 0.0, 60.0)),
                blind("(b) flat spin at 2 pi rad/s", spin(2.0 * PI, 0.0, 60.0)),
            ],
            Kind::AngleError,
        ),
        "fig_4_17" => (
            vec![
                blind("pi rad/s with deflections of up to 60 deg", spin(PI, 60.0, 60.0)),
                blind("flat spin at pi rad/s, for comparison", spin(PI, 0.0, 60.0)),
            ],
            Kind::AnglesAndError,
        ),
        "fig_4_18" => (
            vec![
                blind("(a) Whorl-I: swing of 4 deg", swing(&whorl_1, Vector3::x_axis(), 4.0, -2.0)),
                blind("(b) Whorl-II: swing of 30 deg", swing(&whorl_2(), Vector3::y_axis(), 30.0, -2.0)),
            ],
            Kind::AngleError,
        ),
        "fig_4_19" => (vec![blind("platform that does not move", still())], Kind::AnglesAndError),
        "fig_4_20" => {
            (vec![blind("x-rotation of 3 deg, 4 s for 30 s, then 6 s", oscillation())], Kind::AnglesAndError)
        }
        _ => return None,
    };
    let traces: Vec<Traces> = runs.iter().map(filtered).collect();
    let sentences = spin_sentences::of(name, &traces.iter().map(Traces::measures).collect::<Vec<_>>());
    // The flat spin of Figure 4.17 is there for its sentence alone.
    let shown = if name == "fig_4_17" { 1 } else { runs.len() };
    let plots =
        runs.iter().zip(&traces).take(shown).flat_map(|(run, traces)| plots(run, traces, kind)).collect();
    Some(Reproduction { plots, sentences, ..Reproduction::default() })
}

#[derive(Clone, Copy, PartialEq)]
enum Kind {
    State,
    Error,
    Angles,
    AngleError,
    AnglesAndError,
}

/// A flat spin, or one that starts deflected.
fn spin(rate_rad_s: f64, deflection_deg: f64, duration_s: f64) -> StateSeries {
    let model = rigid_whorl_1(true);
    let start = UnitQuaternion::from_axis_angle(&Vector3::x_axis(), deflection_deg.to_radians());
    let samples = (duration_s * RATE_HZ) as usize;
    let none = |_: f64| Vector3::zeros();
    let omega = Vector3::new(0.0, 0.0, rate_rad_s);
    simulate_rigid_body(&model.mass_properties, (start, omega), &none, 1.0 / RATE_HZ, samples, 4)
}

/// Whorl-II as params/whorl_2.yaml assumes it, about the shaft (x) and across: the dissertation prints no numbers.
fn whorl_2() -> MassProperties {
    let inertia_kg_m2 = nalgebra::Matrix3::new(3.5, 0.1, -0.15, 0.1, 17.0, 0.05, -0.15, 0.05, 17.5);
    MassProperties::new(inertia_kg_m2, Vector3::zeros(), 75.0).unwrap_or(rigid_whorl_1(true).mass_properties)
}

/// A pendulum released at a deflection about an axis; its stiffness in newton metres.
fn swing(
    body: &MassProperties,
    axis: Unit<Vector3<f64>>,
    deflection_deg: f64,
    mgr_z_n_m: f64,
) -> StateSeries {
    let offset = Vector3::new(0.0, 0.0, mgr_z_n_m);
    let mass = MassProperties::new(*body.inertia_b_kg_m2(), offset, body.mass_kg()).unwrap_or(*body);
    let start = UnitQuaternion::from_axis_angle(&axis, deflection_deg.to_radians());
    let none = |_: f64| Vector3::zeros();
    simulate_rigid_body(&mass, (start, Vector3::zeros()), &none, 1.0 / RATE_HZ, 6000, 2)
}

fn prescribed(attitude: &dyn Fn(f64) -> f64, duration_s: f64) -> StateSeries {
    let samples = (0..(duration_s * RATE_HZ) as usize).map(|k| {
        let time_s = k as f64 / RATE_HZ;
        let h = 1e-4;
        let rate = (attitude(time_s + h) - attitude(time_s - h)) / (2.0 * h);
        StateSample {
            time_s,
            q_world_body: UnitQuaternion::from_axis_angle(&Vector3::x_axis(), attitude(time_s)),
            omega_wb_b_rad_s: Vector3::new(rate, 0.0, 0.0),
            wheel_speed_rad_s: Vec::new(),
            external_torque_b_n_m: Vector3::zeros(),
        }
    });
    StateSeries { samples: samples.collect(), wheel_momentum_b_kg_m2: Vec::new() }
}

fn still() -> StateSeries {
    prescribed(&|_| 2.0_f64.to_radians(), 120.0)
}

/// Amplitude 3 deg; 4 s for 30 s, then 6 s, phase carried on.
fn oscillation() -> StateSeries {
    let phase = |t: f64| std::f64::consts::TAU * if t < 30.0 { t / 4.0 } else { 7.5 + (t - 30.0) / 6.0 };
    prescribed(&|t| 3.0_f64.to_radians() * phase(t).sin(), 60.0)
}

fn sensors(run: &Run) -> PlatformModel {
    let mut model = rigid_whorl_1(run.vector_noise_rad.is_some());
    let gyro = &mut model.sensors.gyro.errors;
    gyro.range = 100.0;
    gyro.scale = Vector3::repeat(GYRO_SCALE);
    // "Any constant offsets are calibrated out" (section 4.4): the remaining error.
    gyro.bias_turn_on_stddev = Vector3::repeat(2e-4);
    model.sensors.accelerometer.errors.range = 1e3;
    // Prescribed motions have no equation of motion to take the sensor's acceleration from.
    model.sensors.accelerometer.lever_arm_b_m = Vector3::zeros();
    if let (Some(vector), Some(noise)) = (&mut model.sensors.vector, run.vector_noise_rad) {
        vector.noise_stddev_rad = noise;
    }
    model
}

fn filtered(run: &Run) -> Traces {
    let model = sensors(run);
    let recording = measured(&run.truth, &model, 31, 10);
    let mut parameters = Parameters::motion_pak_ii();
    parameters.gyro_noise_rad_s_sqrt_hz = 1.7e-3 / RATE_HZ.sqrt();
    parameters.gyro_sampling = GyroSampling::Instantaneous;
    parameters.gyro_range_rad_s = 50.0;
    parameters.gyro_step_rad_s = 50.0;
    parameters.accelerometer_range_m_s2 = 500.0;
    parameters.gravity_tolerance_m_s2 = 50.0;
    parameters.initial_bias_sigma_rad_s = 5e-4;
    parameters.vector = run.vector_noise_rad.and_then(|noise_rad| {
        let reference_w = model.sensors.vector?.reference_direction_world;
        Some(VectorParameters {
            reference_w,
            noise_rad,
            usage: VectorUse::Direction,
            max_age_s: 0.2,
            stale_after_s: 0.5,
            recovery_s: 1.0,
        })
    });
    let mut traces = Traces::default();
    let Some(first) = run.truth.samples.first() else { return traces };
    // The start is known: these figures are of tracking, not of finding the attitude.
    let covariance =
        nalgebra::Matrix6::from_diagonal(&nalgebra::Vector6::new(1e-6, 1e-6, 1e-6, 2.5e-7, 2.5e-7, 2.5e-7));
    let start = first.q_world_body;
    let Ok(mut filter) =
        AttitudeBiasEstimator::with_attitude(parameters, 0, start, Vector3::zeros(), &covariance)
    else {
        return traces;
    };
    let ns = |t: f64| (t * 1e9).round() as i64;
    let vectors = recording.vectors.first();
    let mut next = 0;
    let samples = recording.gyro_b_rad_s.value.iter().zip(&recording.specific_force_b_m_s2.value);
    for (k, (truth, (gyro, force))) in run.truth.samples.iter().zip(samples).enumerate() {
        let stamp_ns = ns(truth.time_s);
        filter.on_imu(&ImuSample { stamp_ns, gyro_rad_s: *gyro, specific_force_m_s2: *force });
        if let Some(seen) = vectors.and_then(|v| {
            let t = v.direction_b.time_s.get(next)?;
            (*t <= truth.time_s).then(|| v.direction_b.value.get(next)).flatten()
        }) {
            next += 1;
            filter.on_vector(stamp_ns, seen);
        }
        if k % 5 == 0 && truth.time_s > 0.5 {
            traces.add(truth, &filter.estimate(stamp_ns));
        }
    }
    traces
}

/// Azimuth of the deflection: where body z leans to.
fn clocking_rad(q: &UnitQuaternion<f64>) -> f64 {
    let z = q * Vector3::z();
    z.y.atan2(z.x)
}

impl Traces {
    /// What the sentences are made of.
    fn measures(&self) -> Measures {
        let deg = |points: &[(f64, f64)], from_s: f64, to_s: f64| {
            let inside: Vec<f64> =
                points.iter().filter(|(t, _)| (from_s..to_s).contains(t)).map(|(_, y)| y.abs()).collect();
            inside.iter().sum::<f64>() / inside.len() as f64
        };
        let end_s = self.tilt_error.last().map_or(0.0, |(t, _)| *t);
        let worst = |points: &[(f64, f64)]| points.iter().map(|(_, y)| y.abs()).fold(0.0, f64::max);
        let outside = |axis: &Vec<(f64, f64)>| {
            axis.iter().zip(&self.three_sigma).filter(|(e, s)| e.1.abs() > s.1).count()
        };
        let count = 3 * self.three_sigma.len();
        let rates = self.rates.iter().zip(&self.rates_true);
        Measures {
            attitude_deg: self.error.iter().map(|e| worst(e)).fold(0.0, f64::max),
            rate_deg_s: rates
                .flat_map(|(a, b)| a.iter().zip(b).map(|(a, b)| (a.1 - b.1).abs()))
                .fold(0.0, f64::max),
            inside: 1.0 - self.error.iter().map(outside).sum::<usize>() as f64 / count as f64,
            tilt_deg: worst(&self.tilt_error),
            deflection_deg: worst(&self.tilt[0]),
            clocking_begin_deg: deg(&self.clocking_error, 0.0, 10.0),
            clocking_end_deg: deg(&self.clocking_error, end_s - 10.0, f64::INFINITY),
            seconds: end_s,
        }
    }

    fn add(&mut self, truth: &StateSample, estimate: &whorl_estimation::Estimate) {
        let t = truth.time_s;
        let (q, e) = (truth.q_world_body, estimate.q_world_body);
        let deg = f64::to_degrees;
        self.tilt[0].push((t, deg(tilt_rad(&q))));
        self.tilt[1].push((t, deg(tilt_rad(&e))));
        self.clocking[0].push((t, deg(clocking_rad(&q))));
        self.clocking[1].push((t, deg(clocking_rad(&e))));
        self.tilt_error.push((t, deg(tilt_rad(&e) - tilt_rad(&q))));
        if tilt_rad(&q) > 1.0_f64.to_radians() {
            self.clocking_error.push((t, deg(wrap_angle_rad(clocking_rad(&e) - clocking_rad(&q)))));
        }
        let error = attitude_error(&e, &q);
        let (roll, pitch, yaw) = e.euler_angles();
        for (axis, angle) in [roll, pitch, yaw].into_iter().enumerate() {
            self.error[axis].push((t, deg(error[axis])));
            self.angles[axis].push((t, deg(angle)));
            self.rates[axis].push((t, deg(estimate.omega_wb_b_rad_s[axis])));
            self.rates_true[axis].push((t, deg(truth.omega_wb_b_rad_s[axis])));
        }
        let variance = estimate.covariance.fixed_view::<3, 3>(0, 0).symmetric_eigenvalues().max();
        self.three_sigma.push((t, deg(3.0 * variance.max(0.0).sqrt())));
    }
}

fn plots(run: &Run, traces: &Traces, kind: Kind) -> Vec<ReproducedPlot> {
    let plot = |what: &str, y: &str, curves: Vec<(String, Vec<(f64, f64)>)>, dashed| ReproducedPlot {
        title: format!("{}: {what}", run.title),
        labels: ["time [s]".to_owned(), y.to_owned()],
        curves,
        dashed,
        ..ReproducedPlot::default()
    };
    let named = |names: [&str; 3], all: &[Vec<(f64, f64)>; 3]| {
        names.iter().zip(all).map(|(n, c)| ((*n).to_owned(), c.clone())).collect::<Vec<_>>()
    };
    let angles = || {
        vec![plot(
            "two-angle attitude (dashed: truth)",
            "angle [deg]",
            vec![
                ("out of plane".to_owned(), traces.tilt[1].clone()),
                ("clocking".to_owned(), traces.clocking[1].clone()),
            ],
            vec![
                ("true".to_owned(), traces.tilt[0].clone()),
                ("true".to_owned(), traces.clocking[0].clone()),
            ],
        )]
    };
    let errors = || {
        vec![plot(
            "two-angle error",
            "error [deg]",
            vec![
                ("out of plane".to_owned(), traces.tilt_error.clone()),
                ("clocking".to_owned(), traces.clocking_error.clone()),
            ],
            Vec::new(),
        )]
    };
    match kind {
        Kind::State => vec![
            plot("attitude", "angle [deg]", named(["roll", "pitch", "yaw"], &traces.angles), Vec::new()),
            plot(
                "rate (dashed: truth)",
                "rate [deg/s]",
                named(["x", "y", "z"], &traces.rates),
                named(["x true", "y true", "z true"], &traces.rates_true),
            ),
        ],
        Kind::Error => {
            let negative = traces.three_sigma.iter().map(|(t, s)| (*t, -s)).collect();
            let curves = named(["x", "y", "z"], &traces.error);
            vec![ReproducedPlot {
                band_of_all: Some([negative, traces.three_sigma.clone()]),
                ..plot("attitude error (grey: three standard deviations)", "error [deg]", curves, Vec::new())
            }]
        }
        Kind::Angles => angles(),
        Kind::AngleError => errors(),
        Kind::AnglesAndError => angles().into_iter().chain(errors()).collect(),
    }
}
