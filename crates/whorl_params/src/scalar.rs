//! YAML scalars and lists to parameter values, by the core schema of YAML 1.2.

use crate::document::{Content, Node};
use crate::value::Value;

/// The value of a scalar or list, or what is wrong with it.
pub(crate) fn value_of(node: &Node) -> Result<Value, String> {
    match &node.content {
        Content::Scalar { text, plain } => scalar(text, *plain),
        Content::Sequence(items) => sequence(items),
        Content::Map { .. } => Err("expected a value, found a map".into()),
    }
}

/// Words for "no value".
const NULLS: [&str; 5] = ["", "~", "null", "Null", "NULL"];

fn scalar(text: &str, plain: bool) -> Result<Value, String> {
    if !plain {
        return Ok(Value::String(text.to_owned()));
    }
    match text {
        _ if NULLS.contains(&text) => return Err("has no value; leave the key out instead".into()),
        "true" | "True" | "TRUE" => return Ok(Value::Bool(true)),
        "false" | "False" | "FALSE" => return Ok(Value::Bool(false)),
        ".nan" | ".NaN" | ".NAN" => return Ok(Value::Double(f64::NAN)),
        ".inf" | ".Inf" | ".INF" | "+.inf" | "+.Inf" | "+.INF" => return Ok(Value::Double(f64::INFINITY)),
        "-.inf" | "-.Inf" | "-.INF" => return Ok(Value::Double(f64::NEG_INFINITY)),
        _ => {}
    }
    integer(text).or_else(|| number(text)).unwrap_or_else(|| Ok(Value::String(text.to_owned())))
}

/// `Some` when the text has the shape of an integer.
fn integer(text: &str) -> Option<Result<Value, String>> {
    let digits = text.strip_prefix(['+', '-']).unwrap_or(text);
    let parsed = if let Some(hex) = text.strip_prefix("0x") {
        all(hex, |c| c.is_ascii_hexdigit()).then(|| i64::from_str_radix(hex, 16))?
    } else if let Some(octal) = text.strip_prefix("0o") {
        all(octal, |c| ('0'..='7').contains(&c)).then(|| i64::from_str_radix(octal, 8))?
    } else {
        all(digits, |c| c.is_ascii_digit()).then(|| text.parse::<i64>())?
    };
    Some(parsed.map(Value::Integer).map_err(|_| {
        "is an integer beyond 64 bits; allowed: -9223372036854775808 to 9223372036854775807".into()
    }))
}

/// `Some` when the text has the shape of a decimal number.
fn number(text: &str) -> Option<Result<Value, String>> {
    // Rust's parser also takes words such as `infinity`; YAML's numbers hold only these.
    let shaped = all(text, |c| c.is_ascii_digit() || matches!(c, '.' | 'e' | 'E' | '+' | '-'))
        && text.contains(|c: char| c.is_ascii_digit());
    let x: f64 = if shaped { text.parse().ok()? } else { return None };
    Some(if x.is_finite() {
        Ok(Value::Double(x))
    } else {
        Err("is beyond the largest double, 1.8e308".into())
    })
}

fn all(text: &str, test: impl Fn(char) -> bool) -> bool {
    !text.is_empty() && text.chars().all(test)
}

/// In a list of texts, `~` and `null` are the text `~`: a place that is left empty.
fn sequence(items: &[Node]) -> Result<Value, String> {
    let is_null = |item: &Node| matches!(&item.content, Content::Scalar { text, plain: true } if NULLS.contains(&text.as_str()));
    let is_text = |item: &Node| match &item.content {
        Content::Scalar { text, plain } => matches!(scalar(text, *plain), Ok(Value::String(_))),
        _ => false,
    };
    let texts = items.iter().any(is_text) && items.iter().all(|item| is_null(item) || is_text(item));
    let mut values = Vec::with_capacity(items.len());
    for (index, item) in items.iter().enumerate() {
        let Content::Scalar { text, plain } = &item.content else {
            return Err(format!(
                "element {} of the list is not a single value; allowed: lists of booleans, of integers, of numbers or of texts",
                index + 1
            ));
        };
        if texts && is_null(item) {
            values.push(Value::String("~".to_owned()));
            continue;
        }
        values.push(
            scalar(text, *plain).map_err(|problem| format!("element {} of the list {problem}", index + 1))?,
        );
    }
    same_type(&values).ok_or_else(|| {
        "the list mixes types; allowed: lists of booleans, of integers, of numbers or of texts".into()
    })
}

fn same_type(values: &[Value]) -> Option<Value> {
    match values.first() {
        None => Some(Value::IntegerArray(Vec::new())),
        Some(Value::Bool(_)) => values
            .iter()
            .map(|v| if let Value::Bool(x) = v { Some(*x) } else { None })
            .collect::<Option<_>>()
            .map(Value::BoolArray),
        Some(Value::String(_)) => values
            .iter()
            .map(|v| if let Value::String(x) = v { Some(x.clone()) } else { None })
            .collect::<Option<_>>()
            .map(Value::StringArray),
        _ => {
            let integers: Option<Vec<i64>> =
                values.iter().map(|v| if let Value::Integer(x) = v { Some(*x) } else { None }).collect();
            if let Some(integers) = integers {
                return Some(Value::IntegerArray(integers));
            }
            values
                .iter()
                .map(|v| match v.converted(crate::value::Kind::Double) {
                    Some(Value::Double(x)) => Some(x),
                    _ => None,
                })
                .collect::<Option<_>>()
                .map(Value::DoubleArray)
        }
    }
}
