//! Estimated motion from a recording, the input of the regressions of section 4.6.3.

use nalgebra::Vector3;
use whorl_dynamics::PlatformModel;
use whorl_estimation::{AttitudeBiasEstimator, ImuSample, Parameters, VectorParameters, VectorUse};
use whorl_recording::Recording;

use super::{StateSample, StateSeries};
use crate::prepared::{DataError, prepare};

/// Time for the filter to settle, left out \[s\].
const SETTLING_S: f64 = 3.0;

/// The attitude-error/gyro-bias filter (section 4.5.4) over a recording, sampled about every `step_s`;
/// wheel speeds and torques of jets and other actuators at the same times.
///
/// # Errors
/// When the recording cannot be used.
pub fn estimated_series(
    run: &Recording,
    model: &PlatformModel,
    step_s: f64,
) -> Result<StateSeries, DataError> {
    let chains = prepare(&[run], model, step_s)?;
    let mut filter = AttitudeBiasEstimator::new(parameters(run, model))
        .map_err(|error| DataError::Model(format!("the filter cannot use its sensors: {error}")))?;
    let ns = |t: f64| (t * 1e9).round() as i64;
    let mut series = StateSeries {
        samples: Vec::new(),
        wheel_momentum_b_kg_m2: StateSeries::momentum_axes(model.wheels()),
    };
    let points: Vec<_> = chains.iter().flat_map(|c| &c.points).collect();
    let (gyro, force) = (&run.gyro_b_rad_s, &run.specific_force_b_m_s2);
    let vector = run.vectors.first().map(|v| &v.direction_b);
    let (mut next_point, mut next_vector) = (0, 0);
    for (time_s, rate) in gyro.time_s.iter().zip(&gyro.value) {
        let Some(specific_force) = force.held_at(*time_s) else { continue };
        filter.on_imu(&ImuSample {
            stamp_ns: ns(*time_s),
            gyro_rad_s: *rate,
            specific_force_m_s2: *specific_force,
        });
        while let Some((t, seen)) =
            vector.and_then(|v| Some((v.time_s.get(next_vector)?, v.value.get(next_vector)?)))
        {
            if *t > *time_s {
                break;
            }
            filter.on_vector(ns(*t), seen);
            next_vector += 1;
        }
        let Some(point) = points.get(next_point) else { break };
        if *time_s + 1e-9 < point.time_s {
            continue;
        }
        next_point += 1;
        if *time_s - gyro.time_s.first().copied().unwrap_or(0.0) < SETTLING_S {
            continue;
        }
        let estimate = filter.estimate(ns(*time_s));
        let jets: Vector3<f64> =
            model.jets().iter().zip(&point.jet_share).map(|(jet, share)| jet.torque_b_n_m() * *share).sum();
        series.samples.push(StateSample {
            time_s: *time_s,
            q_world_body: estimate.q_world_body,
            omega_wb_b_rad_s: estimate.omega_wb_b_rad_s,
            wheel_speed_rad_s: point.wheel_speed_rad_s.clone(),
            external_torque_b_n_m: jets + point.body_torque_b_n_m,
        });
    }
    Ok(series)
}

fn parameters(run: &Recording, model: &PlatformModel) -> Parameters {
    let sensors = &model.sensors;
    let (gyro, force) = (&sensors.gyro.errors, &sensors.accelerometer.errors);
    let positive = |x: f64, fallback: f64| if x > 0.0 { x } else { fallback };
    let mut parameters = Parameters::motion_pak_ii();
    let gyro_noise = positive(gyro.noise_stddev.amax(), 1e-4);
    parameters.gyro_noise_rad_s_sqrt_hz = gyro_noise / sensors.rate_hz.sqrt();
    parameters.gyro_bias_walk_rad_s2_sqrt_hz = gyro.bias_walk.amax();
    parameters.accelerometer_noise_m_s2 = positive(force.noise_stddev.amax(), 1e-3);
    parameters.accelerometer_position_b_m = sensors.accelerometer.lever_arm_b_m;
    // Recordings may be slower than the nodes: a sample time is no gap.
    parameters.imu_gap_s = positive(2.5 / sensors.rate_hz, 0.05).max(0.05);
    parameters.imu_timeout_s = parameters.imu_timeout_s.max(2.0 * parameters.imu_gap_s);
    parameters.vector = run.vectors.first().map(|channel| VectorParameters {
        reference_w: channel.reference_world,
        noise_rad: positive(sensors.vector.map_or(0.0, |v| v.noise_stddev_rad), 1e-3),
        usage: VectorUse::Direction,
        max_age_s: 0.2,
        stale_after_s: 0.5,
        recovery_s: 1.0,
    });
    parameters
}
