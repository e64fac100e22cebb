//! Model uncertainty assumed by filters that use the body's equation of motion.

use whorl_dynamics::PlatformModel;
use whorl_dynamics::actuators::ActuatorKind;
use whorl_estimation::BodyModel;
use whorl_params::{Reader, range};

/// Reads group `body`; mass properties and sensor noise come from the platform's model, and so does the random walk of
/// the torque, unless it states none (`stated_walk_n_m_sqrt_s` = 0).
pub(super) fn read(
    r: &mut Reader<'_>,
    model: Option<&PlatformModel>,
    stated_walk_n_m_sqrt_s: f64,
) -> Option<BodyModel> {
    let inertia = model.map_or_else(nalgebra::Matrix3::identity, |m| *m.mass_properties.inertia_b_kg_m2());
    let offset = model.map_or_else(nalgebra::Vector3::zeros, |m| *m.mass_properties.gravity_offset_b_n_m());
    let mut d = BodyModel::new(inertia, offset);
    if stated_walk_n_m_sqrt_s > 0.0 {
        d.torque_walk_n_m_sqrt_s = stated_walk_n_m_sqrt_s;
    }
    let mut body = r.group("body", |r| BodyModel {
        inertia_relative_sigma: r.f64_or(
            "inertia_relative_sigma",
            d.inertia_relative_sigma,
            range(0.0..=1.0),
            "relative error of the model's inertia, standard deviation",
        ),
        torque_noise_n_m_sqrt_hz: r.f64_or(
            "torque_noise_n_m_sqrt_hz",
            d.torque_noise_n_m_sqrt_hz,
            range(0.0..=1.0),
            "white torque noise on the body [N m/sqrt(Hz)]",
        ),
        torque_sigma_n_m: r.f64_or(
            "torque_sigma_n_m",
            d.torque_sigma_n_m,
            range(0.0..=10.0),
            "torque that the model lacks, fixed in the body, standard deviation at the start [N m]",
        ),
        torque_walk_n_m_sqrt_s: r.f64_or(
            "torque_walk_n_m_sqrt_s",
            d.torque_walk_n_m_sqrt_s,
            range(0.0..=1.0),
            "random walk of that torque; by default what the model's effects state [N m/sqrt(s)]",
        ),
        jet_relative_sigma: r.f64_or(
            "jet_relative_sigma",
            d.jet_relative_sigma,
            range(0.0..=1.0),
            "relative error of a jet's impulse, standard deviation",
        ),
        gyro_scale_sigma: r.f64_or(
            "gyro_scale_sigma",
            d.gyro_scale_sigma,
            range(0.0..=0.5),
            "relative error of the gyro's scale, standard deviation",
        ),
        ..d
    });
    let model = model?;
    let speed_noise_rad_s = model.sensors.wheel_speed.one_sample_stddev_rad_s();
    let noise = |kind: &dyn ActuatorKind| kind.momentum_noise_n_m_s(speed_noise_rad_s);
    body.stores_momentum = model.actuators.motor_ranges().iter().any(|range| !range.is_empty());
    body.wheel_momentum_noise_n_m_s = model.actuators.kinds().map(noise).into_iter().fold(0.0, f64::max);
    let accelerometer = &model.sensors.accelerometer.errors;
    body.accelerometer_bias_sigma_m_s2 = accelerometer.bias_turn_on_stddev.amax();
    body.accelerometer_bias_walk_m_s2_sqrt_s = accelerometer.bias_walk.amax();
    Some(body)
}
