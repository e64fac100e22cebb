//! A message as one row of numbers and texts, by its `.msg` definition.

use whorl_msgs::builtin_interfaces::Time;
use whorl_msgs::cdr::CdrError;
use whorl_msgs::definitions::{self, Definition};
use whorl_node::Timestamp;

/// A value in a message that is no message itself.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) enum Leaf<'a> {
    Bool(bool),
    Signed(i64),
    Unsigned(u64),
    Single(f32),
    Double(f64),
    Text(&'a [u8]),
}

/// Where a leaf stands: numbers of fields and of elements from the outermost message inwards. Paths order as
/// the leaves do in the message.
pub(crate) type Path = Vec<u32>;

/// Prepared definition of a message type.
#[derive(Debug, Clone)]
pub(crate) struct Layout {
    fields: Vec<(String, Shape)>,
}

#[derive(Debug, Clone)]
struct Shape {
    element: Element,
    /// `None`: one value. `Some(Some(n))`: an array of n. `Some(None)`: a sequence.
    length: Option<Option<usize>>,
    unit: Option<&'static str>,
}

#[derive(Debug, Clone)]
enum Element {
    Bool,
    I8,
    U8,
    I16,
    U16,
    I32,
    U32,
    I64,
    U64,
    F32,
    F64,
    Text,
    /// `builtin_interfaces/Time`: one column in seconds.
    Time,
    Message(Layout),
}

/// More elements than any message of ours has, so that a damaged length is found before memory is.
const LONGEST: usize = 1 << 20;

impl Layout {
    /// `None` when the type, or one that it needs, has no definition.
    pub fn of(type_name: &str) -> Option<Self> {
        Self::of_definition(definitions::find(type_name)?)
    }

    fn of_definition(definition: Definition) -> Option<Self> {
        let fields = definition.fields.iter().map(|field| {
            let (element, length) = match field.ty.split_once('[') {
                None => (field.ty, None),
                Some((element, "]")) => (element, Some(None)),
                Some((element, length)) => {
                    let length = length.trim_end_matches(']');
                    // `<=N` is a sequence of at most N.
                    (element, Some(if length.starts_with('<') { None } else { Some(length.parse().ok()?) }))
                }
            };
            let element = match element {
                "bool" => Element::Bool,
                "int8" => Element::I8,
                "uint8" | "byte" | "char" => Element::U8,
                "int16" => Element::I16,
                "uint16" => Element::U16,
                "int32" => Element::I32,
                "uint32" => Element::U32,
                "int64" => Element::I64,
                "uint64" => Element::U64,
                "float32" => Element::F32,
                "float64" => Element::F64,
                "string" => Element::Text,
                "builtin_interfaces/Time" => Element::Time,
                message => Element::Message(Self::of(message)?),
            };
            let unit = unit_of(definition.name, field.name);
            Some((field.name.to_owned(), Shape { element, length, unit }))
        });
        Some(Self { fields: fields.collect::<Option<_>>()? })
    }

    /// Visits every leaf in order.
    ///
    /// # Errors
    /// When the bytes are not such a message.
    pub fn visit<'a>(
        &self,
        cdr: &'a [u8],
        visitor: &mut impl FnMut(&[u32], Leaf<'a>),
    ) -> Result<(), CdrError> {
        let [high, low, _, _, payload @ ..] = cdr else {
            return Err(CdrError::TooShort { length: cdr.len() });
        };
        let little_endian = match u16::from_be_bytes([*high, *low]) {
            0 => false,
            1 => true,
            identifier => return Err(CdrError::Representation { identifier }),
        };
        let mut cursor = Cursor { bytes: payload, position: 0, little_endian };
        self.walk(&mut cursor, &mut Vec::new(), visitor).ok_or(CdrError::TooShort { length: cdr.len() })
    }

    fn walk<'a>(
        &self,
        cursor: &mut Cursor<'a>,
        path: &mut Path,
        visitor: &mut impl FnMut(&[u32], Leaf<'a>),
    ) -> Option<()> {
        for (number, (_, shape)) in (0u32..).zip(&self.fields) {
            path.push(number);
            match shape.length {
                None => shape.element.walk(cursor, path, visitor)?,
                Some(length) => {
                    let length = match length {
                        Some(length) => length,
                        None => cursor.number(u32::from_le_bytes, u32::from_be_bytes)? as usize,
                    };
                    if length > LONGEST {
                        return None;
                    }
                    for index in 0..length {
                        path.push(u32::try_from(index).ok()?);
                        shape.element.walk(cursor, path, visitor)?;
                        path.pop();
                    }
                }
            }
            path.pop();
        }
        Some(())
    }

