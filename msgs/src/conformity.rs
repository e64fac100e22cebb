//! Test: every Rust type has the fields of its definition, in order, with the same types.
//!
//! A deserializer that makes up data as it is asked for records what a Rust type asks for: field
//! names, primitive types, sequences and array lengths. The definitions are parsed separately;
//! nothing is shared but the text.

use serde::de::{self, DeserializeSeed, Deserializer, MapAccess, SeqAccess, Visitor};
use serde::forward_to_deserialize_any;

use crate::definitions::{Definition, find};

/// Structure of a type.
#[derive(Debug, Clone, PartialEq)]
enum Shape {
    Primitive(&'static str),
    Struct(Vec<(String, Shape)>),
    Sequence(Box<Shape>),
    Array(usize, Box<Shape>),
}

/// What a Rust type asks its deserializer for.
fn shape_of_rust_type<T: serde::de::DeserializeOwned>() -> Shape {
    let mut shape = None;
    T::deserialize(Tracer { shape: &mut shape }).unwrap();
    shape.unwrap()
}

/// What a definition says.
fn shape_of_fields(text: &'static str) -> Shape {
    let definition = Definition { name: "", text };
    Shape::Struct(definition.fields().map(|f| (f.name.to_owned(), shape_of_type(f.ty))).collect())
}

fn shape_of_type(ty: &str) -> Shape {
    if let Some((element, length)) = ty.strip_suffix(']').and_then(|t| t.split_once('[')) {
        let element = Box::new(shape_of_type(element));
        return match length {
            "" => Shape::Sequence(element),
            n => Shape::Array(n.parse().unwrap(), element),
        };
    }
    match ty {
        "bool" => Shape::Primitive("bool"),
        "byte" | "uint8" => Shape::Primitive("uint8"),
        "int32" => Shape::Primitive("int32"),
        "uint32" => Shape::Primitive("uint32"),
        "uint64" => Shape::Primitive("uint64"),
        "float32" => Shape::Primitive("float32"),
        "float64" => Shape::Primitive("float64"),
        "string" => Shape::Primitive("string"),
        nested => shape_of_fields(find(nested).unwrap_or_else(|| panic!("no definition of {nested}")).text),
    }
}

struct Tracer<'a> {
    shape: &'a mut Option<Shape>,
}

macro_rules! primitives {
    ($($method:ident $visit:ident $value:expr, $name:literal;)+) => {
        $(fn $method<V: Visitor<'de>>(self, visitor: V) -> Result<V::Value, Self::Error> {
            *self.shape = Some(Shape::Primitive($name));
            visitor.$visit($value)
        })+
    };
}

impl<'de> Deserializer<'de> for Tracer<'_> {
    type Error = de::value::Error;

    primitives! {
        deserialize_bool visit_bool false, "bool";
        deserialize_u8 visit_u8 0, "uint8";
        deserialize_i32 visit_i32 0, "int32";
        deserialize_u32 visit_u32 0, "uint32";
        deserialize_u64 visit_u64 0, "uint64";
        deserialize_f32 visit_f32 0.0, "float32";
        deserialize_f64 visit_f64 0.0, "float64";
        deserialize_string visit_string String::new(), "string";
    }

    fn deserialize_seq<V: Visitor<'de>>(self, visitor: V) -> Result<V::Value, Self::Error> {
        let mut elements = Elements { left: 1, shape: None };
        let value = visitor.visit_seq(&mut elements)?;
        *self.shape = Some(Shape::Sequence(Box::new(elements.shape.unwrap())));
        Ok(value)
    }

    fn deserialize_tuple<V: Visitor<'de>>(self, len: usize, visitor: V) -> Result<V::Value, Self::Error> {
        let mut elements = Elements { left: len, shape: None };
        let value = visitor.visit_seq(&mut elements)?;
        assert_eq!(elements.left, 0);
        *self.shape = Some(Shape::Array(len, Box::new(elements.shape.unwrap())));
        Ok(value)
    }

    fn deserialize_struct<V: Visitor<'de>>(
        self,
        _name: &'static str,
        fields: &'static [&'static str],
        visitor: V,
    ) -> Result<V::Value, Self::Error> {
        let mut members = Members { fields, next: 0, shapes: Vec::new() };
        let value = visitor.visit_map(&mut members)?;
        *self.shape = Some(Shape::Struct(members.shapes));
        Ok(value)
    }

    fn deserialize_any<V: Visitor<'de>>(self, _visitor: V) -> Result<V::Value, Self::Error> {
        Err(de::Error::custom("a type that has no ROS 2 counterpart"))
    }

    forward_to_deserialize_any! {
        i8 i16 i64 i128 u16 u128 char str bytes byte_buf option unit unit_struct newtype_struct
        tuple_struct map enum identifier ignored_any
    }
}

