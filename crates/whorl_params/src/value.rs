//! ROS 2 parameter values and how they are written in YAML.

use std::fmt;

/// A parameter's type, as in `rcl_interfaces/msg/ParameterType`.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum Kind {
    /// `true` or `false`.
    Bool,
    /// 64-bit integer.
    Integer,
    /// Double-precision number.
    Double,
    /// Text.
    String,
    /// List of booleans.
    BoolArray,
    /// List of integers.
    IntegerArray,
    /// List of numbers.
    DoubleArray,
    /// List of texts.
    StringArray,
}

impl Kind {
    /// The constant of `rcl_interfaces/msg/ParameterType`.
    #[must_use]
    pub fn ros_type(self) -> u8 {
        match self {
            Self::Bool => 1,
            Self::Integer => 2,
            Self::Double => 3,
            Self::String => 4,
            Self::BoolArray => 6,
            Self::IntegerArray => 7,
            Self::DoubleArray => 8,
            Self::StringArray => 9,
        }
    }
}

/// A parameter's value.
#[derive(Debug, Clone, PartialEq)]
pub enum Value {
    /// `true` or `false`.
    Bool(bool),
    /// 64-bit integer.
    Integer(i64),
    /// Double-precision number; may be NaN or infinite until a reader has checked it.
    Double(f64),
    /// Text.
    String(String),
    /// List of booleans.
    BoolArray(Vec<bool>),
    /// List of integers. An empty YAML list has this type.
    IntegerArray(Vec<i64>),
    /// List of numbers. A YAML list that mixes integers and numbers has this type.
    DoubleArray(Vec<f64>),
    /// List of texts.
    StringArray(Vec<String>),
}

impl Value {
    /// Its type.
    #[must_use]
    pub fn kind(&self) -> Kind {
        match self {
            Self::Bool(_) => Kind::Bool,
            Self::Integer(_) => Kind::Integer,
            Self::Double(_) => Kind::Double,
            Self::String(_) => Kind::String,
            Self::BoolArray(_) => Kind::BoolArray,
            Self::IntegerArray(_) => Kind::IntegerArray,
            Self::DoubleArray(_) => Kind::DoubleArray,
            Self::StringArray(_) => Kind::StringArray,
        }
    }

    /// The same value as `kind`, where nothing is lost: an integer of at most 2^53 as a number,
    /// an empty list as any list.
    #[must_use]
    pub fn converted(&self, kind: Kind) -> Option<Self> {
        if self.kind() == kind {
            return Some(self.clone());
        }
        match (self, kind) {
            // An empty list has no type: YAML gives it one, `ros2 param set` another.
            (_, Kind::BoolArray) if self.is_empty_list() => Some(Self::BoolArray(Vec::new())),
            (_, Kind::IntegerArray) if self.is_empty_list() => Some(Self::IntegerArray(Vec::new())),
            (_, Kind::DoubleArray) if self.is_empty_list() => Some(Self::DoubleArray(Vec::new())),
            (_, Kind::StringArray) if self.is_empty_list() => Some(Self::StringArray(Vec::new())),
            (Self::Integer(x), Kind::Double) => exact_f64(*x).map(Self::Double),
            (Self::IntegerArray(xs), Kind::DoubleArray) => {
                xs.iter().copied().map(exact_f64).collect::<Option<_>>().map(Self::DoubleArray)
            }
            _ => None,
        }
    }

    fn is_empty_list(&self) -> bool {
        match self {
            Self::BoolArray(xs) => xs.is_empty(),
            Self::IntegerArray(xs) => xs.is_empty(),
            Self::DoubleArray(xs) => xs.is_empty(),
            Self::StringArray(xs) => xs.is_empty(),
            Self::Bool(_) | Self::Integer(_) | Self::Double(_) | Self::String(_) => false,
        }
    }
}

