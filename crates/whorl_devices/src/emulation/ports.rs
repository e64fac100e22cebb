//! Pseudo-terminals, sockets and files of emulated devices.

use crate::place::Place;
use std::fs::File;
use std::io::{ErrorKind, Read, Write};
use std::net::{TcpListener, TcpStream};
use std::os::fd::{AsFd, BorrowedFd, OwnedFd};
use std::path::{Path, PathBuf};

use rustix::fs::{Mode, OFlags, open};
use rustix::pty::{OpenptFlags, grantpt, openpt, ptsname, unlockpt};
use rustix::termios::{OptionalActions, tcgetattr, tcsetattr};

/// Rate of wires that only spoil messages [bit/s].
pub(super) const NO_WIRE: u32 = 100_000_000;

/// A serial port: a pseudo-terminal with a link to it.
pub(super) struct Terminal {
    master: File,
    /// Kept open, so that the device hears no hang-up when nobody listens.
    _slave: OwnedFd,
    link: PathBuf,
}

impl Terminal {
    pub(super) fn open(link: &Path) -> std::io::Result<Self> {
        let master = openpt(OpenptFlags::RDWR | OpenptFlags::NOCTTY | OpenptFlags::CLOEXEC)?;
        grantpt(&master)?;
        unlockpt(&master)?;
        let name = ptsname(&master, Vec::new())?;
        let slave = open(name.as_c_str(), OFlags::RDWR | OFlags::NOCTTY | OFlags::CLOEXEC, Mode::empty())?;
        // From the beginning: a terminal that translates would send back what it gets.
        let mut settings = tcgetattr(&slave)?;
        settings.make_raw();
        tcsetattr(&slave, OptionalActions::Now, &settings)?;
        rustix::io::ioctl_fionbio(&master, true)?;
        if let Some(folder) = link.parent() {
            std::fs::create_dir_all(folder)?;
        }
        remove(link);
        let name = name.into_string().map_err(|_| ErrorKind::InvalidData)?;
        std::os::unix::fs::symlink(name, link)?;
        Ok(Self { master: File::from(master), _slave: slave, link: link.to_owned() })
    }

    pub(super) fn fd(&self) -> BorrowedFd<'_> {
        self.master.as_fd()
    }

    pub(super) fn read(&mut self) -> Vec<u8> {
        read_available(&mut self.master).0
    }

    /// What nobody takes is lost, as on a wire.
    pub(super) fn write(&mut self, bytes: &[u8]) {
        let _ = self.master.write(bytes);
    }
}

impl Drop for Terminal {
    fn drop(&mut self) {
        remove(&self.link);
    }
}

/// A TCP port of one client at a time, with a file that tells its number.
pub(super) struct Socket {
    listener: TcpListener,
    pub(super) client: Option<TcpStream>,
    file: PathBuf,
}

impl Socket {
    pub(super) fn open(root: &Path, host: &str) -> std::io::Result<Self> {
        let listener = TcpListener::bind("127.0.0.1:0")?;
        listener.set_nonblocking(true)?;
        let file = Place::host_file(root, host);
        if let Some(folder) = file.parent() {
            std::fs::create_dir_all(folder)?;
        }
        write_at_once(&file, &format!("{}\n", listener.local_addr()?))?;
        Ok(Self { listener, client: None, file })
    }

    pub(super) fn fds(&self) -> impl Iterator<Item = BorrowedFd<'_>> {
        std::iter::once(self.listener.as_fd()).chain(self.client.as_ref().map(AsFd::as_fd))
    }

    /// Whether a client has come; the one before is sent away.
    pub(super) fn accept(&mut self) -> bool {
        let Ok((client, _)) = self.listener.accept() else { return false };
        let ready = client.set_nonblocking(true).is_ok() && client.set_nodelay(true).is_ok();
        self.client = Some(client).filter(|_| ready);
        ready
    }

    pub(super) fn read(&mut self) -> Vec<u8> {
        let Some(client) = &mut self.client else { return Vec::new() };
        let (bytes, gone) = read_available(client);
        if gone {
            self.client = None;
        }
        bytes
    }

    pub(super) fn write(&mut self, bytes: &[u8]) {
        if let Some(client) = &mut self.client
            && !bytes.is_empty()
            && client.write_all(bytes).is_err()
        {
            self.client = None;
        }
    }
}

impl Drop for Socket {
    fn drop(&mut self) {
        remove(&self.file);
    }
}

/// What is there, and whether the other end is gone.
fn read_available(from: &mut impl Read) -> (Vec<u8>, bool) {
    let (mut bytes, mut buffer) = (Vec::new(), [0; 4096]);
    loop {
        match from.read(&mut buffer) {
            Ok(0) => return (bytes, true),
            Ok(count) => bytes.extend_from_slice(buffer.get(..count).unwrap_or_default()),
            Err(error) if error.kind() == ErrorKind::Interrupted => {}
            Err(error) => return (bytes, error.kind() != ErrorKind::WouldBlock),
        }
    }
}

/// Readers see the text before or after, nothing between, as with files of the kernel.
pub(super) fn write_at_once(file: &Path, text: &str) -> std::io::Result<()> {
    whorl_files::write_file(file, text)
}

pub(super) fn remove(file: &Path) {
    // It may never have been there.
    let _ = std::fs::remove_file(file);
}
