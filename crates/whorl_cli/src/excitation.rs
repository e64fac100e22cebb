//! `whorl excitation`: predicts what an experiment will determine.

use std::path::{Path, PathBuf};

use anyhow::Context;
use serde_json::{Value, json};
use whorl_commands::identify::as_json;
use whorl_dynamics::platform::Wheel;
use whorl_identification::{Determined, Options, predict};
use whorl_math::deg_from_rad;
use whorl_math::words::or_did_you_mean;
use whorl_recording::{KnownPlatform, ReadOptions, Recording, read_model, read_run_with};

use crate::identify::{print_findings, print_identification};
use crate::output::{JsonArgument, say};
use crate::simulate;

#[derive(Debug, clap::Args)]
pub struct Arguments {
    /// A name in params/experiments/, or a file, e.g. identify_whorl_1.
    #[arg(value_name = "EXPERIMENT")]
    experiment: PathBuf,
    /// Platforms to analyse [default: the whole formation].
    #[arg(long, value_name = "NAME")]
    platform: Vec<String>,
    /// Parameter folder [default: the experiment file's ../, which is params/].
    #[arg(long, value_name = "DIR")]
    params: Option<PathBuf>,
    /// Seed of the noise in the simulation.
    #[arg(long, default_value_t = 1)]
    seed: u64,
    #[command(flatten)]
    json: JsonArgument,
}

/// Carries out `whorl excitation`: simulates the experiment and computes the Fisher information of its motion.
pub fn run(arguments: &Arguments) -> anyhow::Result<()> {
    let experiment = simulate::experiment_file(&arguments.experiment, arguments.params.as_deref())?;
    let folder = std::env::temp_dir().join(format!("whorl_excitation_{}", std::process::id()));
    let out = folder.join("run");
    std::fs::create_dir_all(&folder).with_context(|| format!("cannot create {}", folder.display()))?;
    let result = simulate::record_quietly(&experiment, arguments.params.as_deref(), &out, arguments.seed)
        .and_then(|()| judge(arguments, &out));
    // Only the scratch copy of the simulated run.
    let _ = std::fs::remove_dir_all(&folder);
    result
}

fn judge(arguments: &Arguments, run: &Path) -> anyhow::Result<()> {
    let recordings = read_run_with(run, &ReadOptions::default())?;
    let mut told = Vec::new();
    for recording in recordings
        .iter()
        .filter(|r| arguments.platform.is_empty() || arguments.platform.contains(&r.platform))
    {
        let known = read_model(run, Some(&recording.platform))?;
        if !told.is_empty() {
            say!();
        }
        told.push(report(&known, recording)?);
    }
    if told.is_empty() {
        let names: Vec<&str> = recordings.iter().map(|r| r.platform.as_str()).collect();
        let asked = arguments.platform.join(", ");
        let likely = or_did_you_mean(&asked, names.iter().copied());
        anyhow::bail!(
            "there is no platform {asked} in this experiment; there is: {}{likely}",
            names.join(", ")
        );
    }
    arguments.json.write(|| Ok(json!({"schema": 4, "experiment": arguments.experiment, "platforms": told})))
}

fn report(known: &KnownPlatform, recording: &Recording) -> anyhow::Result<Value> {
    let tilt = recording.specific_force_b_m_s2.value.iter().map(|f| f.x.hypot(f.y).atan2(f.z));
    let rate = recording.gyro_b_rad_s.value.iter().map(|w| w.norm()).fold(0.0, f64::max);
    say!(
        "{}: {:.1} s, tilt up to {:.1} deg, rate up to {:.1} deg/s",
        known.platform,
        recording.duration_s(),
        deg_from_rad(tilt.fold(0.0, f64::max)),
        deg_from_rad(rate)
    );
    limits(known, recording);
    let found = predict(std::slice::from_ref(recording), &known.model, &known.prior, &Options::default())?;
    print_identification(&known.model, &found);
    let determined = found.determined.iter().filter(|d| **d == Determined::Yes).count();
    say!("This experiment will determine {determined} of 9 parameters to the uncertainties above.");
    print_findings(&found.findings);
    Ok(as_json(&known.platform, &known.model, &found))
}

/// How close the experiment comes to the limits of the wheels, and how long the jets fire.
fn limits(known: &KnownPlatform, recording: &Recording) {
    let wheels = known.model.wheels();
    // For each sample, the wheel nearest to its limit, as a share of the limit.
    let shares = |samples: &[Vec<f64>], limit: &dyn Fn(&Wheel) -> f64| -> Vec<f64> {
        samples
            .iter()
            .map(|sample| {
                sample.iter().zip(wheels).map(|(x, wheel)| x.abs() / limit(wheel)).fold(0.0, f64::max)
            })
            .collect()
    };
    let speed = shares(&recording.wheel_speed_rad_s.value, &|w| w.max_speed_rad_s);
    let torque = shares(&recording.wheel_torque_command_n_m.value, &|w| w.max_torque_n_m);
    let largest = |shares: &[f64]| 100.0 * shares.iter().copied().fold(0.0, f64::max);
    if !wheels.is_empty() {
        say!(
            "wheels: up to {:.0} % of their speed, {:.0} % of their torque",
            largest(&speed),
            largest(&torque)
        );
    }
    for (shares, what) in [(speed, "speed"), (torque, "torque")] {
        let at_limit = shares.iter().filter(|s| **s > 0.99).count();
        if at_limit * 100 > shares.len() {
            say!(
                "note: A wheel is at its largest {what} for {:.0} % of the time, so the motion is not the designed one. Reduce the amplitude.",
                100.0 * at_limit as f64 / shares.len() as f64
            );
        }
    }
    let open_s: f64 = recording.jet_pulses.iter().flatten().map(|p| p.off_s - p.on_s).sum();
    if open_s > 0.0 {
        say!("jets: open for {open_s:.1} s in all");
    }
}
