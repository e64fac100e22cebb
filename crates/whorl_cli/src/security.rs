//! `whorl security`: keystores of SROS2 for Whorl's nodes.

use std::path::{Path, PathBuf};

use anyhow::{Context as _, bail};
use clap::Subcommand;
use serde_json::json;
use whorl_ros::environment::Network;
use whorl_security::{ENCLAVE_FILES, Finding, Keystore, policy};

use crate::output::{JsonArgument, say, tell};

#[derive(Debug, Subcommand)]
pub enum Command {
    /// Makes a keystore with an enclave for each node, or adds what it lacks and renews the permissions of these nodes.
    Create {
        /// Its folder, as in ROS_SECURITY_KEYSTORE.
        keystore: PathBuf,
        /// Names of the platforms.
        #[arg(long, default_values_t = ["whorl_1".to_owned(), "whorl_2".to_owned()], num_args = 1.., value_name = "PLATFORM")]
        platforms: Vec<String>,
        /// ROS domain that it is for [default: ROS_DOMAIN_ID, or 0].
        #[arg(long, value_name = "ID", value_parser = clap::value_parser!(u16).range(0..=232))]
        domain: Option<u16>,
    },
    /// Lists the enclaves of a keystore.
    List {
        /// Its folder.
        keystore: PathBuf,
        #[command(flatten)]
        json: JsonArgument,
    },
    /// Checks signatures, names, dates, domain and rights of every enclave.
    Check {
        /// Its folder.
        keystore: PathBuf,
        /// ROS domain that it should be for [default: ROS_DOMAIN_ID, or 0].
        #[arg(long, value_name = "ID", value_parser = clap::value_parser!(u16).range(0..=232))]
        domain: Option<u16>,
        #[command(flatten)]
        json: JsonArgument,
    },
}

/// Carries out `whorl security`.
pub fn run(command: &Command) -> anyhow::Result<()> {
    match command {
        Command::Create { keystore, platforms, domain } => {
            let domain = domain_or_environment(*domain)?;
            let keystore = complete(keystore, platforms, domain, Renew::Permissions)?;
            let count = keystore.enclaves()?.len();
            say!("{}: {count} enclaves for domain {domain}", keystore.path().display());
            say!(
                "to use it: export ROS_DOMAIN_ID={domain} ROS_SECURITY_ENABLE=true ROS_SECURITY_STRATEGY=Enforce \
                 ROS_SECURITY_KEYSTORE={}",
                std::path::absolute(keystore.path())?.display()
            );
            judged(&keystore, domain)
        }
        Command::List { keystore, json } => {
            let enclaves = Keystore::open(keystore)?.enclaves()?;
            enclaves.iter().for_each(|line| say!("{line}"));
            json.write(|| Ok(enclaves.iter().map(ToString::to_string).collect::<Vec<_>>()))
        }
        Command::Check { keystore, domain, json } => {
            let keystore = Keystore::open(keystore)?;
            let domain = domain_or_environment(*domain)?;
            let count = keystore.enclaves()?.len();
            json.write(|| {
                let found = keystore.check(domain, whorl_ros::wall_clock().0.div_euclid(1_000_000_000))?;
                let finding =
                    |f: &Finding| json!({"enclave": f.enclave, "text": f.text, "is_fatal": f.is_fatal});
                let findings: Vec<_> = found.iter().map(finding).collect();
                Ok(json!({"schema": 1, "domain": domain, "enclaves": count, "findings": findings}))
            })?;
            judged(&keystore, domain)?;
            say!("{count} enclaves: signatures, names, dates and domain {domain} are right");
            Ok(())
        }
    }
}

/// What is done to enclaves that are there already.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Renew {
    /// Nothing: whoever made them may have granted something else.
    Nothing,
    /// Their permissions are written anew, as Whorl grants them.
    Permissions,
}

/// Makes what a keystore lacks for these platforms.
pub fn complete(path: &Path, platforms: &[String], domain: u16, renew: Renew) -> anyhow::Result<Keystore> {
    let now_s = whorl_ros::wall_clock().0.div_euclid(1_000_000_000);
    let keystore = Keystore::create(path, domain, now_s)?;
    for grant in policy::grants(platforms) {
        let folder = keystore.enclave_folder(&grant.enclave)?;
        let is_there = ENCLAVE_FILES.iter().all(|file| folder.join(file).is_file());
        if !is_there || renew == Renew::Permissions {
            keystore.add(&grant, domain, now_s)?;
        }
    }
    Ok(keystore)
}

/// Prints what is wrong; fails if anything would keep a node from working.
pub fn judged(keystore: &Keystore, domain: u16) -> anyhow::Result<()> {
    let now_s = whorl_ros::wall_clock().0.div_euclid(1_000_000_000);
    let findings = keystore.check(domain, now_s)?;
    for Finding { enclave, text, is_fatal } in &findings {
        tell(format_args!("{}: {enclave}: {text}", if *is_fatal { "error" } else { "warning" }));
    }
    if findings.iter().any(|finding| finding.is_fatal) {
        bail!("{} cannot be used as it is", keystore.path().display());
    }
    Ok(())
}

fn domain_or_environment(domain: Option<u16>) -> anyhow::Result<u16> {
    Ok(match domain {
        Some(domain) => domain,
        None => Network::from_environment()?.domain_id,
    })
}

/// The environment of a secured experiment's processes: with the keystore of `ROS_SECURITY_KEYSTORE`, to which missing
/// enclaves are added, or with one of our own for this domain.
pub fn environment(platforms: &[String]) -> anyhow::Result<Vec<(String, String)>> {
    let domain = Network::from_environment()?.domain_id;
    let named = std::env::var("ROS_SECURITY_KEYSTORE").ok().filter(|path| !path.is_empty());
    let (path, renew) = match named {
        Some(path) => (PathBuf::from(path), Renew::Nothing),
        None => (own_keystore(domain)?, Renew::Permissions),
    };
    let keystore = complete(&path, platforms, domain, renew)?;
    judged(&keystore, domain)?;
    let path = std::path::absolute(&path)?.display().to_string();
    say!("secured: keys in {path}");
    Ok([("ENABLE", "true"), ("STRATEGY", "Enforce"), ("KEYSTORE", path.as_str()), ("ENCLAVE_OVERRIDE", "")]
        .map(|(name, value)| (format!("ROS_SECURITY_{name}"), value.to_owned()))
        .into())
}

/// In the user's folder for data, apart from runs, which are passed on.
fn own_keystore(domain: u16) -> anyhow::Result<PathBuf> {
    let set = |name| std::env::var_os(name).filter(|path| !path.is_empty()).map(PathBuf::from);
    let data = set("XDG_DATA_HOME").or_else(|| Some(set("HOME")?.join(".local/share")));
    let data = data.context("neither ROS_SECURITY_KEYSTORE nor HOME is set: no place for keys")?;
    Ok(data.join(format!("whorl/keystore_domain_{domain}")))
}
