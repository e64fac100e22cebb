//! Settings of the diagnosis as a file: the numbers that a verdict depends on.

use std::fmt::Write as _;
use std::path::Path;

use anyhow::bail;
use whorl_identification::Settings;
use whorl_params::{ParameterTree, Value};

/// Section of the file.
const SECTION: &str = "diagnosis";

/// Columns of a comment.
const WIDTH: usize = 110;

/// Settings as a file that [`read`] reads, the meaning of each above it; those of the predictor, which the file does not set, as comments
/// at its end.
#[must_use]
pub fn as_yaml(settings: &Settings) -> String {
    // Writing to a String cannot fail.
    let mut text = format!("{SECTION}:\n");
    for setting in settings.listed() {
        for line in wrapped(&setting.doc) {
            let _ = writeln!(text, "  # {line}");
        }
        let _ = writeln!(text, "  {}: {}", setting.name, setting.value);
    }
    let _ = writeln!(
        text,
        "\n# The predictor, by which samples judge every explanation; this file does not set its numbers."
    );
    for setting in whorl_prediction::Settings::default().listed() {
        for line in wrapped(&setting.doc) {
            let _ = writeln!(text, "#   # {line}");
        }
        let _ = writeln!(text, "#   {}: {}", setting.name, setting.value);
    }
    text
}

/// Words in lines that are not longer than a comment may be.
fn wrapped(text: &str) -> Vec<String> {
    let mut lines = vec![String::new()];
    for word in text.split_whitespace() {
        let is_full = lines.last().is_some_and(|line| !line.is_empty() && line.len() + word.len() >= WIDTH);
        if is_full {
            lines.push(String::new());
        }
        if let Some(line) = lines.last_mut() {
            if !line.is_empty() {
                line.push(' ');
            }
            line.push_str(word);
        }
    }
    lines
}

/// Reads a file of settings; those that it leaves out keep their defaults.
///
/// # Errors
/// When it cannot be read, or a name or a value is not allowed: with file, line and what is allowed.
pub fn read(path: &Path) -> anyhow::Result<Settings> {
    let parameters = ParameterTree::load_for(path, SECTION)?;
    let mut settings = Settings::default();
    for entry in parameters.iter() {
        // What is no number is none that is allowed.
        let value = match &entry.value {
            Value::Integer(number) => *number as f64,
            Value::Double(number) => *number,
            _ => f64::NAN,
        };
        if let Err(problem) = settings.set(&entry.key, value) {
            bail!("{}: {} = {}: {problem}; all stand under {SECTION}:", entry.origin, entry.key, entry.value);
        }
    }
    Ok(settings)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn read_text(text: &str) -> anyhow::Result<Settings> {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("settings.yaml");
        std::fs::write(&path, text).unwrap();
        read(&path)
    }

    #[test]
    fn what_is_printed_is_read_back() {
        let mut changed = Settings::default();
        changed.set("worth_mentioning", 5e-4).unwrap();
        changed.set("unusual_odds", 400.0).unwrap();
        let text = as_yaml(&changed);
        assert_eq!(read_text(&text).unwrap(), changed);
        // Before a line of the predictor stand six characters.
        assert!(text.lines().all(|line| line.chars().count() <= WIDTH + 6), "{text}");
        // Those of the predictor are shown, and not set.
        for line in [
            "#   start_passes: 12",
            "#   level_needed_deviations: 3.09",
            "#   # How often a start is found anew at most.",
        ] {
            assert!(text.lines().any(|other| other == line), "{line}\n{text}");
        }
        // Each stands below what it means.
        let lines: Vec<&str> = text.lines().collect();
        let at = lines.iter().position(|line| *line == "  sure: 0.95").unwrap();
        assert_eq!(
            lines[at - 1],
            "  # Probability that makes an answer [1]. Convention. Allowed: a number between 0 and 1."
        );
    }

    #[test]
    fn a_file_may_hold_some_and_nothing_that_there_is_not() {
        let some = read_text("diagnosis:\n  at_work_s: 40\n").unwrap();
        assert_eq!(some, {
            let mut settings = Settings::default();
            settings.set("at_work_s", 40.0).unwrap();
            settings
        });
        for (line, parts) in [
            (
                "  at_work: 40",
                ["settings.yaml:2: at_work = 40", "allowed: present,", "at_work_s, unusual_size"],
            ),
            ("  sure: 1.5", ["settings.yaml:2: sure = 1.5", "a number between", "0 and 1"]),
            ("  sure: often", ["settings.yaml:2: sure = ", "a number between", "0 and 1"]),
            ("  at_work_s: -1", ["settings.yaml:2: at_work_s = -1", "a number", "> 0"]),
        ] {
            let error = read_text(&format!("diagnosis:\n{line}\n")).unwrap_err().to_string();
            assert!(parts.iter().all(|part| error.contains(part)), "{error}");
        }
        let error = read_text("other:\n  sure: 0.9\n").unwrap_err().to_string();
        assert!(error.contains("diagnosis"), "{error}");
    }
}
