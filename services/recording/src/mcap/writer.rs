//! Writes one MCAP file, chunk by whole chunk.
//!
//! Each flush ends a chunk, so that a process killed in between loses what came since and no more: a chunk is put
//! together in memory and goes to the file in one piece (the crate's seeking writer would leave a chunk with a length
//! of zero behind, at which other readers stop).

use std::collections::BTreeMap;
use std::fs::File;
use std::io::BufWriter;
use std::path::{Path, PathBuf};

use ::mcap::records::{MessageHeader, Metadata};
use ::mcap::{Attachment, McapError, WriteOptions, Writer};
use nav_geometry::{Geodetic, LocalFrame};
use shared_types::{BuoyFix, Duration, GnssFix, Heartbeat, KeyframeReport, NavEstimate, RawReading, Time, Truth};

use super::thinning::EstimateThinning;
use super::topics::Topic;
use super::{messages, scene};
use crate::error::LogError;
use crate::rows::LogRow;

/// A chunk beyond this many bytes is ended before its flush is due.
const CHUNK: u64 = 256 * 1024;
/// Between two scenes.
const SCENE_PERIOD: Duration = Duration(1_000_000_000);
/// Version of topics and messages, raised when the meaning of one changes.
pub(crate) const FORMAT: u32 = 1;
/// How an estimate becomes the text of a message.
type Write = fn(&mut Vec<u8>, &NavEstimate);
/// Name of the record that says it.
pub(crate) const FORMAT_RECORD: &str = "ilns";
/// The configuration's name among the attachments.
pub(crate) const CONFIG: &str = "sensors.toml";

/// What a recording says of itself.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct RecorderStatus {
    /// Messages that found the queue before this file full.
    pub dropped: u64,
    /// Messages that did not reach the recorder.
    pub lost: u64,
}

/// A file under construction.
pub struct McapWriter {
    writer: Writer<BufWriter<File>>,
    path: PathBuf,
    sequences: [u32; Topic::ALL.len()],
    frame: Option<LocalFrame>,
    origin: Option<[f64; 3]>,
    buoys: BTreeMap<u32, BuoyFix>,
    t_newest: i64,
    thinning: EstimateThinning,
    t_scene: Option<Time>,
    bytes: u64,
    text: Vec<u8>,
    scratch: Vec<u8>,
}

impl std::fmt::Debug for McapWriter {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("McapWriter").field("path", &self.path).field("bytes", &self.bytes).finish_non_exhaustive()
    }
}

impl McapWriter {
    /// Makes `path`, which must not exist, with all schemas and channels, and `config` (the text of `sensors.toml`) as an attachment.
    ///
    /// # Errors
    /// The file exists, or the operating system refused.
    pub fn create(path: impl AsRef<Path>, config: &str) -> Result<McapWriter, LogError> {
        let path = path.as_ref().to_owned();
        let file = File::create_new(&path).map_err(LogError::io(&path, "create"))?;
        let writer = begin(file, config).map_err(|error| fault(&path, error))?;
        Ok(McapWriter {
            writer,
            path,
            sequences: [0; Topic::ALL.len()],
            frame: None,
            origin: None,
            buoys: BTreeMap::new(),
            t_newest: 0,
            thinning: EstimateThinning::default(),
            t_scene: None,
            bytes: 0,
            text: Vec::new(),
            scratch: Vec::new(),
        })
    }

    /// The file.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// Bytes of messages so far.
    pub fn bytes(&self) -> u64 {
        self.bytes
    }

    /// Data time of the newest reading or estimate.
    pub fn t_newest(&self) -> Time {
        Time(self.t_newest)
    }

