//! The column map: a YAML file for each form of CSV.

use std::collections::BTreeMap;
use std::path::Path;

use nalgebra::{Unit, Vector3};
use whorl_params::{ParameterTree, Reader};

use super::error::CsvError;
use super::jets::{JetMap, JetQuantity, Slot};
use super::table::NO_COLUMN;
use super::time::TimeMap;
use crate::channels::{Channel, Form};
use crate::units::{self, Unit as ColumnUnit};

/// Assigns columns to channels, with units and order of axes; read from a parameter file. `docs/recordings.md`
/// explains every key:
///
/// ```yaml
/// csv:
///   ros__parameters:
///     time: {column: t, unit: s}
///     gyro: {columns: [gx, gy, gz], unit: rad/s}
///     accelerometer: {columns: [ax, ay, az], unit: m/s^2}
///     # A minus in front of a column's name reverses its sign: [mx, -my, -mz].
///     vector: {columns: [mx, my, mz], reference_world: [0.0, 0.4, -0.9]}
///     true_attitude: {columns: [qw, qx, qy, qz], rotation: body_to_world, scored: movement}
/// ```
///
/// Only `time` is needed (a column, or a rate), and one of `gyro`, `accelerometer` and `wheel_speed`. Columns that are not named are
/// ignored.
#[derive(Debug, Clone, PartialEq)]
pub struct CsvMap {
    /// The time.
    pub time: TimeMap,
    /// Columns of every channel that is axes, wheels or one number.
    pub channels: BTreeMap<Channel, ColumnMap>,
    /// Angles of encoders, whose rates stand in place of wheels' speeds or a gyro.
    pub angles: Vec<super::angle::AngleMap>,
    /// Vector sensors, such as magnetometers, in the order of the file.
    pub vectors: Vec<VectorMap>,
    /// Commands of the jets, in the order of the platform's jets.
    pub jets: Option<JetMap>,
    /// True attitude.
    pub true_attitude: Option<TruthMap>,
    /// Whether a controller was running.
    pub closed_loop: bool,
    /// Whether the platform was clamped (wheel bench test).
    pub clamped: bool,
    /// Whether the jets were off: no valve opened, although no column says so.
    pub jets_off: bool,
    /// Character between the cells.
    pub delimiter: u8,
    /// Whether numbers have a comma where others have a point.
    pub decimal_comma: bool,
    /// How late samples of gyro and accelerometer are against their stamps, beyond half the interval that they average \[s\].
    pub imu_latency_s: f64,
}

/// Columns of one measured quantity. SI value = `factor` * number + `offset`.
#[derive(Debug, Clone, PartialEq)]
pub struct ColumnMap {
    /// Names of the columns; a minus in front reverses the sign, [`NO_COLUMN`] stands for an axis without one.
    pub columns: Vec<String>,
    /// SI units per unit of the column.
    pub factor: f64,
    /// SI value of a zero.
    pub offset: f64,
}

/// A sensor of a direction that is fixed in the world. Its unit does not matter: only the direction is used.
#[derive(Debug, Clone, PartialEq)]
pub struct VectorMap {
    /// Columns of x, y, z of the body.
    pub columns: [String; 3],
    /// The same direction in the world; `None`: determined from the file, see
    /// [`super::CsvRecording::vector_reference_world`].
    pub reference_world: Option<Unit<Vector3<f64>>>,
    /// Columns of the same direction in the world, where it varies in time (a magnetic field along an orbit).
    pub reference_columns: Option<[String; 3]>,
    /// Whether a value that is the same as in the line before is a measurement of its own. Files often repeat
    /// the last value of a slower sensor. `None`: such a value is ignored while it may be that, see
    /// [`super::CsvRows`].
    pub repeats: Option<bool>,
}

/// True attitude, e.g. from motion capture.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct TruthMap {
    /// Columns of w, x, y, z.
    pub columns: [String; 4],
    /// Whether the quaternion rotates world axes into body axes, and must be inverted.
    pub world_to_body: bool,
    /// A column that is 1 where the file's author wants errors to be counted, and 0 elsewhere.
    pub scored_column: Option<String>,
}

/// Names of the platform's wheels and jets, in the order of its parameter file.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct PlatformParts {
    /// Name of the platform.
    pub platform: String,
    /// Names of its wheels.
    pub wheels: Vec<String>,
    /// Names of its jets.
    pub jets: Vec<String>,
}

