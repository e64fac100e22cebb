//! The parameter file with the effect, where nothing speaks against it.

use std::path::Path;

use anyhow::{Context, bail};
use whorl_dynamics::PlatformModel;
use whorl_recording::KnownPlatform;
use whorl_report::three_digits;

use super::versions::{Version, error};
use crate::model_changes::{changes, write as write_model};
use crate::runs::Runs;

/// A held-out error this much above that before counts as worse.
pub const WORSE: f64 = 1.005;
/// Standard deviations of its prior beyond which no mass property is.
const BEYOND_BELIEF: f64 = 12.0;

/// Writes the last version into the parameter file and says so.
pub fn adopt(
    out: Option<&Path>,
    anyway: bool,
    runs: &Runs,
    versions: &[Version],
    provenance: &str,
) -> anyhow::Result<String> {
    let (Some(out), Some(first), Some(last)) = (out, versions.first(), versions.last()) else {
        bail!("name the file to write with --out");
    };
    let Some(fit) = &last.fit else { bail!("nothing was fitted") };
    if let (Some(before), Some(after)) = (error(first, true), error(last, true))
        && after > WORSE * before
        && !anyway
    {
        bail!(
            "the held-out runs are predicted worse with it ({before:.3} -> {after:.3} times the noise), so nothing was written; --anyway writes all the same"
        );
    }
    if let Some(reason) = strangest(&runs.known, &fit.model).filter(|_| !anyway) {
        bail!("{reason}. Nothing was written; --anyway writes all the same");
    }
    if !out.exists() {
        let source = runs.known.files.last().context("there is no parameter file to start from")?;
        std::fs::copy(source, out).with_context(|| format!("cannot write {}", out.display()))?;
    }
    let changes = changes((&runs.known.model, &fit.model), (&runs.known.prior, &fit.prior), provenance);
    if changes.is_empty() {
        bail!("the fit changed nothing, so nothing was written");
    }
    write_model(out, &runs.known.platform, &changes)?;
    Ok(format!("{}: {} entries written.", out.display(), changes.len()))
}

/// The mass property that a fit has moved beyond belief, in a sentence.
fn strangest(known: &KnownPlatform, fitted: &PlatformModel) -> Option<String> {
    let inertia = |model: &PlatformModel, i, j| model.mass_properties.inertia_b_kg_m2()[(i, j)];
    let offset = |model: &PlatformModel, i: usize| model.mass_properties.gravity_offset_b_n_m()[i];
    let mut parts = Vec::new();
    for (name, i, j) in [("xx", 0, 0), ("yy", 1, 1), ("zz", 2, 2), ("xy", 0, 1), ("xz", 0, 2), ("yz", 1, 2)] {
        let stddev = known.prior.inertia_b_kg_m2[(i, j)];
        let name = format!("inertia_kg_m2.{name}");
        parts.push((name, inertia(&known.model, i, j), inertia(fitted, i, j), stddev));
    }
    for (name, i) in [("x", 0), ("y", 1), ("z", 2)] {
        let stddev = known.prior.gravity_offset_b_n_m[i];
        let name = format!("gravity_offset_n_m.{name}");
        parts.push((name, offset(&known.model, i), offset(fitted, i), stddev));
    }
    let sigmas = |part: &(String, f64, f64, f64)| (part.2 - part.1).abs() / part.3;
    let worst = parts.into_iter().filter(|p| p.3 > 0.0).max_by(|a, b| sigmas(a).total_cmp(&sigmas(b)))?;
    (sigmas(&worst) > BEYOND_BELIEF).then(|| {
        format!(
            "the fit asks for {} = {}, and the model says {} +- {}: {:.0} standard deviations. Are these data of \
             another platform? Or is there too little motion in them to fit it: take in a livelier run",
            worst.0,
            three_digits(worst.2),
            three_digits(worst.1),
            three_digits(worst.3),
            sigmas(&worst)
        )
    })
}
