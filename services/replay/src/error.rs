//! What can stop a replay, a score or a picture.

use std::io;
use std::path::PathBuf;

use ilns_recording::LogError;
use ilns_runtime::RuntimeError;

/// Each is one line that names the mend.
#[derive(Debug, thiserror::Error)]
pub enum ReplayError {
    /// The log or the estimates.
    #[error(transparent)]
    Log(#[from] LogError),
    /// `sensors.toml`, `--config` or `--set`.
    #[error(transparent)]
    Config(#[from] RuntimeError),
    /// Nothing says where the ENU frame of the estimates lies.
    #[error("{}: the origin of its frame is not known: no `summary.json` beside it and no `[frame] origin` in a `sensors.toml` beside the truth (give `--origin LAT,LON,H`)", estimate.display())]
    NoOrigin {
        /// The estimates.
        estimate: PathBuf,
    },
    /// Truth and estimates that never meet.
    #[error("{} and {} have no time in common within the limits given (are they of one run, on one clock?)", estimate.display(), truth.display())]
    NoCommonTime {
        /// The estimates.
        estimate: PathBuf,
        /// The truth.
        truth: PathBuf,
    },
    /// Two trajectories of which no poses are near in time.
    #[error("{} and {} have no poses within {max_difference_s} s of each other: {estimate_span} against {truth_span} (one clock? `--max-difference` widens the limit)", estimate.display(), truth.display())]
    NoCommonPoses {
        /// The trajectory.
        estimate: PathBuf,
        /// The reference.
        truth: PathBuf,
        /// The limit.
        max_difference_s: f64,
        /// First and last time.
        estimate_span: String,
        /// First and last time.
        truth_span: String,
    },
    /// A path too short for the stretches asked for.
    #[error("{}: the path is shorter than a stretch of {length} m, or the truth has no attitude: no relative error (leave `--rpe` out, or ask for shorter ones)", estimate.display())]
    NoStretches {
        /// The trajectory.
        estimate: PathBuf,
        /// m.
        length: f64,
    },
    /// Inertial data too slow to navigate by.
    #[error("{}: a sample every {period_s} s is no inertial navigation (take the `_extract` of the drive, 100 Hz, not the `_sync`)", dir.display())]
    SlowImu {
        /// The drive.
        dir: PathBuf,
        /// Median.
        period_s: f64,
    },
    /// A sequence without a position to simulate ranges from.
    #[error("{}: vrs_gps.csv has no fixed position (fix state 4) within the time of xsens_imu.csv, so that there is nothing to simulate ranges from", dir.display())]
    NothingToRangeFrom {
        /// The sequence.
        dir: PathBuf,
    },
    /// An estimate file without rows, of which there is no picture.
    #[error("{}: no row follows the header; there is nothing to draw", file.display())]
    NoEstimates {
        /// Which file.
        file: PathBuf,
    },
    /// An estimate file that does not say which solution each row stands on.
    #[error("{}: its rows do not name the solutions that they stand on; only an estimate.csv written by this program can be followed", file.display())]
    NotFollowable {
        /// Which file.
        file: PathBuf,
    },
    /// A log in which the vehicle never got a first state, or whose measurements do not determine the states.
    #[error("{}: no trajectory: the measurements never gave a first state, or do not determine one (`ilns replay` shows what was refused, and why)", log.display())]
    NothingToSmooth {
        /// Which log.
        log: PathBuf,
    },
    /// A filter is asked to smooth.
    #[error(
        "estimator \"{estimator}\" is a filter and keeps nothing to smooth (leave `--estimator` out, or give `--estimator fgo`)"
    )]
    NotASmoother {
        /// By name.
        estimator: &'static str,
    },
    /// A file that a command line names cannot be read or written.
    #[error("{}: cannot {action}", file.display())]
    Io {
        /// Which file.
        file: PathBuf,
        /// `read` or `write`.
        action: &'static str,
        /// Why.
        source: io::Error,
    },
    /// Standard output takes nothing.
    #[error("cannot write the result")]
    Print(#[source] io::Error),
}
