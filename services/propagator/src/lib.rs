//! The process that publishes an estimate for every IMU sample.
