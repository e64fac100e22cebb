//! SROS2 keystores, and what each of Whorl's nodes may do.
//!
//! - [`policy`]: one enclave for each node, with the topics that it may write and read. Pure.
//! - [`documents`]: `governance.xml` and `permissions.xml` as SROS2 writes them. Pure.
//! - [`Keystore`]: the folder of `ros2 security create_keystore`: makes it, lists it, checks it.
//!
//! Layout and files are those of SROS2 (<https://github.com/ros2/sros2>), so that a keystore made here works with
//! `ros2 security`, and the reverse. The formats are those of OMG DDS Security 1.1, 9.4.1.
//!
//! Keys and signatures need OpenSSL: the feature `security`. Without it a keystore can be listed, but neither made nor
//! checked ([`SecurityError::NotBuilt`]).

pub mod documents;
mod error;
mod keystore;
pub mod policy;
#[cfg(feature = "security")]
mod signing;

pub use error::SecurityError;
pub use keystore::{ENCLAVE_FILES, Finding, Keystore};
