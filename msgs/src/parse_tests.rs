//! Tests of the reader of definitions, which `build.rs` uses.

use crate::parse::{Definition, Element, Length, Service};

fn parse(text: &str) -> Result<Definition, String> {
    Definition::parse("mine", "Thing", text)
}

#[test]
fn fields_constants_and_comments_are_told_apart() {
    let text = "\
# What it is.
# In two lines.

# Of two constants.
uint8 A=1
int32 B = -2   # behind

std_msgs/Header header # stamp
    # and frame
float64[3] x
# above
Other[] others
float32 y 1.5
";
    let d = parse(text).unwrap();
    assert_eq!(d.doc, ["What it is.", "In two lines."]);
    let constants: Vec<_> = d.constants.iter().map(|c| (c.ty.rust, &*c.name, &*c.value)).collect();
    assert_eq!(constants, [("u8", "A", "1"), ("i32", "B", "-2")]);
    assert_eq!(
        (&d.constants[0].doc[..], &d.constants[1].doc[..]),
        (&["Of two constants.".into()][..], &["behind".into()][..])
    );
    let names: Vec<_> = d.fields.iter().map(|f| (&*f.name, f.length, f.doc.join("|"))).collect();
    assert_eq!(
        names,
        [
            ("header", Length::One, "stamp|and frame".to_owned()),
            ("x", Length::Array(3), String::new()),
            ("others", Length::Sequence, "above".to_owned()),
            ("y", Length::One, String::new()),
        ]
    );
    // A name without a package is of the same package.
    assert_eq!(d.fields[0].element, Element::Message("std_msgs".into(), "Header".into()));
    assert_eq!(d.fields[2].element, Element::Message("mine".into(), "Other".into()));
    assert_eq!(d.fields[3].default.as_deref(), Some("1.5"));
}

#[test]
fn wrong_lines_are_named() {
    for (line, problem) in [
        ("float64", "a type and a name"),
        ("float64[a] x", "no length"),
        ("float64 Xy", "no valid name"),
        ("string TEXT=abc", "no constant can have the type `string`"),
        ("string<=10 name", "not supported"),
        ("float64[2] x [1.0, 2.0]", "default"),
        ("float64 first", "two fields"),
    ] {
        let error = parse(&format!("float64 first\n{line}\n")).unwrap_err();
        assert!(error.starts_with("line 2: ") && error.contains(problem), "{line}: {error}");
    }
    assert!(Service::parse("mine", "Do", "string a\n").unwrap_err().contains("---"));
}

#[test]
fn a_service_has_a_request_and_a_response_and_each_may_be_empty() {
    let service = Service::parse("mine", "Do", "# why\n---\nbool success\n").unwrap();
    assert_eq!((service.request.name.as_str(), service.request.fields.len()), ("DoRequest", 0));
    assert_eq!((service.response.name.as_str(), service.response.fields.len()), ("DoResponse", 1));
}
