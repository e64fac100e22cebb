//! `whorl adopt`: a physical effect becomes part of a platform's model.

use std::path::{Path, PathBuf};

use anyhow::{Context, bail};
use serde_json::json;
use whorl_diagnosis::{DiagnosisError, Fit, FittedParameter, Options, fit};
use whorl_dynamics::PlatformModel;
use whorl_dynamics::effects::find;
use whorl_recording::KnownPlatform;
use whorl_report::{AdoptedParameter, AdoptionPage, ComparedRun, three_digits};

use crate::compare::compare_all;
use crate::model_changes::{changes, write as write_model};
use crate::progress;
use crate::provenance::provenance;
use crate::runs::{RunArguments, Runs, write};
use crate::table::print;

/// Version of the JSON form.
const SCHEMA: u32 = 1;
/// A held-out error this much above that before counts as worse.
const WORSE: f64 = 1.005;
/// Ends the names of corrections.
const CORRECTION: &str = " (correction)";
/// A correction of more standard deviations than this is listed.
const TOLD_STDDEVS: f64 = 2.0;
/// Standard deviations of its prior beyond which no mass property is.
const BEYOND_BELIEF: f64 = 12.0;

/// Arguments of `whorl adopt`.
#[derive(Debug, clap::Args)]
pub struct Arguments {
    /// Runs to fit, then the effects to adopt.
    #[arg(required = true, value_name = "RUN... EFFECT")]
    items: Vec<String>,
    /// The parameter file that is changed.
    #[arg(long, value_name = "FILE", required_unless_present = "try_")]
    out: Option<PathBuf>,
    /// Compares rivals side by side and writes nothing; `+` joins effects to a set: a,b+c.
    #[arg(long = "try", value_name = "A,B", value_delimiter = ',')]
    try_: Vec<String>,
    /// Writes even if the held-out runs are predicted worse, or a mass property moves beyond belief.
    #[arg(long)]
    anyway: bool,
    /// A run that takes part in no fit; may be given several times.
    #[arg(long, value_name = "RUN")]
    held_out: Vec<PathBuf>,
    /// The model to start from [default: the file given with --out, else the parameters saved in the first run].
    #[arg(long, value_name = "FILE")]
    model: Option<PathBuf>,
    /// The platform, where runs or parameters hold several.
    #[arg(long, value_name = "NAME")]
    platform: Option<String>,
    /// Which topic or column holds what, for runs that are not Whorl's own.
    #[arg(long, value_name = "FILE")]
    channels: Option<PathBuf>,
    /// Writes all numbers as JSON.
    #[arg(long, value_name = "FILE")]
    json: Option<PathBuf>,
    /// Where the page goes [default: adopt.html in the first run's directory].
    #[arg(long, value_name = "FILE")]
    html: Option<PathBuf>,
}

/// A version of the model with how well it predicts.
struct Version {
    name: String,
    effects: Vec<String>,
    fit: Option<Fit>,
    runs: Vec<ComparedRun>,
}

/// Carries out `whorl adopt`.
pub fn run(arguments: &Arguments) -> anyhow::Result<()> {
    let (run_paths, effects): (Vec<&String>, Vec<&String>) =
        arguments.items.iter().partition(|item| find(item).is_none() || Path::new(item.as_str()).exists());
    if let Some(missing) = run_paths.iter().find(|p| !Path::new(p.as_str()).exists()) {
        bail!("{missing} is neither a run nor an effect; `whorl effects` lists the effects");
    }
    let sets: Vec<Vec<String>> = if arguments.try_.is_empty() {
        if effects.is_empty() {
            bail!(
                "name the effect to adopt after the runs; `whorl effects` lists them, `whorl diagnose` finds them"
            );
        }
        vec![effects.iter().map(|e| (*e).clone()).collect()]
    } else {
        let joined = effects.iter().map(|e| (*e).clone());
        arguments
            .try_
            .iter()
            .map(|set| joined.clone().chain(set.split('+').map(str::to_owned)).collect())
            .collect()
    };
    if let Some(unknown) = sets.iter().flatten().find(|id| find(id).is_none()) {
        bail!("there is no effect {unknown}; `whorl effects` lists them");
    }
    let run_arguments = RunArguments {
        runs: run_paths.iter().map(PathBuf::from).collect(),
        held_out: arguments.held_out.clone(),
        model: arguments.model.clone().or_else(|| arguments.out.clone().filter(|out| out.exists())),
        platform: arguments.platform.clone(),
        channels: arguments.channels.clone(),
    };
    let runs = progress::during("reading the runs", || run_arguments.read())?;
    let (versions, left_out) = versions(&runs, &sets)?;
    let answer = answer(&versions);
    let command = std::env::args().skip(1).collect::<Vec<_>>().join(" ");
    let provenance = provenance(&run_arguments, &command)?;
    // Before anything is printed: whoever reads may close the pipe after a few lines.
    let written = if arguments.try_.is_empty() {
        adopt(arguments, &runs, &versions, &provenance)
    } else {
        Ok("Nothing was written: --try only compares.".to_owned())
    };
    for sentence in &answer {
        println!("{sentence}");
    }
    println!();
    print_versions(&versions);
    for version in versions.iter().filter(|v| !v.effects.is_empty()) {
        print_parameters(version);
    }
    for reason in &left_out {
        println!("note: {reason}");
    }
    println!("\n{}", written?);
    if let Some(path) = &arguments.json {
        write(path, &serde_json::to_string_pretty(&as_json(&runs, &versions, &answer, &provenance)?)?)?;
    }
    let page = run_arguments.page(arguments.html.as_deref(), "adopt.html");
    let mut facts = runs.facts.clone();
    facts.push(("command".to_owned(), format!("whorl {command}")));
    facts.push(("provenance".to_owned(), provenance));
    write(&page, &whorl_report::adoption_html(&as_page(&versions, answer), &facts))?;
    println!("page: {}", page.display());
    Ok(())
}

