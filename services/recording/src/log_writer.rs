//! Writes a log directory: what a recording is and what a simulation leaves.
//!
//! Numbers in the shortest form that gives the same bits back, times to the nanosecond. A file appears with its first
//! row, under its own name: a recording that breaks off is still a recording.

use std::fs;
use std::path::{Path, PathBuf};

use shared_types::{
    BuoyFix, DvlVelocity, GnssFix, ImuSample, LblRange, McpHeading, PsDepth, RawReading, Sensor, Truth,
};

use crate::error::LogError;
use crate::rows::{LogRow, push_row};
use crate::text_file::TextFile;

/// Files of a log, in the order of [`shared_types::SENSORS`], then the truth.
const FILES: [&str; 8] = [
    ImuSample::FILE,
    LblRange::FILE,
    GnssFix::FILE,
    DvlVelocity::FILE,
    McpHeading::FILE,
    PsDepth::FILE,
    BuoyFix::FILE,
    Truth::FILE,
];
const TRUTH: usize = 7;
const CONFIG_FILE: &str = "sensors.toml";

/// What is written, and over what.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct LogWriterOptions {
    /// Adds `t_arrival`, `sequence` and what else a replay needs to take place as it was live.
    pub arrival_columns: bool,
    /// A log that the folder already holds is deleted first; otherwise it is an error.
    pub replace: bool,
}

fn log_files(dir: &Path) -> impl Iterator<Item = PathBuf> {
    FILES.into_iter().chain([CONFIG_FILE]).map(|name| dir.join(name))
}

/// Rows of two logs in one folder would be read as one log.
pub(crate) fn refuse_existing_log(dir: &Path) -> Result<(), LogError> {
    match log_files(dir).find(|file| file.exists()) {
        Some(file) => Err(LogError::LogExists { file }),
        None => Ok(()),
    }
}

/// A log directory under construction. Rows of one sensor are written in the order of the calls.
#[derive(Debug)]
pub struct LogWriter {
    dir: PathBuf,
    options: LogWriterOptions,
    files: [Option<TextFile>; 8],
}

impl LogWriter {
    /// Makes the folder (and its parents) where there is none.
    ///
    /// # Errors
    /// [`LogError::LogExists`] if it holds a log and may not be replaced: rows of two logs in one folder would be
    /// read as one log. [`LogError::Io`] if it cannot be made.
    pub fn create(dir: impl AsRef<Path>, options: LogWriterOptions) -> Result<LogWriter, LogError> {
        let dir = dir.as_ref();
        fs::create_dir_all(dir).map_err(LogError::io(dir, "create the directory"))?;
        if options.replace {
            for file in log_files(dir).filter(|file| file.exists()) {
                fs::remove_file(&file).map_err(LogError::io(&file, "delete"))?;
            }
        }
        refuse_existing_log(dir)?;
        Ok(LogWriter { dir: dir.to_owned(), options, files: Default::default() })
    }

    /// The folder.
    pub fn path(&self) -> &Path {
        &self.dir
    }

    fn put<R: LogRow>(&mut self, slot: usize, row: &R) -> Result<(), LogError> {
        let file = match &mut self.files[slot] {
            Some(file) => file,
            empty => {
                let mut file = TextFile::create(&self.dir.join(R::FILE))?;
                let mut header = R::COLUMNS.to_vec();
                if self.options.arrival_columns {
                    header.extend(R::RECORDED);
                }
                file.text().extend_from_slice(header.join(",").as_bytes());
                file.text().push(b'\n');
                empty.insert(file)
            }
        };
        push_row(file.text(), row, self.options.arrival_columns);
        file.row_done()
    }

    /// Appends an IMU sample.
    ///
    /// # Errors
    /// As those of every writing call: the operating system refused.
    pub fn imu(&mut self, sample: &ImuSample) -> Result<(), LogError> {
        self.put(Sensor::Imu.index(), sample)
    }

    /// Appends a range.
    ///
    /// # Errors
    /// As [`LogWriter::imu`].
    pub fn lbl(&mut self, range: &LblRange) -> Result<(), LogError> {
        self.put(Sensor::Lbl.index(), range)
    }

    /// Appends a buoy's position.
    ///
    /// # Errors
    /// As [`LogWriter::imu`].
    pub fn buoy(&mut self, fix: &BuoyFix) -> Result<(), LogError> {
        self.put(Sensor::Buoys.index(), fix)
    }

    /// Appends a satellite fix.
    ///
    /// # Errors
    /// As [`LogWriter::imu`].
    pub fn gnss(&mut self, fix: &GnssFix) -> Result<(), LogError> {
        self.put(Sensor::Gnss.index(), fix)
    }

    /// Appends a Doppler velocity.
    ///
    /// # Errors
    /// As [`LogWriter::imu`].
    pub fn dvl(&mut self, velocity: &DvlVelocity) -> Result<(), LogError> {
        self.put(Sensor::Dvl.index(), velocity)
    }

    /// Appends a heading.
    ///
    /// # Errors
    /// As [`LogWriter::imu`].
    pub fn mcp(&mut self, heading: &McpHeading) -> Result<(), LogError> {
        self.put(Sensor::Mcp.index(), heading)
    }

    /// Appends a depth.
    ///
    /// # Errors
    /// As [`LogWriter::imu`].
    pub fn ps(&mut self, depth: &PsDepth) -> Result<(), LogError> {
        self.put(Sensor::Ps.index(), depth)
    }

    /// Appends a reading to its sensor's file.
    ///
    /// # Errors
    /// As [`LogWriter::imu`].
    pub fn reading(&mut self, reading: &RawReading) -> Result<(), LogError> {
        match reading {
            RawReading::Imu(sample) => self.imu(sample),
            RawReading::Buoy(fix) => self.buoy(fix),
            RawReading::Gnss(fix) => self.gnss(fix),
            RawReading::Dvl(velocity) => self.dvl(velocity),
            RawReading::Mcp(heading) => self.mcp(heading),
            RawReading::Ps(depth) => self.ps(depth),
            RawReading::Lbl(range) => self.lbl(range),
        }
    }

    /// Appends a row of the truth.
    ///
    /// # Errors
    /// As [`LogWriter::imu`].
    pub fn truth(&mut self, truth: &Truth) -> Result<(), LogError> {
        self.put(TRUTH, truth)
    }

    /// Writes `sensors.toml`.
    ///
    /// # Errors
    /// As [`LogWriter::imu`].
    pub fn sensors_toml(&mut self, text: &str) -> Result<(), LogError> {
        let file = self.dir.join(CONFIG_FILE);
        fs::write(&file, text).map_err(LogError::io(&file, "write"))
    }

    /// Hands all rows so far to the operating system.
    ///
    /// # Errors
    /// As [`LogWriter::imu`].
    pub fn flush(&mut self) -> Result<(), LogError> {
        self.files.iter_mut().flatten().try_for_each(TextFile::flush)
    }

    /// Flushes and closes. Without it the last rows are lost.
    ///
    /// # Errors
    /// As [`LogWriter::imu`].
    pub fn finish(mut self) -> Result<(), LogError> {
        self.flush()
    }
}
