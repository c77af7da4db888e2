//! One file of the log directory as an iterator of readings.
//!
//! Rows must stand in the order by which the log is merged: `t` in a plain log, `t_arrival` in a recording (whose `t` may run
//! backwards where a sensor's did: the recording says what happened, and the preprocessor counts such readings again).

use std::collections::{BTreeMap, BTreeSet, VecDeque};
use std::marker::PhantomData;
use std::path::Path;

use shared_types::{BuoyFix, ImuSample, LblRange, Time, Truth};

use crate::error::LogError;
use crate::rows::{LogRow, columns_of, parse_header, said_column, t_arrival_column};
use crate::table::Table;

/// What to do about an empty file of an aiding sensor.
const MEND_EMPTY: &str = ", or delete the file: a missing file means that the sensor was not fitted";
/// What to do about an empty `imu.csv`, which no log may lack.
const MEND_EMPTY_IMU: &str = ": no log is without an IMU, so the recording was cut off or the file was overwritten";
/// Ranges with one `t` that are counted ahead; an epoch of more has no known size.
const EPOCH_MAX: usize = 256;

/// Which column the rows are ordered by.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Order {
    /// `t`: any log.
    Valid,
    /// `t_arrival`: a recording.
    Arrival,
}

/// Readings of one file, in its order. After an error it ends. A sensor that was not fitted has none.
#[derive(Debug)]
pub struct LogReader<R> {
    table: Option<Table>,
    order: Order,
    last: Option<Time>,
    rows: u64,
    reads: PhantomData<fn() -> R>,
}

impl<R: LogRow> LogReader<R> {
    /// Opens the file of `R` in `dir` and checks its header; a missing file gives an empty reader.
    pub(crate) fn open(dir: &Path, order: Order) -> Result<LogReader<R>, LogError> {
        let file = dir.join(R::FILE);
        let mend = if R::FILE == ImuSample::FILE { MEND_EMPTY_IMU } else { MEND_EMPTY };
        let table = if file.exists() { Some(Table::open(&file, columns_of::<R>(), mend)?) } else { None };
        Ok(LogReader { table, order, last: None, rows: 0, reads: PhantomData })
    }

    /// Whether the file exists.
    pub fn is_fitted(&self) -> bool {
        self.table.is_some()
    }

    /// Whether its rows say when they arrived.
    pub(crate) fn has_arrival(&self) -> bool {
        self.has(t_arrival_column::<R>())
    }

    fn has(&self, column: usize) -> bool {
        !R::RECORDED.is_empty() && self.table.as_ref().is_some_and(|table| table.has(column))
    }

    fn read(&mut self) -> Result<Option<(u64, R)>, LogError> {
        let (has_arrival, counted) = (self.has_arrival(), self.rows);
        let Some(table) = &mut self.table else { return Ok(None) };
        let Some(row) = table.next_row()? else { return Ok(None) };
        let line = row.line();
        let reading = R::parse(&row, parse_header::<R>(&row, has_arrival, counted)?)?;
        let by_arrival = self.order == Order::Arrival && has_arrival;
        let t = Time(if by_arrival { reading.header().t_arrival } else { reading.header().t_valid });
        if let Some(previous) = self.last.filter(|&last| t < last) {
            let (column, file) = (if by_arrival { "t_arrival" } else { "t" }, row.file().to_owned());
            return Err(LogError::TimeRunsBackwards { file, line, column, t, previous });
        }
        self.last = Some(t);
        self.rows += 1;
        Ok(Some((line, reading)))
    }

    /// The next reading with its line number.
    pub(crate) fn next_with_line(&mut self) -> Option<Result<(u64, R), LogError>> {
        let next = self.read().transpose();
        if matches!(next, None | Some(Err(_))) {
            self.table = None;
        }
        next
    }
}

impl<R: LogRow> Iterator for LogReader<R> {
    type Item = Result<R, LogError>;

    fn next(&mut self) -> Option<Self::Item> {
        Some(self.next_with_line()?.map(|(_, reading)| reading))
    }
}