/// The model as given, with its own parameters refitted, and with each set of effects.
/// Rivals that cannot be fitted come second, with the reason.
fn versions(runs: &Runs, sets: &[Vec<String>]) -> anyhow::Result<(Vec<Version>, Vec<String>)> {
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
fn error(version: &Version, held_out: bool) -> Option<f64> {
    let all = version.runs.iter().filter(|r| r.held_out == held_out).filter_map(|r| r.comparison.absolute);
    let (sum, degrees) = all.fold((0.0, 0.0), |(s, d), a| {
        (s + a.chi_squared_per_degree * a.degrees as f64, d + a.degrees as f64)
    });
    (degrees > 0.0).then(|| (sum / degrees).sqrt())
}

/// The gyro axis with the largest error over ten seconds before: name, each version's RMS, floor [deg/s].
fn worst_gyro(versions: &[Version], held_out: bool) -> Option<(String, Vec<f64>, f64)> {
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

fn answer(versions: &[Version]) -> Vec<String> {
    let mut answer = Vec::new();
    let Some(before) = versions.first() else { return answer };
    for version in versions.iter().filter(|v| !v.effects.is_empty()) {
        let mut text = format!("{}:", capitalised(&version.name));
        for (held_out, kind) in [(false, "training"), (true, "held-out")] {
            if let (Some(a), Some(b)) = (error(before, held_out), error(version, held_out)) {
                text.push_str(&format!(" {kind} error {a:.2} -> {b:.2} times the noise;"));
            }
        }
        let held_out = version.runs.iter().any(|r| r.held_out);
        if let Some((name, errors, floor)) = worst_gyro(versions, held_out) {
            let place = versions.iter().position(|v| std::ptr::eq(v, version)).unwrap_or(0);
            if let (Some(a), Some(b)) = (errors.first(), errors.get(place)) {
                text.push_str(&format!(
                    " {} {name} over 10 s {} -> {} deg/s RMS (noise {}).",
                    if held_out { "held-out" } else { "training" },
                    three_digits(*a),
                    three_digits(*b),
                    three_digits(floor)
                ));
            }
        }
        if text.ends_with(';') {
            text.pop();
            text.push('.');
        }
        answer.push(text);
        let base = versions.iter().find(|v| v.name == "base refitted");
        if let Some((a, b)) = base.and_then(|base| Some((error(base, held_out)?, error(version, held_out)?)))
            && b > a / WORSE
        {
            answer.push(format!(
                "Refitting inertia, centre of mass and actuators alone does as well ({a:.3} against {b:.3}): these data do not call for {}.",
                version.effects.join(" and ")
            ));
        }
    }
    if !before.runs.iter().any(|r| r.held_out) {
        answer.push(
            "No held-out run was given: whether the model predicts other runs better was not tested."
                .to_owned(),
        );
    }
    answer
}

fn capitalised(text: &str) -> String {
    let mut characters = text.chars();
    characters.next().map_or_else(String::new, |c| c.to_uppercase().chain(characters).collect())
}

fn print_versions(versions: &[Version]) {
    let mut headings = vec!["run".to_owned(), String::new()];
    headings.extend(versions.iter().map(|v| format!("#{}", v.name)));
    let Some(first) = versions.first() else { return };
    let rows: Vec<Vec<String>> = first
        .runs
        .iter()
        .enumerate()
        .map(|(k, run)| {
            let kind = if run.held_out { "held out" } else { "training" };
            let mut row = vec![run.comparison.run.clone(), kind.to_owned()];
            row.extend(versions.iter().map(|v| {
                let absolute = v.runs.get(k).and_then(|r| r.comparison.absolute);
                absolute.map_or_else(|| "-".to_owned(), |a| format!("{:.3}", a.chi_squared_per_degree.sqrt()))
            }));
            row
        })
        .collect();
    println!(
        "Error over noise (root of chi-squared per degree of freedom, initial states fitted; 1 = noise)"
    );
    print(&headings, &rows);
}

fn print_parameters(version: &Version) {
    let Some(fit) = &version.fit else { return };
    println!("\nParameters {}", version.name);
    // Corrections of wheels and jets that the data do not ask for would only hide the others.
    let is_told = |p: &&FittedParameter| {
        !p.name.ends_with(CORRECTION) || (p.estimate - p.before).abs() > TOLD_STDDEVS * p.stddev
    };
    let rows: Vec<Vec<String>> = fit
        .estimates
        .iter()
        .filter(is_told)
        .map(|p| {
            let bound = if p.at_bound { "at its bound" } else { "" };
            vec![
                p.group.clone(),
                p.name.clone(),
                p.unit.clone(),
                three_digits(p.before),
                three_digits(p.estimate),
                three_digits(p.stddev),
                bound.to_owned(),
            ]
        })
        .collect();
    let headings = ["of", "parameter", "unit", "#before", "#after", "#+-", ""].map(str::to_owned);
    print(&headings, &rows);
    let others = fit.estimates.len() - rows.len();
    if others > 0 {
        println!(
            "  and {others} corrections of wheels and jets, each within {TOLD_STDDEVS} standard deviations of none"
        );
    }
}

/// Writes the last version into the parameter file and says so.
fn adopt(
    arguments: &Arguments,
    runs: &Runs,
    versions: &[Version],
    provenance: &str,
) -> anyhow::Result<String> {
    let (Some(out), Some(first), Some(last)) = (&arguments.out, versions.first(), versions.last()) else {
        bail!("name the file to write with --out");
    };
    let Some(fit) = &last.fit else { bail!("nothing was fitted") };
    if let (Some(before), Some(after)) = (error(first, true), error(last, true))
        && after > WORSE * before
        && !arguments.anyway
    {
        bail!(
            "the held-out runs are predicted worse with it ({before:.3} -> {after:.3} times the noise), so nothing was written; --anyway writes all the same"
        );
    }
    if let Some(reason) = strangest(&runs.known, &fit.model).filter(|_| !arguments.anyway) {
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

fn as_page(versions: &[Version], answer: Vec<String>) -> AdoptionPage {
    let adopted = versions.last().and_then(|v| v.fit.as_ref());
    AdoptionPage {
        answer,
        versions: versions.iter().map(|v| v.name.clone()).collect(),
        runs: versions.iter().map(|v| v.runs.clone()).collect(),
        parameters: adopted.map_or_else(Vec::new, |fit| {
            fit.estimates
                .iter()
                .map(|p| AdoptedParameter {
                    group: p.group.clone(),
                    name: p.name.clone(),
                    unit: p.unit.clone(),
                    before: p.before,
                    estimate: p.estimate,
                    stddev: p.stddev,
                })
                .collect()
        }),
    }
}

fn as_json(
    runs: &Runs,
    versions: &[Version],
    answer: &[String],
    provenance: &str,
) -> anyhow::Result<serde_json::Value> {
    let mut list = Vec::new();
    for version in versions {
        let parameters = version.fit.as_ref().map_or_else(Vec::new, |fit| {
            let estimates = fit.estimates.iter();
            estimates
                .map(|p| {
                    json!({"of": p.group, "name": p.name, "unit": p.unit, "before": p.before,
                           "estimate": p.estimate, "stddev": p.stddev, "at_bound": p.at_bound})
                })
                .collect()
        });
        let mut compared = Vec::new();
        for run in &version.runs {
            let mut value = serde_json::to_value(&run.comparison)?;
            if let Some(object) = value.as_object_mut() {
                object.insert("held_out".to_owned(), json!(run.held_out));
            }
            compared.push(value);
        }
        list.push(json!({
            "name": version.name,
            "effects": version.effects,
            "error": error(version, false),
            "held_out_error": error(version, true),
            "parameters": parameters,
            "runs": compared,
        }));
    }
    Ok(json!({
        "schema": SCHEMA,
        "platform": runs.known.platform,
        "answer": answer,
        "provenance": provenance,
        "versions": list,
    }))
}
