//! Parameter values and descriptions as `rcl_interfaces` sends them.

use ros2_client::parameters::raw;
use whorl_params::{Descriptor, NumericRange, Value};

fn empty_value() -> raw::ParameterValue {
    raw::ParameterValue {
        ptype: raw::ParameterType::NOT_SET,
        boolean_value: false,
        int_value: 0,
        double_value: 0.0,
        string_value: String::new(),
        byte_array: Vec::new(),
        bool_array: Vec::new(),
        int_array: Vec::new(),
        double_array: Vec::new(),
        string_array: Vec::new(),
    }
}

/// A value as `rcl_interfaces/msg/ParameterValue`; not set for `None`.
pub(crate) fn to_wire(value: Option<&Value>) -> raw::ParameterValue {
    let mut wire = empty_value();
    let Some(value) = value else { return wire };
    wire.ptype = value.kind().ros_type();
    match value.clone() {
        Value::Bool(x) => wire.boolean_value = x,
        Value::Integer(x) => wire.int_value = x,
        Value::Double(x) => wire.double_value = x,
        Value::String(x) => wire.string_value = x,
        Value::BoolArray(x) => wire.bool_array = x,
        Value::IntegerArray(x) => wire.int_array = x,
        Value::DoubleArray(x) => wire.double_array = x,
        Value::StringArray(x) => wire.string_array = x,
    }
    wire
}

/// A value from the wire; an error for "not set" and for types that parameter files do not have.
pub(crate) fn from_wire(wire: &raw::ParameterValue) -> Result<Value, String> {
    use raw::ParameterType as T;
    Ok(match wire.ptype {
        T::BOOL => Value::Bool(wire.boolean_value),
        T::INTEGER => Value::Integer(wire.int_value),
        T::DOUBLE => Value::Double(wire.double_value),
        T::STRING => Value::String(wire.string_value.clone()),
        T::BOOL_ARRAY => Value::BoolArray(wire.bool_array.clone()),
        T::INTEGER_ARRAY => Value::IntegerArray(wire.int_array.clone()),
        T::DOUBLE_ARRAY => Value::DoubleArray(wire.double_array.clone()),
        T::STRING_ARRAY => Value::StringArray(wire.string_array.clone()),
        // What some versions of `ros2 param set` make of `[]`.
        T::BYTE_ARRAY if wire.byte_array.is_empty() => Value::IntegerArray(Vec::new()),
        T::NOT_SET => return Err("a parameter cannot be deleted while the node runs".into()),
        other => return Err(format!("parameter type {other} is not supported")),
    })
}

pub(crate) fn empty_descriptor() -> raw::ParameterDescriptor {
    raw::ParameterDescriptor {
        name: String::new(),
        r#type: raw::ParameterType::NOT_SET,
        description: String::new(),
        additional_constraints: String::new(),
        read_only: false,
        dynamic_typing: false,
        floating_point_range: Vec::new(),
        integer_range: Vec::new(),
    }
}

pub(crate) fn describe(descriptor: &Descriptor) -> raw::ParameterDescriptor {
    let mut wire = raw::ParameterDescriptor {
        name: descriptor.name.clone(),
        r#type: descriptor.kind.ros_type(),
        description: descriptor.doc.clone(),
        additional_constraints: descriptor.allowed.clone(),
        read_only: descriptor.read_only,
        ..empty_descriptor()
    };
    match descriptor.range {
        Some(NumericRange::Double { from, to }) => {
            wire.floating_point_range =
                vec![raw::FloatingPointRange { from_value: from, to_value: to, step: 0.0 }];
        }
        Some(NumericRange::Integer { from, to }) => {
            wire.integer_range = vec![raw::IntegerRange { from_value: from, to_value: to, step: 0 }];
        }
        None => {}
    }
    wire
}
