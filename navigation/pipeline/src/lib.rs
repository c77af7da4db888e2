//! The whole navigator in one thread: raw reading in, estimate out.
