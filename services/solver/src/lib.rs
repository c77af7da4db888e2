//! The process that solves the window at each keyframe.