impl CsvMap {
    /// Reads a map file: section `csv` (or `/**`) of a ROS 2 parameter file.
    ///
    /// # Errors
    /// Everything that is wrong in it, with file, line, key and what is allowed.
    pub fn load(path: &Path) -> Result<Self, CsvError> {
        Ok(whorl_params::read(&ParameterTree::load_for(path, "csv")?, |r| Self::read(r, None))?.0)
    }

    /// As [`Self::load`], checked against the platform that was measured.
    ///
    /// # Errors
    /// As [`Self::load`]; also another number of wheels or jets than the platform's.
    pub fn load_for(path: &Path, parts: &PlatformParts) -> Result<Self, CsvError> {
        Ok(whorl_params::read(&ParameterTree::load_for(path, "csv")?, |r| Self::read(r, Some(parts)))?.0)
    }

    /// Reads the map from a node's parameters. The single definition of its keys.
    pub fn read(r: &mut Reader<'_>, parts: Option<&PlatformParts>) -> Self {
        let mut map = Self {
            time: r.group("time", super::time::read),
            channels: BTreeMap::new(),
            angles: Vec::new(),
            vectors: Vec::new(),
            jets: None,
            true_attitude: None,
            closed_loop: false,
            clamped: false,
            jets_off: false,
            delimiter: b',',
            decimal_comma: false,
            imu_latency_s: 0.0,
        };
        for channel in Channel::ALL {
            map.read_channel(r, *channel, parts);
        }
        map.read_angles(r, parts);
        map.read_circumstances(r);
        refuse_unknown(r);
        let motion: Vec<&str> = Channel::ALL
            .iter()
            .map(|c| c.info())
            .filter(|info| info.is_motion)
            .map(|info| info.key)
            .collect();
        if !Channel::ALL.iter().any(|channel| channel.info().is_motion && map.has(*channel)) {
            let first = motion.first().copied().unwrap_or_default();
            r.reject(first, format!("nothing that moves is named; allowed: one of {}", motion.join(", ")));
        }
        map
    }

    /// Whether the map names columns of a channel.
    #[must_use]
    pub fn has(&self, channel: Channel) -> bool {
        match channel.info().form {
            Form::Directions => !self.vectors.is_empty(),
            Form::Pulses => self.jets.is_some(),
            Form::Attitude => self.true_attitude.is_some(),
            Form::Axes | Form::Wheels { .. } | Form::Gimbals { .. } | Form::Scalar => {
                self.channels.contains_key(&channel)
                    || self.angles.iter().any(|angles| angles.channel == channel)
            }
        }
    }

    fn read_channel(&mut self, r: &mut Reader<'_>, channel: Channel, parts: Option<&PlatformParts>) {
        let info = channel.info();
        let wheels = parts.map(|parts| Members { of: &parts.platform, what: "wheels", names: &parts.wheels });
        let jets = parts.map(|parts| Members { of: &parts.platform, what: "jets", names: &parts.jets });
        if info.form == Form::Directions {
            self.vectors = vectors(r, info.key, info.holds);
            return;
        }
        if !r.has(info.key) {
            return;
        }
        r.group(info.key, |r| {
            let (columns, of_unit) = match info.form {
                Form::Axes => {
                    let columns = names::<3>(r, info.holds);
                    let missing = columns.iter().filter(|name| *name == NO_COLUMN).count();
                    let may_lack = info.absent_axis().is_some();
                    if missing == 3 || missing > 0 && !may_lack {
                        let few = if may_lack { "at least one" } else { "all three" };
                        r.reject(
                            "columns",
                            format!("~ stands for an axis that is not measured, and here {few} must be"),
                        );
                    }
                    (columns.to_vec(), "unit of these columns")
                }
                Form::Wheels { .. } => (counted(r, info.holds, wheels), "unit of these columns"),
                Form::Gimbals { .. } => (counted(r, info.holds, None), "unit of these columns"),
                Form::Scalar => {
                    let holds = format!("name of the column of the {}", info.holds);
                    (vec![r.string("column", &holds)], "unit of this column")
                }
                Form::Pulses => {
                    self.jets = Some(read_jets(r, info.holds, jets));
                    return;
                }
                Form::Attitude => {
                    self.true_attitude = Some(attitude(r, info.holds));
                    return;
                }
                Form::Directions => return,
            };
            let ColumnUnit { factor, offset, .. } = unit(r, info.units, of_unit);
            self.channels.insert(channel, ColumnMap { columns, factor, offset });
        });
    }

