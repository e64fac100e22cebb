//! `whorl calibrate imu`: estimates sensor errors from still stretches and turns, and writes them into the platform's file.

use std::path::PathBuf;

use anyhow::{Context, bail};
use clap::Subcommand;
use whorl_calibration::{ImuCalibration, calibrate_imu};
use whorl_commands::calibrate::{as_json, settings};
use whorl_commands::model_file::prepare_out;
use whorl_explain::changes::of_calibration;
use whorl_math::three_digits;
use whorl_params::ModelStep;
use whorl_recording::Recording;

use crate::identify::print_findings;
use crate::model_file;
use crate::output::{JsonArgument, say};
use crate::provenance::provenance_of_this;
use crate::runs::RunArguments;
use crate::table;

#[derive(Debug, clap::Args)]
pub struct Arguments {
    #[command(subcommand)]
    what: What,
}

#[derive(Debug, Subcommand)]
enum What {
    /// Gyro and accelerometer: bias, scale, misalignment, noise. Let the sensor lie still for
    /// 20 s on each of its six faces and turn it from one to the next.
    Imu(Imu),
}

#[derive(Debug, clap::Args)]
struct Imu {
    #[command(flatten)]
    runs: RunArguments,
    /// Turns about the vertical were multiples of this angle [deg].
    #[arg(long, value_name = "DEG")]
    known_turn_deg: Option<f64>,
    /// Standard deviation of the known turns [deg].
    #[arg(long, value_name = "DEG", default_value_t = 0.3)]
    turn_error_deg: f64,
    /// Standard deviation of the levelling of each face [deg].
    #[arg(long, value_name = "DEG", default_value_t = 0.5)]
    level_error_deg: f64,
    /// Gravity where it was recorded [m/s^2] [default: estimated, 9.81 within its range over the Earth; a scale error that all axes
    /// share is then known to 0.2 %].
    #[arg(long, value_name = "M_S2")]
    gravity: Option<f64>,
    /// Parameter file to write into; created as a copy of the model's file if it does not exist [default: --model].
    #[arg(long, value_name = "FILE")]
    out: Option<PathBuf>,
    /// Show, but write nothing into the parameter file.
    #[arg(long)]
    dry_run: bool,
    #[command(flatten)]
    json: JsonArgument,
}

/// Carries out `whorl calibrate`.
pub fn run(arguments: &Arguments) -> anyhow::Result<()> {
    let What::Imu(imu) = &arguments.what;
    let settings = settings(imu.known_turn_deg, imu.turn_error_deg, imu.level_error_deg, imu.gravity)?;
    let runs = imu.runs.read()?;
    let recordings: Vec<&Recording> = runs.training.iter().collect();
    let found = calibrate_imu(&recordings, &runs.known.model.sensors, &settings);
    print(&found);
    print_findings(&found.findings);
    imu.json.write(|| Ok(as_json(&runs.known.platform, &found)))?;
    if found.findings.iter().any(|f| f.fatal) {
        bail!("nothing was written");
    }
    if imu.dry_run {
        return Ok(());
    }
    let out = imu
        .out
        .as_ref()
        .or(imu.runs.context.model.as_ref())
        .context("name the platform's file to write into with --out (or --model), or use --dry-run")?;
    let changes = of_calibration(&found);
    let step = ModelStep::of_source(provenance_of_this(&imu.runs)?);
    prepare_out(out, &runs.known)?;
    let written = model_file::write_step(out, &runs.known, &changes, step)?;
    say!("{written} entries written to {}", out.display());
    Ok(())
}

fn print(found: &ImuCalibration) {
    say!("{} still stretches, {:.1} Hz", found.still_stretches, found.rate_hz);
    let headings: Vec<String> =
        ["", "#x", "#+-", "#y", "#+-", "#z", "#+-", "unit"].iter().map(|s| (*s).to_owned()).collect();
    let mut rows = Vec::new();
    for (name, unit, sensor) in found.sensors() {
        for quantity in sensor.quantities(unit) {
            let mut row = vec![format!("{name} {}", quantity.name)];
            for (value, stddev) in quantity.of.value.iter().zip(quantity.of.stddev.iter()) {
                if stddev.is_finite() {
                    row.extend([three_digits(*value), three_digits(*stddev)]);
                } else {
                    row.extend(["not determined".to_owned(), String::new()]);
                }
            }
            row.push(quantity.unit);
            rows.push(row);
        }
    }
    table::print(&headings, &rows);
    for (name, _, sensor) in found.sensors() {
        if let Some(ratio) = sensor.misfit.and_then(|misfit| misfit.ratio()) {
            say!("{name}: residuals are {ratio:.2} times what the noise explains");
        }
    }
}
