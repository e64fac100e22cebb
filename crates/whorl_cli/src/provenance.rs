//! Provenance of adopted numbers.

use whorl_commands::provenance;

use crate::runs::RunArguments;

/// Data and command: names of the runs with the hash of their measurements, and the command line of this process.
pub fn provenance_of_this(arguments: &RunArguments) -> anyhow::Result<String> {
    let command = std::env::args().skip(1).collect::<Vec<_>>().join(" ");
    provenance::provenance(&arguments.runs, &format!("whorl {command}"))
}
