//! The estimator's parameters: the single definition of their names, ranges and meaning.
//!
//! Sensor properties (noise, lever arm, reference direction) come from the platform's model;
//! these parameters define how the filter uses them.

mod body;

use nalgebra::Vector3;
use whorl_dynamics::actuators::Actuators;
use whorl_dynamics::{Gyrostat, PlatformModel};
use whorl_estimation::{
    AccelerationRejection, BodyModel, FilterKind, GyroSampling, Parameters as FilterParameters,
    VectorParameters, VectorUse,
};
use whorl_math::{GRAVITY_M_S2, rad_from_deg};
use whorl_msgs::topics::PlatformId;
use whorl_params::{Reader, non_negative, own_platform, platform_model_with_prior, positive, range};

use crate::calibration::Calibration;
use crate::identifying::Identification;

/// Validated parameters of an estimator.
#[derive(Debug, Clone, PartialEq)]
pub struct Parameters {
    /// The platform's index.
    pub platform: PlatformId,
    /// The platform's name.
    pub name: String,
    /// Which filter makes the estimate.
    pub kind: FilterKind,
    /// The filter's parameters.
    pub filter: FilterParameters,
    /// The body, for filters that use its equation of motion.
    pub body: Option<BodyModel>,
    /// What moves on the platform, as its motors' messages say.
    pub actuators: Actuators,
    /// Torque of each jet at the reference pressure, body axes [N m].
    pub jet_torque_b_n_m: Vec<Vector3<f64>>,
    /// Known errors of the sensors.
    pub calibration: Calibration,
    /// Rate of `/tf` \[Hz\]; 0: none.
    pub tf_rate_hz: f64,
    /// Position of the platform's centre of rotation in the world, only for `/tf` \[m\].
    pub tf_position_w_m: Vector3<f64>,
    /// Whether and how mass properties are estimated while the platform moves.
    pub identification: Option<Identification>,
}

/// Reads them for the platform in whose namespace the node is. `None` when they are unusable: the reader then
/// holds the reasons.
pub fn read(r: &mut Reader<'_>) -> Option<Parameters> {
    let own = own_platform(r);
    // Effects that the model has adopted correct its constants: inertia, wheels, jets, sensors.
    let mut torque_walk_b_n_m_sqrt_s = Vector3::zeros();
    let platform = platform_model_with_prior(r).and_then(|(model, prior)| match Gyrostat::new(&model) {
        Ok(gyrostat) => {
            torque_walk_b_n_m_sqrt_s = gyrostat.effects().torque_walk_b_n_m_sqrt_s();
            Some((gyrostat.model().clone(), prior))
        }
        Err(error) => {
            r.reject("model", error.to_string());
            None
        }
    });
    let identification = Identification::read(r, platform.as_ref());
    let model = platform.map(|(model, _)| model);
    if let Some(model) = &model {
        refuse_sensors(r, model);
    }
    let calibration = model.as_ref().map(|m| Calibration::new(&m.sensors));
    let tf_rate_hz = r.f64_or("tf_rate_hz", 20.0, range(0.0..=100.0), "rate of /tf [Hz]; 0: none");
    let tf_position_w_m = r.vector3_or(
        "tf_position_w_m",
        Vector3::zeros(),
        range(-1000.0..=1000.0),
        "where the platform stands in the world, for /tf [m]",
    );
    let filter = read_filter(r, model.as_ref());
    if let Err(error) = filter.check() {
        r.reject(error.name, error.to_string());
    }
    let kind = r.choice_or(
        "filter",
        FilterKind::default().name,
        &FilterKind::ALL.map(|kind| kind.name),
        "the filter that computes the estimate",
    );
    let kind = FilterKind::find(kind).unwrap_or_default();
    let body = body::read(r, model.as_ref(), torque_walk_b_n_m_sqrt_s.amax());
    if let Some(Err(error)) = body.as_ref().map(BodyModel::check) {
        r.reject(error.name, error.to_string());
    }
    let actuators = model.as_ref().map(|m| m.actuators.clone()).unwrap_or_default();
    let jets = model.iter().flat_map(|m| m.jets());
    let jet_torque_b_n_m = jets.map(whorl_dynamics::platform::Jet::torque_b_n_m).collect();
    let (index, name) = own?;
    let platform = PlatformId(index);
    let calibration = calibration?;
    Some(Parameters {
        platform,
        name,
        kind,
        filter,
        body,
        actuators,
        jet_torque_b_n_m,
        calibration,
        tf_rate_hz,
        tf_position_w_m,
        identification,
    })
}