    /// Goes on in another file, which must not exist: what holds for the whole run (origin, moored buoys) is written again.
    ///
    /// # Errors
    /// As [`McapWriter::create`] and [`McapWriter::finish`].
    pub fn go_on_in(&mut self, path: impl AsRef<Path>, config: &str) -> Result<(), LogError> {
        let mut next = McapWriter::create(path, config)?;
        next.t_newest = self.t_newest;
        // Views draw them; the readings themselves stand in the file before and are not repeated.
        next.buoys.clone_from(&self.buoys);
        if let Some(origin) = self.origin {
            next.origin(origin)?;
        }
        std::mem::replace(self, next).finish()
    }

    fn put(&mut self, topic: Topic, t_ns: i64) -> Result<(), LogError> {
        let index = topic.index();
        let log_time = t_ns.max(0) as u64;
        let sequence = self.sequences[index];
        self.sequences[index] = sequence.wrapping_add(1);
        let header = MessageHeader { channel_id: channel_id(index), sequence, log_time, publish_time: log_time };
        self.bytes += self.text.len() as u64;
        self.writer.write_to_known_channel(&header, &self.text).map_err(|error| fault(&self.path, error))
    }

    fn row<R: LogRow>(&mut self, topic: Topic, row: &R) -> Result<(), LogError> {
        self.text.clear();
        messages::row(&mut self.text, &mut self.scratch, row);
        let t = row.header().t_valid;
        self.t_newest = self.t_newest.max(t);
        self.put(topic, t)
    }

    /// Appends a reading.
    ///
    /// # Errors
    /// As those of every writing call: the operating system refused.
    pub fn reading(&mut self, reading: &RawReading) -> Result<(), LogError> {
        let topic = Topic::Sensor(reading.sensor());
        match reading {
            RawReading::Imu(sample) => self.row(topic, sample),
            RawReading::Lbl(range) => self.row(topic, range),
            RawReading::Dvl(velocity) => self.row(topic, velocity),
            RawReading::Mcp(heading) => self.row(topic, heading),
            RawReading::Ps(depth) => self.row(topic, depth),
            RawReading::Buoy(fix) => {
                self.buoys.insert(fix.buoy, *fix);
                self.row(topic, fix)
            }
            RawReading::Gnss(fix) => {
                self.row(topic, fix)?;
                self.gnss_location(fix)
            }
        }
    }

    fn gnss_location(&mut self, fix: &GnssFix) -> Result<(), LogError> {
        if !(fix.lat_deg.is_finite() && fix.lon_deg.is_finite()) {
            return Ok(());
        }
        self.text.clear();
        messages::gnss_location(&mut self.text, fix);
        self.put(Topic::GnssLocation, fix.header.t_valid)
    }

    /// Appends a row of the truth.
    ///
    /// # Errors
    /// As [`McapWriter::reading`].
    pub fn truth(&mut self, truth: &Truth) -> Result<(), LogError> {
        self.row(Topic::Truth, truth)
    }

    /// The frame's origin: latitude, longitude in degrees, ellipsoidal height in m. Only the first counts; it never moves.
    ///
    /// # Errors
    /// As [`McapWriter::reading`].
    pub fn origin(&mut self, origin: [f64; 3]) -> Result<(), LogError> {
        if self.frame.is_some() {
            return Ok(());
        }
        let [lat_deg, lon_deg, height] = origin;
        self.frame = Some(LocalFrame::new(Geodetic::from_degrees(lat_deg, lon_deg, height)));
        self.origin = Some(origin);
        self.text.clear();
        messages::frame_origin(&mut self.text, origin);
        self.put(Topic::FrameOrigin, self.t_newest)
    }

