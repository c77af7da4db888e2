//! The best trajectory given the window: sliding-window factor graph on a block-tridiagonal chain.
