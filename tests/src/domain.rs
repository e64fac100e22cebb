//! A ROS domain for each test, also when several test programs run on one machine.

use std::fs::{File, OpenOptions, TryLockError};
use std::time::{Duration, Instant};

/// Domains above 101 use ports that the kernel hands out to others; 0 to 19 are left to people.
const DOMAINS: std::ops::RangeInclusive<u16> = 20..=99;

/// A domain that no other process uses while this exists.
pub struct Domain {
    /// ROS_DOMAIN_ID.
    pub id: u16,
    /// The lock ends with the file.
    _lock: File,
}

impl Domain {
    /// Takes a free one, and waits for it.
    ///
    /// # Panics
    /// When there is none for ten minutes.
    #[must_use]
    pub fn take() -> Self {
        let begin = Instant::now();
        loop {
            if let Some(domain) = DOMAINS.into_iter().find_map(Self::try_take) {
                return domain;
            }
            assert!(begin.elapsed() < Duration::from_secs(600), "no ROS domain is free");
            std::thread::sleep(Duration::from_millis(20));
        }
    }

    fn try_take(id: u16) -> Option<Self> {
        let path = std::env::temp_dir().join(format!("whorl-test-domain-{id}"));
        // It may belong to another user: only the owner may write to it, but anyone may lock it.
        let file = match File::open(&path) {
            Err(_) => OpenOptions::new().create_new(true).write(true).open(path).ok()?,
            Ok(file) => file,
        };
        match file.try_lock() {
            Ok(()) => Some(Self { id, _lock: file }),
            Err(TryLockError::WouldBlock | TryLockError::Error(_)) => None,
        }
    }
}
