//! `whorl identify`: mass properties from runs.

use std::path::{Path, PathBuf};

use anyhow::{Context, bail};
use clap::ValueEnum;
use whorl_dynamics::{ModelPrior, PlatformModel};
use whorl_explain::adopt::changes;
use whorl_identification::mass_parameters::{
    MASS_PARAMETERS, MassVector, NAMES, UNITS, mass_properties, mass_vector,
};
use whorl_identification::regression::{self, Form, Weighting, rows, solve};
use whorl_identification::{Determined, EffectParameter, Finding, Identification, Settings, identify};
use whorl_recording::{KnownPlatform, Recording};

use crate::model_file;
use crate::runs::RunArguments;
use crate::table;
use whorl_math::three_digits;

#[derive(Debug, clap::Args)]
pub struct Arguments {
    #[command(flatten)]
    runs: RunArguments,
    /// Method: `trajectory` integrates the equations of motion between samples and is recommended;
    /// the others are the dissertation's regressions, for comparison.
    #[arg(long, value_enum, default_value_t = Method::Trajectory)]
    method: Method,
    /// Steps between the rows of the momentum integral.
    #[arg(long, default_value_t = 1, value_parser = clap::value_parser!(u8).range(1..=100))]
    shift: u8,
    /// Regressions: differential form (with derivatives of the rate) or integral form.
    #[arg(long, value_enum, default_value_t = FormChoice::Integrated)]
    form: FormChoice,
    /// Regressions: weights of the equations.
    #[arg(long, value_enum, default_value_t = WeightingChoice::PseudoInverse)]
    weighting: WeightingChoice,
    /// Regressions: step between equations [s].
    #[arg(long, default_value_t = 0.1, value_name = "SECONDS")]
    step: f64,
    /// Widens the prior of the mass properties by this factor: 1 uses the model's uncertainties, 100 makes
    /// the prior negligible.
    #[arg(long, default_value_t = 1.0, value_name = "FACTOR")]
    prior_scale: f64,
    /// Parameter file for the result; created as a copy of the model's file if it does not exist.
    #[arg(long, value_name = "FILE")]
    out: Option<PathBuf>,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
enum Method {
    Trajectory,
    Torque,
    Momentum,
    Energy,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
enum FormChoice {
    Natural,
    Integrated,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
enum WeightingChoice {
    PseudoInverse,
    Markov,
    Total,
}

/// Carries out `whorl identify`.
pub fn run(arguments: &Arguments) -> anyhow::Result<()> {
    for (value, what) in [(arguments.prior_scale, "--prior-scale"), (arguments.step, "--step")] {
        if !(value > 0.0 && value.is_finite()) {
            bail!("{what} is {value}; allowed: a positive number");
        }
    }
    let runs = arguments.runs.read()?;
    if arguments.method == Method::Trajectory {
        let mut known = runs.known.clone();
        known.prior.inertia_b_kg_m2 *= arguments.prior_scale;
        known.prior.gravity_offset_b_n_m *= arguments.prior_scale;
        trajectory(arguments, &known, &runs.training)
    } else {
        if arguments.out.is_some() {
            bail!(
                "--out goes with --method trajectory: the regressions have no uncertainty that could be written down"
            );
        }
        runs.training.iter().try_for_each(|recording| regress(arguments, &runs.known.model, recording))
    }
}

fn trajectory(arguments: &Arguments, known: &KnownPlatform, recordings: &[Recording]) -> anyhow::Result<()> {
    let recordings: Vec<&Recording> = recordings.iter().collect();
    let found = identify(&recordings, &known.model, &known.prior, &Settings::default())?;
    println!(
        "{} from {:.1} s of {} run{}: residuals {:.2} times the sensors' noise",
        known.platform,
        found.duration_s,
        recordings.len(),
        if recordings.len() == 1 { "" } else { "s" },
        found.reduced_chi_squared.sqrt()
    );
    print_identification(&known.model, &found);
    print_findings(&found.findings);
    let Some(out) = &arguments.out else { return Ok(()) };
    if !found.usable() {
        bail!("nothing was written to {}: the result must not be used", out.display());
    }
    let names: Vec<&str> = recordings.iter().map(|r| r.name.as_str()).collect();
    let (model, prior) = updated(known, &found)?;
    let source = format!("whorl identify {}", names.join(", "));
    let changes = changes((&known.model, &model), (&known.prior, &prior), &source);
    prepare_out(out, known)?;
    model_file::write(out, &known.platform, &changes)?;
    println!("{} entries written to {}", changes.len(), out.display());
    Ok(())
}

/// Model and prior after an identification; parameters that were not determined keep their values.
fn updated(known: &KnownPlatform, found: &Identification) -> anyhow::Result<(PlatformModel, ModelPrior)> {
    let (mut model, mut prior) = (known.model.clone(), known.prior.clone());
    let mass_kg = model.mass_properties.mass_kg();
    model.mass_properties = mass_properties(&found.estimate, mass_kg)?;
    let stddev = found.stddev();
    let places = [(0, 0), (0, 1), (0, 2), (1, 1), (1, 2), (2, 2)];
    for (n, (i, j)) in places.into_iter().enumerate() {
        prior.inertia_b_kg_m2[(i, j)] = stddev[n];
        prior.inertia_b_kg_m2[(j, i)] = stddev[n];
    }
    prior.gravity_offset_b_n_m.copy_from(&stddev.fixed_rows::<3>(6));
    for found in &found.effects {
        // Effects that are not in the model are not added: adopting one is a separate decision.
        if let Some(effect) = model.effects.get_mut(found.effect) {
            effect.insert(found.name.clone(), found.value);
            let of_effect = prior.effects.entry(found.effect.to_owned()).or_default();
            of_effect.insert(found.name.clone(), found.stddev);
        }
    }
    Ok((model, prior))
}

fn prepare_out(out: &Path, known: &KnownPlatform) -> anyhow::Result<()> {
    if out.exists() {
        return Ok(());
    }
    let file = known
        .files
        .iter()
        .rev()
        .find(|f| std::fs::read_to_string(f).is_ok_and(|text| text.contains("model:")));
    let file = file.context("no file of the model to copy; name an existing --out")?;
    std::fs::copy(file, out)
        .with_context(|| format!("cannot copy {} to {}", file.display(), out.display()))?;
    Ok(())
}

fn regress(arguments: &Arguments, model: &PlatformModel, recording: &Recording) -> anyhow::Result<()> {
    let series = whorl_identification::estimated::estimated_series(recording, model, arguments.step)?;
    let method = match arguments.method {
        Method::Momentum => regression::Method::Momentum { shift: usize::from(arguments.shift) },
        Method::Energy => regression::Method::Energy,
        _ => regression::Method::Torque,
    };
    let form = match arguments.form {
        FormChoice::Natural => Form::Natural,
        FormChoice::Integrated => Form::IntegratedTrapezoid,
    };
    let inertia = model.mass_properties.inertia_b_kg_m2().diagonal();
    let gyro = model.sensors.gyro.errors.noise_stddev;
    let weighting = match arguments.weighting {
        WeightingChoice::PseudoInverse => Weighting::PseudoInverse,
        WeightingChoice::Markov => Weighting::Markov { row_stddev: inertia.component_mul(&gyro).into() },
        WeightingChoice::Total => Weighting::TotalLeastSquares { rate_stddev_rad_s: gyro.amax() },
    };
    let solution = solve(&rows(&series, method, form), weighting)?;
    println!(
        "{}: {} samples, residual {:.2e} RMS",
        recording.name,
        series.samples.len(),
        solution.residual_rms
    );
    let before = mass_vector(&model.mass_properties);
    let cells: Vec<Vec<String>> = (0..MASS_PARAMETERS)
        .map(|i| {
            vec![
                NAMES[i].to_owned(),
                three_digits(before[i]),
                three_digits(solution.estimate[i]),
                three_digits(solution.singular_values[i]),
                UNITS[i].to_owned(),
            ]
        })
        .collect();
    table::print(&headings(&["", "#model", "#found", "#singular value", "unit"]), &cells);
    println!("Regressions are biased by noise where the excitation is weak; `--method trajectory` is not.");
    Ok(())
}

fn headings(names: &[&str]) -> Vec<String> {
    names.iter().map(|n| (*n).to_owned()).collect()
}

/// The nine parameters with their uncertainties.
pub fn print_identification(model: &PlatformModel, found: &Identification) {
    let before: MassVector = mass_vector(&model.mass_properties);
    let stddev = found.stddev();
    let cells: Vec<Vec<String>> = (0..MASS_PARAMETERS)
        .map(|i| {
            vec![
                NAMES[i].to_owned(),
                three_digits(before[i]),
                format!("{:.4}", found.estimate[i]),
                three_digits(stddev[i]),
                three_digits(found.stddev_known_actuators[i]),
                three_digits(found.prior_stddev[i]),
                UNITS[i].to_owned(),
                match found.determined[i] {
                    Determined::Yes => "yes",
                    Determined::Hardly => "hardly",
                    Determined::No => "NO: the prior's",
                }
                .to_owned(),
            ]
        })
        .collect();
    table::print(
        &headings(&[
            "",
            "#model",
            "#found",
            "#+-",
            "#+- (actuators exact)",
            "#+- before",
            "unit",
            "determined",
        ]),
        &cells,
    );
    for EffectParameter { effect, name, unit, value, stddev } in &found.effects {
        println!("  {effect} {name}: {} +- {} {unit}", three_digits(*value), three_digits(*stddev));
    }
    let values: Vec<String> = found.singular_values.iter().map(|v| three_digits(v.sqrt())).collect();
    println!("  singular values of the information over the prior's: {}", values.join(", "));
}

/// Findings, fatal ones first.
pub fn print_findings(findings: &[Finding]) {
    for finding in findings {
        println!("{}: {}", if finding.fatal { "DO NOT USE" } else { "note" }, finding.text);
    }
}
