//! Prior knowledge of a platform: its model and priors.

use std::path::{Path, PathBuf};

use whorl_bag::RunDirectory;
use whorl_dynamics::{ModelPrior, PlatformModel};
use whorl_math::words::or_did_you_mean;
use whorl_params::{
    ModelStep, ParameterTree, PriorEntry, load_effects_beside, model_history, platform_model_with_prior,
    read_shared,
};

use crate::RecordingError;

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
            let present = present.join(" and ");
            return Err(RecordingError::SeveralModels { path: source.to_owned(), present });
        }
    };
    let parameters = tree.for_node(&format!("/{platform}/estimator"));
    if parameters.children("model").is_empty() {
        return Err(no_model("params/README.md shows one".into()));
    }
    let (read, history) = read_shared(&parameters, |r| (platform_model_with_prior(r), model_history(r)))?;
    // Without a model there were errors, which have been returned.
    let (model, known) = read.ok_or_else(|| no_model("it is incomplete".into()))?;
    Ok(KnownPlatform { platform, model, prior: known.prior, prior_entries: known.entries, history, files })
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
