//! JSON text, key by key, without a tree in between.

use shared_types::Time;

use crate::decimal;

/// An object under construction: its text ends with the last value.
#[derive(Debug)]
pub(crate) struct Object<'a> {
    text: &'a mut Vec<u8>,
    is_empty: bool,
}

impl Object<'_> {
    /// Writes the object that `fill` fills.
    pub(crate) fn write(text: &mut Vec<u8>, fill: impl FnOnce(&mut Object<'_>)) {
        text.push(b'{');
        let mut object = Object { text, is_empty: true };
        fill(&mut object);
        object.text.push(b'}');
    }

    fn key(&mut self, key: &str) -> &mut Vec<u8> {
        if !self.is_empty {
            self.text.push(b',');
        }
        self.is_empty = false;
        self.text.push(b'"');
        self.text.extend_from_slice(key.as_bytes());
        self.text.extend_from_slice(b"\":");
        self.text
    }

    /// The cell of a CSV row: the same text, but `nan` leaves no key and infinities are written as JSON can.
    pub(crate) fn cell(&mut self, key: &str, cell: &[u8]) {
        let value: &[u8] = match cell {
            b"nan" => return,
            b"inf" => b"1e999",
            b"-inf" => b"-1e999",
            number => number,
        };
        self.key(key).extend_from_slice(value);
    }

    /// A number in its shortest form; NaN leaves no key.
    pub(crate) fn number(&mut self, key: &str, value: f64) {
        let mut cell = Vec::with_capacity(24);
        decimal::push_shortest(&mut cell, value);
        self.cell(key, &cell);
    }

    pub(crate) fn numbers<const N: usize>(&mut self, keys: [&str; N], values: [f64; N]) {
        for (key, value) in keys.into_iter().zip(values) {
            self.number(key, value);
        }
    }

    pub(crate) fn whole(&mut self, key: &str, value: u64) {
        let mut digits = itoa::Buffer::new();
        self.key(key).extend_from_slice(digits.format(value).as_bytes());
    }

    /// An instant as decimal seconds, exact to the nanosecond.
    pub(crate) fn seconds(&mut self, key: &str, t_ns: i64) {
        decimal::push_time(self.key(key), Time(t_ns));
    }

    /// The object `{sec, nsec}` of Foxglove's schemas; times before 0 have none there and are 0.
    pub(crate) fn stamp(&mut self, key: &str, t_ns: i64) {
        let t_ns = t_ns.max(0) as u64;
        self.object(key, |stamp| {
            stamp.whole("sec", t_ns / 1_000_000_000);
            stamp.whole("nsec", t_ns % 1_000_000_000);
        });
    }

    /// A word of ours: letters, digits, `_`, `-`, `/`, blanks.
    pub(crate) fn word(&mut self, key: &str, word: &str) {
        let text = self.key(key);
        text.push(b'"');
        text.extend_from_slice(word.as_bytes());
        text.push(b'"');
    }

    /// `true` or `false`.
    pub(crate) fn truth(&mut self, key: &str, value: bool) {
        self.key(key).extend_from_slice(if value { b"true" } else { b"false" });
    }

    pub(crate) fn object(&mut self, key: &str, fill: impl FnOnce(&mut Object<'_>)) {
        Object::write(self.key(key), fill);
    }

    /// A list of objects.
    pub(crate) fn list<T>(&mut self, key: &str, items: impl IntoIterator<Item = T>, fill: impl Fn(&mut Object<'_>, T)) {
        let text = self.key(key);
        text.push(b'[');
        for (index, item) in items.into_iter().enumerate() {
            if index > 0 {
                text.push(b',');
            }
            Object::write(text, |object| fill(object, item));
        }
        text.push(b']');
    }

    /// A list of finite numbers; what is none is written as `null`, so that no place shifts.
    pub(crate) fn array(&mut self, key: &str, values: &[f64]) {
        let text = self.key(key);
        text.push(b'[');
        for (index, &value) in values.iter().enumerate() {
            if index > 0 {
                text.push(b',');
            }
            if value.is_finite() {
                decimal::push_shortest(text, value);
            } else {
                text.extend_from_slice(b"null");
            }
        }
        text.push(b']');
    }
}

/// The cells of a flat object of numbers, as [`Object::cell`] wrote them: (key, CSV cell). `None` where it is none.
pub(crate) fn flat_cells(message: &[u8]) -> Option<Vec<(&str, &str)>> {
    let text = std::str::from_utf8(message).ok()?.strip_prefix('{')?.strip_suffix('}')?;
    let mut cells = Vec::new();
    for pair in text.split(',') {
        let (key, value) = pair.split_once(':')?;
        let key = key.strip_prefix('"')?.strip_suffix('"')?;
        let is_number = !value.is_empty() && value.bytes().all(|b| b.is_ascii_digit() || b"+-.eE".contains(&b));
        if !is_number {
            return None;
        }
        let cell = match value {
            "1e999" => "inf",
            "-1e999" => "-inf",
            number => number,
        };
        cells.push((key, cell));
    }
    Some(cells)
}

/// The text of the number under `key` of a message, as [`Object`] wrote it. `None` where there is none.
pub(crate) fn number_of<'a>(message: &'a [u8], key: &str) -> Option<&'a [u8]> {
    let name = [b"\"", key.as_bytes(), b"\":"].concat();
    let begin = message.windows(name.len()).position(|window| window == name)? + name.len();
    let rest = &message[begin..];
    let length = rest.iter().position(|byte| b",}".contains(byte))?;
    Some(&rest[..length])
}

#[cfg(test)]
mod tests {
    #![expect(clippy::unwrap_used, reason = "a test may fail where it stands")]
    use super::*;

    #[test]
    fn what_is_written_is_json_and_the_cells_come_back() {
        let mut text = Vec::new();
        Object::write(&mut text, |object| {
            object.seconds("t", -1);
            object.number("big", 1e300);
            object.number("none", f64::NAN);
            object.number("endless", f64::NEG_INFINITY);
            object.number("zero", -0.0);
        });
        assert_eq!(
            flat_cells(&text).unwrap(),
            [("t", "-0.000000001"), ("big", "1e300"), ("endless", "-inf"), ("zero", "-0.0")]
        );
        let mut nested = Vec::new();
        Object::write(&mut nested, |object| {
            object.stamp("timestamp", 1_500_000_000);
            object.array("a", &[1.0, f64::NAN]);
            object.list("l", [1, 2], |item, value| item.whole("v", value));
            object.truth("b", true);
        });
        let value: serde_json::Value = serde_json::from_slice(&nested).unwrap();
        let expected = serde_json::json!({
            "timestamp": {"sec": 1, "nsec": 500_000_000}, "a": [1.0, null], "l": [{"v": 1}, {"v": 2}], "b": true
        });
        assert_eq!(value, expected);
        assert!(flat_cells(&nested).is_none());
        assert_eq!(number_of(&nested, "nsec"), Some(&b"500000000"[..]));
        assert_eq!((number_of(&nested, "se"), number_of(b"{\"t\":1", "t")), (None, None));
    }
}
