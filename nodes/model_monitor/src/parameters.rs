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
