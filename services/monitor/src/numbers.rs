//! Numbers as people read them: never `NaN`, `inf` or `-0.00`.

/// What is not known.
pub(crate) const UNKNOWN: &str = "-";

/// From here on digits would break every column.
const TOO_LONG: f64 = 1e9;

/// With so many decimals; `-` for what is none.
pub(crate) fn fixed(value: impl Into<Option<f64>>, decimals: usize) -> String {
    let Some(value) = value.into().filter(|value| value.is_finite()) else {
        return UNKNOWN.to_owned();
    };
    if value.abs() >= TOO_LONG {
        return format!("{value:.1e}");
    }
    let text = format!("{value:.decimals$}");
    let is_zero = text.bytes().all(|byte| matches!(byte, b'-' | b'0' | b'.'));
    if is_zero { text.trim_start_matches('-').to_owned() } else { text }
}

/// Data time in seconds. A Unix epoch needs the digits that [`fixed`] refuses.
pub(crate) fn instant(t: Option<f64>, decimals: usize) -> String {
    t.filter(|t| t.is_finite()).map_or(UNKNOWN.to_owned(), |t| format!("{t:.decimals$}"))
}

/// Seconds as milliseconds.
pub(crate) fn milliseconds(seconds: impl Into<Option<f64>>) -> String {
    fixed(seconds.into().map(|seconds| seconds * 1e3), 2)
}

/// Seconds as whole microseconds.
pub(crate) fn microseconds(seconds: impl Into<Option<f64>>) -> String {
    fixed(seconds.into().map(|seconds| seconds * 1e6), 0)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_no_number_is_a_dash() {
        for none in [None, Some(f64::NAN), Some(f64::INFINITY), Some(f64::NEG_INFINITY)] {
            assert_eq!((fixed(none, 2), instant(none, 1), milliseconds(none)), ("-".into(), "-".into(), "-".into()));
        }
    }

    #[test]
    fn a_small_negative_number_is_zero_and_not_minus_zero() {
        assert_eq!(fixed(-0.0004, 3), "0.000");
        assert_eq!(fixed(-0.0006, 3), "-0.001");
        assert_eq!(fixed(-0.4, 0), "0");
        assert_eq!(fixed(2.5e12, 3), "2.5e12");
    }

    #[test]
    fn a_unix_epoch_keeps_its_seconds() {
        assert_eq!(instant(Some(1_746_099_142.37), 1), "1746099142.4");
    }
}
