//! The files of a package do not import each other in a circle: the test reads the sources.
//!
//! A file imports another when its code, tests apart, names a path that leads there: `use crate::list::read`, `super::list`,
//! `crate::list::read()` in the midst of code. A path counts for the file in which its last module stands: what a folder's `mod.rs`
//! re-exports is that folder's interface, and a path to it leads to `mod.rs`. Files below a file belong to it: what a file and
//! those below it say of each other is no circle.

use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};
use std::str::FromStr;

use proc_macro2::{Delimiter, TokenStream, TokenTree};

use crate::support::root;

/// Modules from the crate's root to one of them.
type ModulePath = Vec<String>;

/// One file.
struct Module {
    file: PathBuf,
    children: BTreeSet<String>,
    /// Paths in its code, each with the line.
    paths: Vec<(usize, Vec<String>)>,
}

/// The files of a package from its root on, by their modules.
struct Sources(BTreeMap<ModulePath, Module>);

impl Sources {
    /// `text` gives what a file holds; `None`: there is none.
    fn read(crate_root: &Path, text: &dyn Fn(&Path) -> Option<String>) -> Self {
        let mut sources = Self(BTreeMap::new());
        sources.add(Vec::new(), crate_root.to_owned(), crate_root.parent().unwrap(), text);
        sources
    }

    /// `below`: the folder of the files of its modules.
    fn add(&mut self, path: ModulePath, file: PathBuf, below: &Path, text: &dyn Fn(&Path) -> Option<String>) {
        let code = text(&file).unwrap_or_else(|| panic!("{} is not there", file.display()));
        let tokens = TokenStream::from_str(&code).unwrap_or_else(|e| panic!("{}: {e}", file.display()));
        let tokens: Vec<TokenTree> = without_tests(tokens.into_iter().collect());
        let children: BTreeSet<String> = tokens
            .windows(3)
            .filter(|three| is_word(&three[0], "mod") && is_sign(&three[2], ';'))
            .map(|three| three[1].to_string())
            .collect();
        let mut paths = Vec::new();
        find_paths(&tokens, &children, &mut paths);
        self.0.insert(path.clone(), Module { file, children: children.clone(), paths });
        for child in children {
            let files = [below.join(format!("{child}.rs")), below.join(&child).join("mod.rs")];
            let file = files.into_iter().find(|file| text(file).is_some());
            let file = file.unwrap_or_else(|| panic!("no file of module {child} below {}", below.display()));
            self.add([path.clone(), vec![child.clone()]].concat(), file, &below.join(&child), text);
        }
    }

    /// The module in which the end of a path of another stands.
    fn leads_to(&self, from: &ModulePath, path: &[String]) -> ModulePath {
        let mut at = from.clone();
        for segment in path {
            match segment.as_str() {
                "crate" => at.clear(),
                "super" => _ = at.pop(),
                "self" => {}
                child if self.0.get(&at).is_some_and(|module| module.children.contains(child)) => {
                    at.push(child.to_owned());
                }
                _ => break,
            }
        }
        at
    }

    /// Circles, each as the imports in it: who, whom, and where.
    fn circles(&self) -> Vec<Vec<String>> {
        let mut imports: BTreeMap<&ModulePath, BTreeMap<ModulePath, String>> = BTreeMap::new();
        for (from, module) in &self.0 {
            for (line, path) in &module.paths {
                let to = self.leads_to(from, path);
                if !from.starts_with(&to) && !to.starts_with(from) {
                    let place = format!("{}:{line}: {}", module.file.display(), path.join("::"));
                    imports.entry(from).or_default().entry(to).or_insert(place);
                }
            }
        }
        let reached = |from: &ModulePath| {
            let (mut reached, mut open) = (BTreeSet::new(), vec![from.clone()]);
            while let Some(next) = open.pop() {
                for to in imports.get(&next).into_iter().flat_map(BTreeMap::keys) {
                    if reached.insert(to.clone()) {
                        open.push(to.clone());
                    }
                }
            }
            reached
        };
        let reached: BTreeMap<&ModulePath, BTreeSet<ModulePath>> =
            self.0.keys().map(|module| (module, reached(module))).collect();
        let mut done = BTreeSet::new();
        let mut circles = Vec::new();
        for (module, others) in reached.iter().filter(|(module, others)| others.contains(**module)) {
            if done.contains(*module) {
                continue;
            }
            let members: BTreeSet<&ModulePath> =
                others.iter().filter(|other| reached[other].contains(*module)).collect();
            done.extend(members.iter().copied());
            let of = |from: &&ModulePath| {
                let inside = imports[*from].iter().filter(|(to, _)| members.contains(to));
                inside.map(|(_, place)| place.clone()).collect::<Vec<_>>()
            };
            circles.push(members.iter().flat_map(of).collect());
        }
        circles
    }
}

fn is_word(token: &TokenTree, word: &str) -> bool {
    matches!(token, TokenTree::Ident(ident) if *ident == word)
}

fn is_sign(token: &TokenTree, sign: char) -> bool {
    matches!(token, TokenTree::Punct(punct) if punct.as_char() == sign)
}

/// What is compiled without tests: items behind `#[cfg(test)]` and its like are left out.
fn without_tests(tokens: Vec<TokenTree>) -> Vec<TokenTree> {
    let mut kept: Vec<TokenTree> = Vec::new();
    let mut tokens = tokens.into_iter();
    while let Some(token) = tokens.next() {
        let of_tests = |text: String| {
            let text: String = text.chars().filter(|c| !c.is_whitespace()).collect();
            ["cfg(test)", "cfg(all(test", "cfg(any(test"].iter().any(|begin| text.starts_with(begin))
        };
        match token {
            TokenTree::Group(group)
                if kept.last().is_some_and(|last| is_sign(last, '#'))
                    && group.delimiter() == Delimiter::Bracket
                    && of_tests(group.stream().to_string()) =>
            {
                kept.pop();
                // To the end of the item.
                for skipped in tokens.by_ref() {
                    let is_body =
                        matches!(&skipped, TokenTree::Group(g) if g.delimiter() == Delimiter::Brace);
                    if is_body || is_sign(&skipped, ';') {
                        break;
                    }
                }
            }
            token => kept.push(token),
        }
    }
    kept
}

