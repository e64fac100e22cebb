//! No file outside the effects' folder names an effect by its id: the test reads the sources.

use std::path::{Path, PathBuf};

use super::super::catalogue;

/// Source files below a folder that are compiled without tests, their text cut where tests begin.
fn sources(folder: &Path, found: &mut Vec<(PathBuf, String)>) {
    let entries = std::fs::read_dir(folder).unwrap_or_else(|error| panic!("{}: {error}", folder.display()));
    let paths: Vec<PathBuf> = entries.map(|entry| entry.unwrap().path()).collect();
    let texts: Vec<(PathBuf, String)> = paths
        .iter()
        .filter(|path| path.extension().is_some_and(|e| e == "rs"))
        .map(|path| (path.clone(), std::fs::read_to_string(path).unwrap()))
        .collect();
    // Modules that are only there for tests, by their declarations in this folder, and those of a file's own folder.
    let of_tests: Vec<String> =
        texts.iter().flat_map(|(_, text)| modules_of_tests(text)).map(str::to_owned).collect();
    let is_test = |path: &Path| {
        let name = path.file_stem().unwrap_or_default();
        name == "tests" || of_tests.iter().any(|module| name == module.as_str())
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

/// The texts in quotes, of any form, without those in comments.
fn texts(code: &str) -> Vec<&str> {
    let mut found = Vec::new();
    let mut rest = code;
    while let Some(at) = rest.find(['"', '\'', '/']) {
        let before = &rest[..at];
        let from = &rest[at..];
        rest = if from.starts_with("//") {
            from.split_once('\n').map_or("", |(_, after)| after)
        } else if let Some(text) = from.strip_prefix('"') {
            let hashes = before.len() - before.trim_end_matches('#').len();
            let is_raw = before[..before.len() - hashes].ends_with('r');
            let closing = format!("\"{}", &before[before.len() - hashes..]);
            let end = if is_raw { text.find(&closing) } else { end_of_text(text) };
            let end = end.unwrap_or(text.len());
            found.push(&text[..end]);
            text.get(end + 1..).unwrap_or_default()
        } else {
            // A quote of a character must not open a text; of a lifetime nothing but the mark is skipped.
            let characters = ["'\"'", "'\\\"'", "'/'", "'\\''"];
            let length = characters.iter().find(|c| from.starts_with(**c)).map_or(1, |c| c.len());
            &from[length..]
        };
    }
    found
}

/// Where the first quote stands that no backslash escapes.
fn end_of_text(text: &str) -> Option<usize> {
    let mut is_escaped = false;
    text.bytes().position(|byte| {
        let ends = byte == b'"' && !is_escaped;
        is_escaped = byte == b'\\' && !is_escaped;
        ends
    })
}

/// Texts of the code that hold an id as a word, alone, in a path or in a sentence.
fn texts_with<'t>(code: &'t str, id: &str) -> Vec<&'t str> {
    let is_name = |c: Option<char>| c.is_some_and(|c| c.is_alphanumeric() || c == '_');
    let holds = |text: &&str| {
        text.match_indices(id).any(|(at, _)| {
            !is_name(text[..at].chars().next_back()) && !is_name(text[at + id.len()..].chars().next())
        })
    };
    // An id of one plain word is also a word of sentences.
    let is_plain = !id.contains('_');
    texts(code).into_iter().filter(|text| !(is_plain && text.contains(' '))).filter(holds).collect()
}

/// Help shows names as users type them; a test of the command line tries each of these lines.
const HELP: &str = "whorl_cli/src/examples.rs";

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
    sources(&root.join("python/src"), &mut files);
    assert!(files.len() > 300, "the sources are there: {}", files.len());
    let own = effects.canonicalize().unwrap();
    files.retain(|(path, _)| !path.canonicalize().unwrap().starts_with(&own) && !path.ends_with(HELP));
    let mut named = Vec::new();
    for (path, text) in &files {
        for id in catalogue().iter().map(|effect| effect.info().id) {
            named.extend(
                texts_with(text, id).iter().map(|line| format!("{}: {}", path.display(), line.trim())),
            );
        }
    }
    assert!(named.is_empty(), "say it in the effect's own file instead:\n{}", named.join("\n"));
}

#[test]
fn ids_are_seen_in_texts_and_not_in_comments_or_names() {
    let count = |code: &str, id: &str| texts_with(code, id).len();
    assert_eq!(count("a\n  \"slosh\" => 1,\n", "slosh"), 1);
    assert_eq!(count("get(\"effects.slosh\")", "slosh"), 1);
    assert_eq!(count("// the \"slosh\" of a tank\nlet slosh = sloshing(\"no_slosh_here\");", "slosh"), 0);
    // In sentences, and in what goes over several lines, raw or not.
    assert_eq!(count("say(\"so wheel_friction \\\n   cannot be told\")", "wheel_friction"), 1);
    assert_eq!(count("f(r#\"x: \"wheel_friction: {a: 1}\n\"#, '\"', \"b\")", "wheel_friction"), 1);
    assert_eq!(
        texts("x('\"', \"a\\\"b\", r\"c\\\", 'd: loop {}, \"e\") // \"f\"\n / \"g\""),
        ["a\\\"b", "c\\", "e", "g"]
    );
    let text = "mod a;\n#[cfg(test)]\nmod b;\nfn f() {}\n#[cfg(test)]\nmod tests {\n\"slosh\"\n}\n";
    assert_eq!(modules_of_tests(text).collect::<Vec<_>>(), ["b"]);
    assert!(without_tests(text).contains("fn f()") && count(&without_tests(text), "slosh") == 0);
}

#[test]
fn effects_say_which_data_they_need() {
    use crate::PlatformModel;
    use crate::effects::{Aid, Need, hard_without, untold_without};
    let whorl_1 = PlatformModel::whorl_1_reference();
    assert_eq!(untold_without(Need::Temperature, &whorl_1), ["gyro_temperature"]);
    assert_eq!(hard_without(Aid::Heading, &whorl_1), ["air_current", "magnetic_torque", "harness_spring"]);
    // The bus voltage acts on jets and wheels: their commands show it, either of them.
    assert!(!untold_without(Need::WheelCommands, &whorl_1).contains(&"supply_voltage"));
    assert!(!untold_without(Need::Jets, &whorl_1).contains(&"supply_voltage"));
    let mut without_jets = whorl_1.clone();
    without_jets.jets_mut().clear();
    assert!(untold_without(Need::WheelCommands, &without_jets).contains(&"supply_voltage"));
    // What a platform has no parts for is not missed.
    assert!(untold_without(Need::Jets, &without_jets).iter().all(|id| !id.starts_with("thruster")));
    assert!(untold_without(Need::Gimbals, &whorl_1).is_empty());
}