struct Elements {
    left: usize,
    shape: Option<Shape>,
}

impl<'de> SeqAccess<'de> for &mut Elements {
    type Error = de::value::Error;

    fn next_element_seed<T: DeserializeSeed<'de>>(
        &mut self,
        seed: T,
    ) -> Result<Option<T::Value>, Self::Error> {
        if self.left == 0 {
            return Ok(None);
        }
        self.left -= 1;
        seed.deserialize(Tracer { shape: &mut self.shape }).map(Some)
    }
}

struct Members {
    fields: &'static [&'static str],
    next: usize,
    shapes: Vec<(String, Shape)>,
}

impl<'de> MapAccess<'de> for &mut Members {
    type Error = de::value::Error;

    fn next_key_seed<K: DeserializeSeed<'de>>(&mut self, seed: K) -> Result<Option<K::Value>, Self::Error> {
        let Some(field) = self.fields.get(self.next) else { return Ok(None) };
        seed.deserialize(de::value::BorrowedStrDeserializer::new(field)).map(Some)
    }

    fn next_value_seed<S: DeserializeSeed<'de>>(&mut self, seed: S) -> Result<S::Value, Self::Error> {
        let mut shape = None;
        let value = seed.deserialize(Tracer { shape: &mut shape })?;
        self.shapes.push((self.fields[self.next].to_owned(), shape.unwrap()));
        self.next += 1;
        Ok(value)
    }
}

macro_rules! compare {
    ($($name:literal $ty:ty;)+) => {
        #[test]
        fn rust_types_have_the_fields_of_their_definitions() {
            let mut compared = Vec::new();
            $(
                let definition = find($name).unwrap();
                assert_eq!(shape_of_rust_type::<$ty>(), shape_of_fields(definition.text), "{}", $name);
                compared.push($name);
            )+
            for definition in crate::definitions::DEFINITIONS {
                assert!(compared.contains(&definition.name), "{} is not compared", definition.name);
            }
        }
    };
}

compare! {
    "builtin_interfaces/Time" crate::builtin_interfaces::Time;
    "std_msgs/Header" crate::std_msgs::Header;
    "geometry_msgs/Vector3" crate::geometry_msgs::Vector3;
    "geometry_msgs/Quaternion" crate::geometry_msgs::Quaternion;
    "geometry_msgs/Vector3Stamped" crate::geometry_msgs::Vector3Stamped;
    "geometry_msgs/Transform" crate::geometry_msgs::Transform;
    "geometry_msgs/TransformStamped" crate::geometry_msgs::TransformStamped;
    "tf2_msgs/TFMessage" crate::tf2_msgs::TFMessage;
    "sensor_msgs/Imu" crate::sensor_msgs::Imu;
    "sensor_msgs/JointState" crate::sensor_msgs::JointState;
    "sensor_msgs/FluidPressure" crate::sensor_msgs::FluidPressure;
    "sensor_msgs/Temperature" crate::sensor_msgs::Temperature;
    "sensor_msgs/BatteryState" crate::sensor_msgs::BatteryState;
    "diagnostic_msgs/KeyValue" crate::diagnostic_msgs::KeyValue;
    "diagnostic_msgs/DiagnosticStatus" crate::diagnostic_msgs::DiagnosticStatus;
    "diagnostic_msgs/DiagnosticArray" crate::diagnostic_msgs::DiagnosticArray;
    "whorl_msgs/ActuatorCommand" crate::whorl::ActuatorCommand;
    "whorl_msgs/AttitudeEstimate" crate::whorl::AttitudeEstimate;
    "whorl_msgs/AttitudeReference" crate::whorl::AttitudeReference;
    "whorl_msgs/ClockReply" crate::whorl::ClockReply;
    "whorl_msgs/ClockRequest" crate::whorl::ClockRequest;
    "whorl_msgs/ControlStatus" crate::whorl::ControlStatus;
    "whorl_msgs/Excitation" crate::whorl::Excitation;
    "whorl_msgs/FormationCommand" crate::whorl::FormationCommand;
    "whorl_msgs/FormationState" crate::whorl::FormationState;
    "whorl_msgs/ParameterEstimate" crate::whorl::ParameterEstimate;
    "whorl_msgs/ThrusterState" crate::whorl::ThrusterState;
}

