//! Reads trajectories in TUM format, anybody's: `t x y z qx qy qz qw`, blanks between, `#` before comments.
//!
//! A file is a few megabytes at most and is read whole: its poses are associated with those of another by time.

use std::fs::File;
use std::path::Path;

use shared_types::Time;

use crate::error::LogError;
use crate::lines::{LINE_MAX, Line, Lines};

/// What a line holds.
const EXPECTED: &str = "t x y z qx qy qz qw";
/// A quaternion written with three decimals has a norm within this of 1.
const NORM_TOLERANCE: f64 = 1e-2;

/// One line of a TUM file.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TumRow {
    /// Data time.
    pub t: Time,
    /// m.
    pub position: [f64; 3],
    /// Body to the frame of the file, Hamilton (w, x, y, z), of unit length but for rounding.
    pub quaternion: [f64; 4],
}

/// Reads a TUM file.
///
/// # Errors
/// It cannot be read, has no pose, or a line that is none: too few or too many numbers, one that is not finite, a quaternion
/// that is no rotation, a time that runs backwards.
pub fn read_tum(file: impl AsRef<Path>) -> Result<Vec<TumRow>, LogError> {
    let file = file.as_ref();
    let mut lines = Lines::new(File::open(file).map_err(LogError::io(file, "open"))?);
    let mut rows: Vec<TumRow> = Vec::new();
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
        if text.trim().is_empty() || text.trim_start().starts_with('#') {
            continue;
        }
        let row = parse(&text).map_err(|problem| problem.at(file, line))?;
        if let Some(previous) = rows.last().map(|last| last.t).filter(|&last| row.t < last) {
            let (file, t) = (file.to_owned(), row.t);
            return Err(LogError::TimeRunsBackwards { file, line, column: "t", t, previous });
        }
        rows.push(row);
    }
    if rows.is_empty() {
        return Err(LogError::NoPoses { file: file.to_owned(), expected: EXPECTED });
    }
    Ok(rows)
}

enum Problem {
    Count(usize),
    Number(&'static str, String),
    Quaternion(f64),
}

impl Problem {
    fn at(self, file: &Path, line: u64) -> LogError {
        let file = file.to_owned();
        match self {
            Problem::Count(found) => LogError::PoseCells { file, line, found, expected: EXPECTED },
            Problem::Number(column, found) => {
                LogError::NotANumber { file, line, column, found, expected: "a finite number" }
            }
            Problem::Quaternion(norm) => LogError::BadQuaternion { file, line, norm },
        }
    }
}

fn parse(text: &str) -> Result<TumRow, Problem> {
    let cells: Vec<&str> = text.split_whitespace().collect();
    let &[t, x, y, z, qx, qy, qz, qw] = &cells[..] else { return Err(Problem::Count(cells.len())) };
    let number = |column: &'static str, cell: &str| {
        let value = cell.parse().ok().filter(|value: &f64| value.is_finite());
        value.ok_or_else(|| Problem::Number(column, cell.chars().take(40).collect()))
    };
    let quaternion = [number("qw", qw)?, number("qx", qx)?, number("qy", qy)?, number("qz", qz)?];
    let norm = quaternion.iter().map(|q| q * q).sum::<f64>().sqrt();
    if (norm - 1.0).abs() > NORM_TOLERANCE {
        return Err(Problem::Quaternion(norm));
    }
    let position = [number("x", x)?, number("y", y)?, number("z", z)?];
    let t = Time::parse(t.as_bytes()).map_err(|_| Problem::Number("t", t.chars().take(40).collect()))?;
    Ok(TumRow { t, position, quaternion })
}

#[cfg(test)]
mod tests {
    #![expect(clippy::unwrap_used, reason = "a test may fail where it stands")]
    use std::fs;

    use super::*;

    fn read(text: &str) -> Result<Vec<TumRow>, String> {
        let dir = tempfile::tempdir().unwrap();
        let file = dir.path().join("run.tum");
        fs::write(&file, text).unwrap();
        read_tum(&file).map_err(|error| {
            let message = error.to_string();
            message.split_once("run.tum").unwrap().1.to_owned()
        })
    }

    #[test]
    fn comments_blank_lines_tabs_and_exponents_are_taken_as_they_come() {
        let rows =
            read("# t x y z qx qy qz qw\n\n1.5 1 2 3 0 0 0 1\n1.600000000e+00\t-1 2 3.5e0 0 0 0.6 0.8\r\n").unwrap();
        assert_eq!(
            rows[0],
            TumRow { t: Time(1_500_000_000), position: [1.0, 2.0, 3.0], quaternion: [1.0, 0.0, 0.0, 0.0] }
        );
        assert_eq!((rows[1].t, rows[1].position, rows[1].quaternion[3]), (Time(1_600_000_000), [-1.0, 2.0, 3.5], 0.6));
    }

    #[test]
    fn a_line_that_is_no_pose_is_named_with_its_mend() {
        let refused = |text: &str| read(text).unwrap_err();
        let norm = refused("0 0 0 0 0 0 0 1\n1 0 0 0 0 0 0 0\n");
        assert!(norm.starts_with(":2: the quaternion has the length 0"), "{norm}");
        assert!(refused("0 0 0 0 0.5 0 0 0.5\n").contains("length 0.707"));
        assert!(refused("0 0 0 0 nan 0 0 1\n").contains("column `qx` holds \"nan\""));
        assert!(refused("0,0,0,0,0,0,0,1\n").starts_with(":1: the line has 1 numbers"));
        assert!(refused("0 0 0\n").contains("`t x y z qx qy qz qw`"));
        assert!(refused("2 0 0 0 0 0 0 1\n1 0 0 0 0 0 0 1\n").contains("time runs backwards"));
        assert!(refused("# nothing\n").contains("no pose"));
    }
}
