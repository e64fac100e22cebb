//! Which column of a CSV file is what.

use std::path::Path;

use nalgebra::{Unit, Vector3};
use whorl_params::{ParameterTree, Reader};

use super::CsvError;

/// Which columns a CSV file has, and their units. Read from a parameter file:
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
/// Only `time`, `gyro` and `accelerometer` are needed. Columns that are not named are ignored.
#[derive(Debug, Clone, PartialEq)]
pub struct CsvMap {
    /// Column of the time.
    pub time_column: String,
    /// Seconds per unit of the time column.
    pub time_unit_s: f64,
    /// Columns of the rate about x, y, z of the body.
    pub gyro_columns: [String; 3],
    /// rad/s per unit of the gyro columns.
    pub gyro_unit_rad_s: f64,
    /// Columns of the specific force along x, y, z of the body (+9.81 on z at rest).
    pub accelerometer_columns: [String; 3],
    /// m/s^2 per unit of the accelerometer columns.
    pub accelerometer_unit_m_s2: f64,
    /// A vector sensor, such as a magnetometer.
    pub vector: Option<VectorMap>,
    /// True attitude.
    pub true_attitude: Option<TruthMap>,
    /// Character between the cells.
    pub delimiter: u8,
}

/// A sensor of a direction that is fixed in the world. Its unit does not matter: only the direction is used.
#[derive(Debug, Clone, PartialEq)]
pub struct VectorMap {
    /// Columns of x, y, z of the body.
    pub columns: [String; 3],
    /// The same direction in the world; `None`: determined from the file, see
    /// [`super::CsvRecording::vector_reference_world`].
    pub reference_world: Option<Unit<Vector3<f64>>>,
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

const TIME_UNITS: [(&str, f64); 4] = [("s", 1.0), ("ms", 1e-3), ("us", 1e-6), ("ns", 1e-9)];
const RATE_UNITS: [(&str, f64); 2] = [("rad/s", 1.0), ("deg/s", std::f64::consts::PI / 180.0)];
/// Standard gravity [m/s^2], by definition of the unit g (CGPM 1901).
const STANDARD_GRAVITY_M_S2: f64 = 9.806_65;
const FORCE_UNITS: [(&str, f64); 3] =
    [("m/s^2", 1.0), ("g", STANDARD_GRAVITY_M_S2), ("mg", STANDARD_GRAVITY_M_S2 * 1e-3)];

impl CsvMap {
    /// Reads a map file: section `csv` (or `/**`) of a ROS 2 parameter file.
    ///
    /// # Errors
    /// Everything that is wrong in it, with file, line, key and what is allowed.
    pub fn load(path: &Path) -> Result<Self, CsvError> {
        let tree = ParameterTree::load(&[path.to_owned()], &[])?;
        tree.check_sections(["/csv"])?;
        Ok(whorl_params::read(&tree.for_node("/csv"), Self::read)?.0)
    }

    /// Reads the map from the open group of a node's parameters. The single definition of its keys.
    pub fn read(r: &mut Reader<'_>) -> Self {
        let (time_column, time_unit_s) = r.group("time", |r| {
            (r.string("column", "name of the time column"), unit(r, &TIME_UNITS, "unit of the time column"))
        });
        let (gyro_columns, gyro_unit_rad_s) = r.group("gyro", |r| {
            (columns(r, "rate about x, y, z of the body"), unit(r, &RATE_UNITS, "unit of the gyro columns"))
        });
        let (accelerometer_columns, accelerometer_unit_m_s2) = r.group("accelerometer", |r| {
            let columns = columns(r, "specific force along x, y, z of the body, positive on z at rest");
            (columns, unit(r, &FORCE_UNITS, "unit of the accelerometer columns"))
        });
        let vector = r.has("vector").then(|| {
            r.group("vector", |r| {
                let given = r.has("reference_world");
                VectorMap {
                    columns: columns(r, "direction along x, y, z of the body, of any length"),
                    reference_world: given.then(|| {
                        r.direction("reference_world", "the same direction in the world (east, north, up)")
                    }),
                }
            })
        });
        let true_attitude = r.has("true_attitude").then(|| {
            r.group("true_attitude", |r| TruthMap {
                columns: columns(r, "w, x, y, z of the true attitude quaternion (Hamilton)"),
                world_to_body: r.choice_or(
                    "rotation",
                    "body_to_world",
                    &["body_to_world", "world_to_body"],
                    "what the quaternion rotates",
                ) == "world_to_body",
                scored_column: r.optional_string("scored", "column that is 1 where errors are to be counted"),
            })
        });
        let delimiter =
            r.choice_or("delimiter", ",", &[",", ";", "\t", " ", "|"], "character between the cells");
        Self {
            time_column,
            time_unit_s,
            gyro_columns,
            gyro_unit_rad_s,
            accelerometer_columns,
            accelerometer_unit_m_s2,
            vector,
            true_attitude,
            delimiter: delimiter.bytes().next().unwrap_or(b','),
        }
    }
}

/// The first unit of the table is the default.
fn unit(r: &mut Reader<'_>, table: &[(&str, f64)], doc: &str) -> f64 {
    let names: Vec<&str> = table.iter().map(|(name, _)| *name).collect();
    let default = names.first().copied().unwrap_or_default();
    let chosen = r.choice_or("unit", default, &names, doc);
    table.iter().find(|(name, _)| *name == chosen).map_or(1.0, |(_, factor)| *factor)
}

fn columns<const N: usize>(r: &mut Reader<'_>, doc: &str) -> [String; N] {
    let names = r.string_array("columns", doc);
    let count = names.len();
    names.try_into().unwrap_or_else(|_| {
        if count > 0 {
            r.reject("columns", format!("{count} names, but there must be {N}: {doc}"));
        }
        std::array::from_fn(|_| String::new())
    })
}
