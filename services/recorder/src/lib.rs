//! The process that writes every channel to a log directory.
