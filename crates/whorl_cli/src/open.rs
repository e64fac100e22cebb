//! `whorl open`: the workbench, from a recording to the missing effect in a browser.

use std::net::{Ipv4Addr, SocketAddr};
use std::path::{Path, PathBuf};

use anyhow::{Context as _, bail};
use clap::Args;
use signal_hook::consts::{SIGINT, SIGTERM};
use signal_hook::iterator::Signals;
use whorl_serving::{Door, Visitor, token};
use whorl_workbench::{LARGEST_FILE, Workbench, routes};

use crate::output::say;

/// Where the page is served unless another port is given: beside that of `whorl live`.
const PORT: u16 = 8471;
/// In the environment: the token of the page, chosen by who started it. Nobody but this user can read it.
const TOKEN: &str = "WHORL_OPEN_TOKEN";

#[derive(Debug, Args)]
pub struct Arguments {
    /// A folder with recordings and the files of a platform, or some of these files: recordings (CSV, bag, run directory), a platform's
    /// file, a map of channels; all in one folder [default: the working directory].
    #[arg(value_name = "FILES or FOLDER")]
    items: Vec<PathBuf>,
    /// Port; 0: any free one.
    #[arg(long, default_value_t = PORT)]
    port: u16,
}

/// Carries out `whorl open`, until it is stopped.
pub fn run(arguments: &Arguments) -> anyhow::Result<()> {
    let (folder, files) = opened(&arguments.items)?;
    let bench = whorl_workbench::open(&folder, &files)?;
    let runtime = tokio::runtime::Builder::new_current_thread().enable_all().build()?;
    let served = runtime.block_on(serve(bench, arguments.port));
    // A computation that runs is of no use to anybody any more, and nothing but its end would write.
    runtime.shutdown_background();
    served
}

/// The folder, and the files of it that were named.
fn opened(items: &[PathBuf]) -> anyhow::Result<(PathBuf, Vec<PathBuf>)> {
    let is_plain_folder = |path: &Path| {
        path.is_dir() && !path.join("metadata.yaml").exists() && !path.join("manifest.yaml").exists()
    };
    match items {
        [] => Ok((PathBuf::from("."), Vec::new())),
        [only] if is_plain_folder(only) => Ok((only.clone(), Vec::new())),
        _ => {
            let whole = |path: &PathBuf| {
                if is_plain_folder(path) {
                    bail!(
                        "{}: a folder is opened by itself; name files of one folder, or the folder",
                        path.display()
                    );
                }
                path.canonicalize().with_context(|| format!("cannot open {}", path.display()))
            };
            let files = items.iter().map(whole).collect::<anyhow::Result<Vec<PathBuf>>>()?;
            let parents = files.iter().filter_map(|file| file.parent());
            let common =
                |a: PathBuf, b: &Path| a.ancestors().find(|above| b.starts_with(above)).map(Path::to_owned);
            let mut folder =
                files.first().and_then(|file| file.parent()).context("no file was given")?.to_owned();
            for parent in parents {
                folder = common(folder, parent).with_context(|| "the files have no folder in common")?;
            }
            Ok((folder, files))
        }
    }
}

async fn serve(bench: std::sync::Arc<Workbench>, port: u16) -> anyhow::Result<()> {
    let wanted = SocketAddr::from((Ipv4Addr::LOCALHOST, port));
    let listener = tokio::net::TcpListener::bind(wanted)
        .await
        .with_context(|| format!("cannot serve at {wanted}: --port takes another one, 0 any that is free"))?;
    let address = listener.local_addr()?;
    let token = token::chosen(TOKEN).map_or_else(token::secret, Ok)?;
    say!("{} open at http://{address}/#token={token}", bench.folder().display());
    say!("Everything stays on this computer. Ctrl-C ends it.");
    let (stop, stopped) = tokio::sync::oneshot::channel();
    let mut signals = Signals::new([SIGINT, SIGTERM])?;
    std::thread::Builder::new().name("signals".to_owned()).spawn(move || {
        if signals.forever().next().is_some() {
            let _ = stop.send(());
        }
    })?;
    let routes = routes(bench, address, token).into_make_service_with_connect_info::<Visitor>();
    let serving = axum::serve(Door::new(listener, LARGEST_FILE), routes);
    tokio::select! {
        _ = stopped => Ok(()),
        ended = serving.into_future() => Ok(ended?),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn files_are_opened_in_the_folder_that_they_share() {
        let folder = tempfile::tempdir().unwrap();
        let at = |name: &str| folder.path().canonicalize().unwrap().join(name);
        std::fs::create_dir_all(at("runs/one")).unwrap();
        for file in ["rig.yaml", "runs/a.csv", "runs/one/metadata.yaml"] {
            std::fs::write(at(file), "").unwrap();
        }
        let files = [at("runs/a.csv"), at("rig.yaml")];
        assert_eq!(opened(&files).unwrap(), (at(""), files.to_vec()));
        let run = [at("runs/one")];
        assert_eq!(opened(&run).unwrap(), (at("runs"), run.to_vec()), "a bag's folder is a file");
        assert_eq!(opened(&[at("runs")]).unwrap(), (at("runs"), Vec::new()));
        assert!(opened(&[at("runs"), at("rig.yaml")]).unwrap_err().to_string().contains("by itself"));
        assert!(opened(&[at("gone.csv")]).unwrap_err().to_string().contains("cannot open"));
    }
}
