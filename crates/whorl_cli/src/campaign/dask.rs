//! Distributes a campaign with Dask, through the Python package: `python3 -m whorl campaign`.

use std::path::Path;
use std::process::{Command, Stdio};

use anyhow::{Context, bail};

use super::Arguments;

/// Names the interpreter that has the package, where it is not `python3`.
const INTERPRETER: &str = "WHORL_PYTHON";

/// Computes what is missing on the workers of a scheduler, and waits for it.
pub fn distribute(arguments: &Arguments, scheduler: &str, folder: &Path) -> anyhow::Result<()> {
    let python = std::env::var_os(INTERPRETER).unwrap_or_else(|| "python3".into());
    let name = python.to_string_lossy().into_owned();
    let mut command = Command::new(&python);
    command.args(["-m", "whorl", "campaign"]).arg(&arguments.campaign).arg("--out").arg(folder);
    command.args(["--scheduler", scheduler]);
    if let Some(params) = &arguments.params {
        command.arg("--params").arg(params);
    }
    if let Some(seeds) = arguments.seeds {
        command.args(["--seeds", &seeds.to_string()]);
    }
    // Progress goes to the error stream, the reason of a failure to the other.
    let done = command.stdin(Stdio::null()).stderr(Stdio::inherit()).output();
    let done = done.with_context(|| {
        format!("cannot start `{name}`; Dask needs Python with the package whorl, and {INTERPRETER} names the interpreter")
    })?;
    if done.status.success() {
        return Ok(());
    }
    let why = String::from_utf8_lossy(&done.stdout);
    match why.trim() {
        "" => bail!(
            "`{name} -m whorl campaign` failed ({}); the package whorl has to be installed there, with dask and distributed; \
             {INTERPRETER} names another interpreter",
            done.status
        ),
        why => bail!("{why}"),
    }
}
