//! Faults injected into simulated missions: the matrix of the catalogue, the outlier table, the table of time offsets.

mod catalogue;
mod expect;
pub mod matrix;
pub mod offsets;
pub mod outliers;
mod run;
