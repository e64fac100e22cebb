//! Directions of a tumbling satellite, and smoothing against the closed form of a random walk.

use super::{
    DirectionFilter, DirectionParameters, Observed, Orientation, OrientationFilter, Sample, forward, smooth,
};
use nalgebra::{Unit, UnitQuaternion, Vector3};
use rand_core::SeedableRng;
use rand_distr::{Distribution, StandardNormal};
use rand_pcg::Pcg64Mcg;
use whorl_math::{quaternion_exp, rotation_vector};

const BIAS: [f64; 3] = [1e-3, -2e-3, 5e-4];
const NOISE_RAD: f64 = 2e-3;

struct Satellite {
    rate_hz: f64,
    seconds: f64,
    /// From when to when the gyro gives nothing \[s\].
    gap: [f64; 2],
    /// Samples between two of the sun sensor.
    sun_every: usize,
    start: Vector3<f64>,
    seed: u64,
}

/// Tumbles about a fixed axis of the body, so that the attitude is known in closed form.
fn attitude(start: &Vector3<f64>, t: f64) -> UnitQuaternion<f64> {
    quaternion_exp(start) * quaternion_exp(&(rate() * t))
}

fn rate() -> Vector3<f64> {
    Vector3::new(0.004, -0.007, 0.011)
}

/// A field that turns in the world as along an orbit, and the sun.
fn references(t: f64) -> [Unit<Vector3<f64>>; 2] {
    let phase = 2e-3 * t;
    [
        Unit::new_normalize(Vector3::new(phase.cos(), 0.3, phase.sin())),
        Unit::new_normalize(Vector3::new(0.2, 1.0, -0.4)),
    ]
}

fn fly(case: &Satellite, parameters: &DirectionParameters) -> Vec<(Sample, UnitQuaternion<f64>)> {
    let mut rng = Pcg64Mcg::seed_from_u64(case.seed);
    let mut normal3 = |sigma: f64| {
        Vector3::from_fn(|_, _| {
            let x: f64 = StandardNormal.sample(&mut rng);
            x * sigma
        })
    };
    let white = parameters.gyro_noise_rad_s_sqrt_hz * case.rate_hz.sqrt();
    let mut samples = Vec::new();
    for k in 0..(case.seconds * case.rate_hz) as usize {
        let t = k as f64 / case.rate_hz;
        if t > case.gap[0] && t < case.gap[1] {
            continue;
        }
        let truth = attitude(&case.start, t);
        let seen = |reference: &Unit<Vector3<f64>>, noise: Vector3<f64>| Observed {
            body: truth.inverse() * reference.into_inner() + noise,
            reference_w: Some(*reference),
        };
        let [field, sun] = references(t);
        let vectors = vec![
            Some(seen(&field, normal3(NOISE_RAD))),
            (k % case.sun_every == 0).then(|| seen(&sun, normal3(NOISE_RAD))),
        ];
        let gyro_rad_s = rate() + Vector3::from(BIAS) + normal3(white);
        let stamp_ns = (t * 1e9).round() as i64;
        samples.push((Sample { stamp_ns, gyro_rad_s, force_m_s2: None, vectors }, truth));
    }
    samples
}

fn parameters() -> DirectionParameters {
    DirectionParameters {
        gyro_noise_rad_s_sqrt_hz: 1e-4,
        gyro_bias_walk_rad_s_sqrt_s: 1e-7,
        gyro_bias_sigma_rad_s: 2e-3,
        direction_sigma_rad: vec![NOISE_RAD],
    }
}

fn error(o: &Orientation, truth: &UnitQuaternion<f64>) -> Vector3<f64> {
    rotation_vector(&(o.q_world_body.inverse() * truth))
}

fn nees(o: &Orientation, truth: &UnitQuaternion<f64>) -> f64 {
    let e = error(o, truth);
    let p = o.covariance.fixed_view::<3, 3>(0, 0).into_owned();
    e.dot(&(p.try_inverse().unwrap() * e))
}

/// Any rate of samples, any attitude at the start, also half a turn about each axis.
#[test]
fn two_samples_of_directions_give_the_attitude_at_any_rate() {
    use std::f64::consts::PI;
    for (seed, rate_hz) in [0.1_f64, 1.0, 10.0, 100.0, 1000.0].into_iter().enumerate() {
        for start in [Vector3::zeros(), Vector3::x() * PI, Vector3::y() * PI, Vector3::new(-2.0, 1.0, 1.5)] {
            let seconds = if rate_hz < 1.0 { 4000.0 } else { 300.0 / rate_hz.sqrt() };
            let case = Satellite { rate_hz, seconds, gap: [0.0; 2], sun_every: 1, start, seed: seed as u64 };
            let flight = fly(&case, &parameters());
            let mut filter = DirectionFilter::new(parameters());
            for (k, (sample, truth)) in flight.iter().enumerate() {
                filter.on_sample(sample);
                let found = filter.orientation();
                if k >= 1 {
                    let e = error(&found.unwrap(), truth).norm().to_degrees();
                    assert!(e < 1.0, "{rate_hz} Hz, sample {k}: {e}");
                }
            }
        }
    }
}

