//! Faults injected into simulated missions: the matrix of the catalogue, the outlier table, the tables of time offsets and
//! calibrations.

pub mod calibrations;
mod catalogue;
mod expect;
pub mod matrix;
pub mod offsets;
pub mod outliers;
mod run;
