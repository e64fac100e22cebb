//! The model monitor's parameters: the single definition of their names, ranges and meaning.

use whorl_dynamics::{Gyrostat, ModelPrior, PlatformModel};
use whorl_monitoring::Settings;
use whorl_msgs::topics::PlatformId;
use whorl_params::{Reader, non_negative, own_platform, platform_model_with_prior, range};

/// Validated parameters of a model monitor.
#[derive(Debug, Clone, PartialEq)]
pub struct Parameters {
    /// The platform's index.
    pub platform: PlatformId,
    /// The platform's name.
    pub name: String,
    /// Whether it does anything.
    pub enabled: bool,
    /// The platform's model.
    pub model: PlatformModel,
    /// How well the model is known.
    pub prior: ModelPrior,
    /// How it is watched.
    pub settings: Settings,
    /// Rate of `model/fit` \[Hz\].
    pub rate_hz: f64,
    /// Another number than before: a mismatch is forgotten.
    pub forget: i64,
}

/// Reads them for the platform in whose namespace the node is. `None` when they are unusable: the reader then
/// holds the reasons.
pub fn read(r: &mut Reader<'_>) -> Option<Parameters> {
    let own = own_platform(r);
    let platform = platform_model_with_prior(r).and_then(|(model, prior)| match Gyrostat::new(&model) {
        Ok(_) => Some((model, prior.prior)),
        Err(error) => {
            r.reject("model", error.to_string());
            None
        }
    });
    let default = platform.as_ref().map_or_else(PlatformModel::whorl_1_reference, |(model, _)| model.clone());
    let d = Settings::of(&default);
    let enabled = r.bool_or(
        "enabled",
        true,
        "whether the platform is watched; false: the node only says that it waits",
    );
    let settings = Settings {
        bin_s: r.f64_or("bin_s", d.bin_s, range(0.02..=1.0), "readings are averaged over this long [s]"),
        start_every_s: r.f64_or(
            "start_every_s",
            d.start_every_s,
            range(1.0..=600.0),
            "a break of the model is looked for from every multiple of this on [s]",
        ),
        memory_s: r.f64_or(
            "memory_s",
            d.memory_s,
            range(10.0..=3600.0),
            "what broke longer ago than this is for the diagnosis to find [s]",
        ),
        from_start_s: r.f64_or(
            "from_start_s",
            d.from_start_s,
            range(0.0..=3600.0),
            "an error of the model from the start on is as likely as a break in so long a time; 0: breaks only [s]",
        ),
        false_alarms_per_h: r.f64_or(
            "false_alarms_per_h",
            d.false_alarms_per_h,
            range(1e-6..=60.0),
            "false alarms in an hour at most, in the mean",
        ),
        background_torque_n_m: r.f64_or(
            "background_torque_n_m",
            d.background_torque_n_m,
            non_negative(),
            "slow torque that the model need not know, standard deviation about each axis [N m]",
        ),
        background_time_s: r.f64_or(
            "background_time_s",
            d.background_time_s,
            range(1.0..=10_000.0),
            "time over which that torque changes [s]",
        ),
        pulse_relative_sigma: r.f64_or(
            "pulse_relative_sigma",
            d.pulse_relative_sigma,
            range(0.0..=1.0),
            "relative difference of one pulse of a jet from the next, standard deviation",
        ),
        motor_relative_sigma: r.f64_or(
            "motor_relative_sigma",
            d.motor_relative_sigma,
            range(0.0..=1.0),
            "relative error of a motor's torque from one moment to the next, standard deviation",
        ),
        motor_noise_sqrt_s: r.f64_or(
            "motor_noise_sqrt_s",
            d.motor_noise_sqrt_s,
            range(0.0..=1.0),
            "white noise of a motor's torque, over its largest torque [sqrt(s)]",
        ),
        motor_noise_learned_s: r.f64_or(
            "motor_noise_learned_s",
            d.motor_noise_learned_s,
            range(0.0..=3600.0),
            "that noise is learned in the first so many seconds that are watched; 0: it is as said [s]",
        ),
        systematic_sigma: r.f64_or(
            "systematic_sigma",
            d.systematic_sigma,
            range(0.0..=1.0),
            "whitened readings may be off by this always: evidence that such an error explains is none [standard deviations]",
        ),
        constants_time_s: r.f64_or(
            "constants_time_s",
            d.constants_time_s,
            range(1.0..=1e7),
            "constants of the platform may wander through their prior in this time [s]",
        ),
    };
    let rate_hz = r.f64_or("rate_hz", 1.0, range(0.1..=20.0), "rate of model/fit [Hz]");
    let forget = r.i64_or(
        "forget",
        0,
        range(0..=i64::from(i32::MAX)),
        "another number than before makes the node forget a mismatch, as after a repair",
    );
    let (index, name) = own?;
    let (model, prior) = platform?;
    Some(Parameters { platform: PlatformId(index), name, enabled, model, prior, settings, rate_hz, forget })
}
