//! A CSV file of numbers: columns found by the names in its header, cells parsed where they are asked for.
//!
//! Columns may stand in any order, unknown ones are ignored. `nan` or an empty cell is "not reported" and becomes NaN.
//! Numbers are parsed exactly (the nearest double, as [`f64`]'s `FromStr`), times to integer nanoseconds.

use std::fs::File;
use std::path::{Path, PathBuf};

use shared_types::Time;

use crate::error::LogError;
use crate::lines::{LINE_MAX, Line, Lines};

/// Marks an optional column that the file does not have.
const ABSENT: usize = usize::MAX;
/// Cells are shown in messages up to this many characters.
const SHOWN: usize = 40;

/// The names of a table's columns; a column's index counts through `required`, then `optional`.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Columns {
    pub(crate) required: &'static [&'static str],
    pub(crate) optional: &'static [&'static str],
}

impl Columns {
    fn name(&self, column: usize) -> &'static str {
        self.required.iter().chain(self.optional).nth(column).expect("columns are asked for by their own index")
    }

    fn iter(&self) -> impl Iterator<Item = &'static str> {
        self.required.iter().chain(self.optional).copied()
    }
}

/// An open CSV file.
#[derive(Debug)]
pub(crate) struct Table {
    file: PathBuf,
    lines: Lines,
    columns: Columns,
    header: Vec<String>,
    /// For each column, which cell of a row holds it.
    cell_of: Vec<usize>,
    /// Where the cells of the current row end, each at its comma.
    ends: Vec<usize>,
}

impl Table {
    /// Opens `file` and reads its header. `mend` completes the message for a file of no bytes.
    pub(crate) fn open(file: &Path, columns: Columns, mend: &'static str) -> Result<Table, LogError> {
        let source = File::open(file).map_err(LogError::io(file, "open"))?;
        let mut lines = Lines::new(source);
        let first = match lines.next_line().map_err(LogError::io(file, "read"))? {
            Line::At(range) => lines.bytes(range),
            Line::TooLong => return Err(LogError::LineTooLong { file: file.to_owned(), line: 1, limit: LINE_MAX }),
            Line::End => {
                return Err(LogError::EmptyFile { file: file.to_owned(), expected: columns.required.join(","), mend });
            }
        };
        let header: Vec<String> =
            first.split(|&byte| byte == b',').map(|cell| String::from_utf8_lossy(cell.trim_ascii()).into()).collect();
        let cell_of = find_columns(file, columns, &header)?;
        Ok(Table { file: file.to_owned(), lines, columns, header, cell_of, ends: Vec::new() })
    }

    /// Whether the file has that column.
    pub(crate) fn has(&self, column: usize) -> bool {
        self.cell_of[column] != ABSENT
    }

    /// The next row that is not blank.
    pub(crate) fn next_row(&mut self) -> Result<Option<Row<'_>>, LogError> {
        let range = loop {
            match self.lines.next_line().map_err(LogError::io(&self.file, "read"))? {
                Line::At(range) if self.lines.bytes(range.clone()).trim_ascii().is_empty() => {}
                Line::At(range) => break range,
                Line::TooLong => {
                    let line = self.lines.number();
                    return Err(LogError::LineTooLong { file: self.file.clone(), line, limit: LINE_MAX });
                }
                Line::End => return Ok(None),
            }
        };
        let bytes = self.lines.bytes(range);
        self.ends.clear();
        self.ends.extend(memchr::memchr_iter(b',', bytes));
        self.ends.push(bytes.len());
        if self.ends.len() != self.header.len() {
            return Err(self.cell_count());
        }
        Ok(Some(Row {
            bytes,
            ends: &self.ends,
            cell_of: &self.cell_of,
            columns: self.columns,
            file: &self.file,
            line: self.lines.number(),
        }))
    }

    fn cell_count(&self) -> LogError {
        let (found, expected) = (self.ends.len(), self.header.len());
        let mend = if found < expected {
            "is the row cut off? write every cell, empty where not reported"
        } else {
            "is the comma used as a decimal point? write `.`"
        };
        let column = self.header[found.min(expected - 1)].clone();
        LogError::CellCount { file: self.file.clone(), line: self.lines.number(), column, found, expected, mend }
    }
}

