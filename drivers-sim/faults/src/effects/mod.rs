//! The faults themselves, by what they spoil.

pub(crate) mod acoustics;
pub(crate) mod content;
pub(crate) mod doppler;
pub(crate) mod inertial;
pub(crate) mod loss;
pub(crate) mod order;
pub(crate) mod places;
pub(crate) mod pressure;
pub(crate) mod stamps;
