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
use shared_types::{Heartbeat, KeyframeReport, NavEstimate, RawReading, Time, Truth};

use super::composer::{Composer, MessageSink};
use super::topics::Topic;
use crate::error::LogError;

/// A chunk beyond this many bytes is ended before its flush is due.
const CHUNK: u64 = 256 * 1024;
/// Version of topics and messages, raised when the meaning of one changes.
pub(crate) const FORMAT: u32 = 1;
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
#[derive(Debug)]
pub struct McapWriter {
    composer: Composer,
    file: ChunkedFile,
}

/// The chunks of the file.
struct ChunkedFile {
    writer: Writer<BufWriter<File>>,
    path: PathBuf,
    sequences: [u32; Topic::ALL.len()],
    bytes: u64,
}

impl std::fmt::Debug for ChunkedFile {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("ChunkedFile").field("path", &self.path).field("bytes", &self.bytes).finish_non_exhaustive()
    }
}

impl MessageSink for ChunkedFile {
    fn put(&mut self, channel: usize, t_ns: i64, text: &[u8]) -> Result<(), LogError> {
        let log_time = t_ns.max(0) as u64;
        let sequence = self.sequences[channel];
        self.sequences[channel] = sequence.wrapping_add(1);
        let header = MessageHeader { channel_id: channel_id(channel), sequence, log_time, publish_time: log_time };
        self.bytes += text.len() as u64;
        self.writer.write_to_known_channel(&header, text).map_err(|error| fault(&self.path, error))
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
        let file = ChunkedFile { writer, path, sequences: [0; Topic::ALL.len()], bytes: 0 };
        Ok(McapWriter { composer: Composer::new(), file })
    }

    /// The file.
    pub fn path(&self) -> &Path {
        &self.file.path
    }

    /// Bytes of messages so far.
    pub fn bytes(&self) -> u64 {
        self.file.bytes
    }

    /// Data time of the newest reading or estimate.
    pub fn t_newest(&self) -> Time {
        self.composer.t_newest()
    }

    /// Goes on in another file, which must not exist: what holds for the whole run (origin, moored buoys) is written again;
    /// the readings of buoys stand in the file before and are not repeated.
    ///
    /// # Errors
    /// As [`McapWriter::create`] and [`McapWriter::finish`].
    pub fn go_on_in(&mut self, path: impl AsRef<Path>, config: &str) -> Result<(), LogError> {
        let mut next = McapWriter::create(path, config)?;
        next.composer = self.composer.go_on(&mut next.file)?;
        std::mem::replace(self, next).finish()
    }

    /// Appends a reading.
    ///
    /// # Errors
    /// As those of every writing call: the operating system refused.
    pub fn reading(&mut self, reading: &RawReading) -> Result<(), LogError> {
        self.composer.reading(reading, &mut self.file)
    }

    /// Appends a row of the truth.
    ///
    /// # Errors
    /// As [`McapWriter::reading`].
    pub fn truth(&mut self, truth: &Truth) -> Result<(), LogError> {
        self.composer.truth(truth, &mut self.file)
    }

    /// The frame's origin: latitude, longitude in degrees, ellipsoidal height in m. Only the first counts; it never moves.
    ///
    /// # Errors
    /// As [`McapWriter::reading`].
    pub fn origin(&mut self, origin: [f64; 3]) -> Result<(), LogError> {
        self.composer.origin(origin, &mut self.file)
    }

    /// Takes an estimate, and writes it if [`super::EstimateThinning`] says so.
    ///
    /// # Errors
    /// As [`McapWriter::reading`].
    pub fn estimate(&mut self, estimate: &NavEstimate) -> Result<(), LogError> {
        self.composer.estimate(estimate, &mut self.file)
    }

    /// Appends what a keyframe held.
    ///
    /// # Errors
    /// As [`McapWriter::reading`].
    pub fn report(&mut self, report: &KeyframeReport) -> Result<(), LogError> {
        self.composer.report(report, &mut self.file)
    }

    /// Appends what a process says of itself, at the data time of the newest reading: a process may know no other.
    ///
    /// # Errors
    /// As [`McapWriter::reading`].
    pub fn heartbeat(&mut self, beat: &Heartbeat) -> Result<(), LogError> {
        self.composer.heartbeat(beat, &mut self.file)
    }

    /// Says what is missing and hands everything so far to the operating system, as whole chunks.
    ///
    /// # Errors
    /// As [`McapWriter::reading`].
    pub fn flush(&mut self, status: RecorderStatus) -> Result<(), LogError> {
        let mut text = Vec::new();
        super::json::Object::write(&mut text, |object| {
            object.whole("dropped", status.dropped);
            object.whole("lost", status.lost);
        });
        self.file.put(Topic::Recorder.index(), self.composer.t_newest().0, &text)?;
        self.file.writer.flush().map_err(|error| fault(&self.file.path, error))
    }

    /// Writes summary and indexes and closes the file. Without it the file wants [`crate::mcap::recover`].
    ///
    /// # Errors
    /// As [`McapWriter::reading`].
    pub fn finish(mut self) -> Result<(), LogError> {
        self.file.writer.finish().map(drop).map_err(|error| fault(&self.file.path, error))
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
