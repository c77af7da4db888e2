//! Channels as typed ports over shared memory.