#[test]
fn errors_are_as_stated_and_the_bias_is_found() {
    let (mut sum, mut smoothed, mut count) = (0.0, 0.0, 0.0);
    for seed in 0..40 {
        let case = Satellite {
            rate_hz: 1.0,
            seconds: 600.0,
            gap: [0.0; 2],
            sun_every: 5,
            start: Vector3::new(0.3, -1.0, 2.0),
            seed,
        };
        let flight = fly(&case, &parameters());
        let samples: Vec<Sample> = flight.iter().map(|(s, _)| s.clone()).collect();
        let causal = forward(&mut DirectionFilter::new(parameters()), &samples);
        let whole = smooth(|| DirectionFilter::new(parameters()), &samples);
        for k in (50..550).step_by(50) {
            sum += nees(&causal[k].unwrap(), &flight[k].1);
            smoothed += nees(&whole[k].unwrap(), &flight[k].1);
            count += 1.0;
        }
        let last = causal.last().unwrap().unwrap();
        let off = (last.gyro_bias_rad_s - Vector3::from(BIAS)).norm();
        assert!(off < 5.0 * last.covariance[(3, 3)].sqrt() && off < 1e-4, "{off}");
    }
    // 400 samples of 3 numbers: 3 +- 0.12 one sigma, and they are correlated within a run.
    assert!((sum / count - 3.0).abs() < 0.5, "{}", sum / count);
    assert!((smoothed / count - 3.0).abs() < 0.5, "{}", smoothed / count);
}

#[test]
fn a_gap_of_minutes_is_bridged_by_a_new_start() {
    for rate_hz in [0.2, 1.0, 50.0] {
        let case = Satellite {
            rate_hz,
            seconds: 900.0,
            gap: [300.0, 540.0],
            sun_every: 1,
            start: Vector3::new(0.3, -1.0, 2.0),
            seed: 5,
        };
        let flight = fly(&case, &parameters());
        let mut filter = DirectionFilter::new(parameters());
        let mut after_gap = 0;
        for (sample, truth) in &flight {
            filter.on_sample(sample);
            after_gap += usize::from(sample.stamp_ns > 539_000_000_000);
            if after_gap > 1 {
                let found = filter.orientation().unwrap();
                assert!(error(&found, truth).norm().to_degrees() < 1.0, "{rate_hz}");
                assert!((found.gyro_bias_rad_s - Vector3::from(BIAS)).norm() < 5e-4, "the bias is kept");
            }
        }
        assert!(after_gap > 20);
    }
}

/// A random walk of intensity q per step, three orthogonal directions of variance s: each axis is measured with r = s/2. In
/// the limit of small q/r the filter's variance is sqrt(q r), and that of the smoother half of it (Gelb 1974, example 5.2-2).
#[test]
fn smoothing_halves_the_variance_of_a_random_walk() {
    let (step_s, sigma) = (1.0, 0.01);
    let q = 1e-4 * sigma * sigma / 2.0;
    let parameters = DirectionParameters {
        gyro_noise_rad_s_sqrt_hz: f64::sqrt(q / step_s),
        gyro_bias_walk_rad_s_sqrt_s: 0.0,
        gyro_bias_sigma_rad_s: 1e-9,
        direction_sigma_rad: vec![sigma],
    };
    let axes = [Vector3::x_axis(), Vector3::y_axis(), Vector3::z_axis()];
    let seen = |u: &Unit<Vector3<f64>>| Some(Observed { body: u.into_inner(), reference_w: Some(*u) });
    let samples: Vec<Sample> = (0..3000)
        .map(|k| Sample {
            stamp_ns: k * 1_000_000_000,
            gyro_rad_s: Vector3::zeros(),
            force_m_s2: None,
            vectors: axes.iter().map(seen).collect(),
        })
        .collect();
    let whole = smooth(|| DirectionFilter::new(parameters.clone()), &samples);
    let causal = forward(&mut DirectionFilter::new(parameters.clone()), &samples);
    let limit = (q * sigma * sigma / 2.0).sqrt();
    for axis in 0..3 {
        let filtered = causal[1500].unwrap().covariance[(axis, axis)];
        let smoothed = whole[1500].unwrap().covariance[(axis, axis)];
        assert!((filtered / limit - 1.0).abs() < 0.01, "{filtered} {limit}");
        assert!((smoothed / limit - 0.5).abs() < 0.005, "{smoothed} {limit}");
    }
}
