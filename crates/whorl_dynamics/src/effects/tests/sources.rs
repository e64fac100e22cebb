//! No file outside the effects' folder names an effect by its id: the test reads the sources.

use std::path::{Path, PathBuf};

use super::super::catalogue;

/// Source files below a folder that are compiled without tests, their text cut where tests begin.
fn sources(folder: &Path, found: &mut Vec<(PathBuf, String)>) {
    let Ok(entries) = std::fs::read_dir(folder) else { return };
    let paths: Vec<PathBuf> = entries.map(|entry| entry.unwrap().path()).collect();
    let texts: Vec<(PathBuf, String)> = paths
        .iter()
        .filter(|path| path.extension().is_some_and(|e| e == "rs"))
        .map(|path| (path.clone(), std::fs::read_to_string(path).unwrap()))
        .collect();
    // Modules that are only there for tests, by their declarations in this folder.
    let of_tests: Vec<String> =
        texts.iter().flat_map(|(_, text)| modules_of_tests(text)).map(str::to_owned).collect();
    let is_test = |path: &Path| {
        let name = path.file_stem().unwrap_or_default();
        of_tests.iter().any(|module| name == module.as_str())
    };
    found.extend(texts.into_iter().filter(|(path, _)| !is_test(path)).map(|(p, t)| (p, without_tests(&t))));
    for path in paths.iter().filter(|path| path.is_dir() && !is_test(path)) {
        sources(path, found);
    }
}

fn modules_of_tests(text: &str) -> impl Iterator<Item = &str> {
    text.split("#[cfg(test)]").skip(1).filter_map(|after| {
        let declared = after.trim_start().trim_start_matches("pub(crate) ").strip_prefix("mod ")?;
        let (name, _) = declared.split_once(';')?;
        name.chars().all(|c| c.is_alphanumeric() || c == '_').then_some(name)
    })
}

/// The text up to the module of tests at its end.
fn without_tests(text: &str) -> String {
    text.split("#[cfg(test)]\nmod tests {").next().unwrap_or_default().to_owned()
}

/// Lines of code that hold an id in quotes, alone or as part of a path.
fn lines_with<'t>(text: &'t str, id: &str) -> Vec<&'t str> {
    let is_quote = |c: Option<char>| matches!(c, Some('"' | '`' | '\''));
    let is_name = |c: Option<char>| c.is_some_and(|c| c.is_alphanumeric() || c == '_');
    let holds = |line: &&str| {
        line.match_indices(id).any(|(at, _)| {
            let (before, after) = (line[..at].chars().next_back(), line[at + id.len()..].chars().next());
            !is_name(before) && !is_name(after) && (is_quote(before) || is_quote(after))
        })
    };
    text.lines().filter(|line| !line.trim_start().starts_with("//")).filter(holds).collect()
}

#[test]
fn no_other_source_names_an_effect() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("../..");
    let effects = Path::new(env!("CARGO_MANIFEST_DIR")).join("src/effects");
    let mut files = Vec::new();
    for group in ["crates", "nodes"] {
        for member in std::fs::read_dir(root.join(group)).unwrap() {
            sources(&member.unwrap().path().join("src"), &mut files);
        }
    }
    sources(&root.join("msgs/src"), &mut files);
    assert!(files.len() > 300, "the sources are there: {}", files.len());
    let own = effects.canonicalize().unwrap();
    files.retain(|(path, _)| !path.canonicalize().unwrap().starts_with(&own));
    let mut named = Vec::new();
    for (path, text) in &files {
        for id in catalogue().iter().map(|effect| effect.info().id) {
            named.extend(
                lines_with(text, id).iter().map(|line| format!("{}: {}", path.display(), line.trim())),
            );
        }
    }
    assert!(named.is_empty(), "say it in the effect's own file instead:\n{}", named.join("\n"));
}

#[test]
fn ids_are_seen_in_code_and_not_in_comments_or_names() {
    assert_eq!(lines_with("a\n  \"slosh\" => 1,\n", "slosh").len(), 1);
    assert_eq!(lines_with("get(\"effects.slosh\")", "slosh").len(), 1);
    assert_eq!(
        lines_with("// the `slosh` of a tank\nlet slosh = sloshing(\"no_slosh_here\");", "slosh").len(),
        0
    );
    let text = "mod a;\n#[cfg(test)]\nmod b;\nfn f() {}\n#[cfg(test)]\nmod tests {\n\"slosh\"\n}\n";
    assert_eq!(modules_of_tests(text).collect::<Vec<_>>(), ["b"]);
    assert!(without_tests(text).contains("fn f()") && lines_with(&without_tests(text), "slosh").is_empty());
}
