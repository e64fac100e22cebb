//! Vectors and lists.

use nalgebra::{Unit, Vector3};

use super::numbers::phrase;
use super::{Absent, Reader, Request};
use crate::descriptor::NumericRange;
use crate::limits::Limits;
use crate::value::{Kind, Value};

/// Below this length a vector has no usable direction.
const SHORTEST_DIRECTION: f64 = 1e-6;

fn double_list<'r>(key: &'r str, noun: &str, limits: &Limits<f64>, doc: &'r str) -> Request<'r> {
    let (from, to) = limits.ends();
    let words = limits.words();
    let allowed = if words.is_empty() { noun.to_owned() } else { format!("{noun}, each {words}") };
    Request {
        key,
        kind: Kind::DoubleArray,
        allowed,
        range: Some(NumericRange::Double { from, to }),
        choices: Vec::new(),
        doc,
    }
}

const VECTOR: &str = "three numbers [x, y, z]";

fn accept_list(limits: Limits<f64>) -> impl Fn(&Value) -> Option<Vec<f64>> {
    move |value| match value {
        Value::DoubleArray(xs) if xs.iter().all(|x| limits.allows(*x)) => Some(xs.clone()),
        _ => None,
    }
}

fn accept_vector(limits: Limits<f64>) -> impl Fn(&Value) -> Option<Vector3<f64>> {
    move |value| match value {
        Value::DoubleArray(xs) => match xs.as_slice() {
            &[x, y, z] if [x, y, z].iter().all(|x| limits.allows(*x)) => Some(Vector3::new(x, y, z)),
            _ => None,
        },
        _ => None,
    }
}

fn accept_per_axis(limits: Limits<f64>) -> impl Fn(&Value) -> Option<Vector3<f64>> {
    let vector = accept_vector(limits);
    move |value| match value.converted(Kind::Double) {
        Some(Value::Double(x)) => limits.allows(x).then(|| Vector3::repeat(x)),
        _ => vector(&value.converted(Kind::DoubleArray)?),
    }
}

fn string_list<'r>(key: &'r str, doc: &'r str) -> Request<'r> {
    Request {
        key,
        kind: Kind::StringArray,
        allowed: "a list of texts".into(),
        range: None,
        choices: Vec::new(),
        doc,
    }
}

fn accept_strings(value: &Value) -> Option<Vec<String>> {
    if let Value::StringArray(xs) = value { Some(xs.clone()) } else { None }
}

