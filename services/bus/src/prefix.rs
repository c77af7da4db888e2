//! The name under which one set of processes hears itself, and the places that it owns.

use core::fmt;
use std::path::PathBuf;
use std::str::FromStr;

use crate::error::BusError;

/// Longest name: with it the root path stays below the 62 bytes beyond which socket names break.
const LONGEST: usize = 24;

/// Checked name of a deployment. Two prefixes on one machine do not hear each other.
///
/// Its files lie in `/tmp/ilns-NAME` and not in a folder of the session: a service and an operator's shell have different
/// sessions and must meet.
#[derive(Clone, Debug, PartialEq, Eq, Hash)]
pub struct Prefix(String);

impl Prefix {
    /// Checks a name.
    ///
    /// # Errors
    /// [`BusError::PrefixName`] unless it is 1 to 24 letters, digits and `-`, beginning with a letter or digit.
    pub fn new(text: &str) -> Result<Prefix, BusError> {
        let fits = (1..=LONGEST).contains(&text.len())
            && text.bytes().all(|byte| byte.is_ascii_alphanumeric() || byte == b'-')
            && !text.starts_with('-');
        if fits { Ok(Prefix(text.to_owned())) } else { Err(BusError::PrefixName { text: text.to_owned() }) }
    }

    /// The name.
    pub fn name(&self) -> &str {
        &self.0
    }

    /// Everything of this prefix that is not shared memory; gone when its owner has closed.
    pub fn directory(&self) -> PathBuf {
        PathBuf::from(format!("/tmp/ilns-{}", self.0))
    }

    /// For the files of a run, such as its effective configuration.
    pub fn run_directory(&self) -> PathBuf {
        self.directory().join("run")
    }

    /// Held locked by the owner; contains its process number.
    pub(crate) fn lock_file(&self) -> PathBuf {
        self.directory().join("lock")
    }

    /// Exists once every channel has been created.
    pub(crate) fn ready_file(&self) -> PathBuf {
        self.directory().join("ready")
    }

    /// Where the shared memory layer keeps its files.
    pub(crate) fn layer_directory(&self) -> PathBuf {
        self.directory().join("iox")
    }

    /// Begins the name of every shared memory object. `_` cannot stand in a prefix: `a` does not match those of `ab`.
    pub(crate) fn object_prefix(&self) -> String {
        format!("ilns-{}_", self.0)
    }
}

impl FromStr for Prefix {
    type Err = BusError;

    fn from_str(text: &str) -> Result<Prefix, BusError> {
        Prefix::new(text)
    }
}

impl fmt::Display for Prefix {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.pad(&self.0)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_name_that_breaks_a_file_name_is_refused() {
        for bad in ["", "-a", "a/b", "a_b", "ä", "a b", "..", "1234567890123456789012345"] {
            assert!(Prefix::new(bad).is_err(), "{bad:?}");
        }
        for good in ["main", "AUV-7", "0", "123456789012345678901234"] {
            assert!(Prefix::new(good).is_ok(), "{good:?}");
        }
    }

    #[test]
    fn the_longest_root_path_fits_a_socket_name() {
        let longest = Prefix::new(&"x".repeat(LONGEST)).expect("of the longest length");
        assert!(longest.layer_directory().as_os_str().len() <= 62);
    }
}
