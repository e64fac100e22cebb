//! Files of the folder, shown and written.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use serde_json::Value;

/// A text file of the folder.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
pub struct TextFile {
    /// Path from the folder.
    pub file: String,
    /// Its text; when asked for: empty.
    #[serde(default)]
    pub text: String,
}

/// A number of the model.
#[derive(Debug, Clone, PartialEq, Serialize, JsonSchema)]
pub struct ParameterRow {
    /// Key in the file, below the platform's section.
    pub key: String,
    /// Its value as the file has it.
    pub value: String,
    /// Standard deviations of its prior, as the file has them; none: what is typical.
    pub stddev: Option<String>,
    /// Where the prior is from.
    pub source: Option<String>,
    /// Where the value stands: file and line.
    pub origin: String,
}

/// An arrow of the drawing, body axes.
#[derive(Debug, Clone, PartialEq, Serialize, JsonSchema)]
pub struct Arrow {
    /// What it is: `wheel`, `jet`, `gyro`, `accelerometer`, `vector`.
    pub kind: String,
    /// Its name.
    pub name: String,
    /// Where \[m\]; none: anywhere.
    pub at_m: Option<[f64; 3]>,
    /// Direction: spin axis, force, measured axis; of a vector sensor that of its target, where the body is not turned.
    pub direction: [f64; 3],
}

/// The platform as its file has it.
#[derive(Debug, Clone, PartialEq, Serialize, JsonSchema)]
pub struct Platform {
    /// Its name.
    pub platform: String,
    /// How it may move: on_bearing, hinge, free, clamped.
    pub freedom: String,
    /// Axis of a hinge, body axes.
    pub hinge_axis: Option<[f64; 3]>,
    /// Torque of gravity at full tilt, body axes [N m]: weight times the offset of the centre of mass.
    pub gravity_offset_n_m: [f64; 3],
    /// Principal moments of inertia [kg m^2] ...
    pub principal_moments_kg_m2: [f64; 3],
    /// ... and the axes that they are about, body axes.
    pub principal_axes: [[f64; 3]; 3],
    /// Wheels, jets and sensors.
    pub arrows: Vec<Arrow>,
    /// Every number of the model's file.
    pub parameters: Vec<ParameterRow>,
    /// What was adopted when: as `whorl history --json`.
    pub history: Value,
}

/// A value to write into the model's file.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
pub struct SetParameter {
    /// Key below the platform's section: `model.mass_kg`, `model_prior.inertia_kg_m2.zz`.
    pub key: String,
    /// As it is to stand in the file.
    pub value: String,
}

/// A channel in the map of a CSV file.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, JsonSchema)]
pub struct MapRow {
    /// Its key.
    pub key: String,
    /// Columns in the order of its axes, wheels or jets; `-` before one reverses its sign, `~` stands for none.
    pub columns: Vec<String>,
    /// Their unit; none: SI.
    pub unit: Option<String>,
    /// The units that it may have.
    pub units: Vec<String>,
}

/// The map of a CSV file.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, JsonSchema)]
pub struct ChannelMap {
    /// Its file.
    pub file: String,
    /// Its channels.
    pub rows: Vec<MapRow>,
    /// Columns of the recording.
    pub columns: Vec<String>,
}

/// Columns and unit to write into the map.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
pub struct SetChannel {
    /// The channel's key.
    pub key: String,
    /// See [`MapRow::columns`].
    pub columns: Vec<String>,
    /// See [`MapRow::unit`]; none: as it is.
    pub unit: Option<String>,
}

/// A stretch of a recording, to be one of its own.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct Stretch {
    /// Which recording.
    pub file: String,
    /// From \[s\].
    pub from_s: f64,
    /// To \[s\].
    pub to_s: f64,
    /// It tests, and is never fitted.
    pub held_out: bool,
}

/// An effect of the catalogue.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, JsonSchema)]
pub struct EffectRow {
    /// Its id.
    pub id: String,
    /// A few words.
    pub title: String,
    /// The mechanism, and how it shows.
    pub explanation: String,
    /// Its equation, in plain text.
    pub equation: String,
    /// Where that is from.
    pub source: String,
    /// What separates it from those that it is confused with.
    pub separated_by: String,
}
