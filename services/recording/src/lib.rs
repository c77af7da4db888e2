//! Data at rest: the sensor-log directory, the estimate files and the summary of a run.
//!
//! ```text
//! log directory --> LogDirectory --> LogReader (one file) | MergedLog (all sensors in one order)
//! readings      --> LogWriter    --> log directory
//! estimates     --> EstimateWriter --> estimate.csv, estimate.tum;  Summary --> summary.json
//! estimate.csv  --> read_estimates;  any .tum --> read_tum
//! estimate.csv  --> read_estimates
//! the whole run --> mcap::McapWriter --> recording.mcap --> mcap::{inspect, recover, export}
//! ```
//!
//! Every reader streams: a log of a day takes no more memory than one of a minute. Every error names file, line, column
//! and the mend. What a cell means, and in which unit, stands in the format document of the log directory.

mod checkpoint;
mod decimal;
mod directory;
mod error;
mod estimate_reader;
mod estimate_writer;
mod foreign;
mod kaist;
mod lines;
mod log_writer;
pub mod mcap;
mod merged;
mod oxts;
mod reader;
mod rows;
mod summary;
mod table;
#[cfg(test)]
mod testing;
mod text_file;
mod tum_reader;

pub use checkpoint::{
    Checkpoint, CheckpointError, CheckpointTerms, Durability, Kept, configuration_hash, kept_file, read_checkpoint,
    write_checkpoint,
};
pub use directory::LogDirectory;
pub use error::LogError;
pub use estimate_reader::{EstimateReader, EstimateRow, read_estimates};
pub use estimate_writer::{ESTIMATE_FILES, EstimateWriter, LAGGED_FILES};
pub use foreign::ForeignRows;
pub use kaist::{
    KaistEncoder, KaistMounting, kaist_altimeter, kaist_encoder, kaist_encoder_parameters, kaist_global_pose,
    kaist_gps, kaist_imu, kaist_mounting, kaist_vrs,
};
pub use log_writer::{LogWriter, LogWriterOptions};
pub use merged::MergedLog;
pub use oxts::{OxtsDrive, OxtsSample, read_oxts};
pub use reader::{BuoyReader, LblReader, LogReader, read_truth};
pub use rows::LogRow;
pub use summary::{CalibrationSummary, SUMMARY_FILE, SensorSummary, SolveTimes, Summary, TimeOffsetSummary};
pub use tum_reader::{TumRow, read_tum};
