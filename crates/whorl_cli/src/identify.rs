//! `whorl identify`: mass properties from runs.

use std::path::PathBuf;

use anyhow::{Context, bail};
use clap::ValueEnum;
use serde_json::{Value, json};
use whorl_commands::identify::as_json;
use whorl_dynamics::PlatformModel;
use whorl_dynamics::mass_parameters::{MASS_PARAMETERS, MassVector, NAMES, UNITS, mass_vector};
use whorl_identification::{Determined, Finding, FittedParameter, Identification, Options, identify};
use whorl_params::ModelStep;
use whorl_params::changes::changes;
use whorl_recording::{KnownPlatform, Recording};
use whorl_reproduce::regression::{
    self, Form, Regressed, RegressionSettings, Weights, regress as regression_of,
};

use crate::model_file;
use crate::output::{JsonArgument, say};
use crate::provenance::provenance_of_this;
use crate::runs::RunArguments;
use crate::table;
use whorl_math::three_digits;

#[derive(Debug, clap::Args)]
pub struct Arguments {
    #[command(flatten)]
    runs: RunArguments,
    /// Method: `likelihood` finds the values with which the model predicts the readings best and is recommended; the others
    /// are the dissertation's regressions, for comparison.
    #[arg(long, value_enum, default_value_t = Method::Likelihood)]
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
    #[command(flatten)]
    json: JsonArgument,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
enum Method {
    // The name that it had.
    #[value(alias = "trajectory")]
    Likelihood,
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
    if arguments.method == Method::Likelihood {
        let mut known = runs.known.clone();
        known.prior = known.prior.with_mass_properties_scaled(arguments.prior_scale);
        by_likelihood(arguments, &known, &runs.training)
    } else {
        if arguments.out.is_some() {
            bail!(
                "--out goes with --method likelihood: the regressions have no uncertainty that could be written down"
            );
        }
        let found: Vec<Value> = runs
            .training
            .iter()
            .map(|recording| regress(arguments, &runs.known.model, recording))
            .collect::<anyhow::Result<_>>()?;
        arguments
            .json
            .write(|| Ok(json!({"schema": 1, "platform": runs.known.platform, "regressions": found})))
    }
}

fn by_likelihood(
    arguments: &Arguments,
    known: &KnownPlatform,
    recordings: &[Recording],
) -> anyhow::Result<()> {
    let found = identify(recordings, &known.model, &known.prior, &Options::default())?;
    say!(
        "{} from {:.1} s of {} run{}: prediction error {} times the noise, {} with the model as given",
        known.platform,
        found.duration_s,
        recordings.len(),
        if recordings.len() == 1 { "" } else { "s" },
        found.error_after.map_or_else(|| "-".to_owned(), three_digits),
        found.error_before.map_or_else(|| "-".to_owned(), three_digits)
    );
    print_identification(&known.model, &found);
    print_findings(&found.findings);
    // Before anything is written: what was found is worth knowing also where it cannot be used.
    arguments.json.write(|| {
        let mut value = as_json(&known.platform, &known.model, &found);
        value["schema"] = json!(4);
        value["runs"] = json!(recordings.iter().map(|r| r.name.as_str()).collect::<Vec<_>>());
        Ok(value)
    })?;
    let Some(out) = &arguments.out else { return Ok(()) };
    let (model, prior) = found
        .updated()
        .with_context(|| format!("the result must not be used; nothing was written to {}", out.display()))?;
    let source = provenance_of_this(&arguments.runs)?;
    let changes = changes((&known.model, &model), (&known.prior, &prior), &source);
    whorl_commands::model_file::prepare_out(out, known)?;
    let written = model_file::write_step(out, known, &changes, ModelStep::of_source(source))?;
    say!("{written} entries written to {}", out.display());
    Ok(())
}

fn regress(arguments: &Arguments, model: &PlatformModel, recording: &Recording) -> anyhow::Result<Value> {
    let settings = RegressionSettings {
        method: match arguments.method {
            Method::Momentum => regression::Method::Momentum { shift: usize::from(arguments.shift) },
            Method::Energy => regression::Method::Energy,
            _ => regression::Method::Torque,
        },
        form: match arguments.form {
            FormChoice::Natural => Form::Natural,
            FormChoice::Integrated => Form::IntegratedTrapezoid,
        },
        weights: match arguments.weighting {
            WeightingChoice::PseudoInverse => Weights::PseudoInverse,
            WeightingChoice::Markov => Weights::Markov,
            WeightingChoice::Total => Weights::Total,
        },
        step_s: arguments.step,
    };
    let Regressed { samples, solution } = regression_of(recording, model, &settings)?;
    say!("{}: {samples} samples, residual {:.2e} RMS", recording.name, solution.residual_rms);
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
    say!("Regressions are biased by noise where the excitation is weak; `--method likelihood` is not.");
    let parameters: Vec<Value> = (0..MASS_PARAMETERS)
        .map(|i| {
            json!({"name": NAMES[i], "unit": UNITS[i], "before": before[i], "estimate": solution.estimate[i],
                "singular_value": solution.singular_values[i]})
        })
        .collect();
    Ok(
        json!({"run": recording.name, "samples": samples, "residual_rms": solution.residual_rms, "parameters": parameters}),
    )
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
    table::print(&headings(&["", "#model", "#found", "#+-", "#+- before", "unit", "determined"]), &cells);
    // What the data changed: there may be dozens.
    let told =
        |p: &&FittedParameter| Determined::of(p.stddev, p.prior_stddev) != Determined::No || p.at_bound;
    for p in found.others.iter().filter(told) {
        say!(
            "  {} {}: {} +- {} {} (before +- {}){}",
            p.group,
            p.name,
            three_digits(p.estimate),
            three_digits(p.stddev),
            p.unit,
            three_digits(p.prior_stddev),
            if p.at_bound { ", at an end of what is plausible" } else { "" }
        );
    }
}

/// Findings, fatal ones first.
pub fn print_findings(findings: &[Finding]) {
    for finding in findings {
        say!("{}: {}", if finding.fatal { "DO NOT USE" } else { "note" }, finding.text);
    }
}

#[cfg(test)]
mod tests {
    use std::fs;
    use std::path::Path;

