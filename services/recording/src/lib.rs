//! Data at rest: the sensor-log directory, estimate files, checkpoints.