    /// Angles that stand in place of rates.
    fn read_angles(&mut self, r: &mut Reader<'_>, parts: Option<&PlatformParts>) {
        for (key, channel) in super::angle::KEYS {
            if !r.has(key) {
                continue;
            }
            let rate = channel.info().key;
            if self.channels.contains_key(&channel) {
                let at = if channel == Channel::Gyro { "column" } else { "columns" };
                r.reject(&format!("{key}.{at}"), format!("{rate} is given as well; allowed: one of the two"));
            }
            let angles = r.group(key, |r| {
                let wheels =
                    parts.map(|parts| Members { of: &parts.platform, what: "wheels", names: &parts.wheels });
                let columns =
                    (channel != Channel::Gyro).then(|| counted(r, "angle of each wheel's encoder", wheels));
                super::angle::read(r, channel, columns)
            });
            self.angles.push(angles);
        }
    }

    /// What a map says that is no channel.
    fn read_circumstances(&mut self, r: &mut Reader<'_>) {
        self.closed_loop = r.bool_or("closed_loop", false, "whether a controller was running");
        let mounting = r.choice_or(
            "mounting",
            "on_bearing",
            &["on_bearing", "clamped"],
            "clamped: the body was held, only the wheels moved",
        );
        self.clamped = mounting == "clamped";
        self.jets_off = r.bool_or(
            "jets_off",
            false,
            "whether the jets were off: no valve opened during the run, although no column says so",
        );
        if self.jets_off && self.jets.is_some() {
            r.reject("jets_off", "the map names the jets' columns as well; allowed: one of the two");
        }
        self.imu_latency_s = r.f64_or(
            "imu_latency_s",
            0.0,
            whorl_params::range(-1.0..=1.0),
            "how late gyro and accelerometer are against their stamps; whorl estimate turns its attitudes on by that time [s]",
        );
        let delimiter =
            r.choice_or("delimiter", ",", &[",", ";", "\t", " ", "|"], "character between the cells");
        self.delimiter = delimiter.bytes().next().unwrap_or(b',');
        let decimal = r.choice_or("decimal", ".", &[".", ","], "what stands before the decimals of a number");
        self.decimal_comma = decimal == ",";
        if self.decimal_comma && self.delimiter == b',' {
            r.reject(
                "decimal",
                "the cells are separated by commas as well; give another delimiter, as \";\"",
            );
        }
    }
}

/// Every group or key of a map.
fn keys() -> Vec<&'static str> {
    let channels = Channel::ALL.iter().flat_map(|channel| match channel.info().form {
        Form::Directions => vec![channel.info().key, SEVERAL],
        _ => vec![channel.info().key],
    });
    let angles = super::angle::KEYS.iter().map(|(key, _)| *key);
    ["time"]
        .into_iter()
        .chain(channels)
        .chain(angles)
        .chain(["closed_loop", "mounting", "jets_off", "imu_latency_s", "delimiter", "decimal"])
        .collect()
}

/// The group of vector sensors, for several of them.
const SEVERAL: &str = "vectors";

fn refuse_unknown(r: &mut Reader<'_>) {
    let allowed = keys();
    let first_parts = r.parameters().iter().map(|entry| entry.key.split('.').next().unwrap_or_default());
    let mut unknown: Vec<String> =
        first_parts.filter(|name| !allowed.contains(name)).map(str::to_owned).collect();
    unknown.dedup();
    for name in unknown {
        r.reject_group(&name, format!("is no channel; allowed: {}", allowed.join(", ")));
    }
}

/// Of what a platform has several, for counting columns.
#[derive(Clone, Copy)]
struct Members<'a> {
    of: &'a str,
    what: &'a str,
    names: &'a [String],
}

/// One sensor (`vector`), or several by names of their own (`vectors.<name>`).
fn vectors(r: &mut Reader<'_>, key: &str, holds: &str) -> Vec<VectorMap> {
    let one = r.has(key).then(|| r.group(key, |r| vector(r, holds)));
    let several: Vec<VectorMap> =
        r.group(SEVERAL, |r| r.children("").iter().map(|name| r.group(name, |r| vector(r, holds))).collect());
    let all: Vec<VectorMap> = one.into_iter().chain(several).collect();
    if all.len() > crate::extra::MAX_VECTOR_SENSORS {
        r.reject(
            SEVERAL,
            format!("{} sensors; allowed: at most {}", all.len(), crate::extra::MAX_VECTOR_SENSORS),
        );
    }
    all
}

