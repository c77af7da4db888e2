//! The world that is not there: trajectories, a strapdown IMU, sensors with errors.
