//! `whorl estimate`: the attitude of a recorded sensor or vehicle.

mod output;

use std::path::PathBuf;

use anyhow::bail;
use clap::Args;
use nalgebra::{UnitQuaternion, Vector3};
use serde_json::json;
use whorl_bag::{CsvMap, CsvRows};
use whorl_commands::attitudes::{CsvLines, Line, Tally, recorded_by, told};
use whorl_commands::estimate::{Chosen, EstimateOptions, too_few};
use whorl_free_motion::{Orientation, OrientationErrors, Sample};
use whorl_recording::TruthCheck;

use output::Output;

use crate::output::{JsonArgument, say, shown};

#[derive(Debug, Args)]
pub struct Arguments {
    /// Recording of gyro and what else there is: accelerometer, magnetometer, directions; CSV, also with gzip.
    #[arg(value_name = "FILE")]
    recording: PathBuf,
    /// Map of the file's columns; see params/channels/.
    #[arg(long, value_name = "MAP")]
    channels: PathBuf,
    /// Filter. free_motion: for a sensor in a hand, on a limb or on a trolley, with an accelerometer. directions: for any vehicle
    /// with directions whose references are known (a satellite). The others are filters of the estimator node that need no model
    /// of the body, for a sensor that turns about a fixed point. [default: free_motion with an accelerometer, else directions]
    #[arg(long)]
    filter: Option<String>,
    /// Estimates each sample from the whole recording, not from its past alone (free_motion, directions).
    #[arg(long)]
    smooth: bool,
    /// File for the attitudes: time, quaternion (sensor to world, which is east-north-up for free_motion), gyro bias, standard
    /// deviations.
    #[arg(long, value_name = "CSV")]
    out: Option<PathBuf>,
    /// Adds the whole covariance to that file: 21 columns, upper triangle row by row, attitude error [rad] and gyro bias [rad/s],
    /// sensor axes.
    #[arg(long, requires = "out")]
    covariance: bool,
    /// Azimuth of magnetic north, from true north towards east [deg]; added to the estimate's heading.
    #[arg(long, value_name = "DEG", default_value_t = 0.0, allow_negative_numbers = true)]
    declination_deg: f64,
    /// Gyro white noise, filter directions [rad/s/sqrt(Hz)].
    #[arg(long, value_name = "NOISE", default_value_t = 3e-4)]
    gyro_noise: f64,
    /// Random walk of the gyro's bias, filter directions [rad/s/sqrt(s)].
    #[arg(long, value_name = "WALK", default_value_t = 3e-5)]
    gyro_bias_walk: f64,
    /// Bias of the gyro at the start, one standard deviation, filter directions [rad/s].
    #[arg(long, value_name = "SIGMA", default_value_t = 0.02)]
    gyro_bias_sigma: f64,
    /// Noise of each vector sensor in the order of the map, filter directions; the last stands for all further ones [deg].
    #[arg(long, value_name = "DEG", value_delimiter = ',', default_value = "1.0")]
    vector_noise_deg: Vec<f64>,
    #[command(flatten)]
    json: JsonArgument,
}

impl Arguments {
    fn options(&self) -> EstimateOptions {
        EstimateOptions {
            filter: self.filter.clone(),
            smooth: self.smooth,
            gyro_noise: self.gyro_noise,
            gyro_bias_walk: self.gyro_bias_walk,
            gyro_bias_sigma: self.gyro_bias_sigma,
            vector_noise_deg: self.vector_noise_deg.clone(),
        }
    }
}

