//! Data time and the machine's clock, joined by the start triple.
//!
//! ```text
//! monotonic = mono_start + (data - data_start) / rate
//! ```
//!
//! The supervisor gives every process of a run the same triple, so that emulators in processes of their own replay one
//! common time.

use core::fmt;
use std::fs;
use std::str::FromStr;
use std::sync::OnceLock;

use rustix::time::{ClockId, clock_gettime};
use shared_types::{Clocks, Duration, Time};

use crate::error::RuntimeError;

/// CLOCK_MONOTONIC, ns. For latency and pacing only; it never reaches an estimator.
pub fn monotonic_now() -> i64 {
    nanoseconds(ClockId::Monotonic)
}

/// Another text after each start of the machine.
const BOOT_ID: &str = "/proc/sys/kernel/random/boot_id";

/// What the machine's clocks say now, for what is to be kept beyond this process. Like [`monotonic_now`], nothing for an estimator.
pub fn clocks_now() -> Clocks {
    Clocks { boot: boot(), mono: monotonic_now(), wall: nanoseconds(ClockId::Realtime) }
}

/// Which start of the machine this is; 0 where it does not say. Read once: it never changes, and whoever asks may be in a loop.
fn boot() -> u128 {
    static BOOT: OnceLock<u128> = OnceLock::new();
    *BOOT.get_or_init(|| fs::read_to_string(BOOT_ID).ok().and_then(|text| boot_of(&text)).unwrap_or(0))
}

/// The number that a UUID writes.
fn boot_of(text: &str) -> Option<u128> {
    u128::from_str_radix(&text.trim().replace('-', ""), 16).ok()
}

pub(crate) fn nanoseconds(clock: ClockId) -> i64 {
    let now = clock_gettime(clock);
    now.tv_sec * 1_000_000_000 + now.tv_nsec
}

/// Which data time belongs to which monotonic time.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct StartClock {
    /// Data time at the start.
    pub data: Time,
    /// CLOCK_MONOTONIC at the start, ns.
    pub mono: i64,
    /// Seconds of data time per second.
    pub rate: f64,
}

impl StartClock {
    /// `data` is now, and data time runs at `rate`.
    pub fn now_is(data: Time, rate: f64) -> StartClock {
        StartClock { data, mono: monotonic_now(), rate }
    }

    /// When a data time comes, CLOCK_MONOTONIC in ns.
    pub fn monotonic_of(&self, t: Time) -> i64 {
        self.mono + ((t - self.data).0 as f64 / self.rate) as i64
    }

    /// Which data time a monotonic time (ns) has.
    pub fn data_at(&self, mono: i64) -> Time {
        self.data + Duration(((mono - self.mono) as f64 * self.rate) as i64)
    }

    /// Data time now; before the start it is earlier than `data`.
    pub fn data_now(&self) -> Time {
        self.data_at(monotonic_now())
    }
}

impl fmt::Display for StartClock {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{},{},{}", self.data.0, self.mono, self.rate)
    }
}

impl FromStr for StartClock {
    type Err = RuntimeError;

    fn from_str(text: &str) -> Result<StartClock, RuntimeError> {
        let parse = || {
            let mut parts = text.split(',');
            let data = Time(parts.next()?.parse().ok()?);
            let mono = parts.next()?.parse().ok()?;
            let rate: f64 = parts.next()?.parse().ok()?;
            (parts.next().is_none() && rate.is_finite() && rate > 0.0).then_some(StartClock { data, mono, rate })
        };
        parse().ok_or_else(|| RuntimeError::Start { text: text.to_owned() })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn data_time_runs_at_its_rate_from_the_start() {
        let clock = StartClock { data: Time(5_000_000_000), mono: 1_000, rate: 4.0 };
        assert_eq!(clock.monotonic_of(Time(9_000_000_000)), 1_000_001_000);
        assert_eq!(clock.data_at(1_000_001_000), Time(9_000_000_000));
        assert_eq!(clock.data_at(-249_999_000), Time(4_000_000_000));
    }

    #[test]
    fn a_boot_is_told_by_the_number_that_its_identifier_writes() {
        assert_eq!(boot_of("00000000-0000-0000-0000-0000000001fe\n"), Some(0x1fe));
        assert_eq!((boot_of(""), boot_of("no number")), (None, None));
    }

    #[test]
    fn a_triple_survives_the_command_line() {
        let clock = StartClock { data: Time(-17_000_000_001), mono: 123_456_789_012, rate: 0.1 };
        assert_eq!(clock.to_string().parse::<StartClock>().expect("printed by us"), clock);
        for bad in ["", "1,2", "1,2,3,4", "a,2,1", "1,2,0", "1,2,-1", "1,2,nan", "1,2,inf"] {
            assert!(bad.parse::<StartClock>().is_err(), "{bad:?}");
        }
    }
}
