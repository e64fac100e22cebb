//! Single numbers and booleans.

use super::{Absent, Reader, Request};
use crate::descriptor::NumericRange;
use crate::limits::Limits;
use crate::value::{Kind, Value};

fn f64_request<'r>(key: &'r str, limits: &Limits<f64>, doc: &'r str) -> Request<'r> {
    let (from, to) = limits.ends();
    Request {
        key,
        kind: Kind::Double,
        allowed: phrase("a number", &limits.words()),
        range: Some(NumericRange::Double { from, to }),
        choices: Vec::new(),
        doc,
    }
}

fn i64_request<'r>(key: &'r str, limits: &Limits<i64>, doc: &'r str) -> Request<'r> {
    let (from, to) = limits.ends();
    Request {
        key,
        kind: Kind::Integer,
        allowed: phrase("an integer", &limits.words()),
        range: Some(NumericRange::Integer { from, to }),
        choices: Vec::new(),
        doc,
    }
}

fn bool_request<'r>(key: &'r str, doc: &'r str) -> Request<'r> {
    Request { key, kind: Kind::Bool, allowed: "true or false".into(), range: None, choices: Vec::new(), doc }
}

/// `a number` + `from 0 to 1`.
pub(super) fn phrase(noun: &str, limits: &str) -> String {
    if limits.is_empty() { noun.to_owned() } else { format!("{noun} {limits}") }
}

fn accept_f64(limits: Limits<f64>) -> impl Fn(&Value) -> Option<f64> {
    move |value| match value {
        Value::Double(x) if limits.allows(*x) => Some(*x),
        _ => None,
    }
}

fn accept_i64(limits: Limits<i64>) -> impl Fn(&Value) -> Option<i64> {
    move |value| match value {
        Value::Integer(x) if limits.allows(*x) => Some(*x),
        _ => None,
    }
}

fn accept_bool(value: &Value) -> Option<bool> {
    if let Value::Bool(x) = value { Some(*x) } else { None }
}

impl Reader<'_> {
    /// A number. Integers are taken as numbers; NaN and infinities only when the limits say so.
    pub fn f64(&mut self, key: &str, limits: Limits<f64>, doc: &str) -> f64 {
        self.request(f64_request(key, &limits, doc), Absent::Refuse, accept_f64(limits))
            .unwrap_or_else(|| limits.placeholder())
    }

    /// A number with a default.
    pub fn f64_or(&mut self, key: &str, default: f64, limits: Limits<f64>, doc: &str) -> f64 {
        let absent = Absent::Default(Value::Double(default));
        self.request(f64_request(key, &limits, doc), absent, accept_f64(limits)).unwrap_or(default)
    }

    /// A number that may be left out.
    pub fn optional_f64(&mut self, key: &str, limits: Limits<f64>, doc: &str) -> Option<f64> {
        self.request(f64_request(key, &limits, doc), Absent::Leave, accept_f64(limits))
    }

    /// An integer.
    pub fn i64(&mut self, key: &str, limits: Limits<i64>, doc: &str) -> i64 {
        self.request(i64_request(key, &limits, doc), Absent::Refuse, accept_i64(limits))
            .unwrap_or_else(|| limits.placeholder())
    }

    /// An integer with a default.
    pub fn i64_or(&mut self, key: &str, default: i64, limits: Limits<i64>, doc: &str) -> i64 {
        let absent = Absent::Default(Value::Integer(default));
        self.request(i64_request(key, &limits, doc), absent, accept_i64(limits)).unwrap_or(default)
    }

    /// An integer that may be left out.
    pub fn optional_i64(&mut self, key: &str, limits: Limits<i64>, doc: &str) -> Option<i64> {
        self.request(i64_request(key, &limits, doc), Absent::Leave, accept_i64(limits))
    }

    /// `true` or `false`.
    pub fn bool(&mut self, key: &str, doc: &str) -> bool {
        self.request(bool_request(key, doc), Absent::Refuse, accept_bool).unwrap_or(false)
    }

    /// `true` or `false`, with a default.
    pub fn bool_or(&mut self, key: &str, default: bool, doc: &str) -> bool {
        let absent = Absent::Default(Value::Bool(default));
        self.request(bool_request(key, doc), absent, accept_bool).unwrap_or(default)
    }
}
