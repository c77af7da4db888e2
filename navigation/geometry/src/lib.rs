//! Where things are: rotations, WGS-84, the local frame, gravity.