    /// Takes an estimate, and writes it if [`EstimateThinning`] says so.
    ///
    /// # Errors
    /// As [`McapWriter::reading`].
    pub fn estimate(&mut self, estimate: &NavEstimate) -> Result<(), LogError> {
        let t = Time(estimate.header.t_valid);
        if !self.thinning.wants(estimate) {
            return Ok(());
        }
        self.t_newest = self.t_newest.max(t.0);
        let writes: [(Topic, Write); 4] = [
            (Topic::Estimate, messages::estimate),
            (Topic::Pose, messages::pose_in_frame),
            (Topic::Transform, messages::transforms),
            (Topic::Location, messages::location),
        ];
        for (topic, write) in writes {
            self.text.clear();
            write(&mut self.text, estimate);
            self.put(topic, t.0)?;
        }
        let is_scene_due = self.t_scene.is_none_or(|last| t < last || t - last >= SCENE_PERIOD);
        if let Some(frame) = self.frame.as_ref().filter(|_| is_scene_due) {
            self.t_scene = Some(t);
            self.text.clear();
            scene::update(&mut self.text, estimate, frame, &self.buoys);
            self.put(Topic::Scene, t.0)?;
        }
        Ok(())
    }

    /// Appends what a keyframe held.
    ///
    /// # Errors
    /// As [`McapWriter::reading`].
    pub fn report(&mut self, report: &KeyframeReport) -> Result<(), LogError> {
        self.text.clear();
        messages::keyframe_report(&mut self.text, report);
        self.put(Topic::Diagnostics, report.t_keyframe)
    }

    /// Appends what a process says of itself, at the data time of the newest reading: a process may know no other.
    ///
    /// # Errors
    /// As [`McapWriter::reading`].
    pub fn heartbeat(&mut self, beat: &Heartbeat) -> Result<(), LogError> {
        self.text.clear();
        messages::heartbeat(&mut self.text, beat);
        self.put(Topic::Health, self.t_newest)
    }

    /// Says what is missing and hands everything so far to the operating system, as whole chunks.
    ///
    /// # Errors
    /// As [`McapWriter::reading`].
    pub fn flush(&mut self, status: RecorderStatus) -> Result<(), LogError> {
        self.text.clear();
        super::json::Object::write(&mut self.text, |object| {
            object.whole("dropped", status.dropped);
            object.whole("lost", status.lost);
        });
        self.put(Topic::Recorder, self.t_newest)?;
        self.writer.flush().map_err(|error| fault(&self.path, error))
    }

    /// Writes summary and indexes and closes the file. Without it the file wants [`crate::mcap::recover`].
    ///
    /// # Errors
    /// As [`McapWriter::reading`].
    pub fn finish(mut self) -> Result<(), LogError> {
        self.writer.finish().map(drop).map_err(|error| fault(&self.path, error))
    }
}

/// Channel 0 is allowed, and other readers have stumbled over it.
fn channel_id(index: usize) -> u16 {
    1 + index as u16
}

pub(crate) fn options() -> WriteOptions {
    WriteOptions::new()
        .compression(None)
        .chunk_size(Some(CHUNK))
        .disable_seeking(true)
        .library(concat!("ilns ", env!("CARGO_PKG_VERSION")))
}

fn begin(file: File, config: &str) -> Result<Writer<BufWriter<File>>, McapError> {
    let mut writer = options().create(BufWriter::new(file))?;
    let format = BTreeMap::from([("format".to_owned(), FORMAT.to_string())]);
    writer.write_metadata(&Metadata { name: FORMAT_RECORD.to_owned(), metadata: format })?;
    writer.attach(&Attachment {
        log_time: 0,
        create_time: 0,
        name: CONFIG.to_owned(),
        media_type: "application/toml".to_owned(),
        data: config.as_bytes().into(),
    })?;
    for (index, topic) in Topic::ALL.into_iter().enumerate() {
        let (name, schema) = topic.schema();
        let schema = writer.add_schema(name, "jsonschema", schema.as_bytes())?;
        writer.add_channel_with_id(channel_id(index), schema, topic.name(), "json", &BTreeMap::new())?;
    }
    writer.flush()?;
    Ok(writer)
}

/// The crate's errors while writing are the operating system's.
pub(crate) fn fault(path: &Path, error: McapError) -> LogError {
    let source = match error {
        McapError::Io(source) => source,
        other => std::io::Error::other(other),
    };
    LogError::io(path, "write")(source)
}
