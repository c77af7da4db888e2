//! Makes a torn file whole: everything that can be read, with summary and indexes, in another file.

use std::collections::{BTreeMap, BTreeSet};
use std::fs::{self, File};
use std::io::BufWriter;
use std::path::Path;

use ::mcap::{Attachment, McapError};

use super::reader::{Ending, Item, read};
use super::writer::{fault, options};
use crate::error::LogError;

/// What was found and written.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Recovered {
    /// Messages.
    pub messages: u64,
    /// How the torn file ends.
    pub ending: Ending,
}

/// Copies what is whole in `from` to `to`, which must not exist. Any uncompressed MCAP will do, also one of another program.
///
/// # Errors
/// `from` is no MCAP, `to` exists, the operating system refused; nothing is left at `to` then.
pub fn recover(from: impl AsRef<Path>, to: impl AsRef<Path>) -> Result<Recovered, LogError> {
    let (from, to) = (from.as_ref(), to.as_ref());
    // First a look: a file that is no MCAP leaves nothing behind.
    read(from, &mut |_| Ok(()))?;
    let file = File::create_new(to).map_err(LogError::io(to, "create"))?;
    let recovered = copy(from, to, file);
    if recovered.is_err() {
        // What stands there is no recording; that it cannot be deleted would not help anybody to know.
        let _ = fs::remove_file(to);
    }
    recovered
}

fn copy(from: &Path, to: &Path, file: File) -> Result<Recovered, LogError> {
    let mut writer = options().create(BufWriter::new(file)).map_err(|error| fault(to, error))?;
    let mut schemas = BTreeMap::<u16, u16>::new();
    let mut channels = BTreeSet::<u16>::new();
    let (mut messages, mut without_channel) = (0, 0);
    let mut ending = read(from, &mut |item| {
        let written: Result<(), McapError> = match item {
            Item::Library(_) => Ok(()),
            Item::Schema(header, data) if header.id != 0 => {
                writer.add_schema(&header.name, &header.encoding, data).map(|id| {
                    schemas.insert(header.id, id);
                })
            }
            Item::Schema(..) => Ok(()),
            Item::Channel(channel) => {
                let schema = schemas.get(&channel.schema_id).copied().unwrap_or(0);
                let known = channels.contains(&channel.id);
                match writer.add_channel_with_id(
                    channel.id,
                    schema,
                    &channel.topic,
                    &channel.message_encoding,
                    &channel.metadata,
                ) {
                    // Two channels of one number: the first has messages already.
                    Err(McapError::ConflictingChannels(_)) if known => Ok(()),
                    added => added.map(|id| {
                        channels.insert(id);
                    }),
                }
            }
            Item::Message(header, data) if channels.contains(&header.channel_id) => {
                messages += 1;
                writer.write_to_known_channel(&header, data)
            }
            Item::Message(..) => {
                without_channel += 1;
                Ok(())
            }
            Item::Attachment(header, data) => writer.attach(&Attachment {
                log_time: header.log_time,
                create_time: header.create_time,
                name: header.name,
                media_type: header.media_type,
                data: data.into(),
            }),
            Item::Metadata(metadata) => writer.write_metadata(&metadata),
        };
        written.map_err(|error| fault(to, error))
    })?;
    ending.damaged_records += without_channel;
    writer.finish().map_err(|error| fault(to, error))?;
    Ok(Recovered { messages, ending })
}