#[test]
fn services_have_the_fields_of_their_definitions() {
    use crate::whorl::srv::{AbortExperimentRequest, ExperimentResponse, StartExperimentRequest};
    let start = include_str!("../srv/StartExperiment.srv").split_once("---").unwrap();
    let abort = include_str!("../srv/AbortExperiment.srv").split_once("---").unwrap();
    assert_eq!(shape_of_rust_type::<StartExperimentRequest>(), shape_of_fields(start.0));
    assert_eq!(shape_of_rust_type::<AbortExperimentRequest>(), shape_of_fields(abort.0));
    for response in [start.1, abort.1] {
        assert_eq!(shape_of_rust_type::<ExperimentResponse>(), shape_of_fields(response));
    }
}

/// The value of every constant in a definition, by name.
fn constants(text: &str) -> Vec<(&str, u32)> {
    text.lines()
        .filter_map(|line| line.split('#').next()?.split_once('='))
        .map(|(left, value)| (left.split_whitespace().nth(1).unwrap(), value.trim().parse().unwrap()))
        .collect()
}

#[test]
fn constants_have_the_values_of_their_definitions() {
    macro_rules! check {
        ($name:literal $ty:ty: $($constant:ident)+) => {{
            let rust = vec![$((stringify!($constant), u32::from(<$ty>::$constant))),+];
            assert_eq!(constants(find($name).unwrap().text), rust, $name);
        }};
    }
    use crate::whorl::{
        AttitudeEstimate, AttitudeReference, ControlStatus, FormationCommand, FormationState, ThrusterState,
    };
    check!("whorl_msgs/AttitudeEstimate" AttitudeEstimate:
        HEALTH_INITIALISING HEALTH_OK HEALTH_DEGRADED HEALTH_UNHEALTHY
        FLAG_GYRO_REJECTED FLAG_ACCELEROMETER_REJECTED FLAG_VECTOR_REJECTED FLAG_VECTOR_STALE FLAG_IMU_STALE
        FLAG_INCONSISTENT);
    check!("whorl_msgs/AttitudeReference" AttitudeReference: MODE_TRACK MODE_HOLD);
    check!("whorl_msgs/ControlStatus" ControlStatus:
        MODE_IDLE MODE_TRACK MODE_HOLD MODE_SAFE_DAMPING MODE_SAFE_COAST MODE_EXCITE
        REASON_NONE REASON_NO_AUTHORITY REASON_REFERENCE_STALE REASON_ESTIMATE_STALE REASON_ESTIMATE_UNHEALTHY
        REASON_TILT_LIMIT REASON_ABORT REASON_RATE_LIMIT REASON_EXCITATION_LIMIT REASON_EXCITATION_UNKNOWN
        ALLOCATION_SOLVED ALLOCATION_UNIQUE ALLOCATION_FALLBACK ALLOCATION_OFF);
    check!("whorl_msgs/FormationCommand" FormationCommand:
        COMMAND_STANDBY COMMAND_TRACK COMMAND_HOLD COMMAND_ABORT);
    check!("whorl_msgs/FormationState" FormationState:
        PHASE_WAITING PHASE_READY PHASE_SETTLE PHASE_MANOEUVRE PHASE_HOLD PHASE_FINISHED PHASE_ABORTED);
    check!("whorl_msgs/ThrusterState" ThrusterState: HEALTH_OK HEALTH_FAILED);
}
