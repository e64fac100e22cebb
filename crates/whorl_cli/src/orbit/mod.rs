//! `whorl orbit`: the passes of an experiment as the laboratory would reproduce them.

mod burns;
mod keep;
mod page;

use std::path::{Path, PathBuf};

use anyhow::{Context, bail};
use clap::Args;
use serde::Serialize;
use serde_json::json;
use whorl_coordinator::parameters::{self, CoObservation, StepKind};
use whorl_orbits::flight::Flight;
use whorl_params::{Override, ParameterTree, layers_of_experiment, try_read};
use whorl_report::{DrawnPass, orbit_html};

use crate::output::{JsonArgument, say};
use crate::runs::write;
use crate::simulate::experiment_file;

#[derive(Debug, Args)]
pub struct Arguments {
    /// A name in params/experiments/, or a file; it has a co_observe step.
    #[arg(value_name = "NAME|FILE")]
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
    /// Writes a page: the pass in 3-D, ground tracks, theta_mission and theta_config, and what each platform is given.
    #[arg(long, value_name = "FILE")]
    html: Option<PathBuf>,
    #[command(flatten)]
    json: JsonArgument,
}

/// Carries out `whorl orbit`.
pub fn run(arguments: &Arguments) -> anyhow::Result<()> {
    if !(arguments.every > 0.0 && arguments.every.is_finite()) {
        bail!("--every is {}; allowed: a positive number of seconds", arguments.every);
    }
    let experiment = &experiment_file(&arguments.experiment, arguments.params.as_deref())?;
    let beside = experiment.parent().and_then(Path::parent).map(Path::to_owned);
    let folder = arguments.params.clone().or(beside).context("name the parameter folder with --params")?;
    let overrides =
        arguments.overrides.iter().map(|text| Override::parse(text)).collect::<Result<Vec<_>, _>>()?;
    let tree = ParameterTree::load(&layers_of_experiment(&folder, experiment)?, &overrides)?;
    let (parameters, _) = try_read(&tree.for_node("/coordinator"), parameters::read)?;
    let (mut passes, mut drawn) = (Vec::new(), Vec::new());
    for step in &parameters.steps {
        if let StepKind::CoObserve(pass) = &step.kind {
            let orbit_s = pass.mapping.orbit_span_s();
            say!("step {}: {:.0} s, {orbit_s:.0} s of orbit", step.name, step.duration_s);
            let flight = Flight::new(&pass.pass)?;
            let rows = rows(pass, &flight, &parameters.platforms, arguments.every)?;
            table(&rows);
            let flown = burns::burns(&flight, &parameters.platforms);
            let keeping = burns::keeping(pass, &flight, &parameters.platforms)?;
            burns::print(&flown, &keeping);
            let (kept, of_days): (Vec<_>, Vec<_>) =
                keep::kept(pass, &flight, &parameters.platforms)?.into_iter().unzip();
            keep::print(&kept);
            if arguments.html.is_some() {
                let page = page::drawn(&step.name, pass, &flight, &parameters.platforms)?;
                drawn.push(DrawnPass { keeping: of_days, ..page });
            }
            passes.push(json!({
                "step": step.name, "duration_s": step.duration_s, "orbit_s": orbit_s, "rows": rows,
                "burns": flown, "keeping": keeping, "kept": kept,
            }));
        }
    }
    if passes.is_empty() {
        bail!("{} has no co_observe step", experiment.display());
    }
    if let Some(path) = &arguments.html {
        let facts = [
            ("experiment".to_owned(), experiment.display().to_string()),
            ("changed".to_owned(), arguments.overrides.join(" ")),
            ("Whorl version".to_owned(), env!("CARGO_PKG_VERSION").to_owned()),
        ];
        let facts: Vec<_> = facts.into_iter().filter(|(_, value)| !value.is_empty()).collect();
        let title = format!("Pass: {}", parameters.experiment.name);
        write(path, &orbit_html(&title, &drawn, &facts))?;
        say!("page: {}", path.display());
    }
    arguments.json.write(|| Ok(json!({"schema": 1, "experiment": experiment, "passes": passes})))
}

/// A platform at a moment of the pass; NaN (null in JSON) where an angle has no meaning.
#[derive(Debug, Clone, Serialize)]
struct Row {
    laboratory_s: f64,
    orbit_s: f64,
    platform: String,
    mission_deg: f64,
    config_deg: f64,
    boresight_off_deg: f64,
    thrust_off_deg: f64,
    elevation_deg: f64,
    to_chief_km: f64,
    yaw_pitch_roll_deg: [f64; 3],
}

fn rows(
    pass: &CoObservation,
    flight: &Flight<'_>,
    platforms: &[String],
    every_s: f64,
) -> anyhow::Result<Vec<Row>> {
    let steps = (pass.mapping.duration_s / every_s).floor() as u32;
    let mut rows = Vec::new();
    for k in 0..=steps {
        let time_s = f64::from(k) * every_s;
        let Some(first) = pass.trajectories.first() else { break };
        let orbit_s = first.orbit_time_s(time_s);
        let sights = flight.at(orbit_s)?;
        for (((name, sight), craft), motion) in
            platforms.iter().zip(&sights).zip(&pass.pass.spacecraft).zip(&pass.trajectories)
        {
            let angles = motion.at(time_s).angles_rad.map(f64::to_degrees);
            rows.push(Row {
                laboratory_s: time_s,
                orbit_s,
                platform: name.clone(),
                mission_deg: sight.pointing.mission_angle_rad.to_degrees(),
                config_deg: craft.mounting.angle_rad().to_degrees(),
                boresight_off_deg: sight.pointing.boresight_error_rad.to_degrees(),
                thrust_off_deg: sight.pointing.thrust_error_rad.to_degrees(),
                elevation_deg: sight.elevation_rad.to_degrees(),
                to_chief_km: sight.relative.position_m.norm() * 1e-3,
                yaw_pitch_roll_deg: [angles.x, angles.y, angles.z],
            });
        }
    }
    Ok(rows)
}

fn table(rows: &[Row]) {
    say!(
        "  laboratory  orbit  platform     mission  config  boresight  thrust  elevation  distance    yaw   pitch    roll\n\
         \x20         s      s                 deg     deg    off deg off deg        deg   to chief    deg     deg     deg\n\
         \x20                                                                              km"
    );
    for row in rows {
        let [yaw, pitch, roll] = row.yaw_pitch_roll_deg;
        say!(
            "  {:9.1} {:6.0}  {:<12} {} {:7.2}  {:9.3} {}  {:9.2} {:9.2} {yaw:7.2} {pitch:7.2} {roll:7.2}",
            row.laboratory_s,
            row.orbit_s,
            row.platform,
            degrees(row.mission_deg),
            row.config_deg,
            row.boresight_off_deg,
            degrees(row.thrust_off_deg),
            row.elevation_deg,
            row.to_chief_km,
        );
    }
}

fn degrees(angle_deg: f64) -> String {
    if angle_deg.is_nan() { format!("{:>7}", "-") } else { format!("{angle_deg:7.2}") }
}
