//! Local control's parameters: the single definition of their names, ranges and meaning.

mod authority;
mod excitations;

use std::ops::Range;
use std::time::Duration;

use nalgebra::Vector3;
use whorl_allocation::Mode;
use whorl_control::mass_balancing::BalancingSettings;
use whorl_control::momentum::{MomentumUnloading, UnloadingSettings};
use whorl_control::reference::{CommandFilterSettings, TiltEnvelope};
use whorl_control::safe_mode::{SafeMode, SafeModeSettings};
use whorl_control::tracking::{IntegralAction, TrackingGains, TrackingLaw};
use whorl_dynamics::PlatformModel;
use whorl_msgs::topics::PlatformId;
use whorl_params::{Reader, any, non_negative, own_platform, platform_model, positive, range};

pub use excitations::{Excitation, Hold};

/// Validated parameters.
#[derive(Debug, Clone, PartialEq)]
pub struct Parameters {
    /// The platform's index.
    pub platform: PlatformId,
    /// The platform's name.
    pub name: String,
    /// The platform's model.
    pub model: PlatformModel,
    /// Which actuators are used.
    pub actuators: Mode,
    /// Largest rate of control steps \[Hz\]; each is triggered by an estimate.
    pub control_rate_hz: f64,
    /// Rate of `control/status` \[Hz\].
    pub status_rate_hz: f64,
    /// How long a command is valid \[s\].
    pub command_validity_s: f64,
    /// Length of a jet slot \[s\].
    pub jet_slot_length_s: f64,
    /// Whether each jet is known to have failed, in the model's order.
    pub failed_jets: Vec<bool>,
    /// Whether the model's physical effects are compensated besides gravity.
    pub compensate_effects: bool,
    /// Gains when wheels take part.
    pub gains: TrackingGains,
    /// Gains with jets alone.
    pub jet_gains: TrackingGains,
    /// Safe mode.
    pub safe_mode: SafeModeSettings,
    /// Limits and timeouts.
    pub limits: Limits,
    /// The filter that brings the reference in after a jump.
    pub rejoin: CommandFilterSettings,
    /// Momentum unloading.
    pub unloading: UnloadingSettings,
    /// Wheel speeds to unload to \[rad/s\], one per wheel.
    pub wheel_speed_target_rad_s: Vec<f64>,
    /// Weight of deviations from the desired wheel torques in the allocation; see [`whorl_allocation::TorqueDemand`].
    pub wheel_weight: f64,
    /// Automatic mass balancing; `None`: the mass actuators are left alone.
    pub balancing: Option<BalancingSettings>,
    /// Excitations that the coordinator may request by name.
    pub excitations: Vec<Excitation>,
    /// Whether every allocation is compared with the exact oracle; doubles the computing time.
    pub check_allocation: bool,
}

/// Limits and timeouts.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Limits {
    /// References stay this far inside the bearing's limit \[rad\].
    pub reference_tilt_margin_rad: f64,
    /// Safe mode begins this far inside the bearing's limit \[rad\].
    pub safe_tilt_margin_rad: f64,
    /// Safe mode begins above this body rate \[rad/s\].
    pub max_rate_rad_s: f64,
    /// Age at which an estimate is stale \[s\].
    pub estimate_timeout_s: f64,
    /// Age at which a gyro sample is stale \[s\].
    pub imu_timeout_s: f64,
    /// Oldest message that is taken from another node \[s\].
    pub max_message_age_s: f64,
    /// Angular deceleration of a reference that is no longer renewed \[rad/s^2\].
    pub deceleration_rad_s2: f64,
    /// Longest time spent coming to rest after authority ended \[s\].
    pub authority_grace_s: f64,
}

impl Parameters {
    /// Period of the watchdog timer.
    #[must_use]
    pub fn timer_period(&self) -> Duration {
        Duration::from_millis(20)
    }
}