/// Opens a truth file by its own path, as `ilns score` names it.
///
/// # Errors
/// The file is missing, empty or lacks a column.
pub fn read_truth(file: impl AsRef<Path>) -> Result<LogReader<Truth>, LogError> {
    let table = Some(Table::open(file.as_ref(), columns_of::<Truth>(), "")?);
    Ok(LogReader { table, order: Order::Valid, last: None, rows: 0, reads: PhantomData })
}

/// Ranges of `lbl.csv`, each knowing how many its epoch has.
///
/// Rows with one `t` that follow each other are an epoch; the reader looks ahead to its end. A recording says it itself.
#[derive(Debug)]
pub struct LblReader {
    rows: LogReader<LblRange>,
    is_said: bool,
    epoch: VecDeque<LblRange>,
    /// First row of the next epoch, or the error behind this one.
    beyond: Option<Result<LblRange, LogError>>,
}

impl LblReader {
    pub(crate) fn new(rows: LogReader<LblRange>) -> LblReader {
        let is_said = rows.has(said_column::<LblRange>());
        LblReader { rows, is_said, epoch: VecDeque::new(), beyond: None }
    }

    /// Whether the file exists.
    pub fn is_fitted(&self) -> bool {
        self.rows.is_fitted()
    }

    fn read_epoch(&mut self) -> Result<(), LogError> {
        let Some(first) = self.beyond.take().or_else(|| self.rows.next()).transpose()? else { return Ok(()) };
        self.epoch.push_back(first);
        while self.epoch.len() < EPOCH_MAX {
            match self.rows.next() {
                Some(Ok(range)) if range.header.t_valid == first.header.t_valid => self.epoch.push_back(range),
                beyond => {
                    self.beyond = beyond;
                    break;
                }
            }
        }
        let whole = self.epoch.len() < EPOCH_MAX;
        let in_epoch = if whole { self.epoch.len() as u32 } else { 0 };
        self.epoch.iter_mut().for_each(|range| range.in_epoch = in_epoch);
        Ok(())
    }
}

impl Iterator for LblReader {
    type Item = Result<LblRange, LogError>;

    fn next(&mut self) -> Option<Self::Item> {
        if self.is_said {
            return self.rows.next();
        }
        if self.epoch.is_empty()
            && let Err(error) = self.read_epoch()
        {
            return Some(Err(error));
        }
        self.epoch.pop_front().map(Ok)
    }
}

/// Positions of `buoys.csv`, each knowing whether its buoy is moored: the only row of that buoy, or as a recording says.
#[derive(Debug)]
pub struct BuoyReader {
    rows: LogReader<BuoyFix>,
    moored: BTreeSet<u32>,
}

impl BuoyReader {
    /// Reads the file once for the number of rows per buoy and begins again.
    pub(crate) fn open(dir: &Path, order: Order) -> Result<BuoyReader, LogError> {
        let mut rows: LogReader<BuoyFix> = LogReader::open(dir, order)?;
        let mut moored = BTreeSet::new();
        if rows.is_fitted() && !rows.has(said_column::<BuoyFix>()) {
            let mut count = BTreeMap::<u32, u64>::new();
            // An error ends the count; the reader meets it again in its place.
            for fix in rows.map_while(Result::ok) {
                *count.entry(fix.buoy).or_default() += 1;
            }
            moored.extend(count.into_iter().filter(|&(_, rows)| rows == 1).map(|(buoy, _)| buoy));
            rows = LogReader::open(dir, order)?;
        }
        Ok(BuoyReader { rows, moored })
    }

    /// Whether the file exists.
    pub fn is_fitted(&self) -> bool {
        self.rows.is_fitted()
    }
}

impl Iterator for BuoyReader {
    type Item = Result<BuoyFix, LogError>;

    fn next(&mut self) -> Option<Self::Item> {
        let moored = &self.moored;
        Some(self.rows.next()?.map(|fix| BuoyFix { moored: fix.moored | u32::from(moored.contains(&fix.buoy)), ..fix }))
    }
}