    /// A column's heading: `angular_velocity.x [rad/s]`. Names that end in their unit, as ours do, get none.
    pub fn heading(&self, path: &[u32]) -> String {
        let mut name = String::new();
        let unit = self.name(path, &mut name);
        match unit {
            Some(unit) => format!("{name} [{unit}]"),
            None => name,
        }
    }

    fn name(&self, path: &[u32], name: &mut String) -> Option<&'static str> {
        let [number, rest @ ..] = path else { return None };
        let (field, shape) = self.fields.get(*number as usize)?;
        if !name.is_empty() {
            name.push('.');
        }
        name.push_str(field);
        let rest = match (shape.length, rest) {
            (Some(_), [index, rest @ ..]) => {
                name.push_str(&format!(".{index}"));
                rest
            }
            (_, rest) => rest,
        };
        let inner = match &shape.element {
            Element::Message(layout) => layout.name(rest, name),
            Element::Time => Some("s"),
            _ => None,
        };
        shape.unit.or(inner)
    }
}

impl Element {
    fn walk<'a>(
        &self,
        cursor: &mut Cursor<'a>,
        path: &mut Path,
        visitor: &mut impl FnMut(&[u32], Leaf<'a>),
    ) -> Option<()> {
        macro_rules! number {
            ($ty:ty, $variant:ident, $wide:ty) => {
                Leaf::$variant(<$wide>::from(cursor.number(<$ty>::from_le_bytes, <$ty>::from_be_bytes)?))
            };
        }
        let leaf = match self {
            Self::Bool => Leaf::Bool(cursor.number(u8::from_le_bytes, u8::from_be_bytes)? != 0),
            Self::I8 => number!(i8, Signed, i64),
            Self::U8 => number!(u8, Unsigned, u64),
            Self::I16 => number!(i16, Signed, i64),
            Self::U16 => number!(u16, Unsigned, u64),
            Self::I32 => number!(i32, Signed, i64),
            Self::U32 => number!(u32, Unsigned, u64),
            Self::I64 => number!(i64, Signed, i64),
            Self::U64 => number!(u64, Unsigned, u64),
            Self::F32 => number!(f32, Single, f32),
            Self::F64 => number!(f64, Double, f64),
            Self::Text => Leaf::Text(cursor.text()?),
            Self::Time => {
                let sec = cursor.number(i32::from_le_bytes, i32::from_be_bytes)?;
                let nanosec = cursor.number(u32::from_le_bytes, u32::from_be_bytes)?;
                // Whole nanoseconds: a double would round present-day times to a quarter of a microsecond.
                Leaf::Signed(Timestamp::from(Time { sec, nanosec }).0)
            }
            Self::Message(layout) => return layout.walk(cursor, path, visitor),
        };
        visitor(path, leaf);
        Some(())
    }

    fn is_time(&self) -> bool {
        matches!(self, Self::Time)
    }
}

impl Layout {
    /// Whether the leaf at this path is a time in nanoseconds.
    pub fn is_time(&self, path: &[u32]) -> bool {
        let [number, rest @ ..] = path else { return false };
        let Some((_, shape)) = self.fields.get(*number as usize) else { return false };
        let rest = if shape.length.is_some() { rest.get(1..).unwrap_or_default() } else { rest };
        match &shape.element {
            Element::Message(layout) => layout.is_time(rest),
            element => element.is_time(),
        }
    }
}

/// Reads plain CDR (XCDR version 1): every number is aligned to its size, counted from behind the header.
struct Cursor<'a> {
    bytes: &'a [u8],
    position: usize,
    little_endian: bool,
}

impl<'a> Cursor<'a> {
    fn number<T, const N: usize>(&mut self, little: fn([u8; N]) -> T, big: fn([u8; N]) -> T) -> Option<T> {
        let start = self.position.next_multiple_of(N);
        let bytes = self.take_at(start, N)?.try_into().ok()?;
        Some(if self.little_endian { little(bytes) } else { big(bytes) })
    }