/// Reads them for the platform in whose namespace the node is. `None` when the model is unusable:
/// the reader then holds the reasons.
pub fn read(r: &mut Reader<'_>) -> Option<Parameters> {
    let own = own_platform(r);
    let model = platform_model(r, "model");
    let actuators = match r.choice_or(
        "actuators",
        "both",
        &["wheels", "motors", "jets", "both"],
        "wheels, or motors: momentum wheels and gimbals of control moment gyros alone; jets: cold-gas jets alone; both: \
         motors, wheels unloaded by the jets",
    ) {
        "wheels" | "motors" => Mode::Motors,
        "jets" => Mode::Jets,
        _ => Mode::Both,
    };
    let control_rate_hz =
        r.f64_or("control_rate_hz", 100.0, range(10.0..=1000.0), "largest rate of control steps [Hz]");
    let status_rate_hz = r.f64_or("status_rate_hz", 50.0, range(1.0..=1000.0), "rate of control/status [Hz]");
    let command_validity_s = r.f64_or(
        "command_validity_s",
        0.06,
        range(0.01..=0.1),
        "how long an actuator command is valid [s]; the driver stops everything after 0.1 s",
    );
    let jet_slot_length_s = r.f64_or(
        "jet_slot_length_s",
        0.1,
        range(0.02..=0.25),
        "length of a jet slot [s]: each jet fires at most one pulse in it",
    );
    let failed_names = r.string_array_or(
        "failed_jets",
        &[],
        "names of jets that must not be used, besides those the driver reports",
    );
    let compensate_effects = r.bool_or(
        "compensate_effects",
        true,
        "feed forward the torques of the model's physical effects, besides gravity",
    );
    let gains = r.group("tracking", |r| read_gains(r, &WHEELS));
    let jet_gains = r.group("tracking_jets", |r| read_gains(r, &JETS));
    let safe_mode = r.group("safe_mode", read_safe_mode);
    let limits = r.group("limits", read_limits);
    let rejoin = r.group("rejoin", read_rejoin);
    let unloading = r.group("unloading", read_unloading);
    let targets = r.group("unloading", |r| {
        r.f64_array_or(
            "wheel_speed_target_rad_s",
            &[],
            any(),
            "wheel speeds to unload to [rad/s], one per wheel; left out: zero",
        )
    });
    let wheel_weight = r.group("unloading", |r| {
        r.f64_or(
            "wheel_weight",
            200.0,
            range(0.0..=1e6),
            "weight of deviations from the desired wheel torque against gas: larger values use the jets more [1]",
        )
    });
    let balancing = r.group("balancing", |r| read_balancing(r, model.as_ref()));
    let excitations = r.fixed(|r| excitations::read(r, model.as_ref(), actuators, jet_slot_length_s));
    let check_allocation = r.bool_or(
        "check_allocation",
        false,
        "compares every allocation with the exact set of attainable torques; disagreements are counted in /diagnostics",
    );

    let model = model?;
    let failed_jets = model.jets().iter().map(|jet| failed_names.contains(&jet.name)).collect();
    if let Some(unknown) = failed_names.iter().find(|name| model.jets().iter().all(|jet| jet.name != **name))
    {
        let names: Vec<&str> = model.jets().iter().map(|jet| jet.name.as_str()).collect();
        r.reject("failed_jets", format!("there is no jet {unknown}; allowed: {}", names.join(", ")));
    }
    let wheels = model.wheels().len();
    if ![0, wheels].contains(&targets.len()) {
        r.reject(
            "unloading.wheel_speed_target_rad_s",
            format!("allowed: {wheels} numbers, one per wheel, or none"),
        );
    }
    if actuators != Mode::Motors && model.jets().is_empty() {
        r.reject("actuators", "the model has no jets; allowed: wheels or motors");
    }
    if actuators != Mode::Jets && model.actuators.motor_ranges().iter().all(Range::is_empty) {
        r.reject("actuators", "the model has no wheels and no control moment gyros; allowed: jets");
    }
    if actuators != Mode::Motors && !model.jets().is_empty() {
        authority::refuse_missing_torque(r, &model, actuators, &failed_names);
    }
    for margin in ["reference_tilt_margin_rad", "safe_tilt_margin_rad"] {
        let value = if margin.starts_with('r') {
            limits.reference_tilt_margin_rad
        } else {
            limits.safe_tilt_margin_rad
        };
        if let Err(error) = TiltEnvelope::new(model.tilt_limit, value) {
            r.reject(&format!("limits.{margin}"), error.to_string());
        }
    }
    for (group, gains) in [("tracking", gains), ("tracking_jets", jet_gains)] {
        let total = *model.mass_properties.inertia_b_kg_m2();
        if let Err(error) = TrackingLaw::new(total, &model.actuators, gains) {
            r.reject(group, error.to_string());
        }
    }
    if balancing.is_some() && actuators != Mode::Motors {
        r.reject(
            "balancing.enabled",
            "allowed with actuators: wheels alone; thrust is not known well enough",
        );
    }
    let (index, name) = own?;
    Some(Parameters {
        platform: PlatformId(index),
        name,
        actuators,
        control_rate_hz,
        status_rate_hz,
        command_validity_s,
        jet_slot_length_s,
        failed_jets,
        compensate_effects,
        gains,
        jet_gains,
        safe_mode,
        limits,
        rejoin,
        unloading,
        wheel_speed_target_rad_s: if targets.is_empty() { vec![0.0; wheels] } else { targets },
        wheel_weight,
        balancing,
        excitations,
        check_allocation,
        model,
    })
}

