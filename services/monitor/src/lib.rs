//! The process that shows where the vehicle is and how the machine keeps up.
