//! Sensors whose axes turn against the gyro are named and used no more; right ones never are.

use crate::{AttitudeBiasEstimator, FilterEvent, Health, ImuSample, Parameters, Rejection, SampleOutcome};
use nalgebra::{UnitQuaternion, Vector3};

const STEP_NS: i64 = 10_000_000;

/// Turns about all axes for 40 s; `force` and `field` are signs of the sensors' axes.
fn turned(
    force: Vector3<f64>,
    field: Vector3<f64>,
) -> (AttitudeBiasEstimator, Vec<FilterEvent>, Option<SampleOutcome>) {
    let reference = Vector3::new(0.0, 0.6, -0.8);
    let parameters = Parameters::motion_pak_ii().with_vector(nalgebra::Unit::new_normalize(reference));
    let mut filter = AttitudeBiasEstimator::new(parameters).expect("allowed");
    let mut attitude = UnitQuaternion::<f64>::identity();
    let (mut events, mut latest) = (Vec::new(), None);
    for k in 1..4000 {
        let t = f64::from(k) * 0.01;
        let on = (t - 3.0).clamp(0.0, 1.0);
        // The accelerometer is in the centre of rotation.
        let rate = Vector3::new(0.5 * (1.1 * t).sin(), 0.5 * (0.9 * t).cos(), 0.5) * on;
        attitude *= UnitQuaternion::from_scaled_axis(rate * 0.01);
        let ripple = |k: i32| 1e-4 * Vector3::new(f64::from(k % 7), f64::from(k % 5), f64::from(k % 3));
        let sample = ImuSample {
            stamp_ns: i64::from(k) * STEP_NS,
            gyro_rad_s: rate + ripple(k),
            specific_force_m_s2: (attitude.inverse() * Vector3::new(0.0, 0.0, 9.81) + ripple(k))
                .component_mul(&force),
        };
        events.extend(filter.on_imu(&sample).event);
        if k % 10 == 0 {
            let seen = (attitude.inverse() * reference + ripple(k)).component_mul(&field);
            let (outcome, event) = filter.on_vector(sample.stamp_ns, &seen);
            events.extend(event);
            latest = Some(outcome);
        }
    }
    (filter, events, latest)
}

#[test]
fn a_reversed_axis_of_the_vector_sensor_is_named_and_the_sensor_left_out() {
    for (axis, name) in [(0, 'x'), (1, 'y'), (2, 'z')] {
        let mut signs = Vector3::repeat(1.0);
        signs[axis] = -1.0;
        let (filter, events, latest) = turned(Vector3::repeat(1.0), signs);
        assert!(events.contains(&FilterEvent::VectorContradicted), "{name}: {events:?}");
        assert_eq!(latest, Some(SampleOutcome::Rejected(Rejection::Contradicted)));
        let [force, field] = filter.contradictions();
        assert_eq!(field.as_ref().expect("contradicted").reversed, [name]);
        assert!(force.is_none(), "{force:?}");
        let estimate = filter.estimate(4000 * STEP_NS);
        assert_eq!(estimate.health, Health::Degraded);
        assert!(filter.rejections()[2].of(Rejection::Contradicted) > 10);
        // Nothing says where north is.
        let heading_variance = estimate.covariance.fixed_view::<3, 3>(0, 0).symmetric_eigenvalues().max();
        assert!(heading_variance > 1.0, "{heading_variance}");
    }
}

#[test]
fn a_reversed_axis_of_the_accelerometer_is_named_and_the_sensor_left_out() {
    let (filter, events, _) = turned(Vector3::new(-1.0, 1.0, 1.0), Vector3::repeat(1.0));
    assert!(events.contains(&FilterEvent::AccelerometerContradicted), "{events:?}");
    let [force, field] = filter.contradictions();
    assert_eq!(force.as_ref().expect("contradicted").reversed, ['x']);
    assert!(field.is_none(), "{field:?}");
    assert_ne!(filter.estimate(4000 * STEP_NS).health, Health::Ok);
}

#[test]
fn right_sensors_are_not_contradicted() {
    let (filter, events, latest) = turned(Vector3::repeat(1.0), Vector3::repeat(1.0));
    assert_eq!(filter.contradictions(), &[None, None]);
    assert_eq!(
        (events.as_slice(), latest),
        (&[FilterEvent::StartedWithVector][..], Some(SampleOutcome::Used))
    );
    assert_eq!(filter.estimate(3999 * STEP_NS).health, Health::Ok);
}
