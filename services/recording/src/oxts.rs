//! KITTI raw, the `oxts` folder of a drive: `timestamps.txt` and one `data/%010d.txt` of 30 numbers per sample.
//!
//! Geiger et al., "Vision meets robotics: the KITTI dataset", 2013. The unit's own filtered output beside its inertial readings.

use std::fs;
use std::path::{Path, PathBuf};

use shared_types::Time;

use crate::error::LogError;

/// Numbers of a sample.
const CELLS: usize = 30;

/// One sample.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct OxtsSample {
    /// Unix time.
    pub t: Time,
    /// Latitude, longitude (deg), altitude (m).
    pub lat_lon_h: [f64; 3],
    /// Roll (left side up), pitch (front down), yaw (0 east, counterclockwise), rad.
    pub roll_pitch_yaw: [f64; 3],
    /// East, north, up, m/s.
    pub velocity_enu: [f64; 3],
    /// Specific force forward, left, up, m/s².
    pub accel_body: [f64; 3],
    /// Forward, left, up, rad/s.
    pub gyro_body: [f64; 3],
    /// Of the position, 1-sigma, m.
    pub position_accuracy: f64,
}

/// Samples of a drive, in order of time.
#[derive(Clone, Debug, PartialEq)]
pub struct OxtsDrive {
    /// In order.
    pub samples: Vec<OxtsSample>,
    /// Samples that stood after a later one and were sorted.
    pub out_of_order: u64,
}

/// Reads a drive: `dir` is its folder, or the `oxts` in it.
///
/// # Errors
/// There is no `oxts`, stamps and files do not match, or a file is damaged.
pub fn read_oxts(dir: impl AsRef<Path>) -> Result<OxtsDrive, LogError> {
    let dir = dir.as_ref();
    let oxts = if dir.join("oxts").is_dir() { dir.join("oxts") } else { dir.to_owned() };
    let (stamps_file, data) = (oxts.join("timestamps.txt"), oxts.join("data"));
    if !stamps_file.exists() || !data.is_dir() {
        return Err(LogError::NotAnOxtsFolder { dir: oxts });
    }
    let stamps = read_stamps(&stamps_file)?;
    let files = sample_files(&data)?;
    if stamps.len() != files.len() {
        return Err(LogError::OxtsCounts { dir: oxts, stamps: stamps.len(), files: files.len() });
    }
    let mut samples = Vec::with_capacity(files.len());
    for (&t, file) in stamps.iter().zip(&files) {
        samples.push(read_sample(file, t)?);
    }
    if samples.is_empty() {
        return Err(LogError::NoForeignRows { file: stamps_file });
    }
    let out_of_order = stamps.windows(2).filter(|pair| pair[1] < pair[0]).count() as u64;
    samples.sort_by_key(|sample| sample.t);
    Ok(OxtsDrive { samples, out_of_order })
}

fn read_stamps(file: &Path) -> Result<Vec<Time>, LogError> {
    let text = fs::read_to_string(file).map_err(LogError::io(file, "read"))?;
    let lines = text.lines().enumerate().filter(|(_, line)| !line.trim().is_empty());
    lines
        .map(|(index, line)| {
            parse_stamp(line.trim()).ok_or_else(|| LogError::NotANumber {
                file: file.to_owned(),
                line: index as u64 + 1,
                column: "stamp",
                found: line.chars().take(40).collect(),
                expected: "a time such as 2011-09-26 13:02:25.964389445",
            })
        })
        .collect()
}

fn sample_files(data: &Path) -> Result<Vec<PathBuf>, LogError> {
    let entries = fs::read_dir(data).map_err(LogError::io(data, "read"))?;
    let mut files = Vec::new();
    for entry in entries {
        let path = entry.map_err(LogError::io(data, "read"))?.path();
        if path.extension().is_some_and(|extension| extension == "txt") {
            files.push(path);
        }
    }
    files.sort();
    Ok(files)
}

fn read_sample(file: &Path, t: Time) -> Result<OxtsSample, LogError> {
    let text = fs::read_to_string(file).map_err(LogError::io(file, "read"))?;
    let cells: Vec<&str> = text.split_whitespace().collect();
    if cells.len() != CELLS {
        let mend = "is the file cut off? fetch it again";
        let (file, found, expected) = (file.to_owned(), cells.len(), CELLS.to_string());
        return Err(LogError::ForeignCells { file, line: 1, found, expected, mend });
    }
    let number = |index: usize| {
        cells[index].parse::<f64>().map_err(|_| LogError::NotANumber {
            file: file.to_owned(),
            line: 1,
            column: "a value of the sample",
            found: cells[index].chars().take(40).collect(),
            expected: "a number",
        })
    };
    let three =
        |indices: [usize; 3]| Ok::<_, LogError>([number(indices[0])?, number(indices[1])?, number(indices[2])?]);
    Ok(OxtsSample {
        t,
        lat_lon_h: three([0, 1, 2])?,
        roll_pitch_yaw: three([3, 4, 5])?,
        // The file says north first.
        velocity_enu: three([7, 6, 10])?,
        accel_body: three([11, 12, 13])?,
        gyro_body: three([17, 18, 19])?,
        position_accuracy: number(23)?,
    })
}

/// `2011-09-26 13:02:25.964389445` as Unix time.
fn parse_stamp(text: &str) -> Option<Time> {
    let (date, clock) = text.split_once(' ')?;
    let mut date = date.splitn(3, '-').map(str::parse::<i64>);
    let (year, month, day) = (date.next()?.ok()?, date.next()?.ok()?, date.next()?.ok()?);
    let mut clock = clock.splitn(3, ':');
    let (hours, minutes) = (clock.next()?.parse::<i64>().ok()?, clock.next()?.parse::<i64>().ok()?);
    let seconds = Time::parse(clock.next()?.as_bytes()).ok()?;
    let is_a_date = (1970..2200).contains(&year) && (1..=12).contains(&month) && (1..=31).contains(&day);
    let is_a_time = (0..24).contains(&hours) && (0..60).contains(&minutes) && (0..61_000_000_000).contains(&seconds.0);
    let whole = (days_since_1970(year, month, day) * 24 + hours) * 3600 + minutes * 60;
    (is_a_date && is_a_time).then_some(Time(whole * 1_000_000_000 + seconds.0))
}

/// Gregorian; March counts as the first month, so that the leap day is the last day of a year.
fn days_since_1970(year: i64, month: i64, day: i64) -> i64 {
    let year = if month <= 2 { year - 1 } else { year };
    let from_march = (month + 9) % 12;
    let day_of_year = (153 * from_march + 2) / 5 + day - 1;
    365 * year + year / 4 - year / 100 + year / 400 + day_of_year - 719_468
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn stamps_become_unix_time() {
        // `date -u -d ... +%s` says so.
        assert_eq!(parse_stamp("2011-09-26 13:02:25.964389445"), Some(Time(1_317_042_145_964_389_445)));
        assert_eq!(parse_stamp("1970-01-01 00:00:00"), Some(Time(0)));
        assert_eq!(parse_stamp("2000-02-29 23:59:59.5"), Some(Time(951_868_799_500_000_000)));
        for text in ["2011-09-26", "2011-13-26 13:02:25.9", "2011-09-26 25:02:25.9", "26.9.2011 13:02:25", ""] {
            assert_eq!(parse_stamp(text), None, "{text}");
        }
    }
}