/// Slow sweeps of a few degrees make the z component observable as well; see [`whorl_control::mass_balancing`].
fn read_balancing(r: &mut Reader<'_>, model: Option<&PlatformModel>) -> Option<BalancingSettings> {
    let defaults = BalancingSettings::default();
    let stable = model.map_or(0.0, |m| m.mass_properties.gravity_offset_b_n_m().z);
    let enabled = r.bool_or(
        "enabled",
        false,
        "moves the linear mass actuators until the gravity offset is target_n_m, while tracking with the wheels",
    );
    let settings = BalancingSettings {
        target_b_n_m: r.vector3_or(
            "target_n_m",
            Vector3::new(0.0, 0.0, stable),
            any(),
            "gravity offset wanted [N m]; a negative z is stable; left out: no x and y, z as in the model",
        ),
        limit_b_n_m: r.vector3_or(
            "limit_n_m",
            Vector3::repeat(2.0),
            positive(),
            "largest moment of the actuators along each body axis, either way: weight times travel [N m]",
        ),
        window_s: r.f64_or(
            "window_s",
            defaults.window_s,
            range(1.0..=100.0),
            "momentum is balanced over windows of this length [s]; the actuators move after each",
        ),
        momentum_noise_n_m_s: r.f64_or(
            "momentum_noise_n_m_s",
            defaults.momentum_noise_n_m_s,
            positive(),
            "noise of a sample of momentum: inertia times noise of the estimated rate [N m s]",
        ),
        initial_stddev_n_m: r.f64_or(
            "initial_stddev_n_m",
            0.3,
            positive(),
            "how well the model's gravity offset is known, standard deviation [N m]",
        ),
        tolerance_n_m: r.f64_or(
            "tolerance_n_m",
            defaults.tolerance_n_m,
            positive(),
            "balanced when every axis is nearer to the target than this [N m]",
        ),
        ..defaults
    };
    enabled.then_some(settings)
}

struct GainDefaults {
    bandwidth_rad_s: f64,
    damping: f64,
    integral_time_s: f64,
    rate_error_time_constant_s: f64,
}

/// Wheels: with MotionPak-class noise, more bandwidth does not reduce the error against the
/// reference any further (the rest is the error of the estimate); the low-pass removes two thirds of the
/// gyro's noise from the motor commands.
const WHEELS: GainDefaults = GainDefaults {
    bandwidth_rad_s: 2.0,
    damping: 0.9,
    integral_time_s: 8.0,
    rate_error_time_constant_s: 0.05,
};

/// Jets respond to noise with pulses: less bandwidth and a longer low-pass save gas.
const JETS: GainDefaults = GainDefaults {
    bandwidth_rad_s: 0.8,
    damping: 0.9,
    integral_time_s: 8.0,
    rate_error_time_constant_s: 0.25,
};

fn read_gains(r: &mut Reader<'_>, defaults: &GainDefaults) -> TrackingGains {
    let bandwidth_rad_s = r.vector3_or(
        "bandwidth_rad_s",
        Vector3::repeat(defaults.bandwidth_rad_s),
        range(0.05..=10.0),
        "natural frequency of the pointing error about each body axis [rad/s]",
    );
    let damping = r.vector3_or(
        "damping",
        Vector3::repeat(defaults.damping),
        range(0.1..=5.0),
        "damping ratio about each body axis [1]",
    );
    let time_s = r.f64_or(
        "integral_time_s",
        defaults.integral_time_s,
        range(0.0..=1000.0),
        "integral time [s], more than 1/(2 damping bandwidth); 0: no integral action",
    );
    let limit_n_m = r.vector3_or(
        "integral_limit_n_m",
        Vector3::repeat(0.05),
        non_negative(),
        "largest torque of the integral action about each body axis [N m]",
    );
    let zone_rad = r.f64_or(
        "integral_zone_rad",
        0.035,
        positive(),
        "the integral action works only while the pointing error is smaller than this [rad]",
    );
    let rate_error_time_constant_s = r.f64_or(
        "rate_error_time_constant_s",
        defaults.rate_error_time_constant_s,
        range(0.0..=5.0),
        "time constant of the low-pass on the rate error [s]; 0: none",
    );
    let integral = (time_s > 0.0).then_some(IntegralAction { time_s, limit_n_m, zone_rad });
    TrackingGains { bandwidth_rad_s, damping, integral, rate_error_time_constant_s }
}

