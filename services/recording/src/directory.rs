//! The sensor-log directory: one folder, one CSV file per sensor, `sensors.toml`.

use std::collections::BTreeSet;
use std::fs;
use std::path::{Path, PathBuf};

use shared_types::{
    BuoyFix, ConfigText, DvlVelocity, GnssFix, ImuSample, LblRange, McpHeading, PsDepth, Sensor, Truth,
};

use crate::error::LogError;
use crate::merged::MergedLog;
use crate::reader::{BuoyReader, LblReader, LogReader, Order};
use crate::rows::LogRow;

const CONFIG_FILE: &str = "sensors.toml";

/// A folder that was found to be a log: its IMU file has rows, and the header of every file is in order.
#[derive(Clone, Debug)]
pub struct LogDirectory {
    dir: PathBuf,
    config: Option<ConfigText>,
    /// In the order of [`shared_types::SENSORS`].
    fitted: [bool; 7],
    order: Order,
}

impl LogDirectory {
    /// Opens `dir`, reads `sensors.toml` as text and every file's header; rows are read by the readers.
    ///
    /// # Errors
    /// A missing folder, a log without IMU or of zero length, an empty file, a header without a required column.
    pub fn open(dir: impl AsRef<Path>) -> Result<LogDirectory, LogError> {
        let dir = dir.as_ref();
        if !dir.exists() {
            return Err(LogError::MissingDirectory { dir: dir.to_owned() });
        }
        if !dir.is_dir() {
            return Err(LogError::NotADirectory { dir: dir.to_owned() });
        }
        let mut headers = Headers::default();
        headers.check::<ImuSample>(dir, Sensor::Imu)?;
        if !headers.fitted[Sensor::Imu.index()] {
            return Err(LogError::NoImu { dir: dir.to_owned(), expected: ImuSample::COLUMNS.join(",") });
        }
        headers.check::<LblRange>(dir, Sensor::Lbl)?;
        headers.check::<GnssFix>(dir, Sensor::Gnss)?;
        headers.check::<DvlVelocity>(dir, Sensor::Dvl)?;
        headers.check::<McpHeading>(dir, Sensor::Mcp)?;
        headers.check::<PsDepth>(dir, Sensor::Ps)?;
        headers.check::<BuoyFix>(dir, Sensor::Buoys)?;
        LogReader::<Truth>::open(dir, Order::Valid)?;

        let order = if headers.without_arrival == 0 { Order::Arrival } else { Order::Valid };
        let log = LogDirectory { dir: dir.to_owned(), config: read_config(dir)?, fitted: headers.fitted, order };
        match log.imu()?.next() {
            None => Err(LogError::NoRows { file: dir.join(ImuSample::FILE) }),
            Some(Err(error)) => Err(error),
            Some(Ok(_)) => Ok(log),
        }
    }

    /// The folder.
    pub fn path(&self) -> &Path {
        &self.dir
    }

    /// `sensors.toml`, unparsed, if there is one.
    pub fn config(&self) -> Option<&ConfigText> {
        self.config.as_ref()
    }

    /// Whether the sensor has a file.
    pub fn has(&self, sensor: Sensor) -> bool {
        self.fitted[sensor.index()]
    }

    /// Whether there is a `truth.csv`.
    pub fn has_truth(&self) -> bool {
        self.dir.join(Truth::FILE).exists()
    }

    /// Whether the service recorded it: every sensor file says when its rows arrived. Such a log is merged by
    /// `t_arrival`, and its buoys are where their fixes so far say.
    pub fn is_recording(&self) -> bool {
        self.order == Order::Arrival
    }

    /// IMU samples.
    ///
    /// # Errors
    /// As those of every reader: the file cannot be opened any more, or its header has changed for the worse.
    pub fn imu(&self) -> Result<LogReader<ImuSample>, LogError> {
        LogReader::open(&self.dir, self.order)
    }

    /// Slant ranges, each with the size of its epoch.
    ///
    /// # Errors
    /// As [`LogDirectory::imu`].
    pub fn lbl(&self) -> Result<LblReader, LogError> {
        Ok(LblReader::new(LogReader::open(&self.dir, self.order)?))
    }

