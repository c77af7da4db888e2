//! What a machine's own clocks say at one instant: for what outlives a process, or the machine's next start.

/// CLOCK_MONOTONIC and CLOCK_REALTIME, and which start of the machine the former counts from.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Clocks {
    /// Names this start of the machine; 0 where the machine does not tell one start from another.
    pub boot: u128,
    /// CLOCK_MONOTONIC, ns: comparable within one start of the machine.
    pub mono: i64,
    /// CLOCK_REALTIME, ns: it goes on while the power is off, and may be set back.
    pub wall: i64,
}
