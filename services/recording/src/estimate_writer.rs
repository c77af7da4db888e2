//! `estimate.csv` and `estimate.tum`: one row per published estimate.
//!
//! | columns | precision |
//! |---|---|
//! | `t`, `t_keyframe` | exact, ns |
//! | `e,n,u`, `h`, `ve,vn,vu` | 6 decimals: 1 µm, 1 µm/s |
//! | quaternion | 9 decimals: 0.1 µdeg |
//! | biases | 9 decimals (m/s²), 12 decimals (rad/s) |
//! | sigmas | at least 7 significant digits |
//! | `lat,lon` | 11 decimals: 1.1 µm |
//!
//! After the columns of the format follow `mode,solution,t_keyframe` (which solution the estimate stands on) and
//! `sve,svn,svu` (1-sigma of the velocity). Nothing but finite numbers is ever written.

use std::fs;
use std::path::Path;

use shared_types::{Mode, NavEstimate, Time};

use crate::decimal::{push_fixed, push_significant, push_time};
use crate::error::LogError;
use crate::text_file::TextFile;

/// What a run leaves of its estimates.
pub const ESTIMATE_FILES: [&str; 2] = ["estimate.csv", "estimate.tum"];

/// The same a window later, where that was asked for (`fgo.fixed_lag`).
pub const LAGGED_FILES: [&str; 2] = ["estimate_lagged.csv", "estimate_lagged.tum"];

/// Columns of the format.
pub(crate) const COLUMNS: &[&str] = &[
    "t", "e", "n", "u", "qw", "qx", "qy", "qz", "ve", "vn", "vu", "bax", "bay", "baz", "bgx", "bgy", "bgz", "se", "sn",
    "su", "sroll", "spitch", "syaw", "lat", "lon", "h",
];
/// Columns that this program adds.
pub(crate) const ADDED: &[&str] = &["mode", "solution", "t_keyframe", "sve", "svn", "svu"];

/// Both files under construction, named `*.partial` until [`EstimateWriter::finish`].
#[derive(Debug)]
pub struct EstimateWriter {
    csv: TextFile,
    tum: TextFile,
    rows: u64,
}

impl EstimateWriter {
    /// Makes `out` where there is none and removes the estimates of an earlier run from it: if this one fails, none
    /// are left that could pass for its own.
    ///
    /// # Errors
    /// [`LogError::Io`].
    pub fn create(out: impl AsRef<Path>) -> Result<EstimateWriter, LogError> {
        let out = out.as_ref();
        fs::create_dir_all(out).map_err(LogError::io(out, "create the directory"))?;
        for file in LAGGED_FILES {
            remove(&out.join(file))?;
        }
        EstimateWriter::begin(out, ESTIMATE_FILES)
    }

    /// The same for the estimates of a window ago, beside those of an [`EstimateWriter::create`] before it.
    ///
    /// # Errors
    /// [`LogError::Io`].
    pub fn create_lagged(out: impl AsRef<Path>) -> Result<EstimateWriter, LogError> {
        EstimateWriter::begin(out.as_ref(), LAGGED_FILES)
    }

    fn begin(out: &Path, files: [&str; 2]) -> Result<EstimateWriter, LogError> {
        let [csv, tum] = files.map(|name| out.join(name));
        remove(&csv)?;
        remove(&tum)?;
        let mut csv = TextFile::create_partial(&csv)?;
        csv.text().extend_from_slice([COLUMNS, ADDED].concat().join(",").as_bytes());
        csv.text().push(b'\n');
        Ok(EstimateWriter { csv, tum: TextFile::create_partial(&tum)?, rows: 0 })
    }

