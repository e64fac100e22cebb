//! Files that import each other in a circle.

use std::collections::{BTreeMap, BTreeSet};

/// Imports between files: who, whom, and where it says so.
pub type Imports = BTreeMap<String, BTreeMap<String, String>>;

/// Files that are in one circle or in several that share files, with the imports between them.
pub fn circles(imports: &Imports) -> BTreeMap<Vec<String>, Vec<String>> {
    let reached = |from: &String| {
        let (mut reached, mut open) = (BTreeSet::new(), vec![from]);
        while let Some(next) = open.pop() {
            for to in imports.get(next).into_iter().flat_map(BTreeMap::keys) {
                if reached.insert(to) {
                    open.push(to);
                }
            }
        }
        reached
    };
    let reached: BTreeMap<&String, BTreeSet<&String>> =
        imports.keys().map(|file| (file, reached(file))).collect();
    let mut found = BTreeMap::new();
    for (file, others) in reached.iter().filter(|(file, others)| others.contains(*file)) {
        let is_back = |other: &&&String| reached.get(**other).is_some_and(|further| further.contains(*file));
        let members: Vec<String> = others.iter().filter(is_back).map(|member| (*member).clone()).collect();
        let places = members.iter().flat_map(|from| {
            let inside = imports[from].iter().filter(|(to, _)| members.contains(to));
            inside.map(|(_, place)| place.clone())
        });
        let places = places.collect();
        found.insert(members, places);
    }
    found
}
