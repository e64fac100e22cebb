//! `whorl estimate`: the attitude of a recorded sensor.

use std::fs::File;
use std::io::{BufWriter, Write};
use std::path::{Path, PathBuf};

use anyhow::{Context, bail};
use clap::Args;
use nalgebra::{UnitQuaternion, Vector3};
use whorl_bag::{Channel, CsvMap, CsvRow, CsvRows};
use whorl_estimation::{Estimator, FilterKind, Health, ImuSample, Parameters};
use whorl_free_motion::{FreeMotionEstimator, FreeMotionParameters, OrientationErrors};

/// The filter for sensors that do not turn about a fixed point.
const FREE_MOTION: &str = FilterKind::FREE_MOTION.name;

#[derive(Debug, Args)]
pub struct Arguments {
    /// Recording of gyro, accelerometer and, if there is one, magnetometer: CSV, also with gzip.
    #[arg(value_name = "FILE")]
    recording: PathBuf,
    /// Map of the file's columns; see params/channels/.
    #[arg(long, value_name = "MAP")]
    channels: PathBuf,
    /// Filter. free_motion: for a sensor in a hand, on a limb or on a trolley. The others are filters of the estimator
    /// node that need no model of the body, for a sensor that turns about a fixed point.
    #[arg(long, default_value = FREE_MOTION)]
    filter: String,
    /// File for the attitudes: time, quaternion (sensor to east-north-up), gyro bias, standard deviations.
    #[arg(long, value_name = "CSV")]
    out: Option<PathBuf>,
    /// Azimuth of magnetic north, from true north towards east [deg]; added to the estimate's heading.
    #[arg(long, value_name = "DEG", default_value_t = 0.0, allow_negative_numbers = true)]
    declination_deg: f64,
}

/// One answer.
struct Attitude {
    q_world_body: UnitQuaternion<f64>,
    gyro_bias_rad_s: Vector3<f64>,
    sigma_rad: Vector3<f64>,
}

/// The chosen filter.
enum Chosen {
    FreeMotion(Box<FreeMotionEstimator>),
    Pivot(Box<Estimator>),
}

impl Chosen {
    fn new(name: &str) -> anyhow::Result<Self> {
        if name == FREE_MOTION {
            let filter = FreeMotionEstimator::new(FreeMotionParameters::default());
            return Ok(Self::FreeMotion(Box::new(filter)));
        }
        let usable =
            || FilterKind::ALL.into_iter().filter(|kind| !kind.needs_body && kind.name != FREE_MOTION);
        let Some(kind) = usable().find(|kind| kind.name == name) else {
            let names: Vec<&str> = usable().map(|kind| kind.name).collect();
            bail!("--filter {name}: allowed: {FREE_MOTION}, {}", names.join(", "));
        };
        let parameters = Parameters::freely_moving().with_magnetometer(std::f64::consts::FRAC_PI_2);
        Ok(Self::Pivot(Box::new(Estimator::new(kind, parameters, None)?)))
    }

    fn imu(&mut self, stamp_ns: i64, gyro_rad_s: Vector3<f64>, specific_force_m_s2: Vector3<f64>) {
        match self {
            Self::FreeMotion(filter) => filter.on_imu(stamp_ns, &gyro_rad_s, &specific_force_m_s2),
            Self::Pivot(filter) => {
                filter.on_imu(&ImuSample { stamp_ns, gyro_rad_s, specific_force_m_s2 });
            }
        }
    }

    fn magnetometer(&mut self, stamp_ns: i64, field: &Vector3<f64>) {
        match self {
            Self::FreeMotion(filter) => filter.on_magnetometer(field),
            Self::Pivot(filter) => {
                filter.on_vector(stamp_ns, field);
            }
        }
    }