impl Reader<'_> {
    /// Three numbers.
    pub fn vector3(&mut self, key: &str, limits: Limits<f64>, doc: &str) -> Vector3<f64> {
        self.request(double_list(key, VECTOR, &limits, doc), Absent::Refuse, accept_vector(limits))
            .unwrap_or_else(|| Vector3::repeat(limits.placeholder()))
    }

    /// Three numbers with a default.
    pub fn vector3_or(
        &mut self,
        key: &str,
        default: Vector3<f64>,
        limits: Limits<f64>,
        doc: &str,
    ) -> Vector3<f64> {
        let absent = Absent::Default(Value::DoubleArray(default.as_slice().to_vec()));
        self.request(double_list(key, VECTOR, &limits, doc), absent, accept_vector(limits)).unwrap_or(default)
    }

    /// Three numbers that may be left out.
    pub fn optional_vector3(&mut self, key: &str, limits: Limits<f64>, doc: &str) -> Option<Vector3<f64>> {
        self.request(double_list(key, VECTOR, &limits, doc), Absent::Leave, accept_vector(limits))
    }

    /// One number for all three axes, or three numbers.
    pub fn per_axis(&mut self, key: &str, limits: Limits<f64>, doc: &str) -> Vector3<f64> {
        self.each_axis(key, Absent::Refuse, limits, doc)
    }

    fn each_axis(&mut self, key: &str, absent: Absent, limits: Limits<f64>, doc: &str) -> Vector3<f64> {
        let mut request = double_list(key, VECTOR, &limits, doc);
        request.allowed = format!("{} for all axes, or {VECTOR}", phrase("a number", &limits.words()));
        self.request(request, absent, accept_per_axis(limits))
            .unwrap_or_else(|| Vector3::repeat(limits.placeholder()))
    }

    /// One number for all three axes, or three numbers, with a default for all.
    pub fn per_axis_or(&mut self, key: &str, default: f64, limits: Limits<f64>, doc: &str) -> Vector3<f64> {
        self.each_axis(key, Absent::Default(Value::DoubleArray(vec![default; 3])), limits, doc)
    }

    /// A direction: three numbers, not all zero, of any length; returned with length 1.
    pub fn direction(&mut self, key: &str, doc: &str) -> Unit<Vector3<f64>> {
        let limits = crate::limits::any();
        let request = double_list(key, "three numbers [x, y, z], not all zero", &limits, doc);
        let vector = accept_vector(limits);
        self.request(request, Absent::Refuse, |value| {
            vector(value).and_then(|v| Unit::try_new(v, SHORTEST_DIRECTION))
        })
        .unwrap_or_else(Vector3::x_axis)
    }

    /// A list of numbers of any length.
    pub fn f64_array(&mut self, key: &str, limits: Limits<f64>, doc: &str) -> Vec<f64> {
        let request = double_list(key, "a list of numbers", &limits, doc);
        self.request(request, Absent::Refuse, accept_list(limits)).unwrap_or_default()
    }

    /// A list of numbers with a default.
    pub fn f64_array_or(&mut self, key: &str, default: &[f64], limits: Limits<f64>, doc: &str) -> Vec<f64> {
        let request = double_list(key, "a list of numbers", &limits, doc);
        let absent = Absent::Default(Value::DoubleArray(default.to_vec()));
        self.request(request, absent, accept_list(limits)).unwrap_or_else(|| default.to_vec())
    }

    /// A list of integers of any length.
    pub fn i64_array(&mut self, key: &str, limits: Limits<i64>, doc: &str) -> Vec<i64> {
        self.integers(key, Absent::Refuse, limits, doc).unwrap_or_default()
    }

    /// A list of integers with a default.
    pub fn i64_array_or(&mut self, key: &str, default: &[i64], limits: Limits<i64>, doc: &str) -> Vec<i64> {
        let absent = Absent::Default(Value::IntegerArray(default.to_vec()));
        self.integers(key, absent, limits, doc).unwrap_or_else(|| default.to_vec())
    }

    fn integers(&mut self, key: &str, absent: Absent, limits: Limits<i64>, doc: &str) -> Option<Vec<i64>> {
        let (from, to) = limits.ends();
        let words = limits.words();
        let allowed = if words.is_empty() {
            "a list of integers".into()
        } else {
            format!("a list of integers, each {words}")
        };
        let request = Request {
            key,
            kind: Kind::IntegerArray,
            allowed,
            range: Some(NumericRange::Integer { from, to }),
            choices: Vec::new(),
            doc,
        };
        self.request(request, absent, |value| match value {
            Value::IntegerArray(xs) if xs.iter().all(|x| limits.allows(*x)) => Some(xs.clone()),
            _ => None,
        })
    }

    /// A list of texts.
    pub fn string_array(&mut self, key: &str, doc: &str) -> Vec<String> {
        self.request(string_list(key, doc), Absent::Refuse, accept_strings).unwrap_or_default()
    }

    /// A list of texts that may be left out.
    pub fn optional_string_array(&mut self, key: &str, doc: &str) -> Option<Vec<String>> {
        self.request(string_list(key, doc), Absent::Leave, accept_strings)
    }

    /// A list of texts with a default.
    pub fn string_array_or(&mut self, key: &str, default: &[&str], doc: &str) -> Vec<String> {
        let default: Vec<String> = default.iter().map(|text| (*text).to_owned()).collect();
        let absent = Absent::Default(Value::StringArray(default.clone()));
        self.request(string_list(key, doc), absent, accept_strings).unwrap_or(default)
    }
}
