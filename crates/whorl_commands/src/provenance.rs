//! Provenance of adopted numbers.

use std::path::{Path, PathBuf};

use anyhow::Context;
use sha2::{Digest, Sha256};

/// Data and command: names of the runs with the hash of their measurements.
///
/// # Errors
/// When a run cannot be read.
pub fn provenance(paths: &[PathBuf], command: &str) -> anyhow::Result<String> {
    let mut runs = Vec::new();
    for path in paths {
        let name = path.file_name().unwrap_or(path.as_os_str()).to_string_lossy();
        runs.push(format!("{name} (sha256 {})", data_hash(path)?));
    }
    Ok(format!("{}; {command}", runs.join(", ")))
}

/// First digits of the hash of a run's measurements: the bag's files by name.
fn data_hash(path: &Path) -> anyhow::Result<String> {
    let bag = path.join("bag");
    let mut files = Vec::new();
    if path.is_dir() {
        let folder = if bag.is_dir() { bag.as_path() } else { path };
        for entry in std::fs::read_dir(folder).with_context(|| format!("cannot read {}", folder.display()))? {
            let file = entry?.path();
            if file.extension().is_some_and(|e| ["mcap", "csv", "db3"].iter().any(|x| e == *x)) {
                files.push(file);
            }
        }
        files.sort();
    } else {
        files.push(path.to_owned());
    }
    let mut hash = Sha256::new();
    for file in &files {
        let mut reader =
            whorl_files::open_file(file).with_context(|| format!("cannot read {}", file.display()))?;
        let mut buffer = vec![0; 1 << 16];
        loop {
            let count = std::io::Read::read(&mut reader, &mut buffer)?;
            if count == 0 {
                break;
            }
            hash.update(buffer.get(..count).unwrap_or(&[]));
        }
    }
    Ok(hash.finalize().iter().take(6).map(|byte| format!("{byte:02x}")).collect())
}
