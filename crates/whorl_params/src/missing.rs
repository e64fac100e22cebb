//! What is said of a file that is not there.

use std::path::Path;

use whorl_math::words::did_you_mean;

/// "does not exist", and what may help: the file or folder beside it that is called nearly so, or the first folder of the
/// path that is not there either.
#[must_use]
pub fn missing(path: &Path) -> String {
    let folder = path.parent().filter(|folder| !folder.as_os_str().is_empty()).unwrap_or(Path::new("."));
    if !folder.is_dir() {
        let absent = folder.ancestors().take_while(|f| !f.as_os_str().is_empty() && !f.exists()).last();
        return match absent {
            Some(absent) => format!("does not exist; there is no folder {}", absent.display()),
            None => "does not exist".to_owned(),
        };
    }
    let name = path.file_name().unwrap_or_default().to_string_lossy();
    let mut names: Vec<String> = std::fs::read_dir(folder)
        .into_iter()
        .flatten()
        .flatten()
        .map(|entry| entry.file_name().to_string_lossy().into_owned())
        .collect();
    names.sort_unstable();
    // As the user would type it.
    let as_typed = |name: &String| path.with_file_name(name).display().to_string();
    let candidates: Vec<String> = names.iter().map(as_typed).collect();
    let near = did_you_mean(&name, names.iter().map(String::as_str)).map(|_| {
        did_you_mean(&path.display().to_string(), candidates.iter().map(String::as_str)).unwrap_or_default()
    });
    match near {
        Some(near) if !near.is_empty() => format!("does not exist; {near}"),
        _ => "does not exist".to_owned(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_near_name_or_the_missing_folder_is_named() {
        let folder = tempfile::tempdir().unwrap();
        std::fs::write(folder.path().join("whorl_1.yaml"), "").unwrap();
        let said = |name: &str| missing(&folder.path().join(name));
        let near = folder.path().join("whorl_1.yaml").display().to_string();
        assert_eq!(said("whorl1.yaml"), format!("does not exist; did you mean {near}?"));
        assert_eq!(said("quite_another_thing.csv"), "does not exist");
        let absent = folder.path().join("parms").display().to_string();
        assert_eq!(said("parms/deeper/whorl_1.yaml"), format!("does not exist; there is no folder {absent}"));
    }
}
