//! Explaining: answers as JSON texts, with their pages.

use std::path::PathBuf;
use std::sync::Arc;

use anyhow::bail;
use pyo3::prelude::*;
use whorl_commands::provenance::provenance;
use whorl_commands::runs::Runs;
use whorl_commands::{
    adopt as adoption, compare as comparison, diagnose as diagnosis, discover as discovery,
    identify as identification,
};
use whorl_commands::{locate as location, options, simulate::utc_now};
use whorl_dynamics::effects::find;
use whorl_explain::ProgressCallback;
use whorl_identification::Options;
use whorl_params::effect_yaml;
use whorl_recording::KnownPlatform;

use crate::platform::Platform;
use crate::recording::Recording;
use crate::watch::watched;

pub(crate) type Given<'py> = Vec<Bound<'py, Recording>>;

/// Recordings and their model, owned: computations go on in a thread of their own.
pub(crate) struct Material {
    pub(crate) runs: Runs,
    /// Data and call, for what is written.
    pub(crate) source: String,
}

pub(crate) fn material(
    training: &[Bound<'_, Recording>],
    held_out: &[Bound<'_, Recording>],
    platform: &Bound<'_, Platform>,
    call: &str,
) -> PyResult<Material> {
    let known: KnownPlatform = (*platform.get().0).clone();
    let own = |all: &[Bound<'_, Recording>]| all.iter().map(|r| (*r.get().inner).clone()).collect();
    let model = known.files.last().map_or_else(|| "in memory".to_owned(), |file| file.display().to_string());
    let mut named = Vec::new();
    for recording in training.iter().map(Bound::get) {
        named.push(match &recording.source {
            Some(path) => provenance(std::slice::from_ref(path), call).map_err(crate::errors::error)?,
            None => format!("{} (in memory); {call}", recording.inner.name),
        });
    }
    let suffix = format!("; {call}");
    let names: Vec<&str> = named.iter().map(|text| text.strip_suffix(&suffix).unwrap_or(text)).collect();
    let source = format!("{}{suffix}", names.join(", "));
    Ok(Material { runs: Runs::new(known, own(training), own(held_out), &model), source })
}

fn with_excluded(exclude: Vec<String>) -> anyhow::Result<Options> {
    if let Some(unknown) = exclude.iter().find(|id| find(id).is_none()) {
        bail!("there is no effect {unknown}; `whorl effects` lists them");
    }
    Ok(Options { exclude, ..options() })
}

/// How far off the model is: JSON and page.
#[pyfunction]
#[pyo3(signature = (training, held_out, platform, refit=false, progress=None))]
pub fn compare(
    py: Python<'_>,
    training: Given<'_>,
    held_out: Given<'_>,
    platform: &Bound<'_, Platform>,
    refit: bool,
    progress: Option<Py<PyAny>>,
) -> PyResult<(String, String)> {
    let Material { runs, .. } = material(&training, &held_out, platform, "compare")?;
    watched(py, progress, move |say| {
        let (compared, given) = if refit {
            let (given, refitted) = comparison::refitted(&runs.case(), say)?;
            (refitted, Some(given))
        } else {
            (whorl_explain::compare(&runs.case(), say)?, None)
        };
        let json = comparison::as_json(&runs.known.platform, &compared, given.as_deref())?;
        Ok((json.to_string(), whorl_report::comparison_html(&compared, &[], &runs.facts)))
    })
}

/// Where the model fails: JSON and page.
#[pyfunction]
#[pyo3(signature = (training, held_out, platform, progress=None))]
pub fn locate(
    py: Python<'_>,
    training: Given<'_>,
    held_out: Given<'_>,
    platform: &Bound<'_, Platform>,
    progress: Option<Py<PyAny>>,
) -> PyResult<(String, String)> {
    let Material { runs, .. } = material(&training, &held_out, platform, "where")?;
    watched(py, progress, move |say| {
        let found = whorl_explain::locate(&runs.case(), &options(), say)?;
        let json = location::as_json(&runs.known.platform, &found)?;
        Ok((json.to_string(), whorl_report::localisation_html(&found, &runs.facts)))
    })
}

/// Which effect the model lacks: JSON, sentences and page.
#[pyfunction]
#[pyo3(signature = (training, held_out, platform, exclude=vec![], progress=None))]
pub fn diagnose(
    py: Python<'_>,
    training: Given<'_>,
    held_out: Given<'_>,
    platform: &Bound<'_, Platform>,
    exclude: Vec<String>,
    progress: Option<Py<PyAny>>,
) -> PyResult<(String, Vec<String>, String)> {
    let Material { runs, .. } = material(&training, &held_out, platform, "diagnose")?;
    watched(py, progress, move |say| {
        let found = diagnosis::with_next(&runs, &with_excluded(exclude)?, say)?;
        let page = whorl_report::diagnosis_html(&found, &runs.facts);
        Ok((diagnosis::as_json(&found)?.to_string(), found.answer(), page))
    })
}

/// A law that nobody listed: JSON, page (if anything was searched for), and the best law as an effect in YAML.
#[pyfunction]
#[pyo3(signature = (training, held_out, platform, id, exclude=vec![], anyway=false, progress=None))]
#[expect(clippy::too_many_arguments, reason = "the arguments of a Python function")]
pub fn discover(
    py: Python<'_>,
    training: Given<'_>,
    held_out: Given<'_>,
    platform: &Bound<'_, Platform>,
    id: String,
    exclude: Vec<String>,
    anyway: bool,
    progress: Option<Py<PyAny>>,
) -> PyResult<(String, Option<String>, Option<String>)> {
    let Material { runs, source } = material(&training, &held_out, platform, "whorl.discover in Python")?;
    watched(py, progress, move |say| {
        let options = with_excluded(exclude)?;
        let (case, name) = (runs.case(), runs.known.platform.as_str());
        let mut said = |p: whorl_identification::Progress| say(0.5 * p.share, p.doing);
        let asked = whorl_identification::diagnose(
            case.training,
            case.held_out,
            case.model,
            case.prior,
            &options,
            &mut said,
        )?;
        if let Some(reason) = discovery::settled(&asked).filter(|_| !anyway) {
            let json = discovery::as_json(name, &asked, None, std::slice::from_ref(&reason))?;
            return Ok((json.to_string(), None, None));
        }
        let competitors = discovery::competitors(&asked);
        let mut rest = |share: f64, doing: &str| say(0.5 + 0.5 * share, doing);
        let found = whorl_identification::discover(
            case.training,
            case.held_out,
            case.model,
            case.prior,
            &competitors,
            &id,
            &options,
            &mut rest,
        )?;
        let answer = discovery::answer(&found);
        let json = discovery::as_json(name, &asked, Some(&found), &answer)?;
        let page = whorl_report::discovery_html(&found, &answer, &runs.facts);
        let yaml = found.best().and_then(|law| {
            Some(effect_yaml(law.definition.as_ref()?, &format!("{}\n{source}", law.sentence)))
        });
        Ok((json.to_string(), Some(page), yaml))
    })
}

/// What an adoption gives: JSON, page, the platform with the new model, and what was written.
type Adopted = (String, String, Option<Platform>, Option<String>);

/// Effects become part of the model: JSON, page, the new platform, and what was written into `out`.
#[pyfunction]
#[pyo3(signature = (training, held_out, platform, sets, out=None, anyway=false, progress=None))]
#[expect(clippy::too_many_arguments, reason = "the arguments of a Python function")]
pub fn adopt(
    py: Python<'_>,
    training: Given<'_>,
    held_out: Given<'_>,
    platform: &Bound<'_, Platform>,
    sets: Vec<Vec<String>>,
    out: Option<PathBuf>,
    anyway: bool,
    progress: Option<Py<PyAny>>,
) -> PyResult<Adopted> {
    let Material { runs, source } = material(&training, &held_out, platform, "whorl.adopt in Python")?;
    watched(py, progress, move |say| {
        if let Some(unknown) = sets.iter().flatten().find(|id| find(id).is_none()) {
            bail!("there is no effect {unknown}; `whorl effects` lists them");
        }
        let found = whorl_explain::adopt(&runs.case(), &sets, &options(), say)?;
        if let ([_], Some((version, error))) = (sets.as_slice(), found.left_out.first()) {
            bail!("cannot fit {version}: {error}");
        }
        let written = match &out {
            None => None,
            Some(out) => {
                Some(adoption::write(Some(out.as_path()), anyway, &runs, &found, &source, utc_now())?)
            }
        };
        let simulated = out.as_ref().and_then(|out| adoption::pointing(&runs, out).0);
        let platform = &runs.known.platform;
        let json =
            adoption::as_json(platform, &found.versions, &found.answer(), &source, simulated.as_ref())?;
        let new = found.versions.last().and_then(|version| version.fit.as_ref()).map(|fit| {
            let known =
                KnownPlatform { model: fit.model.clone(), prior: fit.prior.clone(), ..runs.known.clone() };
            Platform(Arc::new(known))
        });
        Ok((json.to_string(), whorl_report::adoption_html(&found, &runs.facts), new, written))
    })
}

/// Mass properties of a platform: JSON and the platform with them.
#[pyfunction]
#[pyo3(signature = (training, platform, prior_scale=1.0, progress=None))]
pub fn identify(
    py: Python<'_>,
    training: Given<'_>,
    platform: &Bound<'_, Platform>,
    prior_scale: f64,
    progress: Option<Py<PyAny>>,
) -> PyResult<(String, Option<Platform>)> {
    let Material { runs, .. } = material(&training, &[], platform, "identify")?;
    watched(py, progress, move |say: &mut ProgressCallback<'_>| {
        if !(prior_scale > 0.0 && prior_scale.is_finite()) {
            bail!("prior_scale is {prior_scale}; allowed: a positive number");
        }
        say(0.0, "identifying the mass properties");
        let known = &runs.known;
        let prior = known.prior.clone().with_mass_properties_scaled(prior_scale);
        let found = whorl_identification::identify(&runs.training, &known.model, &prior, &options())?;
        let json = identification::as_json(&known.platform, &known.model, &found);
        let new = found
            .updated()
            .map(|(model, prior)| Platform(Arc::new(KnownPlatform { model, prior, ..known.clone() })));
        Ok((json.to_string(), new))
    })
}
