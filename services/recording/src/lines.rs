//! Lines of a file as bytes, through one large buffer: constant memory and no copy of a line.

use std::fs::File;
use std::io::{self, Read};
use std::ops::Range;

/// Bytes asked of the operating system at once.
const BUFFER: usize = 256 * 1024;
/// Longer lines are no CSV of ours; the limit keeps a binary file from being read whole.
pub(crate) const LINE_MAX: usize = 64 * 1024;

/// A line, or why there is none.
#[derive(Debug, PartialEq, Eq)]
pub(crate) enum Line {
    /// Where in [`Lines::bytes`] it stands, without its end-of-line.
    At(Range<usize>),
    /// More than [`LINE_MAX`] bytes without an end.
    TooLong,
    /// No more.
    End,
}

/// Reads lines, counted from 1. A byte order mark, `\r\n` and a missing last newline are taken as they come.
#[derive(Debug)]
pub(crate) struct Lines<R = File> {
    source: R,
    buffer: Vec<u8>,
    start: usize,
    end: usize,
    number: u64,
    exhausted: bool,
}

impl<R: Read> Lines<R> {
    pub(crate) fn new(source: R) -> Lines<R> {
        Lines { source, buffer: vec![0; BUFFER], start: 0, end: 0, number: 0, exhausted: false }
    }

    /// Number of the line last returned, from 1.
    pub(crate) fn number(&self) -> u64 {
        self.number
    }

    pub(crate) fn bytes(&self, line: Range<usize>) -> &[u8] {
        &self.buffer[line]
    }

    /// The next line; its range is valid until the next call.
    pub(crate) fn next_line(&mut self) -> io::Result<Line> {
        let mut searched = 0;
        loop {
            let unread = &self.buffer[self.start..self.end];
            if let Some(found) = memchr::memchr(b'\n', &unread[searched..]) {
                return Ok(self.take(searched + found, 1));
            }
            searched = unread.len();
            if searched > LINE_MAX {
                self.number += 1;
                return Ok(Line::TooLong);
            }
            if self.exhausted {
                return Ok(if searched == 0 { Line::End } else { self.take(searched, 0) });
            }
            self.refill()?;
        }
    }

    /// Cuts `length` bytes off the unread part, and the `newline` after them.
    fn take(&mut self, length: usize, newline: usize) -> Line {
        let mut start = self.start;
        let mut end = start + length;
        self.start = end + newline;
        self.number += 1;
        if self.number == 1 && self.buffer[start..end].starts_with(b"\xef\xbb\xbf") {
            start += 3;
        }
        if self.buffer[start..end].ends_with(b"\r") {
            end -= 1;
        }
        Line::At(start..end)
    }

    fn refill(&mut self) -> io::Result<()> {
        self.buffer.copy_within(self.start..self.end, 0);
        self.end -= self.start;
        self.start = 0;
        let read = loop {
            match self.source.read(&mut self.buffer[self.end..]) {
                Err(error) if error.kind() == io::ErrorKind::Interrupted => {}
                read => break read?,
            }
        };
        self.end += read;
        self.exhausted = read == 0;
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn all(text: &[u8]) -> Vec<String> {
        let mut lines = Lines::new(text);
        let mut found = Vec::new();
        while let Line::At(range) = lines.next_line().expect("a slice can be read") {
            found.push(String::from_utf8(lines.bytes(range).to_vec()).expect("the test's text is UTF-8"));
        }
        found
    }

    #[test]
    fn a_byte_order_mark_and_windows_line_ends_are_not_part_of_a_line() {
        assert_eq!(all(b"\xef\xbb\xbft,a\r\n1,2\r\n"), ["t,a", "1,2"]);
    }

    #[test]
    fn the_last_line_needs_no_newline() {
        assert_eq!(all(b"a\n\nb"), ["a", "", "b"]);
        assert_eq!(all(b""), Vec::<String>::new());
    }

    #[test]
    fn lines_across_the_edge_of_the_buffer_stay_whole() {
        let text: Vec<u8> = (0..100_000).flat_map(|i| format!("row {i}\n").into_bytes()).collect();
        assert!(text.len() > 3 * BUFFER);
        for (index, line) in all(&text).iter().enumerate() {
            assert_eq!(line, &format!("row {index}"));
        }
    }

    #[test]
    fn a_line_without_end_is_refused() {
        let text = vec![b'x'; LINE_MAX + 2 * BUFFER];
        assert_eq!(Lines::new(&text[..]).next_line().expect("a slice can be read"), Line::TooLong);
    }
}