/// Carries out `whorl estimate`.
pub fn run(arguments: &Arguments) -> anyhow::Result<()> {
    if !arguments.declination_deg.is_finite() {
        bail!("--declination-deg is not a number");
    }
    let map = CsvMap::load(&arguments.channels)?;
    let mut rows = CsvRows::open(&arguments.recording, &map)?;
    let recorded = recorded_by(&map, &arguments.channels);
    let mut chosen = Chosen::new(&arguments.options(), &recorded)?;
    let mut out =
        arguments.out.as_deref().map(|path| Output::create(path, arguments.covariance)).transpose()?;
    // Clockwise from above, seen from north to east.
    let declination =
        UnitQuaternion::from_axis_angle(&Vector3::z_axis(), -arguments.declination_deg.to_radians());
    let (mut tally, mut times, mut samples) = (Tally::default(), None::<[i64; 2]>, 0);
    let mut reader = CsvLines::new(&map);
    let mut truth = TruthCheck::default();
    let mut take = |tally: &mut Tally,
                    first_ns: i64,
                    line: &Line,
                    estimate: Option<Orientation>|
     -> anyhow::Result<()> {
        let Some(estimate) = estimate else { return Ok(()) };
        // The samples are late: the attitude of now lies a little further on.
        let estimate = told(estimate, &line.sample, &declination, map.imu_latency_s);
        tally.add(&estimate, line.truth.as_ref());
        if let Some(out) = &mut out {
            out.write(line.sample.stamp_ns - first_ns, &estimate)?;
        }
        Ok(())
    };
    let mut kept = Vec::new();
    while let Some(row) = rows.next_row()? {
        let first_ns = times.map_or(row.time_ns, |[first_ns, _]| first_ns);
        times = Some([first_ns, row.time_ns]);
        let Some(line) = reader.line(&row, chosen.needs_force()) else { continue };
        samples += 1;
        truth.add_gyro((row.time_ns - first_ns) as f64 * 1e-9, &line.sample.gyro_rad_s);
        line.truth.iter().for_each(|q| truth.add_attitude(q));
        if arguments.smooth {
            kept.push(line);
        } else {
            let estimate = chosen.causal(&line.sample);
            take(&mut tally, first_ns, &line, estimate)?;
        }
    }
    let [first_ns, last_ns] = times.unwrap_or_default();
    if arguments.smooth {
        let samples: Vec<Sample> = kept.iter().map(|line| line.sample.clone()).collect();
        for (line, estimate) in kept.iter().zip(chosen.smoothed(&samples)?) {
            take(&mut tally, first_ns, line, estimate)?;
        }
    }
    if let Some(out) = out {
        out.finish()?;
    }
    let mut notes = rows.notes();
    notes.extend(recorded.partial_force());
    notes.extend(reader.unused().notes());
    notes.extend(chosen.doubts());
    if let Some(false_truth) = truth.contradiction() {
        notes.push(false_truth);
        tally.errors = OrientationErrors::default();
    }
    tell(arguments, &map, &chosen, &tally, samples, (last_ns - first_ns) as f64 * 1e-9, &notes)
}

fn tell(
    arguments: &Arguments,
    map: &CsvMap,
    chosen: &Chosen,
    tally: &Tally,
    samples: usize,
    duration_s: f64,
    notes: &[String],
) -> anyhow::Result<()> {
    if tally.estimates == 0 {
        bail!("{}", too_few(&arguments.recording.display().to_string(), samples, chosen));
    }
    let smoothed = if arguments.smooth { ", smoothed" } else { "" };
    say!("{samples} samples, {duration_s:.1} s, filter {}{smoothed}", chosen.name());
    for note in notes {
        say!("note: {note}");
    }
    if map.vectors.is_empty() {
        say!("no magnetometer: the heading is relative to the first attitude, and drifts");
    }
    if chosen.is_magnetised() {
        say!("there is iron or a magnet on the sensor; its field is estimated and removed");
    }
    match tally.errors.root_mean_square_rad() {
        Some(rms) => {
            let [total, heading, inclination] = rms.map(f64::to_degrees);
            say!(
                "error against truth, RMS: {total:.2} deg total, {heading:.2} heading, {inclination:.2} inclination \
                 ({} samples)",
                tally.errors.count()
            );
            say!(
                "squared heading error over its stated variance: {:.2} on average, 1 expected",
                tally.heading_consistency().unwrap_or(f64::NAN)
            );
        }
        None => say!("there is no truth to compare with"),
    }
    if let Some(path) = &arguments.out {
        say!("attitudes: {}", path.display());
    }
    let error = tally.errors.root_mean_square_rad().map(|rms| {
        let [total, heading, inclination] = rms.map(f64::to_degrees);
        json!({"samples": tally.errors.count(), "total_deg": total, "heading_deg": heading,
            "inclination_deg": inclination,
            "heading_over_stated_variance": tally.heading_consistency()})
    });
    arguments.json.write(|| {
        Ok(json!({"schema": 1, "samples": samples, "estimates": tally.estimates,
            "duration_s": duration_s, "filter": chosen.name(), "smoothed": arguments.smooth,
            "notes": notes, "error_rms": error, "attitudes": arguments.out.as_deref().map(shown)}))
    })
}
