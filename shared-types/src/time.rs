//! Data time: integer nanoseconds on the vehicle's sensor time base.
//!
//! A Unix epoch held in an `f64` loses 0.24 µs, so time is parsed, kept and printed as integers; only *differences*
//! become seconds.

use core::fmt;
use core::ops::{Add, AddAssign, Neg, Sub};

use serde::{Deserialize, Serialize};

const NANOS_PER_SECOND: i64 = 1_000_000_000;

/// An instant of data time, ns since the epoch of the log or scenario. May be negative.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
pub struct Time(pub i64);

/// A signed difference of two instants, ns.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
pub struct Duration(pub i64);

/// A text that is no decimal number of seconds.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[error("not a decimal number of seconds")]
pub struct TimeError;

impl Time {
    /// Later than every real instant.
    pub const MAX: Time = Time(i64::MAX);
    /// Earlier than every real instant; also "never".
    pub const MIN: Time = Time(i64::MIN);

    /// From seconds; exact to the nanosecond only below 2^53 ns (104 days).
    pub fn from_seconds(seconds: f64) -> Time {
        Time((seconds * NANOS_PER_SECOND as f64).round() as i64)
    }

    /// Parses decimal seconds (`-12`, `1746099142.369755`) to integer nanoseconds without passing through `f64`.
    /// Digits beyond the ninth are rounded; an exponent is accepted and then read as `f64`.
    ///
    /// # Errors
    /// [`TimeError`] when the text is not a finite decimal number or does not fit 64 bits of nanoseconds.
    pub fn parse(text: &[u8]) -> Result<Time, TimeError> {
        let (negative, digits) = match text {
            [b'-', rest @ ..] => (true, rest),
            [b'+', rest @ ..] => (false, rest),
            _ => (false, text),
        };
        let mut value: i64 = 0;
        let mut decimals: Option<u32> = None;
        let mut any = false;
        for (index, &byte) in digits.iter().enumerate() {
            match byte {
                b'0'..=b'9' => {
                    any = true;
                    match decimals {
                        Some(9) => {
                            if byte >= b'5' && !digits[index..].iter().any(|b| !b.is_ascii_digit()) {
                                value = value.checked_add(1).ok_or(TimeError)?;
                            }
                            if digits[index..].iter().any(|b| !b.is_ascii_digit()) {
                                return Time::parse_exponent(text);
                            }
                            break;
                        }
                        Some(ref mut count) => *count += 1,
                        None => {}
                    }
                    let digit = i64::from(byte - b'0');
                    value = value.checked_mul(10).and_then(|v| v.checked_add(digit)).ok_or(TimeError)?;
                }
                b'.' if decimals.is_none() => decimals = Some(0),
                b'e' | b'E' => return Time::parse_exponent(text),
                _ => return Err(TimeError),
            }
        }
        if !any {
            return Err(TimeError);
        }
        let scale = 10_i64.pow(9 - decimals.unwrap_or(0));
        let nanos = value.checked_mul(scale).ok_or(TimeError)?;
        Ok(Time(if negative { -nanos } else { nanos }))
    }

    fn parse_exponent(text: &[u8]) -> Result<Time, TimeError> {
        let seconds: f64 = core::str::from_utf8(text).ok().and_then(|s| s.parse().ok()).ok_or(TimeError)?;
        let nanos = seconds * NANOS_PER_SECOND as f64;
        if nanos.is_finite() && nanos.abs() < 9.2e18 { Ok(Time(nanos.round() as i64)) } else { Err(TimeError) }
    }

    /// Seconds as `f64`, for display and for the few borders that need it.
    pub fn as_seconds(self) -> f64 {
        // Split so that whole seconds stay exact.
        let whole = self.0.div_euclid(NANOS_PER_SECOND);
        let rest = self.0.rem_euclid(NANOS_PER_SECOND);
        whole as f64 + rest as f64 * 1e-9
    }
}

impl Duration {
    /// No time at all.
    pub const ZERO: Duration = Duration(0);

    /// From seconds, rounded to the nanosecond.
    pub fn from_seconds(seconds: f64) -> Duration {
        Duration((seconds * NANOS_PER_SECOND as f64).round() as i64)
    }

    /// Signed seconds.
    pub fn as_seconds(self) -> f64 {
        self.0 as f64 * 1e-9
    }

    /// The length without the sign.
    pub fn abs(self) -> Duration {
        Duration(self.0.abs())
    }
}

impl Sub for Time {
    type Output = Duration;
    fn sub(self, earlier: Time) -> Duration {
        Duration(self.0.saturating_sub(earlier.0))
    }
}

impl Add<Duration> for Time {
    type Output = Time;
    fn add(self, step: Duration) -> Time {
        Time(self.0.saturating_add(step.0))
    }
}

impl Sub<Duration> for Time {
    type Output = Time;
    fn sub(self, step: Duration) -> Time {
        Time(self.0.saturating_sub(step.0))
    }
}

impl AddAssign<Duration> for Time {
    fn add_assign(&mut self, step: Duration) {
        *self = *self + step;
    }
}

impl Neg for Duration {
    type Output = Duration;
    fn neg(self) -> Duration {
        Duration(-self.0)
    }
}

/// Decimal seconds with as many digits as needed, at most nine: what [`Time::parse`] reads back to the same integer.
impl fmt::Display for Time {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let magnitude = self.0.unsigned_abs();
        let sign = if self.0 < 0 { "-" } else { "" };
        let (whole, mut rest) = (magnitude / 1_000_000_000, magnitude % 1_000_000_000);
        if rest == 0 {
            return write!(f, "{sign}{whole}");
        }
        let mut width = 9;
        while rest % 10 == 0 {
            rest /= 10;
            width -= 1;
        }
        write!(f, "{sign}{whole}.{rest:0width$}")
    }
}

impl fmt::Display for Duration {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        Time(self.0).fmt(f)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_unix_epoch_keeps_its_nanoseconds() {
        assert_eq!(Time::parse(b"1746099142.369755001"), Ok(Time(1_746_099_142_369_755_001)));
    }

    #[test]
    fn negative_short_and_whole_seconds_parse() {
        assert_eq!(Time::parse(b"-0.5"), Ok(Time(-500_000_000)));
        assert_eq!(Time::parse(b"17"), Ok(Time(17_000_000_000)));
        assert_eq!(Time::parse(b"17."), Ok(Time(17_000_000_000)));
        assert_eq!(Time::parse(b"+.25"), Ok(Time(250_000_000)));
        assert_eq!(Time::parse(b"1e-3"), Ok(Time(1_000_000)));
    }

    #[test]
    fn a_tenth_digit_rounds() {
        assert_eq!(Time::parse(b"0.1234567895"), Ok(Time(123_456_790)));
        assert_eq!(Time::parse(b"0.12345678949"), Ok(Time(123_456_789)));
    }

    #[test]
    fn what_is_no_number_is_refused() {
        for text in ["", "-", ".", "nan", "1,5", "1.2.3", "12s", "99999999999999999999"] {
            assert_eq!(Time::parse(text.as_bytes()), Err(TimeError), "{text}");
        }
    }

    #[test]
    fn printing_and_parsing_return_to_the_same_instant() {
        for nanos in [0, 1, -1, 5_000_000, -17_000_000_001, 1_746_099_142_369_755_001, i64::MAX] {
            assert_eq!(Time::parse(Time(nanos).to_string().as_bytes()), Ok(Time(nanos)));
        }
    }
}
