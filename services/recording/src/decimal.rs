//! Numbers as text: shortest round-trip form for recordings, fixed decimals for the estimates.
//!
//! A replay writes some seventeen million numbers for an hour of data; the fixed forms go through one integer and
//! two digits at a time, three to five times as fast as `core::fmt`.

use shared_types::Time;

/// Powers of ten that 64 bits hold and that we use.
const POW10: [u64; 13] = [
    1,
    10,
    100,
    1_000,
    10_000,
    100_000,
    1_000_000,
    10_000_000,
    100_000_000,
    1_000_000_000,
    10_000_000_000,
    100_000_000_000,
    1_000_000_000_000,
];

/// Beyond 2^53 the scaled number is no longer a whole one; such values are written by `core::fmt`.
const EXACT: f64 = 9_007_199_254_740_992.0;

const PAIRS: &[u8; 200] = b"0001020304050607080910111213141516171819\
2021222324252627282930313233343536373839\
4041424344454647484950515253545556575859\
6061626364656667686970717273747576777879\
8081828384858687888990919293949596979899";

/// The shortest text that parses back to the same bits; `nan`, `inf` and `-inf` for what is no number.
pub(crate) fn push_shortest(text: &mut Vec<u8>, value: f64) {
    if value.is_finite() {
        text.extend_from_slice(ryu::Buffer::new().format_finite(value).as_bytes());
    } else if value.is_nan() {
        text.extend_from_slice(b"nan");
    } else {
        text.extend_from_slice(if value > 0.0 { b"inf" } else { b"-inf" });
    }
}

/// Decimal seconds as [`Time`]'s `Display`: as many digits as needed, at most nine.
pub(crate) fn push_time(text: &mut Vec<u8>, t: Time) {
    push_scaled(text, t.0 < 0, t.0.unsigned_abs(), 9);
    while text.ends_with(b"0") {
        text.pop();
    }
    if text.ends_with(b".") {
        text.pop();
    }
}

/// A finite number with `decimals` (1 to 12) digits after the point, rounded to nearest. No negative zero.
pub(crate) fn push_fixed(text: &mut Vec<u8>, value: f64, decimals: usize) {
    let scaled = (value * POW10[decimals] as f64).round();
    if scaled.abs() < EXACT {
        push_scaled(text, scaled < 0.0, scaled.abs() as u64, decimals);
    } else {
        text.extend_from_slice(format!("{value:.decimals$}").as_bytes());
    }
}

/// A finite number with at least seven significant digits: 6, 9 or 12 decimals by its size, below 1e-6 the shortest form.
pub(crate) fn push_significant(text: &mut Vec<u8>, value: f64) {
    match value.abs() {
        size if size >= 1.0 => push_fixed(text, value, 6),
        size if size >= 1e-3 => push_fixed(text, value, 9),
        size if size >= 1e-6 || size == 0.0 => push_fixed(text, value, 12),
        _ => push_shortest(text, value),
    }
}

/// `magnitude` / 10^`decimals`, all decimals written.
fn push_scaled(text: &mut Vec<u8>, negative: bool, magnitude: u64, decimals: usize) {
    // 20 digits of a u64, the point, the sign.
    let mut buffer = [0_u8; 24];
    let mut at = buffer.len();
    let mut fraction = magnitude % POW10[decimals];
    let mut left = decimals;
    while left >= 2 {
        at -= 2;
        buffer[at..at + 2].copy_from_slice(pair(fraction % 100));
        fraction /= 100;
        left -= 2;
    }
    if left == 1 {
        at -= 1;
        buffer[at] = b'0' + fraction as u8;
    }
    at -= 1;
    buffer[at] = b'.';
    let mut whole = magnitude / POW10[decimals];
    while whole >= 100 {
        at -= 2;
        buffer[at..at + 2].copy_from_slice(pair(whole % 100));
        whole /= 100;
    }
    if whole >= 10 {
        at -= 2;
        buffer[at..at + 2].copy_from_slice(pair(whole));
    } else {
        at -= 1;
        buffer[at] = b'0' + whole as u8;
    }
    if negative {
        at -= 1;
        buffer[at] = b'-';
    }
    text.extend_from_slice(&buffer[at..]);
}

fn pair(two_digits: u64) -> &'static [u8] {
    let index = 2 * two_digits as usize;
    &PAIRS[index..index + 2]
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    fn text(push: impl FnOnce(&mut Vec<u8>)) -> String {
        let mut bytes = Vec::new();
        push(&mut bytes);
        String::from_utf8(bytes).expect("numbers are ASCII")
    }

    #[test]
    fn small_negative_numbers_keep_their_leading_zeros_and_lose_a_negative_zero() {
        assert_eq!(text(|t| push_fixed(t, -0.05, 6)), "-0.050000");
        assert_eq!(text(|t| push_fixed(t, -1e-9, 6)), "0.000000");
        assert_eq!(text(|t| push_fixed(t, 123.456_789_6, 6)), "123.456790");
        assert_eq!(text(|t| push_fixed(t, -1e20, 3)), "-100000000000000000000.000");
    }

    #[test]
    fn sigmas_of_every_size_keep_seven_significant_digits() {
        for exponent in -15..9 {
            let value = 1.234_567_891_2 * 10_f64.powi(exponent);
            let read: f64 = text(|t| push_significant(t, value)).parse().expect("a number");
            assert!((read / value - 1.0).abs() < 5e-7, "{value} was written as {read}");
        }
        assert_eq!(text(|t| push_significant(t, 0.0)), "0.000000000000");
    }

    #[test]
    fn what_is_no_number_has_a_word() {
        assert_eq!(text(|t| push_shortest(t, f64::NAN)), "nan");
        assert_eq!(text(|t| push_shortest(t, f64::NEG_INFINITY)), "-inf");
    }

    proptest! {
        #[test]
        fn times_are_written_as_they_display(nanos in any::<i64>()) {
            prop_assert_eq!(text(|t| push_time(t, Time(nanos))), Time(nanos).to_string());
        }

        #[test]
        fn fixed_decimals_are_right_to_half_a_digit(value in -1e6..1e6_f64, decimals in 1..10_usize) {
            let read: f64 = text(|t| push_fixed(t, value, decimals)).parse().expect("a number");
            // Half a last digit, and the rounding of value · 10^decimals itself.
            let tolerance = 0.5 / POW10[decimals] as f64 + value.abs() * 2.0 * f64::EPSILON;
            prop_assert!((read - value).abs() <= tolerance, "{} for {}", read, value);
        }

        #[test]
        fn the_shortest_form_gives_the_same_bits(bits in any::<u64>()) {
            let value = f64::from_bits(bits);
            let read: f64 = text(|t| push_shortest(t, value)).parse().expect("a number");
            prop_assert!(read.to_bits() == bits || (read.is_nan() && value.is_nan()));
        }
    }
}
