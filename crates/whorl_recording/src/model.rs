//! Prior knowledge of a platform: its model and priors.

use std::path::{Path, PathBuf};

use whorl_bag::RunDirectory;
use whorl_dynamics::{ModelPrior, PlatformModel};
use whorl_math::statistics::median;
use whorl_math::words::or_did_you_mean;
use whorl_params::{
    ModelStep, NodeParameters, ParameterTree, PriorEntry, Value, load_effects_beside, model_history,
    platform_model_with_prior, read_shared,
};

use crate::{Recording, RecordingError};

/// A platform's model and how well it is known.
#[derive(Debug, Clone, PartialEq)]
pub struct KnownPlatform {
    /// Name of the platform.
    pub platform: String,
    /// The model that estimator and control use.
    pub model: PlatformModel,
    /// Standard deviations of the model's parameters.
    pub prior: ModelPrior,
    /// Those that its files give, with their sources; the rest is typical.
    pub prior_entries: Vec<PriorEntry>,
    /// The changes that commands made to the model, oldest first.
    pub history: Vec<ModelStep>,
    /// The files it was read from, lowest layer first.
    pub files: Vec<PathBuf>,
    /// Keys of sample rates that the files do not state: recordings show them, see [`Self::take_rates_of`].
    pub unstated_rates: Vec<&'static str>,
}

/// Sample rates that recordings show, and what stands for them until one is read \[Hz\]: a usual inertial sensor, a usual
/// magnetometer. Nothing that explains data depends on them.
const RATES: [(&str, f64); 2] = [(RATE, 100.0), (VECTOR_RATE, 10.0)];
const RATE: &str = "model.sensors.rate_hz";
const VECTOR_RATE: &str = "model.sensors.vector.rate_hz";

impl KnownPlatform {
    /// Takes sample rates that the platform's files do not state from a recording of it: the usual time between samples of gyro,
    /// else of the wheels' speeds, and of the first vector sensor.
    pub fn take_rates_of(&mut self, recording: &Recording) {
        let motion = [&recording.gyro_b_rad_s.time_s, &recording.wheel_speed_rad_s.time_s];
        let sensors = &mut self.model.sensors;
        if self.unstated_rates.contains(&RATE)
            && let Some(rate_hz) = motion.into_iter().find_map(|times| usual_rate_hz(times))
        {
            sensors.rate_hz = rate_hz;
        }
        let seen = recording.vectors.first().and_then(|sensor| usual_rate_hz(&sensor.direction_b.time_s));
        if let (true, Some(vector), Some(rate_hz)) =
            (self.unstated_rates.contains(&VECTOR_RATE), &mut sensors.vector, seen)
        {
            vector.rate_hz = rate_hz;
        }
    }
}

/// One over the median time between samples \[Hz\].
#[must_use]
pub fn usual_rate_hz(times_s: &[f64]) -> Option<f64> {
    let steps = times_s.windows(2).filter_map(|two| Some(two.get(1)? - two.first()?));
    let usual_s = median(steps);
    (usual_s > 0.0).then(|| 1.0 / usual_s)
}

/// Parameters with what stands for sample rates that they do not state, and the keys of these.
fn with_rates(mut parameters: NodeParameters) -> (NodeParameters, Vec<&'static str>) {
    let mut unstated = Vec::new();
    for (key, stands) in RATES {
        let group = key.rsplit_once('.').map_or("", |(group, _)| group);
        if parameters.get(key).is_none() && !parameters.children(group).is_empty() {
            parameters = parameters.with(key, Value::Double(stands));
            unstated.push(key);
        }
    }
    (parameters, unstated)
}

/// Reads the model of a platform: from a parameter file (layered on `common.yaml` beside it, if there is
/// one), or from the parameters saved in a run directory. `platform` may be left out where there is only one.
///
/// # Errors
/// What is wrong with the parameters, with file, line and key; or [`RecordingError::NoModel`].
pub fn read_model(source: &Path, platform: Option<&str>) -> Result<KnownPlatform, RecordingError> {
    let no_model = |hint: String| RecordingError::NoModel { path: source.to_owned(), hint };
    let files = parameter_files(source)?;
    if files.is_empty() {
        return Err(no_model(
            "a plain bag holds no parameters: name the platform's file, e.g. --model params/whorl_1.yaml"
                .into(),
        ));
    }
    load_beside(&files)?;
    let tree = ParameterTree::load(&files, &[])?;
    let present = tree.namespaces_with("model");
    let platform = match (platform, present.as_slice()) {
        (Some(platform), [_, ..]) if !present.iter().any(|name| name == platform) => {
            let likely = or_did_you_mean(platform, present.iter().map(String::as_str));
            return Err(no_model(format!(
                "it has the model of {}, not of {platform}{likely}",
                present.join(", ")
            )));
        }
        (Some(platform), _) => platform.to_owned(),
        (None, [only]) => only.clone(),
        // A section for every platform (`/**`) may hold one; then the run or the file names it.
        (None, []) => only_platform(source)
            .unwrap_or_else(|| source.file_stem().unwrap_or_default().to_string_lossy().into_owned()),
        (None, _) => {
            return Err(RecordingError::SeveralModels { path: source.to_owned(), present });
        }
    };
    let parameters = tree.for_node(&format!("/{platform}/estimator"));
    if parameters.children("model").is_empty() {
        return Err(no_model("params/README.md shows one".into()));
    }
    let (parameters, unstated_rates) = with_rates(parameters);
    let (read, history) = read_shared(&parameters, |r| (platform_model_with_prior(r), model_history(r)))?;
    // Without a model there were errors, which have been returned.
    let (model, known) = read.ok_or_else(|| no_model("it is incomplete".into()))?;
    Ok(KnownPlatform {
        platform,
        model,
        prior: known.prior,
        prior_entries: known.entries,
        history,
        files,
        unstated_rates,
    })
}

/// Adds the effects that belong to a parameter file, or to the parameters saved in a run directory, to the catalogue of
/// this process, as [`read_model`] does.
///
/// # Errors
/// What is wrong with one of their files, with file, line and key.
pub fn load_effects(source: &Path) -> Result<(), RecordingError> {
    load_beside(&parameter_files(source)?)
}

/// Not those of a simulation's truth: nobody but its driver may know them.
fn load_beside(files: &[PathBuf]) -> Result<(), RecordingError> {
    let is_of_truth = |file: &&PathBuf| file.parent().is_some_and(|folder| folder.ends_with("truth"));
    let known: Vec<PathBuf> = files.iter().filter(|file| !is_of_truth(file)).cloned().collect();
    Ok(load_effects_beside(&known)?)
}

/// The platform of a run directory that has only one.
fn only_platform(source: &Path) -> Option<String> {
    let platforms = RunDirectory::open(source).ok()?.platforms().ok()?;
    <[String; 1]>::try_from(platforms).ok().map(|[only]| only)
}

fn parameter_files(source: &Path) -> Result<Vec<PathBuf>, RecordingError> {
    let is_yaml = source.extension().is_some_and(|extension| extension == "yaml" || extension == "yml");
    if !is_yaml {
        return Ok(RunDirectory::open(source)?.parameter_files());
    }
    let common = source.with_file_name("common.yaml");
    let layered = common != source && common.is_file();
    Ok(layered.then_some(common).into_iter().chain([source.to_owned()]).collect())
}
