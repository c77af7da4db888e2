//! What the world does and what a sensor sees: state, preintegration, transport, sensor models, propagator.
