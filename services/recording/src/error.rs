//! What can be wrong with files, each with its place and its mend.

use std::io;
use std::path::{Path, PathBuf};

use crate::checkpoint::CheckpointError;
use crate::mcap::McapFault;
use shared_types::Time;

/// A log or estimate file that cannot be read or written.
#[derive(Debug, thiserror::Error)]
pub enum LogError {
    /// No such folder.
    #[error("{}: there is no such directory (a log is a folder with at least `imu.csv`)", dir.display())]
    MissingDirectory {
        /// As given.
        dir: PathBuf,
    },
    /// A file where a folder belongs.
    #[error("{}: this is not a directory (give the folder that holds `imu.csv`)", dir.display())]
    NotADirectory {
        /// As given.
        dir: PathBuf,
    },
    /// A log without an IMU.
    #[error("{}: the log has no `imu.csv`, without which there is nothing to navigate by (expected columns: {expected})", dir.display())]
    NoImu {
        /// The folder.
        dir: PathBuf,
        /// Header of the missing file.
        expected: String,
    },
    /// A file of no bytes.
    #[error("{}:1: the file is empty; its first line must be `{expected}`{mend}", file.display())]
    EmptyFile {
        /// Which file.
        file: PathBuf,
        /// The header that it lacks.
        expected: String,
        /// What else helps.
        mend: &'static str,
    },
    /// Nothing but a header where rows are needed.
    #[error("{}:2: no row follows the header; the log has zero length (record or export it again)", file.display())]
    NoRows {
        /// Which file.
        file: PathBuf,
    },
    /// A column that the format asks for is not there.
    #[error("{}:1: column `{column}` is missing; the header must hold `{expected}`, separated by commas, and reads `{found}`", file.display())]
    MissingColumn {
        /// Which file.
        file: PathBuf,
        /// Its name.
        column: &'static str,
        /// All that are required.
        expected: String,
        /// What stands there.
        found: String,
    },
    /// A column that stands twice, so that it is not clear which counts.
    #[error("{}:1: column `{column}` stands twice in the header; rename or remove one", file.display())]
    RepeatedColumn {
        /// Which file.
        file: PathBuf,
        /// Its name.
        column: &'static str,
    },
    /// A row that is shorter or longer than the header.
    #[error("{}:{line}: the row has {found} cells where the header has {expected} columns, near column `{column}` ({mend})", file.display())]
    CellCount {
        /// Which file.
        file: PathBuf,
        /// From 1.
        line: u64,
        /// First column without a cell, or the last column.
        column: String,
        /// Cells.
        found: usize,
        /// Columns.
        expected: usize,
        /// What the reason may be.
        mend: &'static str,
    },
    /// A cell that should hold a number.
    #[error("{}:{line}: column `{column}` holds {found:?}, which is not {expected}", file.display())]
    NotANumber {
        /// Which file.
        file: PathBuf,
        /// From 1.
        line: u64,
        /// Its name.
        column: &'static str,
        /// What stands there, shortened.
        found: String,
        /// What may stand there.
        expected: &'static str,
    },
    /// Rows out of order.
    #[error("{}:{line}: column `{column}`: time runs backwards, {t} s after {previous} s (sort the rows by `{column}`)", file.display())]
    TimeRunsBackwards {
        /// Which file.
        file: PathBuf,
        /// From 1.
        line: u64,
        /// `t` or `t_arrival`.
        column: &'static str,
        /// Of this row.
        t: Time,
        /// Of the row before.
        previous: Time,
    },
    /// A line without end: not a text file.
    #[error("{}:{line}: the line is longer than {limit} bytes; is this a CSV file?", file.display())]
    LineTooLong {
        /// Which file.
        file: PathBuf,
        /// From 1.
        line: u64,
        /// Longest that is read.
        limit: usize,
    },
    /// Ranges to a buoy that is nowhere.
    #[error("{}:{line}: column `buoy`: buoy {buoy} has no position (add its row to {}, or leave LBL out with `--no-lbl`)", file.display(), buoys.display())]
    BuoyWithoutPosition {
        /// File of the range.
        file: PathBuf,
        /// From 1.
        line: u64,
        /// Its number.
        buoy: u32,
        /// Where the position belongs.
        buoys: PathBuf,
    },
    /// A trajectory file without a pose.
    #[error("{}: there is no pose in the file (expected lines `{expected}`)", file.display())]
    NoPoses {
        /// Which file.
        file: PathBuf,
        /// What a line holds.
        expected: &'static str,
    },
    /// A line of a trajectory file that has not the numbers of a pose.
    #[error("{}:{line}: the line has {found} numbers where a pose has eight, separated by blanks: `{expected}`", file.display())]
    PoseCells {
        /// Which file.
        file: PathBuf,
        /// From 1.
        line: u64,
        /// Numbers.
        found: usize,
        /// What a line holds.
        expected: &'static str,
    },
    /// Four numbers that are no rotation.
    #[error("{}:{line}: the quaternion has the length {norm:.3}, so that it is no rotation; a TUM file holds unit quaternions in the order qx qy qz qw", file.display())]
    BadQuaternion {
        /// Which file.
        file: PathBuf,
        /// From 1.
        line: u64,
        /// Its length; 1 for a rotation.
        norm: f64,
    },
    /// A row of a public data set that has not the cells of its format.
    #[error("{}:{line}: the row has {found} values where the format has {expected} ({mend})", file.display())]
    ForeignCells {
        /// Which file.
        file: PathBuf,
        /// From 1.
        line: u64,
        /// Values.
        found: usize,
        /// How many there should be.
        expected: String,
        /// What the reason may be.
        mend: &'static str,
    },
    /// A file of a public data set without a row.
    #[error("{}: there is no row in the file (fetch it again)", file.display())]
    NoForeignRows {
        /// Which file.
        file: PathBuf,
    },
    /// A calibration that lacks a line.
    #[error("{}: there is no line `{line}` with its numbers", file.display())]
    MissingCalibration {
        /// Which file.
        file: PathBuf,
        /// How it begins.
        line: &'static str,
    },
    /// A folder that is no KITTI drive.
    #[error("{}: there is no `timestamps.txt` beside a folder `data` (give the folder of a drive, such as 2011_09_26_drive_0001_extract)", dir.display())]
    NotAnOxtsFolder {
        /// As given.
        dir: PathBuf,
    },
    /// A KITTI drive whose stamps and samples do not belong together.
    #[error("{}: {stamps} stamps in `timestamps.txt` but {files} files in `data` (was the archive unpacked whole?)", dir.display())]
    OxtsCounts {
        /// The `oxts` folder.
        dir: PathBuf,
        /// Lines.
        stamps: usize,
        /// Files.
        files: usize,
    },
    /// A folder that already holds a log; two logs in one would be read as one.
    #[error("{} exists: the folder already holds a log (choose another `--out` or delete it)", file.display())]
    LogExists {
        /// The file in the way.
        file: PathBuf,
    },
    /// An estimate with a NaN or an infinity, which is never written.
    #[error("the estimate at {t} s has {value} as its {field}; nothing was written for it and the run cannot go on")]
    EstimateNotFinite {
        /// Data time.
        t: Time,
        /// Which column.
        field: &'static str,
        /// What it holds.
        value: f64,
    },
    /// `summary.json` that is none.
    #[error("{}:{line}: {message} (is this a `summary.json` of this program?)", file.display())]
    Summary {
        /// Which file.
        file: PathBuf,
        /// From 1.
        line: usize,
        /// What is wrong.
        message: String,
    },
    /// A checkpoint that cannot be taken up.
    #[error("{}: {reason}", file.display())]
    Checkpoint {
        /// Which file.
        file: PathBuf,
        /// Why not.
        reason: CheckpointError,
    },
    /// An MCAP that is none, or not one of ours.
    #[error("{}: {fault}", file.display())]
    Mcap {
        /// Which file.
        file: PathBuf,
        /// What is wrong.
        fault: McapFault,
    },
    /// The operating system refused.
    #[error("{}: cannot {action}", file.display())]
    Io {
        /// Which file.
        file: PathBuf,
        /// `open`, `read`, `write` or the like.
        action: &'static str,
        /// Why.
        source: io::Error,
    },
}

impl LogError {
    /// Whether the disk refuses for want of room or of leave (full, over a quota, read-only): later it may take again.
    pub fn is_refusal(&self) -> bool {
        use io::ErrorKind::{FileTooLarge, QuotaExceeded, ReadOnlyFilesystem, StorageFull};
        let LogError::Io { source, .. } = self else { return false };
        matches!(source.kind(), StorageFull | QuotaExceeded | ReadOnlyFilesystem | FileTooLarge)
    }

    /// For `map_err`: what was tried on which file.
    pub(crate) fn io(file: &Path, action: &'static str) -> impl FnOnce(io::Error) -> LogError {
        let file = file.to_owned();
        move |source| LogError::Io { file, action, source }
    }
}
