//! Reads an MCAP from its beginning, record by record, as far as it is whole.
//!
//! Nothing of the file is trusted: lengths are checked against what is there and against a limit, chunks against their checksums.
//! A chunk that is damaged is passed over and counted; behind a record of wrong length nothing can be found any more.

use std::fs::File;
use std::io::{self, BufReader, Read};
use std::path::{Path, PathBuf};

use ::mcap::records::{AttachmentHeader, Channel, MessageHeader, Metadata, Record, SchemaHeader};
use ::mcap::{MAGIC, parse_record};

use crate::error::LogError;

/// No record of ours comes near it; a length beyond is a damaged one.
const RECORD_MAX: u64 = 256 * 1024 * 1024;
/// Operation codes of the format.
const OP_ATTACHMENT: u8 = 0x09;
const OP_MESSAGE_INDEX: u8 = 0x07;
const OP_CHUNK: u8 = 0x06;
const OP_DATA_END: u8 = 0x0f;
const OP_FOOTER: u8 = 0x02;

/// Why a file is no recording that can be read.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum McapFault {
    /// Something else.
    #[error("this is not an MCAP file: it does not begin with its magic bytes")]
    Foreign,
    /// Less than the magic bytes.
    #[error("the file ends within its first {0} bytes: nothing was recorded")]
    Empty(u64),
    /// An MCAP to come.
    #[error("this is an MCAP of major version {0:?}, and this program reads version '0'")]
    FutureMcap(char),
    /// A recording to come.
    #[error("a later version of this program recorded it (format {found}; this one reads up to {known})")]
    FutureFormat {
        /// As it says.
        found: String,
        /// As this program knows.
        known: u32,
    },
    /// Chunks that want a decompressor.
    #[error(
        "its chunks are compressed by {0:?}, which this program does not read (`mcap compress --compression none` rewrites it)"
    )]
    Compressed(String),
    /// An MCAP of another program.
    #[error("it holds no `/sensor/imu` of this program, and no log is without an IMU")]
    NoReadings,
    /// A reading that does not say what it must.
    #[error("message {number} of {topic} is not as this program writes it: {shown:?}")]
    Message {
        /// Which channel.
        topic: &'static str,
        /// From 1.
        number: u64,
        /// Its beginning.
        shown: String,
    },
}

impl McapFault {
    /// [`McapFault::Message`] of the message numbered so, from 1.
    pub(crate) fn message(topic: &'static str, number: u64, message: &[u8]) -> McapFault {
        /// Characters of it that are shown.
        const SHOWN: usize = 60;
        let shown = String::from_utf8_lossy(message).chars().take(SHOWN).collect();
        McapFault::Message { topic, number, shown }
    }
}

/// How a file ends.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Ending {
    /// Summary and closing magic bytes are there.
    pub is_finished: bool,
    /// Where reading had to stop, and why.
    pub broken: Option<(u64, &'static str)>,
    /// Chunks whose checksum or content is wrong.
    pub damaged_chunks: u64,
    /// Records that could not be read, and messages without a channel.
    pub damaged_records: u64,
    /// Size of the file.
    pub bytes: u64,
}

impl Ending {
    /// Whether nothing is missing.
    pub fn is_whole(&self) -> bool {
        self.is_finished && self.broken.is_none() && self.damaged_chunks + self.damaged_records == 0
    }
}

