//! One process per sensor, from the world or from a log directory.
