//! Where ports, files, hosts and topics of a list of devices really are.

use std::net::{SocketAddr, ToSocketAddrs};
use std::path::{Path, PathBuf};
use std::sync::Arc;

use whorl_node::{ForeignNetwork, TransportError};

/// Where ports, files and hosts are looked for.
#[derive(Debug, Clone, Default)]
pub struct Place {
    /// The folder in which emulators keep theirs; `None`: this computer's own.
    pub root: Option<PathBuf>,
    /// Where topics of other nodes are; `None`: nowhere.
    pub network: Option<Arc<dyn ForeignNetwork>>,
}

impl Place {
    /// The folder of emulators, without topics.
    #[must_use]
    pub fn below(root: &Path) -> Self {
        Self { root: Some(root.to_owned()), network: None }
    }

    /// The network on which topics of other nodes are.
    pub(crate) fn network(&self) -> Result<&dyn ForeignNetwork, TransportError> {
        let missing = || TransportError("no network was given to this driver".to_owned());
        self.network.as_deref().ok_or_else(missing)
    }

    /// Where a port or file of the list really is.
    #[must_use]
    pub fn path(&self, path: &str) -> PathBuf {
        match &self.root {
            Some(root) => root.join(path.trim_start_matches('/')),
            None => PathBuf::from(path),
        }
    }

    /// The topic on which a node of the list really is: emulators keep away from those of real devices.
    #[must_use]
    pub fn topic(&self, topic: &str) -> String {
        match &self.root {
            Some(_) => format!("/emulated{topic}"),
            None => topic.to_owned(),
        }
    }

    /// The file in which an emulator says on which address of this computer a host of the list is.
    #[must_use]
    pub fn host_file(root: &Path, host: &str) -> PathBuf {
        root.join("hosts").join(host.replace(['/', ':'], "_"))
    }

    /// Where a host of the list really is.
    ///
    /// # Errors
    /// When its name is not known.
    pub fn host(&self, host: &str) -> std::io::Result<SocketAddr> {
        let written;
        let name = match &self.root {
            Some(root) => {
                written = std::fs::read_to_string(Self::host_file(root, host))?;
                written.trim()
            }
            None => host,
        };
        name.to_socket_addrs()?.next().ok_or_else(|| std::io::ErrorKind::NotFound.into())
    }
}
