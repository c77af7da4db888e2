//! Files of public data sets: numbers without a header, in columns whose meaning a document says.
//!
//! Columns are counted, so that a file of another generation is told from a damaged one. Rows out of order are sorted and counted:
//! these sets were written by several processes at once.

use std::fs::File;
use std::path::Path;

use shared_types::Time;

use crate::error::LogError;
use crate::lines::{LINE_MAX, Line, Lines};

/// Which cells of a row are wanted.
pub(crate) struct Format<const N: usize> {
    /// Cells that a row may have.
    pub(crate) cells: &'static [usize],
    /// Index and name of those that are read.
    pub(crate) wanted: [(usize, &'static str); N],
    /// What a row of some other length may be, by its number of cells.
    pub(crate) known_others: &'static [(usize, &'static str)],
}

/// Rows of numbers with their stamps, in order of time.
#[derive(Clone, Debug, PartialEq)]
pub struct ForeignRows<const N: usize> {
    /// Time and the numbers that were asked for.
    pub rows: Vec<(Time, [f64; N])>,
    /// Rows that stood after a later one and were sorted.
    pub out_of_order: u64,
}

/// Reads a file whose first column is whole nanoseconds since the Unix epoch.
pub(crate) fn read_foreign<const N: usize>(file: &Path, format: &Format<N>) -> Result<ForeignRows<N>, LogError> {
    let mut lines = Lines::new(File::open(file).map_err(LogError::io(file, "open"))?);
    let mut rows: Vec<(Time, [f64; N])> = Vec::new();
    let mut out_of_order = 0;
    let mut latest = Time::MIN;
    loop {
        let range = match lines.next_line().map_err(LogError::io(file, "read"))? {
            Line::At(range) => range,
            Line::TooLong => {
                return Err(LogError::LineTooLong { file: file.to_owned(), line: lines.number(), limit: LINE_MAX });
            }
            Line::End => break,
        };
        let line = lines.number();
        let text = String::from_utf8_lossy(lines.bytes(range));
        if text.trim().is_empty() {
            continue;
        }
        let row = parse(&text, format).map_err(|problem| problem.at(file, line, format))?;
        out_of_order += u64::from(row.0 < latest);
        latest = latest.max(row.0);
        rows.push(row);
    }
    if rows.is_empty() {
        return Err(LogError::NoForeignRows { file: file.to_owned() });
    }
    // Stable: of equal stamps the first stays the first.
    rows.sort_by_key(|(t, _)| *t);
    Ok(ForeignRows { rows, out_of_order })
}

enum Problem {
    Cells(usize),
    Number(&'static str, String),
}

impl Problem {
    fn at<const N: usize>(self, file: &Path, line: u64, format: &Format<N>) -> LogError {
        let file = file.to_owned();
        match self {
            Problem::Cells(found) => {
                let known = format.known_others.iter().find(|(cells, _)| *cells == found);
                let expected: Vec<String> = format.cells.iter().map(ToString::to_string).collect();
                let mend = known.map_or("is the file cut off? fetch it again, or delete the row", |(_, mend)| mend);
                LogError::ForeignCells { file, line, found, expected: expected.join(" or "), mend }
            }
            Problem::Number(column, found) => LogError::NotANumber { file, line, column, found, expected: "a number" },
        }
    }
}

fn parse<const N: usize>(text: &str, format: &Format<N>) -> Result<(Time, [f64; N]), Problem> {
    let cells: Vec<&str> = text.split(',').map(str::trim).collect();
    if !format.cells.contains(&cells.len()) {
        return Err(Problem::Cells(cells.len()));
    }
    let shown = |cell: &str| cell.chars().take(40).collect();
    let stamp = cells[0].parse().map_err(|_| Problem::Number("stamp", shown(cells[0])))?;
    let mut numbers = [0.0; N];
    for (number, &(index, name)) in numbers.iter_mut().zip(&format.wanted) {
        *number = cells[index].parse().map_err(|_| Problem::Number(name, shown(cells[index])))?;
    }
    Ok((Time(stamp), numbers))
}
