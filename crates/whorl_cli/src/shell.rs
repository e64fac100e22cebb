//! `whorl completions` and `whorl man`: what a shell knows of the command.

use std::path::Path;

use anyhow::Context;
use clap_complete::Shell;

use crate::output::{say, text};

/// Prints the completions of a shell.
pub fn completions(shell: Shell) {
    let mut script = Vec::new();
    clap_complete::generate(shell, &mut crate::command_line(), "whorl", &mut script);
    text(&String::from_utf8_lossy(&script));
}

/// Writes a manual page for the command and for each of its commands.
pub fn man(folder: &Path) -> anyhow::Result<()> {
    std::fs::create_dir_all(folder).with_context(|| format!("cannot create {}", folder.display()))?;
    clap_mangen::generate_to(crate::command_line(), folder)
        .with_context(|| format!("cannot write manual pages into {}", folder.display()))?;
    say!("manual pages: {} (try: man -l {})", folder.display(), folder.join("whorl.1").display());
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_command_is_described_and_well_formed() {
        let command = crate::command_line();
        command.clone().debug_assert();
        for sub in command.get_subcommands() {
            assert!(sub.get_about().is_some(), "{} has no description", sub.get_name());
        }
    }

    #[test]
    fn manual_pages_are_written_for_every_command() {
        let folder = tempfile::tempdir().unwrap();
        man(folder.path()).unwrap();
        for name in ["whorl.1", "whorl-live.1", "whorl-diagnose.1"] {
            let page = std::fs::read_to_string(folder.path().join(name)).unwrap();
            assert!(page.contains(".SH SYNOPSIS"), "{name}");
        }
    }
}