/// What stands in a file.
#[derive(Debug)]
pub(crate) enum Item<'a> {
    Library(String),
    Schema(SchemaHeader, &'a [u8]),
    Channel(Channel),
    Message(MessageHeader, &'a [u8]),
    Attachment(AttachmentHeader, &'a [u8]),
    Metadata(Metadata),
}

/// Shows every item of `path`, in its order, to `see`.
///
/// # Errors
/// It cannot be opened or read, it is no MCAP of today, or `see` refuses. Torn and damaged files are no error.
pub(crate) fn read(path: &Path, see: &mut impl FnMut(Item<'_>) -> Result<(), LogError>) -> Result<Ending, LogError> {
    let file = File::open(path).map_err(LogError::io(path, "open"))?;
    let bytes = file.metadata().map_err(LogError::io(path, "read"))?.len();
    let mut records =
        Records { path: path.to_owned(), source: BufReader::with_capacity(256 * 1024, file), offset: 0, bytes };
    records.magic()?;
    let mut ending = Ending { bytes, ..Ending::default() };
    let mut body = Vec::new();
    loop {
        let start = records.offset;
        match records.next(&mut body)? {
            Next::Torn(why) => {
                ending.broken = Some((start, why));
                return Ok(ending);
            }
            Next::Record(OP_FOOTER) => {
                ending.is_finished = records.is_closed()?;
                if !ending.is_finished {
                    ending.broken = Some((records.offset, "the closing magic bytes are missing"));
                }
                return Ok(ending);
            }
            Next::Record(OP_DATA_END) => {
                // What follows repeats what stood before.
                return records.skip_summary(&mut body, ending);
            }
            Next::Record(OP_CHUNK) => chunk(path, &body, &mut ending, see)?,
            Next::Record(OP_MESSAGE_INDEX) => {}
            Next::Record(op) => show(op, &body, &mut ending, see)?,
        }
    }
}

/// The next record, or why there is none.
enum Next {
    Record(u8),
    Torn(&'static str),
}

struct Records {
    path: PathBuf,
    source: BufReader<File>,
    offset: u64,
    bytes: u64,
}

impl Records {
    fn fault(&self, fault: McapFault) -> LogError {
        LogError::Mcap { file: self.path.clone(), fault }
    }

    fn read_exact(&mut self, buffer: &mut [u8]) -> Result<(), LogError> {
        self.source.read_exact(buffer).map_err(LogError::io(&self.path, "read"))?;
        self.offset += buffer.len() as u64;
        Ok(())
    }

    fn magic(&mut self) -> Result<(), LogError> {
        let mut start = [0; 8];
        let whole = usize::try_from(self.bytes).map_or(start.len(), |bytes| bytes.min(start.len()));
        self.read_exact(&mut start[..whole])?;
        // The byte in the middle is the major version.
        let same = |range: std::ops::Range<usize>| {
            let range = range.start.min(whole)..range.end.min(whole);
            start[range.clone()] == MAGIC[range]
        };
        match (same(0..5) && same(6..8), whole == start.len()) {
            (false, _) => Err(self.fault(McapFault::Foreign)),
            (true, false) => Err(self.fault(McapFault::Empty(self.bytes))),
            (true, true) if start[5] != MAGIC[5] => Err(self.fault(McapFault::FutureMcap(char::from(start[5])))),
            (true, true) => Ok(()),
        }
    }

    fn next(&mut self, body: &mut Vec<u8>) -> Result<Next, LogError> {
        let left = self.bytes.saturating_sub(self.offset);
        if left == 0 {
            return Ok(Next::Torn("it was not finished"));
        }
        if left < 9 {
            return Ok(Next::Torn("the file ends within a record"));
        }
        let mut head = [0; 9];
        self.read_exact(&mut head)?;
        let [op, length @ ..] = head;
        let length = u64::from_le_bytes(length);
        if length > left - 9 {
            return Ok(Next::Torn("the file ends within a record"));
        }
        if length > RECORD_MAX || op == 0 {
            return Ok(Next::Torn("what stands there is no record"));
        }
        body.resize(length as usize, 0);
        self.read_exact(body)?;
        Ok(Next::Record(op))
    }

    /// Whether the rest is the closing magic.
    fn is_closed(&mut self) -> Result<bool, LogError> {
        let mut end = Vec::new();
        let rest = self.source.by_ref().take(MAGIC.len() as u64 + 1).read_to_end(&mut end);
        rest.map_err(LogError::io(&self.path, "read"))?;
        Ok(end == MAGIC)
    }

    fn skip_summary(&mut self, body: &mut Vec<u8>, mut ending: Ending) -> Result<Ending, LogError> {
        loop {
            let start = self.offset;
            match self.next(body)? {
                Next::Torn(_) => {
                    ending.broken = Some((start, "the file ends within its summary"));
                    return Ok(ending);
                }
                Next::Record(OP_FOOTER) => {
                    ending.is_finished = self.is_closed()?;
                    if !ending.is_finished {
                        ending.broken = Some((self.offset, "the closing magic bytes are missing"));
                    }
                    return Ok(ending);
                }
                Next::Record(_) => {}
            }
        }
    }
}

/// Shows what stands in a chunk.
fn chunk(
    path: &Path,
    body: &[u8],
    ending: &mut Ending,
    see: &mut impl FnMut(Item<'_>) -> Result<(), LogError>,
) -> Result<(), LogError> {
    let Ok(Record::Chunk { header, data }) = parse_record(OP_CHUNK, body) else {
        ending.damaged_chunks += 1;
        return Ok(());
    };
    // A checksum of 0 means that there is none.
    let is_sound = |data: &[u8]| header.uncompressed_crc == 0 || crc32fast::hash(data) == header.uncompressed_crc;
    if !header.compression.is_empty() {
        let known = ["lz4", "zstd"].contains(&header.compression.as_str());
        if !known {
            ending.damaged_chunks += 1;
            return Ok(());
        }
        let fault = McapFault::Compressed(header.compression);
        return Err(LogError::Mcap { file: path.to_owned(), fault });
    }
    if !is_sound(&data) {
        ending.damaged_chunks += 1;
        return Ok(());
    }
    let mut rest = &data[..];
    while let Some((&op, behind)) = rest.split_first() {
        let split = behind.split_first_chunk::<8>().and_then(|(length, behind)| {
            let length = usize::try_from(u64::from_le_bytes(*length)).ok()?;
            behind.split_at_checked(length)
        });
        let Some((record, behind)) = split else {
            ending.damaged_chunks += 1;
            return Ok(());
        };
        show(op, record, ending, see)?;
        rest = behind;
    }
    Ok(())
}

fn show(
    op: u8,
    body: &[u8],
    ending: &mut Ending,
    see: &mut impl FnMut(Item<'_>) -> Result<(), LogError>,
) -> Result<(), LogError> {
    if op == OP_ATTACHMENT {
        return match attachment(body) {
            Ok((header, data)) => see(Item::Attachment(header, data)),
            Err(_) => {
                ending.damaged_records += 1;
                Ok(())
            }
        };
    }
    match parse_record(op, body) {
        Ok(Record::Header(header)) => see(Item::Library(header.library)),
        Ok(Record::Schema { header, data }) => see(Item::Schema(header, &data)),
        Ok(Record::Channel(channel)) => see(Item::Channel(channel)),
        Ok(Record::Message { header, data }) => see(Item::Message(header, &data)),
        Ok(Record::Metadata(metadata)) => see(Item::Metadata(metadata)),
        // Private records, and such as this version of the format does not know, are skipped as it asks.
        Ok(_) => Ok(()),
        Err(_) => {
            ending.damaged_records += 1;
            Ok(())
        }
    }
}

/// An attachment, by hand: the crate's parser slices past the end of one that is cut short.
fn attachment(body: &[u8]) -> io::Result<(AttachmentHeader, &[u8])> {
    let mut rest = body;
    let log_time = u64::from_le_bytes(take(&mut rest)?);
    let create_time = u64::from_le_bytes(take(&mut rest)?);
    let name = text(&mut rest)?;
    let media_type = text(&mut rest)?;
    let length = u64::from_le_bytes(take(&mut rest)?);
    let too_short = || io::Error::from(io::ErrorKind::UnexpectedEof);
    let length = usize::try_from(length).map_err(|_| too_short())?;
    let (data, mut rest) = rest.split_at_checked(length).ok_or_else(too_short)?;
    let crc = u32::from_le_bytes(take(&mut rest)?);
    if crc != 0 && crc != crc32fast::hash(&body[..body.len() - 4 - rest.len()]) {
        return Err(io::ErrorKind::InvalidData.into());
    }
    Ok((AttachmentHeader { log_time, create_time, name, media_type }, data))
}

fn take<const N: usize>(rest: &mut &[u8]) -> io::Result<[u8; N]> {
    let mut bytes = [0; N];
    rest.read_exact(&mut bytes)?;
    Ok(bytes)
}

fn text(rest: &mut &[u8]) -> io::Result<String> {
    let length = u32::from_le_bytes(take(rest)?) as usize;
    let (text, behind) = rest.split_at_checked(length).ok_or(io::ErrorKind::UnexpectedEof)?;
    *rest = behind;
    String::from_utf8(text.to_vec()).map_err(|_| io::ErrorKind::InvalidData.into())
}
