//! What any process needs around its core: configuration, tracing, shutdown, heartbeat, clocks.
