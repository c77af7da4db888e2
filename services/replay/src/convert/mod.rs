//! `ilns convert`: public data sets of land vehicles as log directories, with acoustic ranges simulated from their positions.
//!
//! The paper's Experiment III: nobody publishes long missions under water with a reference, so a car drives, its positions give
//! ranges to four buoys, its odometer stands for the Doppler log and its height for the depth. Whatever is left out or stands in
//! for something else is said on standard error and in the head of `sensors.toml`.

mod kaist;
mod kitti;
mod log;
mod ranges;

use std::path::PathBuf;

use clap::{Args, Subcommand};

use crate::error::ReplayError;

/// Turns a public data set into a log directory, with acoustic ranges simulated from its positions.
#[derive(Args, Clone, Debug)]
pub struct ConvertArgs {
    #[command(subcommand)]
    #[expect(missing_docs, reason = "a doc comment here would become the help text of the whole group")]
    pub format: ConvertFormat,
}

/// Which data set.
#[derive(Subcommand, Clone, Debug)]
pub enum ConvertFormat {
    /// A sequence of KAIST complex urban: sensor_data, calibration, global_pose.csv.
    ///
    /// IMU and wheel encoders as they are, ranges to four buoys from the VRS-RTK positions (worse where the fix is, none where there
    /// is none), the altimeter as depth, the consumer receiver as GNSS, global_pose.csv as truth.
    Kaist(FolderArgs),
    /// A drive of KITTI raw, `<date>_drive_<n>_extract` (100 Hz).
    ///
    /// IMU of the OXTS unit as it is; ranges to four buoys, velocities and depths from the unit's own output, with noise; the
    /// output itself as GNSS and as truth.
    Kitti(FolderArgs),
}

/// From where to where.
#[derive(Args, Clone, Debug)]
pub struct FolderArgs {
    /// Folder of the sequence or drive.
    #[arg(value_name = "DIR")]
    pub dir: PathBuf,
    /// Folder for the log; made where there is none.
    #[arg(long, value_name = "LOG")]
    pub out: PathBuf,
    /// Replace a log that the folder already holds.
    #[arg(long)]
    pub replace: bool,
    /// Of the simulated noise.
    #[arg(long, value_name = "N", default_value_t = 1)]
    pub seed: u64,
}

/// Converts, and says on standard error what was left out or stands in for something else.
///
/// # Errors
/// A file that is missing or damaged, in one line; a folder that already holds a log.
pub fn run(args: &ConvertArgs) -> Result<(), ReplayError> {
    let notes = match &args.format {
        ConvertFormat::Kaist(folder) => kaist::convert(folder)?,
        ConvertFormat::Kitti(folder) => kitti::convert(folder)?,
    };
    for note in notes {
        eprintln!("{note}");
    }
    Ok(())
}