/// Paths that begin with `crate`, `super`, `self` or one of the children; groups of a `use` are taken apart.
fn find_paths(tokens: &[TokenTree], children: &BTreeSet<String>, found: &mut Vec<(usize, Vec<String>)>) {
    let mut at = 0;
    while at < tokens.len() {
        if let TokenTree::Group(group) = &tokens[at] {
            find_paths(&without_tests(group.stream().into_iter().collect()), children, found);
        }
        let TokenTree::Ident(first) = &tokens[at] else {
            at += 1;
            continue;
        };
        let after_colons = at >= 2 && is_sign(&tokens[at - 1], ':') && is_sign(&tokens[at - 2], ':');
        let begins = ["crate", "super", "self"].iter().any(|word| *first == word)
            || children.contains(&first.to_string());
        let line = first.span().start().line;
        if after_colons || !begins {
            at += 1;
            continue;
        }
        let (path, next) = path_at(tokens, at);
        at = next;
        match tokens.get(at) {
            // `use a::b::{...}`
            Some(TokenTree::Group(group)) if is_sign(&tokens[at - 1], ':') => {
                for inner in alternatives(group.stream()) {
                    found.push((line, [path.clone(), inner].concat()));
                }
                at += 1;
            }
            _ if path.len() > 1 => found.push((line, path)),
            _ => {}
        }
    }
}

/// The words of a path from here on, and where it ends.
fn path_at(tokens: &[TokenTree], mut at: usize) -> (Vec<String>, usize) {
    let mut path = Vec::new();
    while let Some(TokenTree::Ident(word)) = tokens.get(at) {
        path.push(word.to_string());
        let follows = |k: usize| tokens.get(at + k).is_some_and(|token| is_sign(token, ':'));
        if !(follows(1) && follows(2)) {
            return (path, at + 1);
        }
        at += 3;
    }
    (path, at)
}

/// What stands between the braces of a `use`, taken apart.
fn alternatives(stream: TokenStream) -> Vec<Vec<String>> {
    let tokens: Vec<TokenTree> = stream.into_iter().collect();
    let mut found = Vec::new();
    for part in tokens.split(|token| is_sign(token, ',')).filter(|part| !part.is_empty()) {
        let (path, at) = path_at(part, 0);
        match part.get(at) {
            Some(TokenTree::Group(group)) => {
                let inner = alternatives(group.stream());
                found.extend(inner.into_iter().map(|inner| [path.clone(), inner].concat()));
            }
            _ => found.push(path),
        }
    }
    found
}

#[test]
fn no_files_import_each_other_in_a_circle() {
    let packages =
        ["crates", "nodes", "tests"].map(|group| root().join(group)).into_iter().flat_map(|group| {
            std::fs::read_dir(group).unwrap().map(|entry| entry.unwrap().path()).collect::<Vec<_>>()
        });
    let packages = packages.chain([root().join("msgs"), root().join("python")]);
    let roots = packages.flat_map(|package| ["src/lib.rs", "src/main.rs"].map(|file| package.join(file)));
    let roots: Vec<PathBuf> = roots.filter(|file| file.is_file()).collect();
    assert!(roots.len() > 40, "the sources are there: {}", roots.len());
    let text = |file: &Path| std::fs::read_to_string(file).ok();
    let circles: Vec<String> = roots
        .iter()
        .flat_map(|file| Sources::read(file, &text).circles())
        .map(|imports| imports.join("\n  "))
        .collect();
    assert!(circles.is_empty(), "files that import each other in a circle:\n  {}", circles.join("\n\n  "));
}

#[test]
fn a_circle_is_found_whatever_it_goes_through() {
    let files = |pairs: &'static [(&'static str, &'static str)]| {
        move |file: &Path| {
            let found = pairs.iter().find(|(name, _)| Path::new(name) == file);
            found.map(|(_, text)| (*text).to_owned())
        }
    };
    let circles = |pairs| Sources::read(Path::new("lib.rs"), &files(pairs)).circles();
    // A path in the midst of code, a group, a comment and a text that say nothing.
    let found = circles(&[
        ("lib.rs", "mod a;\nmod b;\nmod c;\npub use a::A;"),
        ("a.rs", "// crate::c::C\npub struct A;\nfn f() {\n    crate::b::g(\"crate::c::C\");\n}"),
        ("b.rs", "use crate::{c::{C, D}, A};\npub fn g(_: &str) {}"),
        ("c.rs", "use super::a::A;\npub struct C;"),
    ]);
    assert_eq!(found, [["a.rs:4: crate::b::g", "b.rs:1: crate::c::C", "c.rs:1: super::a::A"]]);
    // What only tests import, a re-export, and what stands above or below.
    let none = circles(&[
        ("lib.rs", "mod a;\nmod b;\npub use a::A;\npub struct L;\nfn f() { b::g() }"),
        ("a.rs", "use crate::b::B;\n#[cfg(test)]\nmod tests { use crate::b::B; }"),
        ("b/mod.rs", "mod d;\nuse crate::{A, L};\nuse d::D;\n#[cfg(test)]\nuse crate::a::A as Other;"),
        ("b/d.rs", "use super::B;"),
    ]);
    assert_eq!(none, Vec::<Vec<String>>::new());
}