fn read_safe_mode(r: &mut Reader<'_>) -> SafeModeSettings {
    let settings = SafeModeSettings {
        damping_time_constant_s: r.f64_or(
            "damping_time_constant_s",
            2.0,
            range(0.1..=100.0),
            "time constant of rate damping [s]",
        ),
        coast_rate_rad_s: r.f64_or(
            "coast_rate_rad_s",
            0.005,
            positive(),
            "body rate below which damping ends and the platform coasts [rad/s]",
        ),
        rate_time_constant_s: r.f64_or(
            "rate_time_constant_s",
            0.5,
            range(0.0..=10.0),
            "time constant of the low-pass before the rate is compared with these limits [s]",
        ),
        dwell_s: r.f64_or("dwell_s", 1.0, non_negative(), "how long the rate must stay below that [s]"),
        redamp_rate_rad_s: r.f64_or(
            "redamp_rate_rad_s",
            0.05,
            positive(),
            "body rate above which a coasting platform is damped again [rad/s]",
        ),
        max_damping_s: r.f64_or(
            "max_damping_s",
            60.0,
            positive(),
            "longest time spent damping before coasting for good [s]",
        ),
        recovery_s: r.f64_or(
            "recovery_s",
            1.0,
            non_negative(),
            "how long there must be no fault before tracking resumes [s]",
        ),
    };
    if let Err(error) = SafeMode::new(settings) {
        r.reject(error.field, error.to_string());
    }
    settings
}

fn read_limits(r: &mut Reader<'_>) -> Limits {
    Limits {
        reference_tilt_margin_rad: r.f64_or(
            "reference_tilt_margin_rad",
            0.0087,
            positive(),
            "references are clipped this far inside the bearing's limit [rad]",
        ),
        safe_tilt_margin_rad: r.f64_or(
            "safe_tilt_margin_rad",
            0.0035,
            positive(),
            "safe mode begins this far inside the bearing's limit [rad]",
        ),
        max_rate_rad_s: r.f64_or(
            "max_rate_rad_s",
            0.5,
            positive(),
            "safe mode begins above this body rate [rad/s]",
        ),
        estimate_timeout_s: r.f64_or(
            "estimate_timeout_s",
            0.1,
            range(0.01..=10.0),
            "age at which an attitude estimate is stale [s]",
        ),
        imu_timeout_s: r.f64_or(
            "imu_timeout_s",
            0.1,
            range(0.01..=10.0),
            "age at which a gyro sample is stale [s]",
        ),
        max_message_age_s: r.f64_or(
            "max_message_age_s",
            1.0,
            positive(),
            "oldest reference or authority that is accepted [s]; includes the difference of the computers' clocks",
        ),
        deceleration_rad_s2: r.f64_or(
            "deceleration_rad_s2",
            0.015,
            positive(),
            "angular deceleration of a reference that is not renewed [rad/s^2]",
        ),
        authority_grace_s: r.f64_or(
            "authority_grace_s",
            20.0,
            non_negative(),
            "longest time spent coming to rest after authority ended without a word [s]",
        ),
    }
}

fn read_rejoin(r: &mut Reader<'_>) -> CommandFilterSettings {
    CommandFilterSettings {
        bandwidth_rad_s: r.f64_or(
            "bandwidth_rad_s",
            1.0,
            range(0.05..=20.0),
            "natural frequency of the filter that brings in a reference that jumped [rad/s]",
        ),
        damping: r.f64_or("damping", 1.0, range(0.3..=5.0), "its damping ratio [1]"),
        max_rate_rad_s: r.f64_or("max_rate_rad_s", 0.1, positive(), "its largest rate [rad/s]"),
        max_acceleration_rad_s2: r.f64_or(
            "max_acceleration_rad_s2",
            0.015,
            positive(),
            "its largest angular acceleration [rad/s^2]",
        ),
    }
}

fn read_unloading(r: &mut Reader<'_>) -> UnloadingSettings {
    let settings = UnloadingSettings {
        engage_share: r.f64_or(
            "engage_share",
            0.5,
            range(0.0..=1.0),
            "share of a wheel's largest momentum, away from its target, at which the jets begin to unload",
        ),
        release_share: r.f64_or(
            "release_share",
            0.1,
            range(0.0..=1.0),
            "share at which unloading ends; less than engage_share",
        ),
        time_constant_s: r.f64_or("time_constant_s", 20.0, positive(), "time constant of unloading [s]"),
    };
    if let Err(error) = MomentumUnloading::new(settings) {
        r.reject("engage_share", error.to_string());
    }
    settings
}