fn vector(r: &mut Reader<'_>, holds: &str) -> VectorMap {
    let given = r.has("reference_world");
    let reference_columns = r.has("reference_columns").then(|| {
        let holds = "the same direction in the world, where it varies in time";
        let names = r.string_array("reference_columns", holds);
        <[String; 3]>::try_from(names).unwrap_or_else(|names| {
            r.reject(
                "reference_columns",
                format!("has {} names; allowed: three, of x, y and z", names.len()),
            );
            Default::default()
        })
    });
    if given && reference_columns.is_some() {
        r.reject("reference_columns", "reference_world is given as well; allowed: one of the two".to_owned());
    }
    VectorMap {
        columns: names(r, holds),
        reference_world: given
            .then(|| r.direction("reference_world", "the same direction in the world (east, north, up)")),
        reference_columns,
        repeats: r.has("repeats").then(|| {
            r.bool(
                "repeats",
                "whether a value that is the same as in the line before is a measurement of its own",
            )
        }),
    }
}

fn attitude(r: &mut Reader<'_>, holds: &str) -> TruthMap {
    TruthMap {
        columns: names(r, holds),
        world_to_body: r.choice_or(
            "rotation",
            "body_to_world",
            &["body_to_world", "world_to_body"],
            "what the quaternion rotates",
        ) == "world_to_body",
        scored_column: r.optional_string("scored", "column that is 1 where errors are to be counted"),
    }
}

fn read_jets(r: &mut Reader<'_>, holds: &str, jets: Option<Members<'_>>) -> JetMap {
    let columns = counted(r, holds, jets);
    let quantity = r.choice(
        "quantity",
        &["on_time", "duty", "open"],
        "on_time: time open in each slot; duty: share of the slot; open: 1 while the valve is switched on, else 0",
    );
    let (quantity, table) = match quantity {
        "duty" => (JetQuantity::Duty, units::SHARE),
        "open" => (JetQuantity::Open, units::SHARE),
        _ => (JetQuantity::OnTime, units::ON_TIME),
    };
    let factor = match quantity {
        JetQuantity::Open => 1.0,
        _ => unit(r, table, "unit of the jets' columns").factor,
    };
    let slot = match quantity {
        JetQuantity::Open => Slot::Row,
        _ if r.has("slot_length_s") => Slot::Length {
            ns: (r.f64("slot_length_s", whorl_params::range(1e-3..=3600.0), "length of a pulse slot [s]")
                * 1e9)
                .round() as i64,
        },
        _ => {
            let at_rows = r.choice(
                "slot",
                &["row"],
                "row: every line with numbers opens one pulse at its time; else give slot_length_s",
            ) == "row";
            if at_rows && quantity == JetQuantity::Duty {
                r.reject(
                    "quantity",
                    "a duty needs the slot's length; allowed: on_time, or give slot_length_s",
                );
            }
            Slot::Row
        }
    };
    JetMap { columns, quantity, factor, slot }
}

/// The first unit of the table is the default.
fn unit(r: &mut Reader<'_>, table: &[ColumnUnit], doc: &str) -> ColumnUnit {
    let names: Vec<&str> = table.iter().map(|unit| unit.name).collect();
    let default = names.first().copied().unwrap_or_default();
    let chosen = r.choice_or("unit", default, &names, doc);
    let found = table.iter().find(|unit| unit.name == chosen).copied();
    found.unwrap_or(ColumnUnit { name: "", factor: 1.0, offset: 0.0 })
}

/// Reads column names and checks that there are as many as the platform has wheels or jets.
fn counted(r: &mut Reader<'_>, doc: &str, members: Option<Members<'_>>) -> Vec<String> {
    let columns = r.string_array("columns", doc);
    if let Some(Members { of, what, names }) = members
        && columns.len() != names.len()
        && !columns.is_empty()
    {
        r.reject(
            "columns",
            format!(
                "{} names, but {of} has {} {what}; allowed: {}",
                columns.len(),
                names.len(),
                match names {
                    [] => format!(
                        "no such columns; leave the group out, or write the {what} into the platform's file"
                    ),
                    names => format!("one column for each of {}, in this order", names.join(", ")),
                }
            ),
        );
    } else if columns.is_empty() && r.has("columns") {
        r.reject("columns", "no names; leave the group out if there is no such column");
    }
    columns
}

fn names<const N: usize>(r: &mut Reader<'_>, doc: &str) -> [String; N] {
    let names = r.string_array("columns", doc);
    let count = names.len();
    names.try_into().unwrap_or_else(|_| {
        if count > 0 {
            r.reject("columns", format!("{count} names, but there must be {N}: {doc}"));
        }
        std::array::from_fn(|_| String::new())
    })
}