    /// Length with the final zero, then the characters.
    fn text(&mut self) -> Option<&'a [u8]> {
        let length = self.number(u32::from_le_bytes, u32::from_be_bytes)? as usize;
        let text = self.take_at(self.position, length)?;
        Some(text.strip_suffix(&[0]).unwrap_or(text))
    }

    fn take_at(&mut self, start: usize, length: usize) -> Option<&'a [u8]> {
        let end = start.checked_add(length)?;
        let bytes = self.bytes.get(start..end)?;
        self.position = end;
        Some(bytes)
    }
}

/// Units of the fields of standard messages, whose names do not say them (their definitions' comments and
/// REP-103 do).
fn unit_of(definition: &str, field: &str) -> Option<&'static str> {
    Some(match (definition, field) {
        ("sensor_msgs/Imu", "angular_velocity") => "rad/s",
        ("sensor_msgs/Imu", "linear_acceleration") => "m/s^2",
        ("sensor_msgs/Imu", "orientation_covariance") => "rad^2",
        ("sensor_msgs/Imu", "angular_velocity_covariance") => "rad^2/s^2",
        ("sensor_msgs/Imu", "linear_acceleration_covariance") => "m^2/s^4",
        ("sensor_msgs/JointState", "position") => "rad",
        ("sensor_msgs/JointState", "velocity") => "rad/s",
        ("sensor_msgs/JointState", "effort") => "N m",
        ("sensor_msgs/FluidPressure", "fluid_pressure") => "Pa",
        ("sensor_msgs/FluidPressure", "variance") => "Pa^2",
        ("sensor_msgs/Temperature", "temperature") => "degC",
        ("sensor_msgs/Temperature", "variance") => "degC^2",
        ("sensor_msgs/BatteryState", "voltage" | "cell_voltage") => "V",
        ("sensor_msgs/BatteryState", "temperature" | "cell_temperature") => "degC",
        ("sensor_msgs/BatteryState", "current") => "A",
        ("sensor_msgs/BatteryState", "charge" | "capacity" | "design_capacity") => "A h",
        ("geometry_msgs/Transform", "translation") => "m",
        _ => return None,
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use whorl_msgs::sensor_msgs::JointState;
    use whorl_msgs::{Message, MessageType};

    fn flat(message: &Message) -> Vec<(String, String)> {
        let layout = Layout::of(message.message_type().name()).unwrap();
        let mut cdr = Vec::new();
        message.encode_into(&mut cdr).unwrap();
        let mut leaves = Vec::new();
        layout
            .visit(&cdr, &mut |path, leaf| leaves.push((layout.heading(path), format!("{leaf:?}"))))
            .unwrap();
        leaves
    }

    #[test]
    fn every_type_has_a_layout_and_damaged_bytes_are_an_error() {
        for &message_type in MessageType::ALL {
            let layout = Layout::of(message_type.name()).unwrap();
            let mut cdr = Vec::new();
            Message::default_of(message_type).encode_into(&mut cdr).unwrap();
            layout.visit(&cdr, &mut |_, _| {}).unwrap();
            for length in 0..cdr.len() {
                assert!(layout.visit(&cdr[..length], &mut |_, _| {}).is_err());
            }
            cdr.fill(0xff);
            assert!(layout.visit(&cdr, &mut |_, _| {}).is_err());
        }
        assert!(Layout::of("std_msgs/msg/String").is_none());
    }

    #[test]
    fn values_units_and_paths_are_those_of_the_message() {
        let mut state = JointState { name: vec!["a".into(), "bc".into()], ..JointState::default() };
        state.header.frame_id = "f".into();
        state.header.stamp.sec = -1;
        state.header.stamp.nanosec = 999_999_999;
        state.velocity = vec![1.5, -2.5];
        state.effort = vec![f64::NAN];
        let expected = [
            ("header.stamp [s]", "Signed(-1)"),
            ("header.frame_id", "Text([102])"),
            ("name.0", "Text([97])"),
            ("name.1", "Text([98, 99])"),
            ("velocity.0 [rad/s]", "Double(1.5)"),
            ("velocity.1 [rad/s]", "Double(-2.5)"),
            ("effort.0 [N m]", "Double(NaN)"),
        ];
        let found = flat(&state.into());
        let found: Vec<_> = found.iter().map(|(a, b)| (a.as_str(), b.as_str())).collect();
        assert_eq!(found, expected);
    }
}