    fn attitude(&self, stamp_ns: i64) -> Option<Attitude> {
        match self {
            Self::FreeMotion(filter) => filter.estimate().map(|e| Attitude {
                q_world_body: e.q_world_body,
                gyro_bias_rad_s: e.gyro_bias_rad_s,
                sigma_rad: e.sigma_rad,
            }),
            Self::Pivot(filter) => {
                let e = filter.estimate(stamp_ns);
                let in_body = e.covariance.fixed_view::<3, 3>(0, 0);
                let rotation = *e.q_world_body.to_rotation_matrix().matrix();
                let in_world = rotation * in_body * rotation.transpose();
                (e.health != Health::Initialising).then(|| Attitude {
                    q_world_body: e.q_world_body,
                    gyro_bias_rad_s: e.gyro_bias_b_rad_s,
                    sigma_rad: in_world.diagonal().map(|v| v.max(0.0).sqrt()),
                })
            }
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
    let mut filter = Chosen::new(&arguments.filter)?;
    let mut out = arguments.out.as_deref().map(create).transpose()?;
    let repeats = map.vectors.first().is_some_and(|vector| vector.repeats);
    // Clockwise from above, seen from north to east.
    let declination =
        UnitQuaternion::from_axis_angle(&Vector3::z_axis(), -arguments.declination_deg.to_radians());
    let mut errors = OrientationErrors::default();
    let (mut first_ns, mut last_ns, mut samples, mut estimates) = (None, 0, 0_u64, 0_u64);
    let mut last_field = None;
    while let Some(row) = rows.next_row()? {
        let start_ns = *first_ns.get_or_insert(row.time_ns);
        last_ns = row.time_ns;
        let (Some(gyro), Some(force)) = (row.axes(Channel::Gyro), row.axes(Channel::Accelerometer)) else {
            continue;
        };
        samples += 1;
        filter.imu(row.time_ns, gyro, force);
        if let Some(field) = field(&row)
            && (last_field.replace(field) != Some(field) || repeats)
        {
            filter.magnetometer(row.time_ns, &field);
        }
        let Some(attitude) = filter.attitude(row.time_ns) else { continue };
        let q = declination * attitude.q_world_body;
        estimates += 1;
        if let Some(truth) = row.q_world_body.filter(|_| row.scored) {
            errors.add(&q, &truth);
        }
        if let Some(out) = &mut out {
            write_line(out, row.time_ns - start_ns, &q, &attitude).context("writing the attitudes")?;
        }
    }
    if let Some(mut out) = out {
        out.flush().context("writing the attitudes")?;
    }
    if estimates == 0 {
        bail!(
            "{}: {samples} samples of gyro and accelerometer are too few for a first attitude",
            arguments.recording.display()
        );
    }
    let duration_s = (last_ns - first_ns.unwrap_or(last_ns)) as f64 * 1e-9;
    println!("{samples} samples, {duration_s:.1} s, filter {}", arguments.filter);
    if map.vectors.is_empty() {
        println!("no magnetometer: the heading is relative to the first attitude, and drifts");
    }
    if let Chosen::FreeMotion(filter) = &filter
        && filter.is_magnetised()
    {
        println!("there is iron or a magnet on the sensor; its field is estimated and removed");
    }
    match errors.root_mean_square_rad() {
        Some(rms) => {
            let [total, heading, inclination] = rms.map(f64::to_degrees);
            println!(
                "error against truth, RMS: {total:.2} deg total, {heading:.2} heading, {inclination:.2} inclination \
                 ({} samples)",
                errors.count()
            );
        }
        None => println!("the file has no truth to compare with"),
    }
    if let Some(path) = &arguments.out {
        println!("attitudes: {}", path.display());
    }
    Ok(())
}

/// The magnetometer's sample with its length, which reveals disturbances.
fn field(row: &CsvRow) -> Option<Vector3<f64>> {
    let direction = row.vectors_b.first().copied().flatten()?;
    Some(direction.into_inner() * row.vector_lengths.first().copied().flatten()?)
}

fn create(path: &Path) -> anyhow::Result<BufWriter<File>> {
    let mut out =
        BufWriter::new(File::create(path).with_context(|| format!("cannot create {}", path.display()))?);
    let header = "time_s,qw,qx,qy,qz,gyro_bias_x_rad_s,gyro_bias_y_rad_s,gyro_bias_z_rad_s,\
                  sigma_east_rad,sigma_north_rad,sigma_heading_rad";
    writeln!(out, "{header}").with_context(|| format!("cannot write {}", path.display()))?;
    Ok(out)
}

fn write_line(
    out: &mut impl Write,
    since_start_ns: i64,
    q: &UnitQuaternion<f64>,
    attitude: &Attitude,
) -> std::io::Result<()> {
    let (b, s) = (attitude.gyro_bias_rad_s, attitude.sigma_rad);
    writeln!(
        out,
        "{:.6},{:.9},{:.9},{:.9},{:.9},{:.6e},{:.6e},{:.6e},{:.3e},{:.3e},{:.3e}",
        since_start_ns as f64 * 1e-9,
        q.w,
        q.i,
        q.j,
        q.k,
        b.x,
        b.y,
        b.z,
        s.x,
        s.y,
        s.z
    )
}
