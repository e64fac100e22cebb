//! Versions of a model, fitted and compared with the same runs.

use anyhow::Context;
use whorl_diagnosis::{DiagnosisError, Fit, FittedParameter, Options, fit};
use whorl_dynamics::PlatformModel;
use whorl_report::ComparedRun;

use crate::compare::compare_all;
use crate::progress;
use crate::runs::Runs;

/// Ends the names of corrections.
pub const CORRECTION: &str = " (correction)";

/// A version of the model with how well it predicts.
pub struct Version {
    pub name: String,
    pub effects: Vec<String>,
    pub fit: Option<Fit>,
    pub runs: Vec<ComparedRun>,
}

/// The model as given, with its own parameters refitted, and with each set of effects.
/// Rivals that cannot be fitted come second, with the reason.
pub fn versions(runs: &Runs, sets: &[Vec<String>]) -> anyhow::Result<(Vec<Version>, Vec<String>)> {
    let known = &runs.known;
    let mut versions = vec![Version {
        name: "as given".to_owned(),
        effects: Vec::new(),
        fit: None,
        runs: compare_all(runs, &known.model)?,
    }];
    let none = Vec::new();
    let mut left_out = Vec::new();
    for effects in std::iter::once(&none).chain(sets) {
        let name = if effects.is_empty() {
            "base refitted".to_owned()
        } else {
            format!("with {}", effects.join(" and "))
        };
        let ids: Vec<&str> = effects.iter().map(String::as_str).collect();
        let doing = if effects.is_empty() {
            "fitting the platform's own parameters".to_owned()
        } else {
            format!("fitting {}", effects.join(" and "))
        };
        let fitted = progress::during(&doing, || {
            fit(&runs.training, &runs.held_out, &known.model, &known.prior, &ids, &Options::default())
        });
        let mut fitted = match fitted {
            Err(error @ DiagnosisError::NoEffect { .. }) if sets.len() > 1 => {
                left_out.push(format!("{}: {error}", effects.join(" and ")));
                continue;
            }
            fitted => fitted.with_context(|| format!("cannot fit {name}"))?,
        };
        let after = fitted.model.clone();
        fitted.estimates.iter_mut().for_each(|p| say_in_full(p, &known.model, &after));
        let runs = compare_all(runs, &fitted.model)?;
        versions.push(Version { name, effects: effects.clone(), fit: Some(fitted), runs });
    }
    Ok((versions, left_out))
}

/// The fit corrects the platform's constants; a person wants to read the constants themselves, or that it is
/// a correction.
fn say_in_full(parameter: &mut FittedParameter, before: &PlatformModel, after: &PlatformModel) {
    let axis = |letter: Option<char>| letter.and_then(|c| "xyz".find(c));
    let totals = match parameter.group.as_str() {
        "gravity_offset" => axis(parameter.name.chars().nth(4)).map(|i| {
            let of = |model: &PlatformModel| model.mass_properties.gravity_offset_b_n_m()[i];
            (of(before), of(after))
        }),
        "inertia_products" => {
            let mut letters = parameter.name.chars().skip(1);
            axis(letters.next()).zip(axis(letters.next())).map(|(i, j)| {
                let of = |model: &PlatformModel| model.mass_properties.inertia_b_kg_m2()[(i, j)];
                (of(before), of(after))
            })
        }
        "wheel_inertia" | "wheel_misalignment" | "thruster_strength" | "thruster_misalignment" => {
            if !before.effects.contains_key(&parameter.group) {
                parameter.name.push_str(CORRECTION);
            }
            None
        }
        _ => None,
    };
    if let Some((before, after)) = totals {
        (parameter.before, parameter.estimate) = (before, after);
    }
}

/// Root of chi-squared per degree of freedom over the runs of one kind: 1 = noise.
pub fn error(version: &Version, held_out: bool) -> Option<f64> {
    let all = version.runs.iter().filter(|r| r.held_out == held_out).filter_map(|r| r.comparison.absolute);
    let (sum, degrees) = all.fold((0.0, 0.0), |(s, d), a| {
        (s + a.chi_squared_per_degree * a.degrees as f64, d + a.degrees as f64)
    });
    (degrees > 0.0).then(|| (sum / degrees).sqrt())
}

/// The gyro axis with the largest error over ten seconds before: name, each version's RMS, floor [deg/s].
pub fn worst_gyro(versions: &[Version], held_out: bool) -> Option<(String, Vec<f64>, f64)> {
    let of = |version: &Version, name: &str| -> Option<f64> {
        let channels =
            version.runs.iter().filter(|r| r.held_out == held_out).flat_map(|r| &r.comparison.channels);
        let longest = channels
            .filter(|c| c.name == name)
            .filter_map(|c| c.horizons.iter().rev().find(|h| h.horizon_s.is_some()))
            .map(|h| (h.rms * h.rms, 1.0))
            .fold((0.0, 0.0), |a, b| (a.0 + b.0, a.1 + b.1));
        (longest.1 > 0.0).then(|| whorl_math::deg_from_rad((longest.0 / longest.1).sqrt()))
    };
    let first = versions.first()?;
    let (name, _) = ["gyro_x", "gyro_y", "gyro_z"]
        .into_iter()
        .filter_map(|n| of(first, n).map(|e| (n, e)))
        .max_by(|a, b| a.1.total_cmp(&b.1))?;
    let floor = first.runs.iter().flat_map(|r| &r.comparison.channels).find(|c| c.name == name)?.noise_floor;
    let all = versions.iter().map(|v| of(v, name).unwrap_or(f64::NAN)).collect();
    Some((name.to_owned(), all, whorl_math::deg_from_rad(floor)))
}
