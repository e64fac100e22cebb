//! What the sources must look like; the tests read them.
//!
//! Files do not import each other in a circle. A file imports another when its code, tests apart, names a path that leads there:
//! `use crate::list::read`, `super::list`, `crate::list::read()` in the midst of code. A path counts for the file that defines what it
//! names, whatever re-exports it goes through. Files below a file belong to it: what a file and those below it say of each other is no
//! circle.
//!
//! What a type does stands with it: an `impl` block of no trait in the type's file or in one right below it. Elsewhere it is a part of
//! the type that its file does not show, and files that seem to import one another are one.

mod circles;
mod known;
mod python;
mod sources;
mod tokens;

use std::collections::BTreeSet;
use std::path::{Path, PathBuf};

use circles::circles;
use known::{FAR_FROM_THEIR_TYPE, IN_A_CIRCLE};
use sources::Sources;

use crate::support::root;

/// The sources of every package, with files relative to the repository.
fn packages() -> Vec<Sources> {
    let below = |group: &str| {
        let folder = std::fs::read_dir(root().join(group)).unwrap();
        let names = folder.map(|entry| entry.unwrap().file_name().into_string().unwrap());
        names.map(|name| format!("{group}/{name}")).collect::<Vec<_>>()
    };
    let packages = ["crates", "nodes", "tests"].into_iter().flat_map(below);
    let packages = packages.chain(["msgs", "python"].map(str::to_owned));
    let files =
        packages.flat_map(|package| ["src/lib.rs", "src/main.rs"].map(|file| Path::new(&package).join(file)));
    let files: Vec<PathBuf> = files.filter(|file| root().join(file).is_file()).collect();
    assert!(files.len() > 30, "the sources are there: {}", files.len());
    files.iter().map(|file| Sources::read(file, &text)).collect()
}

fn text(file: &Path) -> Option<String> {
    std::fs::read_to_string(root().join(file)).ok()
}

/// What is found is what is known: nothing is added to it, and what is gone from the sources is gone from the list.
fn assert_known<T: Ord + std::fmt::Debug>(found: &BTreeSet<T>, known: &BTreeSet<T>, what: &str) {
    let new: Vec<&T> = found.difference(known).collect();
    assert!(new.is_empty(), "{what}: {new:#?}");
    let gone: Vec<&T> = known.difference(found).collect();
    assert!(gone.is_empty(), "no longer so; take it from the list in tests/structure/known.rs: {gone:#?}");
}

#[test]
fn no_files_import_each_other_in_a_circle() {
    let package = Path::new("python/package/whorl");
    let names = std::fs::read_dir(root().join(package)).unwrap().map(|entry| entry.unwrap().file_name());
    let files =
        names.map(|name| package.join(name)).filter(|file| file.extension().is_some_and(|e| e == "py"));
    let files: Vec<PathBuf> = files.collect();
    assert!(files.len() > 10, "the Python package is there: {files:?}");
    let of_python = python::imports(&files, &|file| text(file).unwrap());
    let packages = packages();
    let imports = packages.iter().map(Sources::imports).chain([of_python]);
    let circles: Vec<_> = imports.flat_map(|imports| circles(&imports)).collect();
    for (_, imports) in &circles {
        println!("files that import each other in a circle:\n  {}", imports.join("\n  "));
    }
    let found = circles.into_iter().flat_map(|(files, _)| files).collect();
    let known = IN_A_CIRCLE.iter().map(|file| (*file).to_owned()).collect();
    assert_known(&found, &known, "in a circle");
}

#[test]
fn what_a_type_does_stands_with_it() {
    let packages = packages();
    let found: BTreeSet<(String, String)> = packages.iter().flat_map(Sources::scattered).collect();
    let known = FAR_FROM_THEIR_TYPE.iter().map(|(file, of)| ((*file).to_owned(), (*of).to_owned())).collect();
    assert_known(&found, &known, "an `impl` neither in the file of its type nor in one right below it");
}