    use clap::Parser;
    use whorl_params::set_in_file;
    use whorl_recording::read_model;

    use super::*;
    use crate::simulate;

    #[derive(Parser)]
    struct Line {
        #[command(flatten)]
        arguments: Arguments,
    }

    /// Swings about yaw, with the wheels alone.
    const SWING: &str = "
/**:
  ros__parameters:
    formation: {platforms: [whorl_1]}
/coordinator:
  ros__parameters:
    experiment: {name: short, description: yaw}
    limits: {whorl_1: {rate_max_deg_s: 8.0, acceleration_max_deg_s2: 2.5}}
    law: {kind: leader_follower}
    steps:
      settle: {kind: settle, duration_s: 4.0, pitch_deg: -0.6, roll_deg: 2.0}
      yaw: {kind: scan, axis: yaw, amplitude_deg: 20.0, period_s: 20.0, duration_s: 40.0}
/**/local_control:
  ros__parameters: {actuators: wheels}
/whorl_1/driver:
  ros__parameters:
    initial: {yaw_deg: 0.0, pitch_deg: -0.6, roll_deg: 2.0}
";

    /// Two effects were adopted, with values that are off; both are identified beside the mass properties and written.
    #[test]
    fn parameters_of_every_adopted_effect_are_written_and_load_again() {
        let folder = tempfile::tempdir().unwrap();
        let path = |name: &str| folder.path().join(name);
        let of_whorl = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../params");
        for name in ["truth", "experiments"] {
            fs::create_dir(path(name)).unwrap();
        }
        for name in ["common.yaml", "whorl_1.yaml"] {
            fs::copy(of_whorl.join(name), path(name)).unwrap();
        }
        let adopted = [
            ("bearing_viscous_friction", "c_n_m_s", 0.15, 0.1, 0.25),
            ("harness_spring", "k_n_m_rad", 0.2, 0.1, 0.3),
        ];
        let (model, truth) = (path("whorl_1.yaml"), path("truth/whorl_1.yaml"));
        fs::write(&truth, "/whorl_1/driver:\n  ros__parameters:\n    backend: sim\n").unwrap();
        for (effect, name, value, stddev, in_truth) in adopted {
            let set = |file: &Path, section: &str, key: String, value: f64| {
                set_in_file(file, section, &key, &whorl_params::Value::Double(value), None).unwrap();
            };
            set(&model, "/whorl_1/**", format!("model.effects.{effect}.{name}"), value);
            set(&model, "/whorl_1/**", format!("model_prior.effects.{effect}.{name}"), stddev);
            set(&truth, "/whorl_1/driver", format!("truth.effects.{effect}.{name}"), in_truth);
        }
        let experiment = path("experiments/short.yaml");
        fs::write(&experiment, SWING).unwrap();
        let recorded = path("run");
        simulate::record_quietly(&experiment, None, &recorded, 1).unwrap();

        let out = path("identified.yaml");
        let words = [&recorded, Path::new("--model"), &model, Path::new("--out"), &out];
        run(&Line::parse_from([Path::new("identify")].into_iter().chain(words)).arguments).unwrap();

        let again = read_model(&out, None).unwrap();
        for (effect, name, value, stddev, in_truth) in adopted {
            let (found, known) = (again.model.effects[effect][name], again.prior.effects[effect][name]);
            assert!(known > 0.0 && known < 0.5 * stddev, "{effect}: {found} +- {known}");
            assert!(
                (found - in_truth).abs() < 0.3 * (value - in_truth).abs(),
                "{effect}: {found} +- {known}"
            );
        }
        assert_ne!(again.model.mass_properties, read_model(&model, None).unwrap().model.mass_properties);
        let [step] = again.history.as_slice() else { panic!("{:?}", again.history) };
        assert!(step.effects.is_empty() && step.date.is_some());
        assert!(step.source.as_ref().unwrap().starts_with("run (sha256 "), "{step:?}");
    }
}
