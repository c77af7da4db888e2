//! The process that turns raw readings into anchored measurements.