/// A package of these files.
fn package(files: &'static [(&'static str, &'static str)]) -> Sources {
    let text = |file: &Path| {
        let found = files.iter().find(|(name, _)| Path::new(name) == file);
        found.map(|(_, text)| (*text).to_owned())
    };
    Sources::read(Path::new("lib.rs"), &text)
}

fn circles_of(files: &'static [(&'static str, &'static str)]) -> Vec<Vec<String>> {
    circles(&package(files).imports()).into_values().collect()
}

#[test]
fn a_circle_is_found_whatever_it_goes_through() {
    // A path in the midst of code, a group, a comment and a text that say nothing, a name that the root re-exports.
    let found = circles_of(&[
        ("lib.rs", "mod a;\nmod b;\nmod c;\npub use a::A;"),
        ("a.rs", "// crate::c::C\npub struct A;\nfn f() {\n    crate::b::g(\"crate::c::C\");\n}"),
        ("b.rs", "use crate::c::{C, D};\npub fn g(_: &str) {}"),
        ("c.rs", "use super::A;\npub struct C;\npub struct D;"),
    ]);
    assert_eq!(found, [["a.rs:4: crate::b::g", "b.rs:1: crate::c::C", "c.rs:1: super::A"]]);
    // What a folder hands on, under another name, from a module that another `use` brings in.
    let found = circles_of(&[
        ("lib.rs", "mod a;\nmod b;"),
        ("a/mod.rs", "mod inner;\npub use self::inner::{self, I as Renamed};"),
        ("a/inner.rs", "use crate::b;\npub struct I;\nfn f() { b::g() }"),
        ("b.rs", "use crate::a::Renamed;\npub fn g() {}"),
    ]);
    assert_eq!(found, [["a/inner.rs:1: crate::b", "b.rs:1: crate::a::Renamed"]]);
    // What only tests import, and what stands above or below.
    let none = circles_of(&[
        ("lib.rs", "mod a;\nmod b;\npub struct L;\nfn f() { b::g() }"),
        ("a.rs", "pub struct A;\nuse crate::b::B;\n#[cfg(test)]\nmod tests { use crate::b::B; }"),
        ("b/mod.rs", "mod d;\npub use d::B;\nuse crate::L;\n#[cfg(test)]\nuse crate::a::A as Other;"),
        ("b/d.rs", "use super::g;\npub struct B;"),
    ]);
    assert_eq!(none, Vec::<Vec<String>>::new());
}

#[test]
fn a_circle_of_python_is_found_in_functions_too() {
    let text = |file: &Path| match file.to_str() {
        Some("p/a.py") => "from . import b, _native\n".to_owned(),
        Some("p/b.py") => "def f():\n    from .c import g\n".to_owned(),
        _ => "from .a import (\n    A,\n)\nfrom .c import C\n".to_owned(),
    };
    let imports = python::imports(&["p/a.py", "p/b.py", "p/c.py"].map(PathBuf::from), &text);
    let found: Vec<Vec<String>> = circles(&imports).into_values().collect();
    let expected =
        ["p/a.py:1: from . import b, _native", "p/b.py:2: from .c import g", "p/c.py:1: from .a import ("];
    assert_eq!(found, [expected]);
}

#[test]
fn an_impl_far_from_its_type_is_found_however_it_is_written() {
    let found = package(&[
        ("lib.rs", "mod a;\nmod b;\npub use a::A;"),
        ("a/mod.rs", "mod below;\npub struct A<T>(T);\npub trait F {}\nimpl<T> A<T> {}"),
        (
            "a/below.rs",
            "mod deep;\nuse super::A;\nimpl<T: Fn(f64) -> f64> A<T> where T: Copy { fn f() -> impl Sized {} }",
        ),
        ("a/below/deep.rs", "impl crate::A<f64> {}"),
        (
            "b.rs",
            "use crate::a::{A as Other, F};\nimpl F for Other<u8> {}\n#[allow(unused)]\nimpl Other<u8> {}\nimpl dyn F {}",
        ),
    ]);
    let expected = [("a/below/deep.rs", "crate::A"), ("b.rs", "F"), ("b.rs", "Other")];
    assert_eq!(found.scattered(), expected.map(|(file, of)| (file.to_owned(), of.to_owned())).into());
}
