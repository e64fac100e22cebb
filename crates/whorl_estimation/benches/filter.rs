//! Cost of the filter's steps: one IMU sample (propagation and accelerometer), one vector sample,
//! one estimate.

#![allow(missing_docs, reason = "criterion's macros generate undocumented items")]
#![allow(clippy::expect_used, reason = "a bench stops at a broken precondition")]

use criterion::{BatchSize, Criterion, criterion_group, criterion_main};
use nalgebra::{Matrix3, Vector3};
use std::hint::black_box;
use whorl_estimation::{AttitudeBiasEstimator, BodyModel, Estimator, FilterKind, ImuSample, Parameters};
use whorl_free_motion::{FreeMotionEstimator, FreeMotionParameters};

fn sample(step: i64) -> ImuSample {
    let t = step as f64 * 0.01;
    ImuSample {
        stamp_ns: step * 10_000_000,
        gyro_rad_s: Vector3::new(0.02 * t.sin(), 0.02 * t.cos(), 0.3),
        specific_force_m_s2: Vector3::new(0.01 * (7.0 * t).sin(), 0.01 * (9.0 * t).sin(), 9.81),
    }
}

fn parameters(lever_arm: bool) -> Parameters {
    let mut parameters = Parameters::motion_pak_ii().with_vector(Vector3::x_axis());
    // Not a simulation: keep the gates open.
    parameters.outlier_probability = 1e-12;
    parameters.accelerometer_noise_m_s2 = 1.0;
    if lever_arm {
        parameters.accelerometer_position_b_m = Vector3::new(0.2, -0.1, 0.15);
    }
    parameters
}

fn running(lever_arm: bool) -> AttitudeBiasEstimator {
    let mut filter = AttitudeBiasEstimator::new(parameters(lever_arm)).expect("allowed");
    for step in 1..200 {
        filter.on_imu(&sample(step));
    }
    filter
}

fn filter(criterion: &mut Criterion) {
    for (name, lever_arm) in [("imu_every_sample", false), ("imu_lever_arm", true)] {
        criterion.bench_function(name, |bencher| {
            let mut filter = running(lever_arm);
            let mut step = 200;
            bencher.iter(|| {
                step += 1;
                filter.on_imu(black_box(&sample(step)))
            });
        });
    }
    criterion.bench_function("make_sample_alone", |bencher| {
        let mut step = 200;
        bencher.iter(|| {
            step += 1;
            sample(black_box(step))
        });
    });
    criterion.bench_function("vector_30_ms_late", |bencher| {
        let filter = running(false);
        bencher.iter_batched_ref(
            || filter.clone(),
            |filter| filter.on_vector(black_box(1_960_000_000), &Vector3::x()),
            BatchSize::SmallInput,
        );
    });
    criterion.bench_function("estimate", |bencher| {
        let filter = running(false);
        bencher.iter(|| black_box(&filter).estimate(black_box(2_000_000_000)));
    });
}

/// One IMU sample through each filter with its supervision; every tenth comes with a vector sample.
fn kinds(criterion: &mut Criterion) {
    for kind in FilterKind::ALL {
        criterion.bench_function(&format!("estimator_{}", kind.name), |bencher| {
            let inertia = Matrix3::from_diagonal(&Vector3::new(6.0, 7.0, 12.0));
            let body = BodyModel::new(inertia, Vector3::new(0.0, 0.0, -2.0));
            let mut estimator = Estimator::new(kind, parameters(false), Some(body)).expect("allowed");
            let mut step = 0;
            bencher.iter(|| {
                step += 1;
                let sample = sample(step);
                estimator.on_wheels(sample.stamp_ns, Vector3::x(), Vector3::zeros());
                estimator.on_imu(black_box(&sample));
                if step % 10 == 0 {
                    estimator.on_vector(sample.stamp_ns, &Vector3::x());
                }
            });
        });
    }
    criterion.bench_function("free_motion_sample", |bencher| {
        let mut estimator = FreeMotionEstimator::new(FreeMotionParameters::default());
        let mut step = 0;
        bencher.iter(|| {
            step += 1;
            let sample = sample(step);
            estimator.on_imu(step * 3_500_000, &sample.gyro_rad_s, black_box(&sample.specific_force_m_s2));
            estimator.on_magnetometer(&Vector3::new(0.1 * (step as f64 * 0.01).sin(), 15.0, -40.0));
        });
    });
}

criterion_group!(benches, filter, kinds);
criterion_main!(benches);
