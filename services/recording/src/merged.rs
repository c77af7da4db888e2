//! All sensors of a log in the one order in which a navigator takes them.
//!
//! A recording is merged by `t_arrival`, any other log by `t`; ties in the order imu, buoys, gnss, dvl, mcp, ps, lbl. The order
//! depends on the files alone, so that two replays see the same sequence.

use shared_types::RawReading;

use crate::directory::LogDirectory;
use crate::error::LogError;

type Readings = Box<dyn Iterator<Item = Result<RawReading, LogError>> + Send>;

/// One file and its next reading.
struct Source {
    readings: Readings,
    head: Option<Result<RawReading, LogError>>,
}

impl Source {
    fn new(readings: impl Iterator<Item = Result<RawReading, LogError>> + Send + 'static) -> Source {
        let mut readings: Readings = Box::new(readings);
        let head = readings.next();
        Source { readings, head }
    }
}

/// Readings of all sensors, merged. Ends after the first error.
pub struct MergedLog {
    /// In the order of ties.
    sources: [Source; 7],
    is_recording: bool,
    failed: bool,
}

impl std::fmt::Debug for MergedLog {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("MergedLog").field("is_recording", &self.is_recording).finish_non_exhaustive()
    }
}

impl MergedLog {
    pub(crate) fn open(log: &LogDirectory) -> Result<MergedLog, LogError> {
        let sources = [
            Source::new(log.imu()?.map(|reading| reading.map(RawReading::Imu))),
            Source::new(log.buoys()?.map(|reading| reading.map(RawReading::Buoy))),
            Source::new(log.gnss()?.map(|reading| reading.map(RawReading::Gnss))),
            Source::new(log.dvl()?.map(|reading| reading.map(RawReading::Dvl))),
            Source::new(log.mcp()?.map(|reading| reading.map(RawReading::Mcp))),
            Source::new(log.ps()?.map(|reading| reading.map(RawReading::Ps))),
            Source::new(log.lbl()?.map(|reading| reading.map(RawReading::Lbl))),
        ];
        Ok(MergedLog { sources, is_recording: log.is_recording(), failed: false })
    }

    /// Whether it is merged by arrival.
    pub fn is_recording(&self) -> bool {
        self.is_recording
    }

    /// When the source's head is due; a bad row is due at once. `None`: the file has ended.
    fn due(&self, source: &Source) -> Option<i64> {
        match source.head.as_ref()? {
            Ok(reading) if self.is_recording => Some(reading.header().t_arrival),
            Ok(reading) => Some(reading.header().t_valid),
            Err(_) => Some(i64::MIN),
        }
    }
}

impl Iterator for MergedLog {
    type Item = Result<RawReading, LogError>;

    fn next(&mut self) -> Option<Self::Item> {
        if self.failed {
            return None;
        }
        let due = self.sources.iter().enumerate().filter_map(|(rank, source)| Some((self.due(source)?, rank))).min();
        let (_, rank) = due?;
        let source = &mut self.sources[rank];
        let next = source.head.take();
        self.failed = matches!(next, Some(Err(_)));
        source.head = source.readings.next();
        next
    }
}