fn read_filter(r: &mut Reader<'_>, model: Option<&PlatformModel>) -> FilterParameters {
    let d = FilterParameters::motion_pak_ii();
    let sampling = r.choice_or(
        "gyro_sampling",
        "instantaneous",
        &["instantaneous", "interval_mean"],
        "whether a gyro sample is the rate at its stamp or the mean since the sample before",
    );
    let noise_scale = r.f64_or(
        "noise_scale",
        1.0,
        range(0.1..=10.0),
        "factor on all measurement noises of the model, for sensors worse than their data sheet",
    );
    let mut filter = FilterParameters {
        gyro_sampling: match sampling {
            "interval_mean" => GyroSampling::IntervalMean,
            _ => GyroSampling::Instantaneous,
        },
        gravity_m_s2: GRAVITY_M_S2,
        accelerometer_window_s: r.f64_or(
            "accelerometer_window_s",
            d.accelerometer_window_s,
            range(0.0..=10.0),
            "specific force is averaged this long, in a frame that does not turn, before it corrects [s]",
        ),
        accelerometer_velocity_sigma_m_s: r.f64_or(
            "accelerometer_velocity_sigma_m_s",
            d.accelerometer_velocity_sigma_m_s,
            non_negative(),
            "unknown change of the accelerometer's velocity over that time [m/s]; 0 on a fixed pivot",
        ),
        start_window_s: r.f64_or(
            "start_window_s",
            d.start_window_s,
            range(0.01..=60.0),
            "samples are averaged for this long before the first attitude [s]",
        ),
        start_vector_wait_s: r.f64_or(
            "start_vector_wait_s",
            d.start_vector_wait_s,
            range(0.0..=60.0),
            "how much longer the start waits for the vector sensor [s]",
        ),
        initial_heading_rad: rad_from_deg(r.f64_or(
            "initial_heading_deg",
            0.0,
            range(-360.0..=360.0),
            "initial yaw without a vector sensor [deg]",
        )),
        initial_heading_sigma_rad: rad_from_deg(r.f64_or(
            "initial_heading_sigma_deg",
            100.0,
            range(0.001..=180.0),
            "its standard deviation [deg]",
        )),
        initial_bias_sigma_rad_s: rad_from_deg(r.f64_or(
            "initial_bias_sigma_deg_s",
            1.0,
            range(1e-6..=50.0),
            "turn-on bias of the gyro, standard deviation [deg/s]",
        )),
        outlier_probability: r.f64_or(
            "outlier_probability",
            d.outlier_probability,
            range(1e-12..=0.1),
            "probability of refusing a good measurement as an outlier",
        ),
        recovery_s: r.f64_or(
            "recovery_s",
            d.recovery_s,
            range(0.01..=600.0),
            "after uninterrupted accelerometer outliers for this long the attitude is initialised again [s]",
        ),
        gravity_tolerance_m_s2: r.f64_or(
            "gravity_tolerance_m_s2",
            d.gravity_tolerance_m_s2,
            positive(),
            "a specific force whose length differs from gravity by more is refused [m/s^2]",
        ),
        frozen_samples: u32::try_from(r.i64_or(
            "frozen_samples",
            i64::from(d.frozen_samples),
            range(0..=10_000),
            "number of identical consecutive samples that indicate a frozen sensor; 0: no check",
        ))
        .unwrap_or(0),
        imu_gap_s: r.f64_or("imu_gap_s", d.imu_gap_s, range(0.001..=10.0), "an IMU gap beyond this adds uncertainty [s]"),
        imu_timeout_s: r.f64_or(
            "imu_timeout_s",
            d.imu_timeout_s,
            range(0.01..=60.0),
            "without IMU for this long the estimate is stale, and is initialised again when samples return [s]",
        ),
        unhealthy_tilt_sigma_rad: rad_from_deg(r.f64_or(
            "unhealthy_tilt_sigma_deg",
            5.0,
            range(0.01..=90.0),
            "tilt uncertainty above which the estimate is unhealthy, standard deviation [deg]",
        )),
        acceleration_rejection: r.group("acceleration_rejection", |r| {
            let gain = r.f64_or(
                "gain",
                0.0,
                range(0.0..=1000.0),
                "accelerometer noise added per unit of | |f| - g |, for a sensor that itself accelerates; 0: off",
            );
            let decay_s = r.f64_or("decay_s", 1.0, range(0.001..=100.0), "time constant of its decay [s]");
            (gain > 0.0).then_some(AccelerationRejection { gain, decay_s })
        }),
        ..d
    };
    let usage = r.group("vector", |r| {
        let usage = r.choice_or(
            "use",
            "direction",
            &["direction", "heading", "none"],
            "what the vector sensor corrects: both axes across it, only the heading (magnetometer), nothing",
        );
        let stale_after_s = r.f64_or(
            "stale_after_s",
            0.5,
            range(0.01..=60.0),
            "without it for this long the heading counts as unobserved [s]",
        );
        let max_age_s =
            r.f64_or("max_age_s", 0.2, range(0.001..=10.0), "an older sample is refused as late [s]");
        let recovery_s = r.f64_or(
            "recovery_s",
            1.0,
            range(0.01..=600.0),
            "after outliers for this long the heading is initialised again from the sensor [s]",
        );
        (usage, stale_after_s, max_age_s, recovery_s)
    });
    if let Some(model) = model {
        apply_model(&mut filter, model, noise_scale, usage);
    }
    filter
}

