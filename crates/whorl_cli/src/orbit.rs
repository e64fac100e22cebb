//! `whorl orbit`: the passes of an experiment as the laboratory would reproduce them.

use std::io::Write;
use std::path::{Path, PathBuf};

use anyhow::{Context, bail};
use clap::Args;
use whorl_coordinator::parameters::{self, CoObservation, StepKind};
use whorl_params::{Override, ParameterTree, layers_of_experiment, try_read};

#[derive(Debug, Args)]
pub struct Arguments {
    /// Experiment file with a co_observe step.
    #[arg(value_name = "FILE")]
    experiment: PathBuf,
    /// Parameter folder [default: the experiment file's ../, which is params/].
    #[arg(long, value_name = "DIR")]
    params: Option<PathBuf>,
    /// Overrides a parameter of the files: -p /coordinator:steps.observe.time_ratio:=2.0; may be repeated.
    #[arg(short = 'p', value_name = "NODE:KEY:=VALUE")]
    overrides: Vec<String>,
    /// Time between two lines of the table, in the laboratory [s].
    #[arg(long, value_name = "SECONDS", default_value_t = 10.0)]
    every: f64,
}

/// Carries out `whorl orbit`.
pub fn run(arguments: &Arguments) -> anyhow::Result<()> {
    let experiment = &arguments.experiment;
    if !experiment.is_file() {
        bail!("no experiment file {}", experiment.display());
    }
    if !(arguments.every > 0.0 && arguments.every.is_finite()) {
        bail!("--every is {}; allowed: a positive number of seconds", arguments.every);
    }
    let beside = experiment.parent().and_then(Path::parent).map(Path::to_owned);
    let folder = arguments.params.clone().or(beside).context("name the parameter folder with --params")?;
    let overrides =
        arguments.overrides.iter().map(|text| Override::parse(text)).collect::<Result<Vec<_>, _>>()?;
    let tree = ParameterTree::load(&layers_of_experiment(&folder, experiment)?, &overrides)?;
    let (parameters, _) = try_read(&tree.for_node("/coordinator"), parameters::read)?;
    let mut out = std::io::stdout().lock();
    let mut found = false;
    for step in &parameters.steps {
        if let StepKind::CoObserve(pass) = &step.kind {
            found = true;
            writeln!(
                out,
                "step {}: {:.0} s, {:.0} s of orbit",
                step.name,
                step.duration_s,
                pass.mapping.orbit_span_s()
            )?;
            table(&mut out, pass, &parameters.platforms, arguments.every)?;
        }
    }
    if !found {
        bail!("{} has no co_observe step", experiment.display());
    }
    Ok(())
}

fn table(
    out: &mut impl Write,
    pass: &CoObservation,
    platforms: &[String],
    every_s: f64,
) -> anyhow::Result<()> {
    writeln!(
        out,
        "  laboratory  orbit  platform     mission  config  boresight  thrust  elevation  distance    yaw   pitch    roll\n\
         \x20         s      s                 deg     deg    off deg off deg        deg   to chief    deg     deg     deg\n\
         \x20                                                                              km"
    )?;
    let steps = (pass.mapping.duration_s / every_s).floor() as u32;
    for k in 0..=steps {
        let time_s = f64::from(k) * every_s;
        let Some(first) = pass.trajectories.first() else { break };
        let orbit_s = first.orbit_time_s(time_s);
        let sights = pass.pass.at(orbit_s)?;
        for (((name, sight), craft), motion) in
            platforms.iter().zip(&sights).zip(&pass.pass.spacecraft).zip(&pass.trajectories)
        {
            let angles = motion.at(time_s).angles_rad.map(f64::to_degrees);
            writeln!(
                out,
                "  {time_s:9.1} {orbit_s:6.0}  {name:<12} {} {:7.2}  {:9.3} {}  {:9.2} {:9.2} {:7.2} {:7.2} {:7.2}",
                degrees(sight.pointing.mission_angle_rad),
                craft.mounting.angle_rad().to_degrees(),
                sight.pointing.boresight_error_rad.to_degrees(),
                degrees(sight.pointing.thrust_error_rad),
                sight.elevation_rad.to_degrees(),
                sight.relative.position_m.norm() * 1e-3,
                angles.x,
                angles.y,
                angles.z,
            )?;
        }
    }
    Ok(())
}

fn degrees(angle_rad: f64) -> String {
    if angle_rad.is_nan() { format!("{:>7}", "-") } else { format!("{:7.2}", angle_rad.to_degrees()) }
}
