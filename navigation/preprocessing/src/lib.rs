//! Which reading counts, and at which keyframe.
