//! The KAIST complex urban data set: `sensor_data/*.csv`, `global_pose.csv`, `calibration/*.txt` of a sequence.
//!
//! Jeong et al., "Complex urban dataset with multi-level sensors from highly diverse urban environments", 2019. Stamps are whole
//! nanoseconds since the Unix epoch on one clock. Positions in the pose file are UTM of zone 52 north.

use std::fs;
use std::path::Path;

use crate::error::LogError;
use crate::foreign::{ForeignRows, Format, read_foreign};

/// Rate (rad/s) and specific force (m/s², z up) of `sensor_data/xsens_imu.csv`: gx, gy, gz, ax, ay, az.
///
/// # Errors
/// The file is missing, damaged, or of a generation without raw rates.
pub fn kaist_imu(file: impl AsRef<Path>) -> Result<ForeignRows<6>, LogError> {
    const OLD: &str =
        "an older sequence whose IMU file holds orientations only, no raw rates: take one with 17 columns";
    let format = Format {
        cells: &[17],
        wanted: [(8, "gx"), (9, "gy"), (10, "gz"), (11, "ax"), (12, "ay"), (13, "az")],
        known_others: &[(8, OLD)],
    };
    read_foreign(file.as_ref(), &format)
}

/// Of `sensor_data/vrs_gps.csv`: latitude, longitude (deg), altitude (m), fix state (1 single, 4 fixed, 5 float), and their standard
/// deviations along latitude, longitude, up (m).
///
/// # Errors
/// The file is missing or damaged.
pub fn kaist_vrs(file: impl AsRef<Path>) -> Result<ForeignRows<7>, LogError> {
    let wanted =
        [(1, "lat"), (2, "lon"), (5, "altitude"), (6, "fix_state"), (9, "lat_std"), (10, "lon_std"), (11, "alt_std")];
    read_foreign(file.as_ref(), &Format { cells: &[17, 18], wanted, known_others: &[] })
}

/// Of `sensor_data/gps.csv`: latitude, longitude (deg), altitude (m), variances along east, north, up (m²).
///
/// # Errors
/// The file is missing or damaged.
pub fn kaist_gps(file: impl AsRef<Path>) -> Result<ForeignRows<6>, LogError> {
    let wanted = [(1, "lat"), (2, "lon"), (3, "alt"), (4, "cov[0]"), (8, "cov[4]"), (12, "cov[8]")];
    read_foreign(file.as_ref(), &Format { cells: &[13], wanted, known_others: &[] })
}

/// Left and right count of `sensor_data/encoder.csv`, cumulative.
///
/// # Errors
/// The file is missing or damaged.
pub fn kaist_encoder(file: impl AsRef<Path>) -> Result<ForeignRows<2>, LogError> {
    let wanted = [(1, "left_count"), (2, "right_count")];
    read_foreign(file.as_ref(), &Format { cells: &[3], wanted, known_others: &[] })
}

/// Barometric altitude of `sensor_data/altimeter.csv`, m.
///
/// # Errors
/// The file is missing or damaged.
pub fn kaist_altimeter(file: impl AsRef<Path>) -> Result<ForeignRows<1>, LogError> {
    read_foreign(file.as_ref(), &Format { cells: &[2], wanted: [(1, "altitude")], known_others: &[] })
}

/// Vehicle to UTM of `global_pose.csv`: the 3 × 4 matrix row by row, m.
///
/// # Errors
/// The file is missing or damaged.
pub fn kaist_global_pose(file: impl AsRef<Path>) -> Result<ForeignRows<12>, LogError> {
    const NAMES: [&str; 12] = ["r11", "r12", "r13", "tx", "r21", "r22", "r23", "ty", "r31", "r32", "r33", "tz"];
    let wanted = std::array::from_fn(|index| (index + 1, NAMES[index]));
    read_foreign(file.as_ref(), &Format { cells: &[13], wanted, known_others: &[] })
}

/// Where a sensor sits in the vehicle (x forward, y left, z up): p_vehicle = R p_sensor + T.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct KaistMounting {
    /// R row by row.
    pub rotation: [f64; 9],
    /// T, m.
    pub translation: [f64; 3],
}

impl KaistMounting {
    /// At the vehicle's origin, axes alike.
    pub const IDENTITY: KaistMounting =
        KaistMounting { rotation: [1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0], translation: [0.0; 3] };
}

/// Reads `calibration/Vehicle2IMU.txt` and its like.
///
/// # Errors
/// The file is missing, or has no line `R:` of nine numbers or `T:` of three.
pub fn kaist_mounting(file: impl AsRef<Path>) -> Result<KaistMounting, LogError> {
    let file = file.as_ref();
    let text = fs::read_to_string(file).map_err(LogError::io(file, "read"))?;
    let rotation = numbers(&text, "R:").ok_or_else(|| missing(file, "R: r11 r12 ... r33"))?;
    let translation = numbers(&text, "T:").ok_or_else(|| missing(file, "T: x y z"))?;
    Ok(KaistMounting { rotation, translation })
}

/// What turns counts into metres.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct KaistEncoder {
    /// Counts of a turn.
    pub resolution: f64,
    /// m.
    pub left_diameter: f64,
    /// m.
    pub right_diameter: f64,
}

/// Reads `calibration/EncoderParameter.txt`.
///
/// # Errors
/// The file is missing or lacks a line.
pub fn kaist_encoder_parameters(file: impl AsRef<Path>) -> Result<KaistEncoder, LogError> {
    let file = file.as_ref();
    let text = fs::read_to_string(file).map_err(LogError::io(file, "read"))?;
    let number = |name: &'static str| {
        let [value] = numbers(&text, name).filter(|[value]| *value > 0.0).ok_or_else(|| missing(file, name))?;
        Ok::<f64, LogError>(value)
    };
    Ok(KaistEncoder {
        resolution: number("Encoder resolution:")?,
        left_diameter: number("Encoder left wheel diameter:")?,
        right_diameter: number("Encoder right wheel diameter:")?,
    })
}

fn missing(file: &Path, line: &'static str) -> LogError {
    LogError::MissingCalibration { file: file.to_owned(), line }
}

/// The numbers of the line that begins with `name`; `None` if there is none or it holds something else.
fn numbers<const N: usize>(text: &str, name: &str) -> Option<[f64; N]> {
    let line = text.lines().find_map(|line| line.trim().strip_prefix(name))?;
    let values: Option<Vec<f64>> = line.split_whitespace().map(|cell| cell.parse().ok()).collect();
    values?.try_into().ok().filter(|values: &[f64; N]| values.iter().all(|value| value.is_finite()))
}