/// The number, if a double holds it exactly.
pub(crate) fn exact_f64(x: i64) -> Option<f64> {
    const LIMIT: u64 = 1 << f64::MANTISSA_DIGITS;
    #[expect(clippy::cast_precision_loss, reason = "checked to be exact")]
    (x.unsigned_abs() <= LIMIT).then_some(x as f64)
}

/// YAML text of a number that reads back to the same bits, also in YAML 1.1 readers (PyYAML), which
/// take `1e-6` for text: there is always a point, and the exponent always has a sign.
pub(crate) fn double_to_yaml(x: f64) -> String {
    if x.is_nan() {
        return ".nan".into();
    }
    if x.is_infinite() {
        return if x > 0.0 { ".inf".into() } else { "-.inf".into() };
    }
    // Debug gives the shortest digits that read back, with a point or an exponent.
    let text = format!("{x:?}");
    match text.split_once('e') {
        None => text,
        Some((mantissa, exponent)) => {
            let point = if mantissa.contains('.') { "" } else { ".0" };
            let sign = if exponent.starts_with('-') { "" } else { "+" };
            format!("{mantissa}{point}e{sign}{exponent}")
        }
    }
}

/// Short text of a number for people: `1`, `0.05`, `1e-7`.
pub(crate) fn double_for_people(x: f64) -> String {
    if x != 0.0 && (x.abs() < 1e-4 || x.abs() >= 1e7) { format!("{x:e}") } else { format!("{x}") }
}

/// A text, quoted where YAML would otherwise read it as something else.
pub(crate) fn string_to_yaml(text: &str) -> String {
    let plain = !text.is_empty()
        && text.chars().all(|c| c.is_ascii_alphanumeric() || matches!(c, '_' | '-' | '/' | '.' | '+'))
        && text.starts_with(|c: char| c.is_ascii_alphabetic() || c == '/' || c == '_')
        && !matches!(
            text.to_ascii_lowercase().as_str(),
            "null" | "true" | "false" | "yes" | "no" | "on" | "off" | "y" | "n"
        );
    if plain {
        return text.to_owned();
    }
    let mut quoted = String::with_capacity(text.len() + 2);
    quoted.push('"');
    for c in text.chars() {
        match c {
            '"' => quoted.push_str("\\\""),
            '\\' => quoted.push_str("\\\\"),
            '\n' => quoted.push_str("\\n"),
            '\r' => quoted.push_str("\\r"),
            '\t' => quoted.push_str("\\t"),
            c if c.is_control() || c == '\u{feff}' => {
                quoted.push_str(&format!("\\U{:08X}", u32::from(c)));
            }
            c => quoted.push(c),
        }
    }
    quoted.push('"');
    quoted
}

fn list<T>(f: &mut fmt::Formatter<'_>, items: &[T], text: impl Fn(&T) -> String) -> fmt::Result {
    write!(f, "[{}]", items.iter().map(text).collect::<Vec<_>>().join(", "))
}

/// The value as YAML, on one line; it reads back to the same value.
impl fmt::Display for Value {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Bool(x) => write!(f, "{x}"),
            Self::Integer(x) => write!(f, "{x}"),
            Self::Double(x) => f.write_str(&double_to_yaml(*x)),
            Self::String(x) => f.write_str(&string_to_yaml(x)),
            Self::BoolArray(x) => list(f, x, bool::to_string),
            Self::IntegerArray(x) => list(f, x, i64::to_string),
            Self::DoubleArray(x) => list(f, x, |x| double_to_yaml(*x)),
            Self::StringArray(x) => list(f, x, |x| string_to_yaml(x)),
        }
    }
}

macro_rules! value_from {
    ($($from:ty => $variant:ident),* $(,)?) => {
        $(impl From<$from> for Value {
            fn from(x: $from) -> Self {
                Self::$variant(x.into())
            }
        })*
    };
}
value_from! {
    bool => Bool, i64 => Integer, f64 => Double, String => String, &str => String,
    Vec<bool> => BoolArray, Vec<i64> => IntegerArray, Vec<f64> => DoubleArray,
    Vec<String> => StringArray, [f64; 3] => DoubleArray,
}