    /// Positions of buoys; a buoy of one row is moored.
    ///
    /// # Errors
    /// As [`LogDirectory::imu`].
    pub fn buoys(&self) -> Result<BuoyReader, LogError> {
        BuoyReader::open(&self.dir, self.order)
    }

    /// Satellite fixes.
    ///
    /// # Errors
    /// As [`LogDirectory::imu`].
    pub fn gnss(&self) -> Result<LogReader<GnssFix>, LogError> {
        LogReader::open(&self.dir, self.order)
    }

    /// Doppler velocities.
    ///
    /// # Errors
    /// As [`LogDirectory::imu`].
    pub fn dvl(&self) -> Result<LogReader<DvlVelocity>, LogError> {
        LogReader::open(&self.dir, self.order)
    }

    /// Headings.
    ///
    /// # Errors
    /// As [`LogDirectory::imu`].
    pub fn mcp(&self) -> Result<LogReader<McpHeading>, LogError> {
        LogReader::open(&self.dir, self.order)
    }

    /// Depths.
    ///
    /// # Errors
    /// As [`LogDirectory::imu`].
    pub fn ps(&self) -> Result<LogReader<PsDepth>, LogError> {
        LogReader::open(&self.dir, self.order)
    }

    /// The truth, for scoring only.
    ///
    /// # Errors
    /// As [`LogDirectory::imu`].
    pub fn truth(&self) -> Result<LogReader<Truth>, LogError> {
        LogReader::open(&self.dir, Order::Valid)
    }

    /// All readings of all sensors in the order in which a navigator takes them.
    ///
    /// # Errors
    /// As [`LogDirectory::imu`].
    pub fn merged(&self) -> Result<MergedLog, LogError> {
        MergedLog::open(self)
    }

    /// Every position of every buoy, for interpolation between rows that are still to come.
    ///
    /// # Errors
    /// The first bad row.
    pub fn buoy_fixes(&self) -> Result<Vec<BuoyFix>, LogError> {
        self.buoys()?.collect()
    }

    /// Reads `lbl.csv` and `buoys.csv` through and refuses ranges to a buoy whose position stands nowhere.
    ///
    /// Not for recordings: there a fix may have been lost, and the preprocessor counts ranges without one.
    ///
    /// # Errors
    /// [`LogError::BuoyWithoutPosition`] with the first such range, or the first bad row.
    pub fn check_buoys(&self) -> Result<(), LogError> {
        let mut known = BTreeSet::new();
        for fix in self.buoys()? {
            let fix = fix?;
            if fix.lat_deg.is_finite() && fix.lon_deg.is_finite() && fix.height.is_finite() {
                known.insert(fix.buoy);
            }
        }
        let mut ranges: LogReader<LblRange> = LogReader::open(&self.dir, self.order)?;
        while let Some(range) = ranges.next_with_line() {
            let (line, range) = range?;
            if !known.contains(&range.buoy) {
                let (file, buoys) = (self.dir.join(LblRange::FILE), self.dir.join(BuoyFix::FILE));
                return Err(LogError::BuoyWithoutPosition { file, line, buoy: range.buoy, buoys });
            }
        }
        Ok(())
    }
}

/// What the headers say.
#[derive(Default)]
struct Headers {
    fitted: [bool; 7],
    without_arrival: usize,
}

impl Headers {
    fn check<R: LogRow>(&mut self, dir: &Path, sensor: Sensor) -> Result<(), LogError> {
        let reader = LogReader::<R>::open(dir, Order::Valid)?;
        self.fitted[sensor.index()] = reader.is_fitted();
        self.without_arrival += usize::from(reader.is_fitted() && !reader.has_arrival());
        Ok(())
    }
}

fn read_config(dir: &Path) -> Result<Option<ConfigText>, LogError> {
    let file = dir.join(CONFIG_FILE);
    if !file.exists() {
        return Ok(None);
    }
    let text = fs::read_to_string(&file).map_err(LogError::io(&file, "read"))?;
    Ok(Some(ConfigText { file, text }))
}
