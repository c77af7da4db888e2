//! Reads `estimate.csv`, ours or anybody's: the columns of the format are required, those that we add are not.

use std::path::Path;

use shared_types::Time;

use crate::error::LogError;
use crate::estimate_writer::{ADDED, COLUMNS};
use crate::table::{Columns, Row, Table};

/// One row of `estimate.csv`. Angles in degrees, as the file has them.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct EstimateRow {
    /// Data time.
    pub t: Time,
    /// m.
    pub position_enu: [f64; 3],
    /// Body to ENU, Hamilton (w, x, y, z).
    pub q_enu_body: [f64; 4],
    /// m/s.
    pub velocity_enu: [f64; 3],
    /// m/s².
    pub accel_bias: [f64; 3],
    /// rad/s.
    pub gyro_bias: [f64; 3],
    /// 1-sigma, m.
    pub sigma_position_enu: [f64; 3],
    /// 1-sigma about body x, body y and the up axis, degrees.
    pub sigma_rpy_deg: [f64; 3],
    /// Latitude, longitude in degrees, ellipsoidal height in m.
    pub lat_lon_h: [f64; 3],
    /// [`shared_types::Mode`] as a number.
    pub mode: Option<u32>,
    /// Which solution it stands on.
    pub solution: Option<u64>,
    /// Keyframe of that solution.
    pub t_keyframe: Option<Time>,
    /// 1-sigma, m/s; NaN where the file has none.
    pub sigma_velocity_enu: [f64; 3],
}

/// Rows of an `estimate.csv`. After an error it ends.
#[derive(Debug)]
pub struct EstimateReader {
    table: Option<Table>,
    has_keyframe: bool,
    last: Option<Time>,
}

/// Opens an `estimate.csv`.
///
/// # Errors
/// The file cannot be opened, is empty or lacks a column.
pub fn read_estimates(file: impl AsRef<Path>) -> Result<EstimateReader, LogError> {
    const MEND: &str = " (did the run that should have written it fail?)";
    let columns = Columns { required: COLUMNS, optional: ADDED };
    let table = Table::open(file.as_ref(), columns, MEND)?;
    let has_keyframe = table.has(COLUMNS.len() + 2);
    Ok(EstimateReader { table: Some(table), has_keyframe, last: None })
}

impl EstimateReader {
    fn read(&mut self) -> Result<Option<EstimateRow>, LogError> {
        let Some(table) = &mut self.table else { return Ok(None) };
        let Some(row) = table.next_row()? else { return Ok(None) };
        let estimate = parse(&row, self.has_keyframe)?;
        if let Some(previous) = self.last.filter(|&last| estimate.t < last) {
            let (file, line, t) = (row.file().to_owned(), row.line(), estimate.t);
            return Err(LogError::TimeRunsBackwards { file, line, column: "t", t, previous });
        }
        self.last = Some(estimate.t);
        Ok(Some(estimate))
    }
}

impl Iterator for EstimateReader {
    type Item = Result<EstimateRow, LogError>;

    fn next(&mut self) -> Option<Self::Item> {
        let next = self.read().transpose();
        if matches!(next, None | Some(Err(_))) {
            self.table = None;
        }
        next
    }
}

fn parse(row: &Row<'_>, has_keyframe: bool) -> Result<EstimateRow, LogError> {
    let added = COLUMNS.len();
    Ok(EstimateRow {
        t: row.time(0)?,
        position_enu: row.numbers(1)?,
        q_enu_body: row.numbers(4)?,
        velocity_enu: row.numbers(8)?,
        accel_bias: row.numbers(11)?,
        gyro_bias: row.numbers(14)?,
        sigma_position_enu: row.numbers(17)?,
        sigma_rpy_deg: row.numbers(20)?,
        lat_lon_h: row.numbers(23)?,
        mode: row.whole(added)?.map(|mode| mode as u32),
        solution: row.whole(added + 1)?,
        t_keyframe: if has_keyframe { Some(row.time(added + 2)?) } else { None },
        sigma_velocity_enu: row.numbers(added + 3)?,
    })
}
