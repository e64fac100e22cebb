//! Texts and choices.

use super::{Absent, Reader, Request};
use crate::value::{Kind, Value};

fn string_request<'r>(key: &'r str, doc: &'r str) -> Request<'r> {
    Request { key, kind: Kind::String, allowed: "a text".into(), range: None, choices: Vec::new(), doc }
}

fn choice_request<'r>(key: &'r str, choices: &[&str], doc: &'r str) -> Request<'r> {
    Request {
        key,
        kind: Kind::String,
        allowed: format!("one of {}", choices.join(", ")),
        range: None,
        choices: choices.iter().map(|choice| (*choice).to_owned()).collect(),
        doc,
    }
}

fn accept_string(value: &Value) -> Option<String> {
    if let Value::String(x) = value { Some(x.clone()) } else { None }
}

fn accept_choice<'c>(choices: &[&'c str]) -> impl Fn(&Value) -> Option<&'c str> {
    move |value| match value {
        Value::String(x) => choices.iter().copied().find(|choice| choice == x),
        _ => None,
    }
}

impl Reader<'_> {
    /// A text.
    pub fn string(&mut self, key: &str, doc: &str) -> String {
        self.request(string_request(key, doc), Absent::Refuse, accept_string).unwrap_or_default()
    }

    /// A text with a default.
    pub fn string_or(&mut self, key: &str, default: &str, doc: &str) -> String {
        let absent = Absent::Default(default.into());
        self.request(string_request(key, doc), absent, accept_string).unwrap_or_else(|| default.to_owned())
    }

    /// A text that may be left out.
    pub fn optional_string(&mut self, key: &str, doc: &str) -> Option<String> {
        self.request(string_request(key, doc), Absent::Leave, accept_string)
    }

    /// One of some words; the first one after an error.
    pub fn choice<'c>(&mut self, key: &str, choices: &[&'c str], doc: &str) -> &'c str {
        self.request(choice_request(key, choices, doc), Absent::Refuse, accept_choice(choices))
            .unwrap_or_else(|| choices.first().copied().unwrap_or_default())
    }

    /// One of some words, with a default.
    pub fn choice_or<'c>(&mut self, key: &str, default: &'c str, choices: &[&'c str], doc: &str) -> &'c str {
        let absent = Absent::Default(default.into());
        self.request(choice_request(key, choices, doc), absent, accept_choice(choices)).unwrap_or(default)
    }
}
