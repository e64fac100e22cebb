//! The sources of a package, read: which file says what of which other.

use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};
use std::str::FromStr;

use proc_macro2::{TokenStream, TokenTree};

use super::circles::Imports;
use super::tokens::{defined, find_paths, impls, is_sign, is_word, uses, without_tests};

/// Modules from the crate's root to one of them.
type ModulePath = Vec<String>;

/// One file, without its tests.
struct Module {
    file: PathBuf,
    children: BTreeSet<String>,
    /// Names that `use` brings in, re-exports among them, with the path that each stands for.
    uses: BTreeMap<String, Vec<String>>,
    /// Names of the types, traits, functions and constants that it defines.
    items: BTreeSet<String>,
    /// Paths in its code, each with the line.
    paths: Vec<(usize, Vec<String>)>,
    /// Types of its `impl` blocks that are of no trait.
    impls: Vec<Vec<String>>,
}

/// The files of a package from its root on, by their modules.
pub struct Sources(BTreeMap<ModulePath, Module>);

impl Sources {
    /// `text` gives what a file holds; `None`: there is none.
    pub fn read(crate_root: &Path, text: &dyn Fn(&Path) -> Option<String>) -> Self {
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
        let uses = uses(&tokens);
        let is_here = |first: &String| {
            ["crate", "super", "self"].contains(&first.as_str())
                || children.contains(first)
                || uses.contains_key(first)
        };
        let star =
            uses.iter().find(|(name, path)| name.starts_with('*') && path.first().is_some_and(is_here));
        assert!(star.is_none(), "{}: a star hides what is imported: {star:?}", file.display());
        let mut paths = Vec::new();
        find_paths(&tokens, &|word| children.contains(word) || uses.contains_key(word), &mut paths);
        let (items, impls) = (defined(&tokens), impls(&tokens));
        self.0.insert(path.clone(), Module { file, children: children.clone(), uses, items, paths, impls });
        for child in children {
            let files = [below.join(format!("{child}.rs")), below.join(&child).join("mod.rs")];
            let file = files.into_iter().find(|file| text(file).is_some());
            let file = file.unwrap_or_else(|| panic!("no file of module {child} below {}", below.display()));
            self.add([path.clone(), vec![child.clone()]].concat(), file, &below.join(&child), text);
        }
    }

    /// Imports between files, those between a file and the files below it apart.
    pub fn imports(&self) -> Imports {
        let mut imports = Imports::new();
        for (from, module) in &self.0 {
            for (line, path) in &module.paths {
                let Some(to) = self.leads_to(from, path) else { continue };
                if !from.starts_with(&to) && !to.starts_with(from) {
                    let place = format!("{}:{line}: {}", module.file.display(), path.join("::"));
                    imports.entry(self.file(from)).or_default().entry(self.file(&to)).or_insert(place);
                }
            }
        }
        imports
    }

    fn file(&self, module: &ModulePath) -> String {
        self.0[module].file.display().to_string()
    }

    /// `impl` blocks of no trait that stand neither in the file of their type nor in one right below it: file and type.
    pub fn scattered(&self) -> BTreeSet<(String, String)> {
        let mut found = BTreeSet::new();
        for (at, module) in &self.0 {
            for path in &module.impls {
                // What a macro defines is defined where it is called.
                let of = self.leads_to(at, path).unwrap_or_else(|| at.clone());
                if *at != of && at.split_last().is_none_or(|(_, above)| above != of) {
                    found.insert((self.file(at), path.join("::")));
                }
            }
        }
        found
    }

    /// The module that defines what a path of another names, whatever re-exports it goes through; `None`: another package has it.
    fn leads_to(&self, from: &ModulePath, path: &[String]) -> Option<ModulePath> {
        self.walk(from, path, 32)
    }

    /// `left`: re-exports that it may still go through.
    fn walk(&self, from: &ModulePath, path: &[String], left: usize) -> Option<ModulePath> {
        let mut at = from.clone();
        for (k, segment) in path.iter().enumerate() {
            let module = self.0.get(&at)?;
            match segment.as_str() {
                "crate" => at.clear(),
                "super" => _ = at.pop(),
                "self" => {}
                child if module.children.contains(child) => at.push(child.to_owned()),
                own if module.items.contains(own) => return Some(at),
                name => {
                    let Some(stands_for) = module.uses.get(name) else { return (k > 0).then_some(at) };
                    let path = [stands_for, &path[k + 1..]].concat();
                    return left.checked_sub(1).and_then(|left| self.walk(&at, &path, left));
                }
            }
        }
        Some(at)
    }
}
