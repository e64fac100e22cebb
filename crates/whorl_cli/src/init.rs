//! `whorl init`: the parameter folder that this program was built with, for those who have no checkout.

use std::path::{Path, PathBuf};

use anyhow::{Context, bail};
use clap::Args;

use crate::output::say;

/// Path below `params/` and content of every file.
const FILES: &[(&str, &[u8])] = include!(concat!(env!("OUT_DIR"), "/params.rs"));

#[derive(Debug, Args)]
pub struct Arguments {
    /// Folder that gets params/, and later runs/.
    #[arg(value_name = "FOLDER", default_value = ".")]
    folder: PathBuf,
}

/// Carries out `whorl init`. Files that are there already, with another content, are somebody's: then nothing is written.
pub fn run(arguments: &Arguments) -> anyhow::Result<()> {
    let params = arguments.folder.join("params");
    let (mut missing, mut others) = (Vec::new(), Vec::new());
    for (name, content) in FILES {
        let file = params.join(name);
        match std::fs::read(&file) {
            Ok(there) if there == *content => {}
            Ok(_) => others.push(file.display().to_string()),
            Err(error) if error.kind() == std::io::ErrorKind::NotFound => missing.push((file, *content)),
            Err(error) => return Err(error).with_context(|| format!("cannot read {}", file.display())),
        }
    }
    if let Some(first) = others.first() {
        let more = match others.len() {
            1 => String::new(),
            count => format!(" and {} more", count - 1),
        };
        bail!(
            "{first}{more}: not as this version of Whorl has it, so nothing was written; to compare, write its files elsewhere: \
             whorl init FOLDER"
        );
    }
    for (file, content) in &missing {
        write(file, content)?;
    }
    match missing.len() {
        0 => say!("{} has all {} parameter files already", params.display(), FILES.len()),
        written => say!("{}: {written} parameter files, explained in README.md there", params.display()),
    }
    let go = match arguments.folder.as_path() {
        here if here == Path::new(".") => String::new(),
        folder => format!("cd {} && ", folder.display()),
    };
    say!("next: {go}whorl run leader_follower_short");
    Ok(())
}

/// Writes all parameter files into a folder, over those that are there.
pub fn write_into(params: &Path) -> anyhow::Result<()> {
    FILES.iter().try_for_each(|(name, content)| write(&params.join(name), content))
}

fn write(file: &Path, content: &[u8]) -> anyhow::Result<()> {
    let folder = file.parent().unwrap_or(Path::new("."));
    std::fs::create_dir_all(folder).with_context(|| format!("cannot create {}", folder.display()))?;
    whorl_files::write_file(file, content).with_context(|| format!("cannot write {}", file.display()))
}