fn find_columns(file: &Path, columns: Columns, header: &[String]) -> Result<Vec<usize>, LogError> {
    let mut cell_of = Vec::new();
    for (index, column) in columns.iter().enumerate() {
        let mut cells = header.iter().enumerate().filter(|(_, name)| *name == column).map(|(cell, _)| cell);
        match (cells.next(), cells.next()) {
            (Some(_), Some(_)) => return Err(LogError::RepeatedColumn { file: file.to_owned(), column }),
            (Some(cell), None) => cell_of.push(cell),
            (None, _) if index >= columns.required.len() => cell_of.push(ABSENT),
            (None, _) => {
                return Err(LogError::MissingColumn {
                    file: file.to_owned(),
                    column,
                    expected: columns.required.join(","),
                    found: shorten(header.join(",").as_bytes()),
                });
            }
        }
    }
    Ok(cell_of)
}

fn shorten(bytes: &[u8]) -> String {
    let text = String::from_utf8_lossy(bytes);
    match text.char_indices().nth(SHOWN) {
        Some((end, _)) => format!("{}...", &text[..end]),
        None => text.into_owned(),
    }
}

/// One row, as bytes.
#[derive(Debug)]
pub struct Row<'a> {
    bytes: &'a [u8],
    ends: &'a [usize],
    cell_of: &'a [usize],
    columns: Columns,
    file: &'a Path,
    line: u64,
}

impl Row<'_> {
    pub(crate) fn line(&self) -> u64 {
        self.line
    }

    pub(crate) fn file(&self) -> &Path {
        self.file
    }

    /// The cell, without blanks around it; empty where the column is absent.
    fn cell(&self, column: usize) -> &[u8] {
        let cell = self.cell_of[column];
        if cell == ABSENT {
            return &[];
        }
        let start = if cell == 0 { 0 } else { self.ends[cell - 1] + 1 };
        self.bytes[start..self.ends[cell]].trim_ascii()
    }

    fn error(&self, column: usize, expected: &'static str) -> LogError {
        LogError::NotANumber {
            file: self.file.to_owned(),
            line: self.line,
            column: self.columns.name(column),
            found: shorten(self.cell(column)),
            expected,
        }
    }

    /// A number; NaN where none is reported.
    pub(crate) fn number(&self, column: usize) -> Result<f64, LogError> {
        let cell = self.cell(column);
        if cell.is_empty() {
            return Ok(f64::NAN);
        }
        let parsed = std::str::from_utf8(cell).ok().and_then(|text| text.parse().ok());
        parsed.ok_or_else(|| self.error(column, "a number (write `nan` for not reported)"))
    }

    /// `N` numbers in columns that follow each other in the list of names.
    pub(crate) fn numbers<const N: usize>(&self, first: usize) -> Result<[f64; N], LogError> {
        let mut values = [0.0; N];
        for (index, value) in values.iter_mut().enumerate() {
            *value = self.number(first + index)?;
        }
        Ok(values)
    }

    /// An instant; every row needs one.
    pub(crate) fn time(&self, column: usize) -> Result<Time, LogError> {
        Time::parse(self.cell(column)).map_err(|_| self.error(column, "a time in decimal seconds"))
    }

    /// A whole number from 0; `None` where none is reported.
    pub(crate) fn whole(&self, column: usize) -> Result<Option<u64>, LogError> {
        let cell = self.cell(column);
        if cell.is_empty() || cell.eq_ignore_ascii_case(b"nan") {
            return Ok(None);
        }
        let text = std::str::from_utf8(cell).map_err(|_| self.error(column, "a whole number"))?;
        // Spreadsheets and numerical tools write `3.0`.
        let text = text
            .split_once('.')
            .map_or(text, |(whole, rest)| if rest.bytes().all(|b| b == b'0') { whole } else { text });
        text.parse().map(Some).map_err(|_| self.error(column, "a whole number"))
    }

    /// A whole number from 0 of 32 bits; every row needs one.
    pub(crate) fn index(&self, column: usize) -> Result<u32, LogError> {
        let whole = self.whole(column)?.and_then(|value| u32::try_from(value).ok());
        whole.ok_or_else(|| self.error(column, "a whole number of at most 32 bits"))
    }
}