    /// Appends an estimate; one that is still INITIALISING is passed over.
    ///
    /// # Errors
    /// [`LogError::EstimateNotFinite`] if a number is not finite, [`LogError::Io`].
    pub fn write(&mut self, estimate: &NavEstimate) -> Result<(), LogError> {
        if estimate.mode() == Mode::Initialising {
            return Ok(());
        }
        let sigmas = Sigmas::of(estimate);
        check(estimate, &sigmas)?;

        let t = Time(estimate.header.t_valid);
        let row = self.csv.text();
        let pose_start = row.len();
        push_time(row, t);
        push_row(row, b',', &estimate.position_enu, |text, value| push_fixed(text, value, 6));
        let position_end = row.len();
        push_row(row, b',', &estimate.q_enu_body, |text, value| push_fixed(text, value, 9));
        push_tum(self.tum.text(), &row[pose_start..position_end], &row[position_end..]);
        push_row(row, b',', &estimate.velocity_enu, |text, value| push_fixed(text, value, 6));
        push_row(row, b',', &estimate.accel_bias, |text, value| push_fixed(text, value, 9));
        push_row(row, b',', &estimate.gyro_bias, |text, value| push_fixed(text, value, 12));
        push_row(row, b',', &sigmas.position_enu, push_significant);
        push_row(row, b',', &sigmas.rpy_deg, push_significant);
        push_row(row, b',', &estimate.lat_lon_h[..2], |text, value| push_fixed(text, value, 11));
        push_row(row, b',', &estimate.lat_lon_h[2..], |text, value| push_fixed(text, value, 6));
        row.extend_from_slice(&[b',', b'0' + estimate.mode() as u8, b',']);
        row.extend_from_slice(itoa::Buffer::new().format(estimate.solution).as_bytes());
        row.push(b',');
        push_time(row, Time(estimate.t_keyframe));
        push_row(row, b',', &sigmas.velocity_enu, push_significant);
        row.push(b'\n');

        self.rows += 1;
        self.csv.row_done()?;
        self.tum.row_done()
    }

    /// Rows so far.
    pub fn rows(&self) -> u64 {
        self.rows
    }

    /// Hands all rows so far to the operating system; the files keep their `.partial`.
    ///
    /// # Errors
    /// [`LogError::Io`].
    pub fn flush(&mut self) -> Result<(), LogError> {
        self.csv.flush()?;
        self.tum.flush()
    }

    /// Completes both files and gives them their names.
    ///
    /// # Errors
    /// [`LogError::Io`].
    pub fn finish(self) -> Result<(), LogError> {
        self.csv.finish()?;
        self.tum.finish()
    }
}

fn remove(file: &Path) -> Result<(), LogError> {
    if file.exists() {
        fs::remove_file(file).map_err(LogError::io(file, "delete"))?;
    }
    Ok(())
}

fn push_row(text: &mut Vec<u8>, separator: u8, values: &[f64], push: impl Fn(&mut Vec<u8>, f64)) {
    for &value in values {
        text.push(separator);
        push(text, value);
    }
}

/// `t x y z qx qy qz qw` from the cells `t,e,n,u` and `,qw,qx,qy,qz`.
fn push_tum(tum: &mut Vec<u8>, t_and_position: &[u8], quaternion: &[u8]) {
    let end_of_w = 1 + memchr::memchr(b',', &quaternion[1..]).expect("four numbers were written, each behind a comma");
    let start = tum.len();
    tum.extend_from_slice(t_and_position);
    tum.extend_from_slice(&quaternion[end_of_w..]);
    tum.extend_from_slice(&quaternion[..end_of_w]);
    for byte in &mut tum[start..] {
        if *byte == b',' {
            *byte = b' ';
        }
    }
    tum.push(b'\n');
}

/// Standard deviations as the file gives them.
struct Sigmas {
    position_enu: [f64; 3],
    velocity_enu: [f64; 3],
    rpy_deg: [f64; 3],
}

impl Sigmas {
    fn of(estimate: &NavEstimate) -> Sigmas {
        // Diagonal of ee, en, eu, nn, nu, uu.
        let diagonal = |cov: &[f64; 6]| [cov[0].sqrt(), cov[3].sqrt(), cov[5].sqrt()];
        Sigmas {
            position_enu: diagonal(&estimate.position_cov),
            velocity_enu: diagonal(&estimate.velocity_cov),
            rpy_deg: estimate.sigma_rpy.map(f64::to_degrees),
        }
    }
}

fn check(estimate: &NavEstimate, sigmas: &Sigmas) -> Result<(), LogError> {
    let groups: [(&'static str, &[f64]); 9] = [
        ("position (e,n,u)", &estimate.position_enu),
        ("quaternion (qw,qx,qy,qz)", &estimate.q_enu_body),
        ("velocity (ve,vn,vu)", &estimate.velocity_enu),
        ("accelerometer bias (bax,bay,baz)", &estimate.accel_bias),
        ("gyroscope bias (bgx,bgy,bgz)", &estimate.gyro_bias),
        ("position sigma (se,sn,su)", &sigmas.position_enu),
        ("velocity sigma (sve,svn,svu)", &sigmas.velocity_enu),
        ("attitude sigma (sroll,spitch,syaw)", &sigmas.rpy_deg),
        ("latitude, longitude, height", &estimate.lat_lon_h),
    ];
    for (field, values) in groups {
        if let Some(&value) = values.iter().find(|value| !value.is_finite()) {
            return Err(LogError::EstimateNotFinite { t: Time(estimate.header.t_valid), field, value });
        }
    }
    Ok(())
}
