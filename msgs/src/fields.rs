//! A walk over the fields of any message: what checks, translates or changes fields of every type is written once.
//!
//! The types' part is made from the `.msg` files, as the types are.

use crate::builtin_interfaces::Time;

/// Sees every field of a message, in the order of its definition, and may change it.
///
/// Integers are shown in 64 bits; what does not fit the field when it comes back loses its upper bits.
pub trait Visitor {
    /// The fields that follow, until [`Self::leave`], are those of the message in the field `name`; of the message
    /// itself when `name` is empty.
    fn enter(&mut self, _name: &'static str) {}
    /// The end of the message that was entered last.
    fn leave(&mut self) {}
    /// A floating-point number, or an element of an array of them.
    fn real(&mut self, _name: &'static str, _value: &mut f64) {}
    /// An integer without a sign, likewise.
    fn unsigned(&mut self, _name: &'static str, _value: &mut u64) {}
    /// An integer with a sign, likewise.
    fn signed(&mut self, _name: &'static str, _value: &mut i64) {}
    /// A truth value, likewise.
    fn flag(&mut self, _name: &'static str, _value: &mut bool) {}
    /// A text, likewise.
    fn text(&mut self, _name: &'static str, _value: &mut String) {}
    /// An instant. Its two numbers are not shown one by one.
    fn time(&mut self, _name: &'static str, _value: &mut Time) {}
    /// The number of elements of a sequence, before its elements. A larger one appends default elements.
    fn length(&mut self, _name: &'static str, _length: &mut usize) {}
}

/// What a visitor can be shown.
pub trait Fields {
    /// Shows the visitor this field, whose name is `name`.
    fn walk(&mut self, name: &'static str, visitor: &mut dyn Visitor);
}

impl Fields for f64 {
    fn walk(&mut self, name: &'static str, visitor: &mut dyn Visitor) {
        visitor.real(name, self);
    }
}

impl Fields for f32 {
    fn walk(&mut self, name: &'static str, visitor: &mut dyn Visitor) {
        let mut wide = f64::from(*self);
        visitor.real(name, &mut wide);
        *self = wide as Self;
    }
}

macro_rules! integers {
    ($($ty:ty, $wide:ty, $visit:ident;)+) => {
        $(impl Fields for $ty {
            fn walk(&mut self, name: &'static str, visitor: &mut dyn Visitor) {
                let mut wide = <$wide>::from(*self);
                visitor.$visit(name, &mut wide);
                *self = wide as Self;
            }
        })+
    };
}

integers! {
    u8, u64, unsigned;
    u16, u64, unsigned;
    u32, u64, unsigned;
    u64, u64, unsigned;
    i8, i64, signed;
    i16, i64, signed;
    i32, i64, signed;
    i64, i64, signed;
}

impl Fields for bool {
    fn walk(&mut self, name: &'static str, visitor: &mut dyn Visitor) {
        visitor.flag(name, self);
    }
}

impl Fields for String {
    fn walk(&mut self, name: &'static str, visitor: &mut dyn Visitor) {
        visitor.text(name, self);
    }
}

impl Fields for Time {
    fn walk(&mut self, name: &'static str, visitor: &mut dyn Visitor) {
        visitor.time(name, self);
    }
}

impl<T: Fields, const N: usize> Fields for [T; N] {
    fn walk(&mut self, name: &'static str, visitor: &mut dyn Visitor) {
        self.iter_mut().for_each(|element| element.walk(name, visitor));
    }
}

impl<T: Fields + Default> Fields for Vec<T> {
    fn walk(&mut self, name: &'static str, visitor: &mut dyn Visitor) {
        let mut length = self.len();
        visitor.length(name, &mut length);
        self.resize_with(length, T::default);
        self.iter_mut().for_each(|element| element.walk(name, visitor));
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::definitions::DEFINITIONS;
    use crate::topics::{Message, MessageType};

    /// The path of every field that is not a message itself.
    #[derive(Default)]
    struct Paths {
        within: Vec<&'static str>,
        seen: Vec<String>,
    }

    impl Paths {
        fn note(&mut self, name: &'static str) {
            let path = self.within.iter().copied().filter(|part| !part.is_empty()).chain([name]);
            let path = path.collect::<Vec<_>>().join(".");
            if self.seen.last() != Some(&path) {
                self.seen.push(path);
            }
        }
    }

    impl Visitor for Paths {
        fn enter(&mut self, name: &'static str) {
            self.within.push(name);
        }
        fn leave(&mut self) {
            self.within.pop();
        }
        fn real(&mut self, name: &'static str, _: &mut f64) {
            self.note(name);
        }
        fn unsigned(&mut self, name: &'static str, _: &mut u64) {
            self.note(name);
        }
        fn signed(&mut self, name: &'static str, _: &mut i64) {
            self.note(name);
        }
        fn flag(&mut self, name: &'static str, _: &mut bool) {
            self.note(name);
        }
        fn text(&mut self, name: &'static str, _: &mut String) {
            self.note(name);
        }
        fn time(&mut self, name: &'static str, _: &mut Time) {
            self.note(name);
        }
        fn length(&mut self, _: &'static str, length: &mut usize) {
            *length = 1;
        }
    }

    /// As the definitions' texts say, without the generated code.
    fn paths_in_definition(name: &str, prefix: &str, found: &mut Vec<String>) {
        let definition = DEFINITIONS.iter().find(|d| d.name == name).unwrap();
        for field in definition.fields {
            let path =
                if prefix.is_empty() { field.name.to_owned() } else { format!("{prefix}.{}", field.name) };
            let element = field.ty.split('[').next().unwrap();
            if element.contains('/') && element != "builtin_interfaces/Time" {
                paths_in_definition(element, &path, found);
            } else {
                found.push(path);
            }
        }
    }

    #[test]
    fn every_field_of_every_definition_is_shown() {
        for &message_type in MessageType::ALL {
            if message_type.name() == "builtin_interfaces/msg/Time" {
                continue;
            }
            let mut paths = Paths::default();
            Message::default_of(message_type).walk(&mut paths);
            let mut expected = Vec::new();
            paths_in_definition(&message_type.name().replace("/msg/", "/"), "", &mut expected);
            assert_eq!(paths.seen, expected, "{}", message_type.name());
        }
    }
}
