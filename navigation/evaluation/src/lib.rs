//! How good was it: association, RMS, NEES, containment.