/// Every filter integrates a whole gyro and takes the vertical from weight.
fn refuse_sensors(r: &mut Reader<'_>, model: &PlatformModel) {
    if !model.freedom.has_weight() {
        let problem = "the vertical is taken from weight, which a free platform does not feel; allowed: on_bearing, hinge, clamped";
        r.reject("model.freedom.kind", problem);
    }
    if model.sensors.gyro.axes != [true; 3] {
        r.reject("model.sensors.gyro", "the attitude needs all axes; allowed: axes left out, or [x, y, z]");
    }
    if !model.sensors.accelerometer.fitted {
        r.reject("model.sensors", "the attitude needs an accelerometer; add model.sensors.accelerometer");
    } else if !model.sensors.accelerometer.shows_vertical() {
        let problem = "the vertical needs all axes; allowed: axes left out, or [x, y, z]";
        r.reject("model.sensors.accelerometer", problem);
    }
}

fn apply_model(
    filter: &mut FilterParameters,
    model: &PlatformModel,
    noise_scale: f64,
    (usage, stale_after_s, max_age_s, recovery_s): (&str, f64, f64, f64),
) {
    let sensors = &model.sensors;
    let (gyro, accelerometer) = (&sensors.gyro.errors, &sensors.accelerometer.errors);
    // White noise of one sample sigma at interval T has the density sigma sqrt(T).
    filter.gyro_noise_rad_s_sqrt_hz = noise_scale * gyro.one_sample_stddev().amax() / sensors.rate_hz.sqrt();
    filter.gyro_bias_walk_rad_s2_sqrt_hz = gyro.bias_walk.amax();
    filter.gyro_range_rad_s = gyro.range;
    // The accelerometer's bias is not estimated: its prior standard deviation counts as noise.
    filter.accelerometer_noise_m_s2 = noise_scale * accelerometer.one_sample_stddev().amax();
    filter.accelerometer_range_m_s2 = accelerometer.range;
    filter.accelerometer_position_b_m = sensors.accelerometer.lever_arm_b_m;
    filter.vector = sensors.vector.filter(|_| usage != "none").map(|vector| VectorParameters {
        reference_w: vector.reference_direction_world,
        noise_rad: noise_scale * vector.noise_stddev_rad,
        usage: if usage == "heading" { VectorUse::Heading } else { VectorUse::Direction },
        max_age_s,
        stale_after_s,
        recovery_s,
    });
}
