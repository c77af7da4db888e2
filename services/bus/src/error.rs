//! What can go wrong with a prefix, a channel or a port.

use std::path::PathBuf;

/// A prefix, channel or port that cannot be used.
#[derive(Debug, thiserror::Error)]
pub enum BusError {
    /// A name that does not fit into file and socket names.
    #[error("prefix {text:?} is not usable: 1 to 24 letters, digits and `-` are, beginning with a letter or digit")]
    PrefixName {
        /// As given.
        text: String,
    },
    /// Another set lives under this prefix.
    #[error("prefix `{prefix}` is in use by process {pid}; stop that one, or choose another with --prefix NAME")]
    InUse {
        /// Which prefix.
        prefix: String,
        /// Who holds it; `unknown` while it is just starting.
        pid: String,
    },
    /// Nobody owns this prefix.
    #[error(
        "nothing runs under prefix `{prefix}` (`ilns run --prefix {prefix}` or `ilns bus --prefix {prefix}` starts it)"
    )]
    NotRunning {
        /// Which prefix.
        prefix: String,
    },
    /// The channels on which this process speaks and listens are no longer those of its prefix.
    #[error(
        "the channels of prefix `{prefix}` were taken down, or made anew by another owner, since this process joined; start it again"
    )]
    Replaced {
        /// Which prefix.
        prefix: String,
    },
    /// The directory of the prefix belongs to somebody else.
    #[error("{} belongs to another user; choose another prefix with --prefix NAME", path.display())]
    NotOurs {
        /// Directory of the prefix.
        path: PathBuf,
    },
    /// The channel was created by a build whose messages are laid out differently.
    #[error("channel `{channel}` was created by another build of ilns; restart the whole set with one executable")]
    OtherBuild {
        /// Which channel.
        channel: &'static str,
    },
    /// The channel has as many senders, or as many readers, as it can have.
    #[error("channel `{channel}` already has its {most} {ports}; is the process running twice?")]
    Crowded {
        /// Which channel.
        channel: &'static str,
        /// How many there can be.
        most: usize,
        /// `sender` or `readers`.
        ports: &'static str,
    },
    /// The operating system refuses.
    #[error("cannot {what} {}", path.display())]
    Io {
        /// What was tried.
        what: &'static str,
        /// With which file.
        path: PathBuf,
        /// Why not.
        source: std::io::Error,
    },
    /// The shared memory layer refuses.
    #[error("cannot {what} `{name}`: {reason}")]
    Layer {
        /// What was tried.
        what: &'static str,
        /// Channel, bell or prefix.
        name: String,
        /// Its own word for it.
        reason: String,
    },
}

impl BusError {
    pub(crate) fn layer(what: &'static str, name: &str, reason: impl core::fmt::Debug) -> BusError {
        BusError::Layer { what, name: name.to_owned(), reason: format!("{reason:?}") }
    }

    pub(crate) fn io(what: &'static str, path: impl Into<PathBuf>) -> impl FnOnce(std::io::Error) -> BusError {
        let path = path.into();
        move |source| BusError::Io { what, path, source }
    }
}
